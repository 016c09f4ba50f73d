"""glTF 2.0 (.gltf, .glb): meshes placed by their nodes, base colours and their textures, a perspective camera.

Read here rather than by a library because colours must stay floats, cameras must follow their parents, offsets of
an untrusted file must be checked, and no file outside the scene's folder may be opened.
Source: Khronos, glTF 2.0, sections 3.5 (nodes), 3.6 (accessors), 3.9 (materials), 3.10 (cameras), 4 (GLB).
"""

from __future__ import annotations

import base64
import io
import json
import math
import struct
import warnings
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np

from ..camera import LARGEST_PICTURE, Camera
from .content import DEFAULT_ALBEDO, MOST_TRIANGLES, Content, Piece
from .texture import linear_texture

COMPONENT = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
WIDTH = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}
TRIANGLES, STRIP, FAN = 4, 5, 6
# Elements of an accessor that the file does not hold are zeros, and cost its writer nothing but their number.
MOST_IMPLIED = 1 << 20
# What a file may require and still be shown: all others of these only change the look of surfaces.
UNDERSTOOD = ("KHR_materials_", "KHR_mesh_quantization", "KHR_lights_punctual", "KHR_texture_", "EXT_texture_")


def read(content: Content, folder: Path, data: bytes, kind: str) -> None:
    """Fill `content` from the bytes of a file of `kind` "gltf" or "glb", which may name others in its folder."""
    _Reader(content, folder, *_chunks(data, kind)).run()


def _chunks(data: bytes, kind: str) -> tuple[dict[str, Any], bytes | None]:
    """The JSON and, of a .glb, the binary chunk (GLB: 12 bytes of header, then chunks of length, type, content)."""
    if kind == "gltf":
        return json.loads(data), None
    if len(data) < 20 or data[:4] != b"glTF":
        raise ValueError("not a GLB file: it does not begin with glTF")
    version, length = struct.unpack_from("<II", data, 4)
    if version != 2:
        raise ValueError(f"expected version 2 of glTF, got {version}")
    if length > len(data):
        raise ValueError(f"truncated: {length} bytes announced, {len(data)} found")
    chunks: dict[bytes, bytes] = {}
    at = 12
    while at + 8 <= length:
        size, name = struct.unpack_from("<I4s", data, at)
        if at + 8 + size > length:
            raise ValueError(f"truncated: a chunk of {size} bytes passes the end")
        chunks.setdefault(name, data[at + 8 : at + 8 + size])
        at += 8 + size
    return json.loads(chunks[b"JSON"]), chunks.get(b"BIN\0")


