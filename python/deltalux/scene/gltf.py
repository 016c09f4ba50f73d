"""glTF 2.0 (.gltf, .glb): meshes placed by their nodes, skinned and morphed as the file stands, and its cameras.

Read here rather than by a library because colours must stay floats, cameras must follow their parents, offsets of
an untrusted file must be checked, and no file may be opened that is not near the scene.
Source: Khronos, glTF 2.0, sections 3.5 (nodes), 3.7 (meshes, morph targets, skins), 3.10 (cameras).
"""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ..camera import LARGEST_PICTURE, Camera
from ..mistakes import near
from .content import Content, Piece
from .gltf_data import Data, chunks, item
from .gltf_materials import Materials

TRIANGLES, STRIP, FAN = 4, 5, 6
DONE = {
    "EXT_mesh_gpu_instancing",
    "EXT_texture_webp",
    "KHR_materials_emissive_strength",
    "KHR_materials_pbrSpecularGlossiness",
    "KHR_mesh_quantization",
    "KHR_texture_transform",
}
"""Extensions that are shown."""
_LOOKS = (
    "anisotropy", "clearcoat", "diffuse_transmission", "dispersion", "ior", "iridescence", "sheen", "specular",
    "transmission", "unlit", "variants", "volume",
)  # fmt: skip
SHOWN_WITHOUT = {f"KHR_materials_{look}" for look in _LOOKS} | {
    "KHR_animation_pointer",
    "KHR_lights_punctual",
    "KHR_xmp_json_ld",
}
"""Extensions that a file may require and still be shown: they change the look of surfaces, or what moves."""


def read(content: Content, folder: Path, data: bytes, kind: str) -> None:
    """Fill `content` from the bytes of a file of `kind` "gltf" or "glb", which may name others near it."""
    _Reader(content, Data(content, folder, *chunks(data, kind))).run()


