"""PLY: polygons with normals, colours and texture coordinates of vertices or of corners, text or binary.

Colours of whole numbers are read as sRGB, as scanners and MeshLab write them, and those of floats as linear. Textures
are those of comments (``comment TextureFile wood.png``), by the number of a face where there are several.
Source: Turk, The PLY polygon file format (1994).
"""

from __future__ import annotations

import re
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from .content import DEFAULT_ALBEDO, MOST_TRIANGLES, Content, Piece
from .nearby import nearby
from .polygons import numbered, triangulated
from .texture import linear, read_picture

__all__ = ["read"]

_TYPES = {"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4", "float": "f4",
          "double": "f8", "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4",
          "float32": "f4", "float64": "f8"}  # fmt: skip
_COORDINATES = (("texture_u", "texture_v"), ("u", "v"), ("s", "t"))


@dataclass
class _Property:
    name: str
    kind: str
    length: str = ""
    """Of a list the type of its length."""


@dataclass
class _List:
    """Lists of one property: their values one behind the other."""

    sizes: np.ndarray
    values: np.ndarray


Columns = dict[str, "np.ndarray | _List"]


def read(content: Content, folder: Path, data: bytes, kind: str) -> None:
    """Fill `content` from the bytes of a file, which may name textures."""
    order, elements, textures, start = _header(data)
    tables = _text(data[start:], elements) if order == "" else _binary(data, start, elements, order)
    vertices, faces = tables.get("vertex", {}), tables.get("face", {})
    lists = [faces[name] for name in ("vertex_indices", "vertex_index") if name in faces]
    if not lists or not isinstance(lists[0], _List):
        if "tristrips" in tables:
            content.leave_out("strips of triangles", "they are not shown")
        return
    points = _columns(vertices, ("x", "y", "z"))
    if points is None:
        raise ValueError("the vertices have no x, y and z")
    whole = np.repeat(lists[0].sizes >= 3, lists[0].sizes)
    sizes, place = lists[0].sizes[lists[0].sizes >= 3], lists[0].values[whole].astype(np.int64)
    if len(sizes) == 0:
        return
    if place.min() < 0 or place.max() >= len(points):
        raise ValueError(f"corners must be in [0, {len(points)}), but one is {place.max()}")
    triangles, polygon = triangulated(points[place], sizes)

    # What faces say of their corners comes apart there.
    kept = np.flatnonzero(lists[0].sizes >= 3)
    of_face = np.repeat(kept, sizes)
    mapped, colours = _coordinates(vertices, faces, place, whole), _colours(vertices)
    tinted = None if colours is None else colours[place]
    of_faces = _colours(faces)
    if tinted is None and of_faces is not None:
        tinted = of_faces[of_face]
    apart = [] if tinted is None or colours is not None else [of_face]
    if mapped is not None:
        apart.append(np.unique(mapped, axis=0, return_inverse=True)[1].reshape(-1))
    first, vertex = numbered(place, *apart)
    normals = _columns(vertices, ("nx", "ny", "nz"))
    number = faces.get("texnumber")
    of_polygon = np.asarray(number)[kept] if isinstance(number, np.ndarray) else np.zeros(len(sizes), np.int64)
    for texture in np.unique(of_polygon[polygon]):
        own, corners = np.unique(vertex[triangles[of_polygon[polygon] == texture]], return_inverse=True)
        at = first[own]
        content.add_piece(
            Piece(
                vertices=points[place[at]],
                triangles=corners.reshape(-1, 3),
                uv=None if mapped is None else mapped[at],
                material=_material(content, folder, textures, int(texture), tinted is not None),
                normals=None if normals is None else normals[place[at]],
                colours=None if tinted is None else tinted[at],
            )
        )


def _material(content: Content, folder: Path, textures: list[str], number: int, white: bool) -> int:
    name = textures[number] if 0 <= number < len(textures) else None
    picture = None if name is None else read_picture(content, nearby(folder, name), name)
    plain = DEFAULT_ALBEDO if picture is None and not white else (1.0, 1.0, 1.0)
    return content.add_material(plain, None if picture is None else picture.linear)


def _header(data: bytes) -> tuple[str, list[tuple[str, int, list[_Property]]], list[str], int]:
    """The order of bytes ("" of text), the elements with their properties, the textures, and where the data begin."""
    end = re.search(rb"(?m)^end_header[ \t]*(\r\n|\r|\n)", data)
    if not data.startswith(b"ply") or end is None:
        raise ValueError("expected a PLY file with a whole header")
    order: str | None = None
    elements: list[tuple[str, int, list[_Property]]] = []
    textures = []
    for line in data[: end.start()].decode("latin-1").splitlines()[1:]:
        words = line.split()
        if words[:1] == ["format"]:
            order = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}[words[1]]
        elif words[:1] == ["element"]:
            count = int(words[2])
            if not 0 <= count <= 3 * MOST_TRIANGLES:
                raise ValueError(f"element {words[1]} has {count} rows")
            elements.append((words[1], count, []))
        elif words[:2] == ["property", "list"]:
            elements[-1][2].append(_Property(words[4], _TYPES[words[3]], _TYPES[words[2]]))
        elif words[:1] == ["property"]:
            elements[-1][2].append(_Property(words[2], _TYPES[words[1]]))
        elif len(words) > 2 and words[0] == "comment" and words[1].lower() == "texturefile":
            textures.append(line.split(None, 2)[2].strip())
    if order is None:
        raise ValueError("the header says no format")
    return order, elements, textures, end.end()


