"""The bytes of a glTF file: its JSON, buffers, views and accessors, each checked to lie inside the last.

Source: Khronos, glTF 2.0, sections 3.6 (accessors) and 4 (GLB).
"""

from __future__ import annotations

import base64
import json
import struct
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np

from .content import MOST_TRIANGLES, Content
from .nearby import is_nearby

__all__ = ["Data", "chunks", "item"]

COMPONENT = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
WIDTH = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}
# Elements of an accessor that the file does not hold are zeros, and cost its writer nothing but their number. They go
# with others that it does hold, as displacements go with vertices, which take three bytes at the least.
LEAST_CORNER, MOST_TIMES = 3, 8


def chunks(data: bytes, kind: str) -> tuple[dict[str, Any], bytes | None]:
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


class Data:
    """The bytes that a file names, read when they are first asked for."""

    def __init__(self, content: Content, folder: Path, tree: dict[str, Any], binary: bytes | None) -> None:
        self.content, self.folder, self.tree, self.binary = content, folder, tree, binary
        self.buffers: dict[int, bytes] = {}
        self.implied = 0

    def accessor(self, index: int, *shapes: str) -> np.ndarray:
        """Decode an accessor, (count, components): strides, normalised integers and sparse corrections included."""
        accessor = item(self.tree.get("accessors", []), index, "accessor")
        shape = accessor["type"]
        if shape not in shapes:
            raise ValueError(f"accessor {index} must be {' or '.join(shapes)}, got {shape}")
        dtype, count = np.dtype(COMPONENT[accessor["componentType"]]), _natural(accessor["count"])
        if count > 3 * MOST_TRIANGLES:
            raise ValueError(f"accessor {index} has {count} elements, more than {3 * MOST_TRIANGLES}")
        if "bufferView" in accessor:
            values = self._elements(accessor["bufferView"], accessor.get("byteOffset", 0), dtype, count, WIDTH[shape])
        elif "sparse" in accessor:
            self._imply(index, count)
            values = np.zeros((count, WIDTH[shape]), dtype)
        else:
            raise ValueError(f"accessor {index} has no data")
        if "sparse" in accessor:
            values = self._corrected(values, accessor["sparse"])
        if accessor.get("normalized") and dtype.kind in "iu":
            values = np.maximum(values / np.iinfo(dtype).max, -1.0)
        return values

    def _imply(self, index: int, count: int) -> None:
        """Count elements that the file does not hold: as many as its bytes could be corners of, a few times over."""
        held = sum(len(self._buffer(number)) for number in range(len(self.tree.get("buffers", []))))
        self.implied += count
        if count > held // LEAST_CORNER or self.implied > MOST_TIMES * held:
            raise ValueError(f"accessor {index} has {count} elements without data, too many for a file of {held} bytes")

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
        data, stride = self.view(view)
        size = dtype.itemsize * width
        stride = stride or size
        if count == 0:
            return np.empty((0, width), dtype)
        if stride < size or _natural(offset) + (count - 1) * stride + size > len(data):
            raise ValueError(f"an accessor of {count} elements passes the end of buffer view {view}")
        return np.ndarray((count, width), dtype, data, offset, (stride, dtype.itemsize))

    def view(self, index: int) -> tuple[bytes, int]:
        """The bytes of a buffer view and its stride (0: closely packed)."""
        view = item(self.tree.get("bufferViews", []), index, "buffer view")
        buffer = self._buffer(view["buffer"])
        start, length = _natural(view.get("byteOffset", 0)), _natural(view["byteLength"])
        if start + length > len(buffer):
            raise ValueError(f"buffer view {index} passes the end of its buffer of {len(buffer)} bytes")
        return buffer[start : start + length], _natural(view.get("byteStride", 0))

    def _buffer(self, index: int) -> bytes:
        if index not in self.buffers:
            uri = item(self.tree.get("buffers", []), index, "buffer").get("uri")
            if uri is None and (index != 0 or self.binary is None):
                raise ValueError(f"buffer {index} has no data")
            self.buffers[index] = self.binary or b"" if uri is None else self.uri(uri)
        return self.buffers[index]

    def uri(self, uri: str) -> bytes:
        """Embedded base64, or a file in the scene's folder or one beside it."""
        if uri.startswith("data:"):
            header, _, payload = uri.partition(",")
            if not header.endswith(";base64"):
                raise ValueError("embedded data must be base64")
            return base64.b64decode(payload, validate=True)
        path = self.check_path(uri)
        if not path.is_file():
            raise FileNotFoundError(f"{uri} is not there")
        return self.content.read(path)

    def check_path(self, uri: str) -> Path:
        """A path that the rule of `nearby` lets be read."""
        name = unquote(uri)
        if ":" in uri or not is_nearby(self.folder, name):
            raise ValueError(f"refused to read {uri!r}: it is outside the scene's folder and those beside it")
        return self.folder / name

    def attribute(self, attributes: dict[str, Any], name: str, count: int, *shapes: str) -> np.ndarray | None:
        """Numbers of vertices as float64, or None where the primitive has none."""
        if name not in attributes:
            return None
        values = self.accessor(attributes[name], *shapes).astype(np.float64)
        if len(values) != count:
            raise ValueError(f"{count} vertices have {len(values)} of {name}")
        return values


def item(items: list[Any], index: Any, what: str) -> Any:
    """`items[index]`, where the index comes from the file."""
    if type(index) is not int or not 0 <= index < len(items):
        raise ValueError(f"there is no {what} {index}: the file has {len(items)}")
    return items[index]


def _natural(number: Any) -> int:
    """A count or an offset; JSON may hold anything."""
    if type(number) is not int or number < 0:
        raise ValueError(f"expected a whole number of at least 0, got {number!r}")
    return number
