"""Shapes that the built-in scenes are made of: grids, surfaces of revolution, tubes, boxes, and leaves by the thousand.

A shape is a pair (vertices (v, 3) float64, triangles (t, 3) int64). A `Model` collects shapes by material.
Everything is numpy, deterministic and free of triangles without area.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from ...camera import Camera
from ..content import Content, Piece

Shape = tuple[np.ndarray, np.ndarray]
Colour = tuple[float, float, float]

# Sines and cosines differ in their last bit between processors; on this grid the scene, and its hash, do not.
GRID = 2.0**-20


class Model:
    """A scene in the making; `palette`: linear albedos by the names of its materials; `laid`: those that pictures may
    be laid over, from above, and how wide one is."""

    def __init__(self, name: str, palette: Mapping[str, Colour], laid: Mapping[str, float] | None = None) -> None:
        self.name, self._palette, self._laid = name, palette, laid or {}
        self._shapes: list[Shape] = []
        self._material: list[int] = []
        self._used: list[str] = []

    def add(self, material: str, *shapes: Shape) -> None:
        """Add shapes of a material; they are numbered as they come."""
        if material not in self._used:
            self._used.append(material)
        self._shapes += shapes
        self._material += [self._used.index(material)] * len(shapes)

    def content(self, camera: Camera) -> Content:
        """The finished model, one piece a shape, seen by its own camera."""
        content = Content(self.name, cameras={"": camera})
        for name in self._used:
            content.add_material(self._palette[name], name=name)
        for (vertices, triangles), material in zip(self._shapes, self._material, strict=True):
            points = np.round(vertices / GRID) * GRID
            wide = self._laid.get(self._used[material])
            uv = None if wide is None else points[:, (0, 2)] * (1.0 / wide, -1.0 / wide)
            content.add_piece(Piece(points, triangles[_distinct_corners(points, triangles)], uv, material))
        return content


def join(*shapes: Shape) -> Shape:
    """Several shapes as one."""
    starts = np.cumsum([0] + [len(vertices) for vertices, _ in shapes])
    triangles = [corners + start for (_, corners), start in zip(shapes, starts, strict=False)]
    return np.concatenate([vertices for vertices, _ in shapes]), np.concatenate(triangles)


def moved(shape: Shape, offset: Sequence[float] | np.ndarray, turn: float = 0.0) -> Shape:
    """The shape turned about +Y by `turn` degrees, then shifted."""
    angle = math.radians(turn)
    cos, sin = math.cos(angle), math.sin(angle)
    rotation = np.array([[cos, 0.0, sin], [0.0, 1.0, 0.0], [-sin, 0.0, cos]])
    return shape[0] @ rotation.T + offset, shape[1]


def surface(points: np.ndarray) -> Shape:
    """Two triangles for each cell of one or many grids of points, (..., a, b, 3)."""
    rows, columns = points.shape[-3:-1]
    grids = points.reshape(-1, rows * columns, 3)
    corner = np.arange(rows * columns).reshape(rows, columns)
    a, b, c, d = (corner[:-1, :-1], corner[:-1, 1:], corner[1:, :-1], corner[1:, 1:])
    cells = np.stack([a, b, d, a, d, c], axis=-1).reshape(-1, 3)
    triangles = (cells + rows * columns * np.arange(len(grids))[:, None, None]).reshape(-1, 3)
    vertices = grids.reshape(-1, 3)
    return vertices, triangles[_distinct_corners(vertices, triangles)]


def quad(origin: Sequence[float], along: Sequence[float], across: Sequence[float]) -> Shape:
    """A parallelogram."""
    o, u, v = np.array(origin), np.array(along), np.array(across)
    return surface(np.array([[o, o + u], [o + v, o + u + v]]))


def box(low: Sequence[float], high: Sequence[float]) -> Shape:
    """An axis-parallel box."""
    corners = np.array([[x, y, z] for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])])
    faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return corners, np.array([t for a, b, c, d in faces for t in ((a, b, c), (a, c, d))])


def revolved(profile: Sequence[tuple[float, float]], segments: int = 64) -> Shape:
    """The surface that a profile of (radius, height) sweeps about +Y."""
    radius, height = np.array(profile, dtype=np.float64).T
    angle = np.linspace(0.0, 2.0 * np.pi, segments + 1)
    # The last column repeats the first bit for bit, so that the seam is closed.
    angle[-1] = 0.0
    x, z = radius[:, None] * np.cos(angle), radius[:, None] * np.sin(angle)
    return surface(np.stack([x, np.broadcast_to(height[:, None], x.shape), z], axis=-1))


def sphere(centre: Sequence[float] | np.ndarray, radius: float, segments: int = 32) -> Shape:
    """A sphere of latitudes and longitudes."""
    latitude = np.linspace(-0.5 * np.pi, 0.5 * np.pi, segments // 2 + 1)
    profile = [(radius * math.cos(t) if abs(t) < 1.5 else 0.0, radius * math.sin(t)) for t in latitude]
    return moved(revolved(profile, segments), centre)


def tube(path: np.ndarray, radius: np.ndarray | float, sides: int = 8) -> Shape:
    """Round tubes along one or many paths (..., n, 3)."""
    path = np.asarray(path, dtype=np.float64)
    tangent = unit(np.gradient(path, axis=-2))
    # The axis that the whole path leans on least keeps the frame from turning over.
    helper = np.eye(3)[np.argmin(np.abs(tangent).reshape(-1, 3).max(axis=0))]
    side = unit(np.cross(tangent, helper))
    other = np.cross(tangent, side)
    angle = np.linspace(0.0, 2.0 * np.pi, sides + 1)
    angle[-1] = 0.0
    ring = side[..., None, :] * np.cos(angle)[:, None] + other[..., None, :] * np.sin(angle)[:, None]
    thickness = np.broadcast_to(radius, path.shape[:-1])
    return surface(path[..., None, :] + thickness[..., None, None] * ring)


def arch(
    base: np.ndarray, heading: np.ndarray, rise: np.ndarray, bend: np.ndarray, length: np.ndarray, steps: int
) -> np.ndarray:
    """Centre lines of stalks that bend under their weight, (n, steps + 1, 3).

    A stalk begins at `base` (n, 3), points along the compass direction `heading` (n,) and upwards by `rise` (n,), and
    has turned down by `bend` (n,) at its tip, most of it towards the tip (all in radians); `length` (n,).
    """
    s = (np.arange(steps) + 0.5) / steps
    angle = rise[:, None] - bend[:, None] * s**1.5
    step = length[:, None] / steps
    out = np.cumsum(np.cos(angle) * step, axis=1)
    up = np.cumsum(np.sin(angle) * step, axis=1)
    path = np.stack([out * np.cos(heading)[:, None], up, out * np.sin(heading)[:, None]], axis=-1)
    return np.asarray(base[:, None, :] + np.concatenate([np.zeros_like(path[:, :1]), path], axis=1))


def leaves(
    centre: np.ndarray, width: np.ndarray, fold: float = 0.3, up: Sequence[float] | np.ndarray = (0, 1, 0)
) -> Shape:
    """Blades along centre lines (..., n, 3), `width` (..., n) wide on each side, folded upwards along the midrib."""
    tangent = unit(np.gradient(centre, axis=-2))
    side = unit(np.cross(tangent, np.broadcast_to(up, tangent.shape)))
    normal = np.cross(side, tangent)
    half = width[..., None]
    edge = half * fold * normal
    return surface(np.stack([centre - half * side + edge, centre, centre + half * side + edge], axis=-2))


def unit(vectors: np.ndarray) -> np.ndarray:
    """Vectors of length 1."""
    return np.asarray(vectors / np.linalg.norm(vectors, axis=-1, keepdims=True))


def _distinct_corners(vertices: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Which triangles have three different corners: at poles and tips of a grid half of them do not."""
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    return np.asarray((a != b).any(axis=1) & (b != c).any(axis=1) & (c != a).any(axis=1))