def _text(data: bytes, elements: list[tuple[str, int, list[_Property]]]) -> dict[str, Columns]:
    lines = [line for line in data.decode("latin-1").splitlines() if line.strip()]
    tables, at = {}, 0
    for name, count, properties in elements:
        if at + count > len(lines):
            raise ValueError(f"truncated: {count} rows of {name} announced, {len(lines) - at} found")
        rows = [line.split() for line in lines[at : at + count]]
        at += count
        tables[name] = _text_columns(rows, properties)
    return tables


def _text_columns(rows: list[list[str]], properties: list[_Property]) -> Columns:
    columns: Columns = {}
    places = [0] * len(rows)
    for own in properties:
        if not own.length:
            columns[own.name] = np.array([row[k] for row, k in zip(rows, places, strict=True)], np.float64).astype(
                own.kind
            )
            places = [k + 1 for k in places]
            continue
        sizes = [int(row[k]) for row, k in zip(rows, places, strict=True)]
        values = [x for row, k, n in zip(rows, places, sizes, strict=True) for x in row[k + 1 : k + 1 + n]]
        if len(values) != sum(sizes):
            raise ValueError(f"truncated: a list of {own.name} is shorter than it says")
        columns[own.name] = _List(np.array(sizes, np.int64), np.array(values, np.float64).astype(own.kind))
        places = [k + 1 + n for k, n in zip(places, sizes, strict=True)]
    return columns


def _binary(data: bytes, at: int, elements: list[tuple[str, int, list[_Property]]], order: str) -> dict[str, Columns]:
    tables: dict[str, Columns] = {}
    for name, count, properties in elements:
        found = _regular(data, at, count, properties, order)
        tables[name], at = found if found is not None else _irregular(data, at, count, properties, order)
    return tables


def _regular(data: bytes, at: int, count: int, properties: list[_Property], order: str) -> tuple[Columns, int] | None:
    """Rows that all have lists of the lengths of the first; None where they have not."""
    fields: list[Any] = []
    offset = at
    for k, own in enumerate(properties):
        if not own.length:
            fields.append((f"{k}", np.dtype(order + own.kind)))
            offset += np.dtype(own.kind).itemsize
            continue
        length = np.dtype(order + own.length)
        size = int(np.frombuffer(data, length, 1, offset)[0]) if count else 0
        if size < 0 or size * np.dtype(own.kind).itemsize > len(data):
            return None
        fields += [(f"{k}n", length), (f"{k}", np.dtype(order + own.kind), (size,))]
        offset += length.itemsize + size * np.dtype(own.kind).itemsize
    row = np.dtype(fields)
    if at + count * row.itemsize > len(data):
        if any(own.length for own in properties):
            return None
        raise ValueError(f"truncated: {count} rows of {row.itemsize} bytes announced, {len(data) - at} bytes found")
    table = np.frombuffer(data, row, count, at)
    columns: Columns = {}
    for k, own in enumerate(properties):
        if not own.length:
            columns[own.name] = table[f"{k}"]
            continue
        sizes = table[f"{k}n"].astype(np.int64)
        if len(sizes) and (sizes != sizes[0]).any():
            return None
        columns[own.name] = _List(sizes, table[f"{k}"].reshape(-1))
    return columns, at + count * row.itemsize


def _irregular(data: bytes, at: int, count: int, properties: list[_Property], order: str) -> tuple[Columns, int]:
    """Rows one after the other."""
    sizes: list[list[int]] = [[] for _ in properties]
    values: list[list[bytes]] = [[] for _ in properties]
    for _ in range(count):
        for k, own in enumerate(properties):
            width, size = np.dtype(own.kind).itemsize, 1
            if own.length:
                length = struct.Struct(order + np.dtype(own.length).char)
                (size,) = length.unpack_from(data, at)
                at += length.size
            if size < 0 or at + size * width > len(data):
                raise ValueError("truncated: a list passes the end of the file")
            sizes[k].append(size)
            values[k].append(data[at : at + size * width])
            at += size * width
    columns: Columns = {}
    for k, own in enumerate(properties):
        flat = np.frombuffer(b"".join(values[k]), order + own.kind)
        columns[own.name] = _List(np.array(sizes[k], np.int64), flat) if own.length else flat
    return columns, at


def _columns(table: Columns, names: tuple[str, ...]) -> np.ndarray | None:
    """Properties side by side as float64, or None where one is missing."""
    found = [table[name] for name in names if isinstance(table.get(name), np.ndarray)]
    return np.stack([np.asarray(own, np.float64) for own in found], -1) if len(found) == len(names) else None


def _colours(table: Columns) -> np.ndarray | None:
    """Linear colours, or None where there are none."""
    for names in (("red", "green", "blue"), ("r", "g", "b"), ("diffuse_red", "diffuse_green", "diffuse_blue")):
        values, first = _columns(table, names), table.get(names[0])
        if values is not None and isinstance(first, np.ndarray):
            if first.dtype.kind == "f":
                return np.asarray(values.clip(0.0, 1.0))
            return linear((values / np.iinfo(first.dtype).max).clip(0.0, 1.0)).astype(np.float64)
    return None


def _coordinates(vertices: Columns, faces: Columns, place: np.ndarray, whole: np.ndarray) -> np.ndarray | None:
    """Texture coordinates of all corners of polygons."""
    of_faces = faces.get("texcoord")
    if isinstance(of_faces, _List) and of_faces.values.size == 2 * len(whole):
        return np.asarray(of_faces.values.reshape(-1, 2)[whole], np.float64)
    for names in _COORDINATES:
        of_vertices = _columns(vertices, names)
        if of_vertices is not None:
            return np.asarray(of_vertices[place])
    return None