class _Reader:
    """One file, with what has been decoded of it so far."""

    def __init__(self, content: Content, data: Data) -> None:
        self.content, self.data, self.tree = content, data, data.tree
        self.materials = Materials(content, data)
        self.nodes: list[dict[str, Any]] = self.tree.get("nodes", [])
        self.meshes: dict[tuple[int, tuple[float, ...]], list[tuple[Piece, dict[str, Any]]]] = {}

    def run(self) -> None:
        """Walk the nodes of a scene, placing meshes and cameras."""
        if int(str(self.tree.get("asset", {}).get("version", "2")).split(".")[0]) != 2:
            raise ValueError(f"expected version 2 of glTF, got {self.tree['asset']['version']}")
        self._check_extensions()
        # Joints of skins may lie outside the scene.
        worlds = self._worlds(self._orphans())
        for index, world in self._worlds(self._roots()).items():
            node = self.nodes[index]
            if "mesh" in node:
                for place in self._instances(node, world):
                    self._place(node, place, worlds)
            if "camera" in node:
                self._see(node, world)

    def _check_extensions(self) -> None:
        """Refuse what the file cannot be shown without, and note what it is shown without."""
        required = self.tree.get("extensionsRequired", [])
        for extension in required:
            if extension not in DONE | SHOWN_WITHOUT:
                raise ValueError(f"the file requires {extension}, which is not supported")
        for extension in dict.fromkeys([*self.tree.get("extensionsUsed", []), *required]):
            if extension not in DONE:
                self.content.leave_out(str(extension), "the file uses this extension, which is not shown")

    def _worlds(self, roots: list[int]) -> dict[int, np.ndarray]:
        """Of each node under some roots its matrix in the world, parents before children."""
        found: dict[int, np.ndarray] = {}
        waiting = [(root, np.eye(4)) for root in reversed(roots)]
        while waiting:
            index, parent = waiting.pop()
            if index in found:
                raise ValueError(f"node {index} has two parents or is its own ancestor")
            node = item(self.nodes, index, "node")
            found[index] = parent @ _transform(node)
            waiting += [(child, found[index]) for child in reversed(node.get("children", []))]
        return found

    def _orphans(self) -> list[int]:
        children = {child for node in self.nodes for child in node.get("children", [])}
        return [index for index in range(len(self.nodes)) if index not in children]

    def _roots(self) -> list[int]:
        """The nodes of the scene that is wanted, or of the default one; without scenes, those without a parent."""
        scenes, wanted = self.tree.get("scenes", []), self.content.wanted
        named = {str(scene.get("name", "")): number for number, scene in reversed(list(enumerate(scenes)))}
        if isinstance(wanted, str):
            if wanted not in named and not wanted.isdecimal():
                known = ", ".join(filter(None, named)) or "none"
                what = f"expected the name of a scene ({known}) or a number below {len(scenes)}, got {wanted!r}"
                raise ValueError(what + near(wanted, named))
            wanted = named[wanted] if wanted in named else int(wanted)
        if not scenes and wanted is None:
            return self._orphans()
        if len(scenes) > 1 and wanted is None:
            self.content.leave_out(
                "scenes ignored", f"one of {len(scenes)} is shown; --scene or scene= chooses another"
            )
        roots: list[int] = item(scenes, self.tree.get("scene", 0) if wanted is None else wanted, "scene").get(
            "nodes", []
        )
        return roots

    def _instances(self, node: dict[str, Any], world: np.ndarray) -> list[np.ndarray]:
        """The matrices of a node's mesh: one, or those of EXT_mesh_gpu_instancing."""
        attributes = node.get("extensions", {}).get("EXT_mesh_gpu_instancing", {}).get("attributes")
        if attributes is None:
            return [world]
        named = {"TRANSLATION": "VEC3", "ROTATION": "VEC4", "SCALE": "VEC3"}
        values = {
            name: self.data.accessor(attributes[name], shape) for name, shape in named.items() if name in attributes
        }
        count = min((len(own) for own in values.values()), default=0)
        return [world @ _transform({name.lower(): own[k] for name, own in values.items()}) for k in range(count)]

    def _place(self, node: dict[str, Any], world: np.ndarray, worlds: dict[int, np.ndarray]) -> None:
        """Add an instance of a mesh; its accessors are decoded once."""
        mesh = item(self.tree.get("meshes", []), node["mesh"], "mesh")
        weights = tuple(float(weight) for weight in node.get("weights", mesh.get("weights", ())))
        key = (node["mesh"], weights)
        if key not in self.meshes:
            found = ((self._primitive(own, weights), own) for own in mesh.get("primitives", []))
            self.meshes[key] = [(piece, own) for piece, own in found if piece is not None]
        for piece, primitive in self.meshes[key]:
            if "skin" in node and "JOINTS_0" in primitive["attributes"]:
                self.content.add_piece(self._skinned(piece, primitive["attributes"], node["skin"], worlds))
            else:
                self.content.add_piece(piece.placed(world))

    def _primitive(self, primitive: dict[str, Any], weights: tuple[float, ...]) -> Piece | None:
        """The triangles of a primitive, in the mesh's own space."""
        mode, attributes = primitive.get("mode", TRIANGLES), primitive.get("attributes", {})
        if mode not in (TRIANGLES, STRIP, FAN) or "POSITION" not in attributes:
            self.content.leave_out("geometries without triangles", "points and lines are not shown")
            return None
        points = self.data.accessor(attributes["POSITION"], "VEC3").astype(np.float64)
        count = len(points)
        if "indices" in primitive:
            order = self.data.accessor(primitive["indices"], "SCALAR").reshape(-1).astype(np.int64)
        else:
            order = np.arange(count)
        triangles = _corners(order, mode)
        if len(triangles) == 0:
            return None
        material, placing = self.materials.number(primitive.get("material"))
        uv = self.data.attribute(attributes, f"TEXCOORD_{placing.channel}", count, "VEC2")
        tint = self.data.attribute(attributes, "COLOR_0", count, "VEC3", "VEC4")
        cut = self.content.cutouts[material] is not None and tint is not None and tint.shape[1] == 4
        piece = Piece(
            points,
            triangles,
            None if uv is None else placing.of(uv),
            material,
            normals=self.data.attribute(attributes, "NORMAL", count, "VEC3"),
            tangents=self.data.attribute(attributes, "TANGENT", count, "VEC4"),
            colours=None if tint is None else tint[:, :3],
            opacity=tint[:, 3] if cut and tint is not None else None,
        )
        return self._morphed(piece, primitive.get("targets", []), weights)

    def _morphed(self, piece: Piece, targets: list[dict[str, Any]], weights: tuple[float, ...]) -> Piece:
        """With what the morph targets add at the weights of the file."""
        for target, weight in zip(targets, weights, strict=False):
            if weight == 0.0:
                continue
            names = {"POSITION": "vertices", "NORMAL": "normals", "TANGENT": "tangents"}
            for name, own in names.items():
                added, base = self.data.attribute(target, name, len(piece.vertices), "VEC3"), getattr(piece, own)
                if added is not None and base is not None:
                    moved = base.copy()
                    moved[:, :3] += weight * added
                    piece = replace(piece, **{own: moved})
        return piece

    def _skinned(self, piece: Piece, attributes: dict[str, Any], number: int, worlds: dict[int, np.ndarray]) -> Piece:
        """As its joints stand: the node of a skinned mesh says nothing of its place."""
        skin = item(self.tree.get("skins", []), number, "skin")
        joints = skin["joints"]
        inverse = np.tile(np.eye(4), (len(joints), 1, 1))
        if "inverseBindMatrices" in skin:
            stored = self.data.accessor(skin["inverseBindMatrices"], "MAT4").reshape(-1, 4, 4)
            inverse = stored[: len(joints)].transpose(0, 2, 1).astype(np.float64)
        if len(inverse) < len(joints):
            raise ValueError(f"skin {number} has {len(joints)} joints and {len(inverse)} matrices")
        moves = np.stack([worlds[item(joints, k, "joint")] @ inverse[k] for k in range(len(joints))])
        count = len(piece.vertices)
        whole, sum_of_weights = np.zeros((count, 4, 4)), np.zeros(count)
        for group in range(len(attributes)):
            which = self.data.attribute(attributes, f"JOINTS_{group}", count, "VEC4")
            share = self.data.attribute(attributes, f"WEIGHTS_{group}", count, "VEC4")
            if which is None or share is None:
                break
            if which.max(initial=0) >= len(joints):
                raise ValueError(f"there is no joint {int(which.max())}: skin {number} has {len(joints)}")
            whole += np.einsum("vk,vkij->vij", share, moves[which.astype(np.int64)])
            sum_of_weights += share.sum(axis=1)
        whole /= np.where(sum_of_weights > 0.0, sum_of_weights, 1.0)[:, None, None]
        whole[sum_of_weights <= 0.0] = np.eye(4)
        return _moved_each(piece, whole)

    def _see(self, node: dict[str, Any], world: np.ndarray) -> None:
        """A perspective camera; it looks along its own -z, and its aspect ratio gives the picture's height."""
        camera = item(self.tree.get("cameras", []), node["camera"], "camera")
        if "perspective" not in camera:
            self.content.leave_out("cameras ignored", "those without perspective are not used")
            return
        lens = camera["perspective"]
        aspect = float(lens.get("aspectRatio", 1.0))
        if not 0.0 < aspect < math.inf:
            raise ValueError(f"a camera's aspectRatio must be positive, got {aspect}")
        position, forward, up = world[:3, 3], -world[:3, 2], world[:3, 1]
        names = [str(of.get("name", "")) for of in (node, camera)]
        free = (
            name
            for name in [*names, f"camera {len(self.content.cameras)}"]
            if name and name not in self.content.cameras
        )
        self.content.cameras[next(free, f"camera {len(self.content.cameras)}")] = Camera(
            tuple(position),
            tuple(position + forward),
            tuple(up),
            vertical_fov=math.degrees(lens["yfov"]),
            height=min(max(round(512 / aspect), 1), LARGEST_PICTURE),
        )


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