class _Reader:
    """One file, with what has been decoded of it so far."""

    def __init__(self, content: Content, folder: Path, tree: dict[str, Any], binary: bytes | None) -> None:
        self.content, self.folder, self.tree, self.binary = content, folder, tree, binary
        self.buffers: dict[int, bytes] = {}
        self.pictures: dict[int, np.ndarray | None] = {}
        self.materials: dict[int | None, int] = {}
        self.meshes: dict[int, list[Piece]] = {}

    def run(self) -> None:
        """Walk the nodes of the default scene, placing meshes and the first camera."""
        if int(str(self.tree.get("asset", {}).get("version", "2")).split(".")[0]) != 2:
            raise ValueError(f"expected version 2 of glTF, got {self.tree['asset']['version']}")
        for extension in self.tree.get("extensionsRequired", []):
            if not extension.startswith(UNDERSTOOD):
                raise ValueError(f"the file requires {extension}, which is not supported")
        nodes = self.tree.get("nodes", [])
        waiting = [(root, np.eye(4)) for root in reversed(self._roots())]
        visited: set[int] = set()
        while waiting:
            index, parent = waiting.pop()
            if index in visited:
                raise ValueError(f"node {index} has two parents or is its own ancestor")
            visited.add(index)
            node = _item(nodes, index, "node")
            world = parent @ _transform(node)
            if "mesh" in node:
                self._place(node["mesh"], world)
            if "camera" in node:
                self._see(node["camera"], world)
            waiting += [(child, world) for child in reversed(node.get("children", []))]

    def _roots(self) -> list[int]:
        """The nodes of the default scene; without scenes, all that are nobody's children."""
        if self.tree.get("scenes"):
            roots: list[int] = _item(self.tree["scenes"], self.tree.get("scene", 0), "scene").get("nodes", [])
            return roots
        nodes = self.tree.get("nodes", [])
        children = {child for node in nodes for child in node.get("children", [])}
        return [index for index in range(len(nodes)) if index not in children]

    def _place(self, mesh: int, world: np.ndarray) -> None:
        """Add an instance of a mesh; its accessors are decoded once."""
        if mesh not in self.meshes:
            primitives = _item(self.tree.get("meshes", []), mesh, "mesh").get("primitives", [])
            self.meshes[mesh] = [piece for piece in map(self._primitive, primitives) if piece is not None]
        for piece in self.meshes[mesh]:
            points = piece.vertices @ world[:3, :3].T + world[:3, 3]
            self.content.add_piece(Piece(points, piece.triangles, piece.uv, piece.material))

    def _primitive(self, primitive: dict[str, Any]) -> Piece | None:
        """The triangles of a primitive, in the mesh's own space."""
        mode, attributes = primitive.get("mode", TRIANGLES), primitive.get("attributes", {})
        if mode not in (TRIANGLES, STRIP, FAN) or "POSITION" not in attributes:
            self.content.leave_out("geometries without triangles", "points and lines are not shown")
            return None
        points = self._accessor(attributes["POSITION"], "VEC3").astype(np.float64)
        if "indices" in primitive:
            order = self._accessor(primitive["indices"], "SCALAR").reshape(-1).astype(np.int64)
        else:
            order = np.arange(len(points))
        material = self._material(primitive.get("material"))
        if "COLOR_0" in attributes:
            self.content.leave_out("meshes with vertex colours", "the colours of vertices are not shown")
        uv = None
        if self.content.textures[material] is not None:
            channel = f"TEXCOORD_{self._base_colour(primitive['material']).get('texCoord', 0)}"
            if channel in attributes:
                uv = self._accessor(attributes[channel], "VEC2").astype(np.float64)
                # glTF measures v downwards.
                uv[:, 1] = 1.0 - uv[:, 1]
                if len(uv) != len(points):
                    raise ValueError(f"{len(points)} vertices have {len(uv)} texture coordinates")
        triangles = _corners(order, mode)
        return Piece(points, triangles, uv, material) if len(triangles) else None

    def _material(self, index: int | None) -> int:
        """The material's place in the content, added when first met."""
        if index is None:
            self.content.counts["meshes without material"] += 1
        if index in self.materials:
            return self.materials[index]
        albedo: Any = DEFAULT_ALBEDO
        texture, name = None, ""
        emission: tuple[float, ...] = (0.0, 0.0, 0.0)
        if index is not None:
            stated = _item(self.tree.get("materials", []), index, "material")
            albedo = stated.get("pbrMetallicRoughness", {}).get("baseColorFactor", (1.0, 1.0, 1.0))
            texture = self._picture(self._base_colour(index))
            if stated.get("alphaMode", "OPAQUE") != "OPAQUE":
                self.content.leave_out("transparent materials", "shown opaque")
            emission, name = self._emission(stated), str(stated.get("name", ""))
        self.materials[index] = self.content.add_material(albedo, texture, emission, name)
        return self.materials[index]

    def _emission(self, stated: dict[str, Any]) -> tuple[float, ...]:
        """The radiance that a material gives off; of what a picture modulates, nothing."""
        factor = stated.get("emissiveFactor", (0.0, 0.0, 0.0))
        strength = stated.get("extensions", {}).get("KHR_materials_emissive_strength", {}).get("emissiveStrength", 1.0)
        if any(factor) and "emissiveTexture" in stated:
            self.content.leave_out("emissive textures", "what they give off is left out")
            return 0.0, 0.0, 0.0
        return tuple(float(value) * float(strength) for value in factor)

    def _base_colour(self, material: int) -> dict[str, Any]:
        """The reference to a material's base colour texture, empty where it has none."""
        stated = self.tree["materials"][material].get("pbrMetallicRoughness", {})
        reference: dict[str, Any] = stated.get("baseColorTexture", {})
        return reference

    def _picture(self, reference: dict[str, Any]) -> np.ndarray | None:
        """A texture's linear values; what cannot be read is counted, and the base colour alone is used."""
        if "index" not in reference:
            return None
        if "KHR_texture_transform" in reference.get("extensions", {}):
            self.content.leave_out("texture transforms", "textures are placed without them")
        source = _item(self.tree.get("textures", []), reference["index"], "texture").get("source")
        if source is None:
            self.content.leave_out("textures ignored", "their format is an extension")
            return None
        if source not in self.pictures:
            self.pictures[source] = self._decode(_item(self.tree.get("images", []), source, "image"))
        return self.pictures[source]

    def _decode(self, image: dict[str, Any]) -> np.ndarray | None:
        # A path that leaves the folder is an attack, not a missing picture.
        if "uri" in image and not image["uri"].startswith("data:"):
            self._path(image["uri"])
        from PIL import Image

        try:
            blob = self._view(image["bufferView"])[0] if "bufferView" in image else self._uri(image["uri"])
            with warnings.catch_warnings():
                warnings.simplefilter("error", Image.DecompressionBombWarning)
                return linear_texture(Image.open(io.BytesIO(blob)))
        except (OSError, ValueError, Image.DecompressionBombWarning, Image.DecompressionBombError) as error:
            self.content.leave_out("textures ignored", str(error))
            return None

    def _see(self, index: int, world: np.ndarray) -> None:
        """The first perspective camera; it looks along its own -z, and its aspect ratio gives the picture's height."""
        camera = _item(self.tree.get("cameras", []), index, "camera")
        if self.content.camera is not None or "perspective" not in camera:
            self.content.leave_out("cameras ignored", "the first perspective camera is used")
            return
        lens = camera["perspective"]
        aspect = float(lens.get("aspectRatio", 1.0))
        if not 0.0 < aspect < math.inf:
            raise ValueError(f"a camera's aspectRatio must be positive, got {aspect}")
        position, forward, up = world[:3, 3], -world[:3, 2], world[:3, 1]
        self.content.camera = Camera(
            tuple(position),
            tuple(position + forward),
            tuple(up),
            vertical_fov=math.degrees(lens["yfov"]),
            height=min(max(round(512 / aspect), 1), LARGEST_PICTURE),
        )

    def _accessor(self, index: int, shape: str) -> np.ndarray:
        """Decode an accessor, (count, components): strides, normalised integers and sparse corrections included."""
        accessor = _item(self.tree.get("accessors", []), index, "accessor")
        if accessor["type"] != shape:
            raise ValueError(f"accessor {index} must be {shape}, got {accessor['type']}")
        dtype, count = np.dtype(COMPONENT[accessor["componentType"]]), _natural(accessor["count"])
        if count > 3 * MOST_TRIANGLES:
            raise ValueError(f"accessor {index} has {count} elements, more than {3 * MOST_TRIANGLES}")
        if "bufferView" in accessor:
            values = self._elements(accessor["bufferView"], accessor.get("byteOffset", 0), dtype, count, WIDTH[shape])
        elif "sparse" in accessor:
            if count > MOST_IMPLIED:
                raise ValueError(f"accessor {index} has {count} elements without data, more than {MOST_IMPLIED}")
            values = np.zeros((count, WIDTH[shape]), dtype)
        else:
            raise ValueError(f"accessor {index} has no data")
        if "sparse" in accessor:
            values = self._corrected(values, accessor["sparse"])
        if accessor.get("normalized") and dtype.kind in "iu":
            values = np.maximum(values / np.iinfo(dtype).max, -1.0)
        return values

    def _corrected(self, values: np.ndarray, sparse: dict[str, Any]) -> np.ndarray:
        """Overwrite the rows that a sparse accessor lists."""
        count, where, what = _natural(sparse["count"]), sparse["indices"], sparse["values"]
        dtype = np.dtype(COMPONENT[where["componentType"]])
        rows = self._elements(where["bufferView"], where.get("byteOffset", 0), dtype, count, 1)[:, 0]
        values = values.copy()
        values[rows] = self._elements(
            what["bufferView"], what.get("byteOffset", 0), values.dtype, count, values.shape[1]
        )
        return values

    def _elements(self, view: int, offset: int, dtype: np.dtype[Any], count: int, width: int) -> np.ndarray:
        """`count` rows of `width` components from a buffer view, after checking that they are inside it."""
        data, stride = self._view(view)
        size = dtype.itemsize * width
        stride = stride or size
        if count == 0:
            return np.empty((0, width), dtype)
        if stride < size or _natural(offset) + (count - 1) * stride + size > len(data):
            raise ValueError(f"an accessor of {count} elements passes the end of buffer view {view}")
        return np.ndarray((count, width), dtype, data, offset, (stride, dtype.itemsize))

    def _view(self, index: int) -> tuple[bytes, int]:
        """The bytes of a buffer view and its stride (0: closely packed)."""
        view = _item(self.tree.get("bufferViews", []), index, "buffer view")
        buffer = self._buffer(view["buffer"])
        start, length = _natural(view.get("byteOffset", 0)), _natural(view["byteLength"])
        if start + length > len(buffer):
            raise ValueError(f"buffer view {index} passes the end of its buffer of {len(buffer)} bytes")
        return buffer[start : start + length], _natural(view.get("byteStride", 0))

    def _buffer(self, index: int) -> bytes:
        if index not in self.buffers:
            uri = _item(self.tree.get("buffers", []), index, "buffer").get("uri")
            if uri is None and (index != 0 or self.binary is None):
                raise ValueError(f"buffer {index} has no data")
            self.buffers[index] = self.binary or b"" if uri is None else self._uri(uri)
        return self.buffers[index]

    def _uri(self, uri: str) -> bytes:
        """Embedded base64, or a file inside the scene's folder."""
        if uri.startswith("data:"):
            header, _, payload = uri.partition(",")
            if not header.endswith(";base64"):
                raise ValueError("embedded data must be base64")
            return base64.b64decode(payload, validate=True)
        return self._path(uri).read_bytes()

    def _path(self, uri: str) -> Path:
        path = (self.folder / unquote(uri)).resolve()
        if ":" in uri or not path.is_relative_to(self.folder):
            raise ValueError(f"refused to read {uri!r}: it is outside the scene's folder")
        return path


