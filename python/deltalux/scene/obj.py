"""Wavefront OBJ: polygons with texture coordinates and normals, and colours of vertices.

Read here rather than by trimesh, which counts relative indices from the end of the file, cuts concave polygons as if
they were convex, and takes one library without a word of others. Colours of vertices (``v x y z r g b``) are read as
sRGB, as MeshLab, ZBrush and Blender write them.
Source: Wavefront, Advanced Visualizer manual, appendix B1.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from .content import DEFAULT_ALBEDO, Content, Piece
from .mtl import Finish, read_libraries
from .polygons import numbered, triangulated
from .texture import linear

__all__ = ["read"]

_OTHER = {"p", "l", "curv", "curv2", "surf"}
"""Statements of what has no triangles."""


@dataclass
class _Lines:
    """What the lines of a file say."""

    rows: dict[str, list[list[str]]] = field(default_factory=lambda: {"v": [], "vt": [], "vn": []})
    corners: list[str] = field(default_factory=list)
    counts: list[tuple[int, int, int]] = field(default_factory=list)
    """How many places, coordinates and normals there are before each face: relative numbers count from there."""
    sizes: list[int] = field(default_factory=list)
    material: list[int] = field(default_factory=list)
    names: list[str] = field(default_factory=list)
    libraries: list[str] = field(default_factory=list)


def read(content: Content, folder: Path, data: bytes, kind: str) -> None:
    """Fill `content` from the bytes of a file, which may name libraries of materials and textures."""
    lines = _lines(content, data)
    if not lines.sizes:
        return
    finishes = read_libraries(content, folder, lines.libraries)
    place, coordinate, normal = _corners(lines)
    points, colours = _points(lines.rows["v"])
    uv, normals = (_table(lines.rows[name], width) for name, width in (("vt", 2), ("vn", 3)))
    for name, indices, count in (("v", place, len(points)), ("vt", coordinate, len(uv)), ("vn", normal, len(normals))):
        if indices.max(initial=-1) >= count:
            raise ValueError(f"a face names {name} {indices.max() + 1}, but there are {count}")

    triangles, polygon = triangulated(points[place], np.array(lines.sizes))
    attributes = [of for of in (coordinate, normal) if (of >= 0).any()]
    first, vertex = numbered(place, *attributes)
    of_triangle = np.array(lines.material)[polygon]
    for number in np.unique(of_triangle):
        finish = _finish(content, finishes, lines.names[number] if number >= 0 else None)
        own, corners = np.unique(vertex[triangles[of_triangle == number]], return_inverse=True)
        at = first[own]
        mapped = None if len(uv) == 0 else finish.placed(_rows(uv, coordinate[at]))
        tinted = None if colours is None else colours[place[at]]
        content.add_piece(
            Piece(
                vertices=points[place[at]],
                triangles=corners.reshape(-1, 3),
                uv=mapped,
                material=finish.added(content, white=tinted is not None),
                normals=None if len(normals) == 0 else _rows(normals, normal[at]),
                colours=tinted,
            )
        )


def _statements(data: bytes) -> Iterator[tuple[str, str]]:
    """Keywords and what follows them; a line that ends with a backslash goes on."""
    text = os.fsdecode(data).replace("\\\r\n", " ").replace("\\\n", " ")
    for line in text.splitlines():
        parts = line.split(None, 1)
        if len(parts) == 2 and not parts[0].startswith("#"):
            yield parts[0], parts[1]


def _lines(content: Content, data: bytes) -> _Lines:
    lines, known = _Lines(), -1
    numbers: dict[str, int] = {}
    v, vt, vn = lines.rows["v"], lines.rows["vt"], lines.rows["vn"]
    for keyword, rest in _statements(data):
        if keyword in lines.rows:
            lines.rows[keyword].append(rest.split())
        elif keyword == "f":
            corners = rest.split("#", 1)[0].split()
            if len(corners) < 3:
                content.leave_out("faces with fewer than three corners", "they are left out")
                continue
            lines.corners += corners
            lines.counts.append((len(v), len(vt), len(vn)))
            lines.sizes.append(len(corners))
            lines.material.append(known)
        elif keyword == "usemtl":
            known = numbers.setdefault(rest.strip(), len(numbers))
        elif keyword == "mtllib":
            lines.libraries.append(rest.strip())
        elif keyword in _OTHER:
            content.leave_out("geometries without triangles", "points and lines are not shown")
    lines.names = list(numbers)
    return lines


def _corners(lines: _Lines) -> list[np.ndarray]:
    """Of each corner the numbers of its place, its coordinates and its normal, from 0; -1 where it has none."""
    known: dict[str, tuple[int, int, int]] = {}
    for text in set(lines.corners):
        parts = (text.split("/") + ["", ""])[:3]
        known[text] = tuple(int(part) if part else 0 for part in parts)  # type: ignore[assignment]
    stated = np.array([known[text] for text in lines.corners], np.int64)
    if (stated[:, 0] == 0).any():
        raise ValueError("a face names a vertex 0: the first is 1")
    before = np.repeat(np.array(lines.counts, np.int64), lines.sizes, axis=0)
    found = np.where(stated < 0, before + stated, stated - 1)
    if ((stated < 0) & (found < 0)).any():
        raise ValueError("a relative number leads before the first vertex")
    return list(found.T)


def _table(rows: list[list[str]], width: int) -> np.ndarray:
    """The first numbers of all rows, (n, width); those that are not there are 0."""
    if not rows:
        return np.zeros((0, width))
    short = any(len(row) < width for row in rows)
    return np.array([(row + ["0"] * width)[:width] if short else row[:width] for row in rows], dtype=np.float64)


def _points(rows: list[list[str]]) -> tuple[np.ndarray, np.ndarray | None]:
    """Places, and colours where all vertices have one."""
    if any(len(row) < 3 for row in rows):
        raise ValueError("a vertex has fewer than three coordinates")
    points = _table(rows, 3)
    if not rows or any(len(row) < 6 for row in rows):
        return points, None
    colours = np.array([row[3:6] for row in rows], dtype=np.float64)
    if np.nanmax(colours) > 1.0:
        colours /= 255.0
    return points, linear(colours.clip(0.0, 1.0)).astype(np.float64)


def _rows(table: np.ndarray, numbers: np.ndarray) -> np.ndarray:
    """Rows of a table by number; zeros for -1."""
    return np.asarray(np.where((numbers >= 0)[:, None], table[numbers], 0.0))


def _finish(content: Content, finishes: dict[str, Finish], name: str | None) -> Finish:
    """The material of a name, or grey."""
    if name is None:
        return finishes.setdefault("", Finish(albedo=DEFAULT_ALBEDO))
    if name not in finishes:
        content.leave_out("missing materials", f"{name} is not defined; shown in grey")
        finishes[name] = Finish(albedo=DEFAULT_ALBEDO, name=name)
    return finishes[name]