def _moved_each(piece: Piece, matrices: np.ndarray) -> Piece:
    """A piece of which each vertex has a matrix of its own, (v, 4, 4)."""
    linear = matrices[:, :3, :3]
    across = np.stack([np.cross(linear[:, (k + 1) % 3], linear[:, (k + 2) % 3]) for k in range(3)], axis=1)
    points = np.einsum("vij,vj->vi", linear, piece.vertices) + matrices[:, :3, 3]
    normals = None if piece.normals is None else np.einsum("vij,vj->vi", across, piece.normals)
    tangents = piece.tangents
    if tangents is not None:
        along = np.einsum("vij,vj->vi", linear, tangents[:, :3])
        tangents = np.concatenate([along, tangents[:, 3:]], axis=1)
    return replace(piece, vertices=points, normals=normals, tangents=tangents)


def _corners(order: np.ndarray, mode: int) -> np.ndarray:
    """Corners (t, 3) of triangles, a strip or a fan."""
    if mode == TRIANGLES:
        return order[: len(order) // 3 * 3].reshape(-1, 3)
    if len(order) < 3:
        return np.empty((0, 3), np.int64)
    first = order[:-2] if mode == STRIP else np.broadcast_to(order[:1], len(order) - 2)
    return np.stack([first, order[1:-1], order[2:]], axis=1)