def _item(items: list[Any], index: Any, what: str) -> Any:
    """`items[index]`, where the index comes from the file."""
    if type(index) is not int or not 0 <= index < len(items):
        raise ValueError(f"there is no {what} {index}: the file has {len(items)}")
    return items[index]


def _natural(number: Any) -> int:
    """A count or an offset; JSON may hold anything."""
    if type(number) is not int or number < 0:
        raise ValueError(f"expected a whole number of at least 0, got {number!r}")
    return number


def _transform(node: dict[str, Any]) -> np.ndarray:
    """The node's matrix (stored by columns), or translation * rotation (quaternion x, y, z, w) * scale."""
    if "matrix" in node:
        return np.array(node["matrix"], dtype=np.float64).reshape(4, 4).T
    x, y, z, w = node.get("rotation", (0.0, 0.0, 0.0, 1.0))
    result = np.eye(4)
    result[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    result[:3, :3] *= np.array(node.get("scale", (1.0, 1.0, 1.0)), dtype=np.float64)
    result[:3, 3] = node.get("translation", (0.0, 0.0, 0.0))
    return result


def _corners(order: np.ndarray, mode: int) -> np.ndarray:
    """Corners (t, 3) of triangles, a strip or a fan."""
    if mode == TRIANGLES:
        return order[: len(order) // 3 * 3].reshape(-1, 3)
    if len(order) < 3:
        return np.empty((0, 3), np.int64)
    first = order[:-2] if mode == STRIP else np.broadcast_to(order[:1], len(order) - 2)
    return np.stack([first, order[1:-1], order[2:]], axis=1)
