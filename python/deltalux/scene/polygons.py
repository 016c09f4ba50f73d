"""Polygons to triangles: convex ones as fans, others by mapbox_earcut, imported here alone and only when needed."""

from __future__ import annotations

import numpy as np

__all__ = ["triangulated"]


def triangulated(points: np.ndarray, sizes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The triangles of polygons that lie one behind the other.

    Parameters
    ----------
    points : (corners, 3)
        The places of all corners.
    sizes : (polygons,)
        Corners of each polygon, at least 3.

    Returns
    -------
    triangles : (t, 3) int64
        Numbers of corners, wound as their polygon is.
    polygon : (t,) int64
        The polygon of each.
    """
    starts = np.cumsum(sizes) - sizes
    made: list[np.ndarray] = []
    owners: list[np.ndarray] = []
    for size in np.unique(sizes):
        own = np.flatnonzero(sizes == size)
        corners = starts[own][:, None] + np.arange(size)
        # What is not finite is refused later.
        convex = (size == 3) | ~np.isfinite(points[corners]).all(axis=(1, 2))
        convex[~convex] = _is_convex(points[corners[~convex]])
        fan = np.stack([np.zeros(size - 2, np.int64), np.arange(1, size - 1), np.arange(2, size)], -1)
        made.append(corners[convex][:, fan].reshape(-1, 3))
        owners.append(np.repeat(own[convex], size - 2))
        for number, corner in zip(own[~convex], corners[~convex], strict=True):
            cut = corner[_cut(points[corner])]
            made.append(cut)
            owners.append(np.full(len(cut), number))
    order = np.argsort(np.concatenate(owners), kind="stable")
    return np.concatenate(made)[order], np.concatenate(owners)[order]


def _normals(polygons: np.ndarray) -> np.ndarray:
    """Twice the areas of polygons (n, corners, 3), along their normals (Newell)."""
    about = polygons - polygons[:, :1]
    return np.asarray(np.cross(about, np.roll(about, -1, axis=1)).sum(axis=1))


def _is_convex(polygons: np.ndarray) -> np.ndarray:
    """Whether no triangle of the fan about the first corner, and no corner, turns the other way."""
    normal = _normals(polygons)[:, None]
    sides = np.roll(polygons, -1, axis=1) - polygons
    bends = (np.cross(sides, np.roll(sides, -1, axis=1)) * normal).sum(axis=2)
    about = polygons[:, 1:] - polygons[:, :1]
    fan = (np.cross(about[:, :-1], about[:, 1:]) * normal).sum(axis=2)
    slack = -1e-9 * (normal[:, 0] ** 2).sum(axis=1)
    return np.asarray((bends.min(axis=1) >= slack) & (fan.min(axis=1) >= slack))


def _is_flat(polygon: np.ndarray, normal: np.ndarray) -> bool:
    """Whether all corners lie in one plane, to a thousandth of the polygon's size."""
    away = (polygon - polygon[0]) @ (normal / max(float(np.linalg.norm(normal)), 1e-300))
    return bool(np.abs(away).max() <= 1e-3 * np.ptp(polygon, axis=0).max())


def _cut(polygon: np.ndarray) -> np.ndarray:
    """The triangles of one polygon, seen along its normal: (t, 3) numbers of its corners."""
    import mapbox_earcut

    normal = _normals(polygon[None])[0]
    axis = int(np.abs(normal).argmax())
    # Two axes that are right-handed with the third, so that the sense of the corners stays.
    plane = [(axis + 1) % 3, (axis + 2) % 3] if normal[axis] >= 0.0 else [(axis + 2) % 3, (axis + 1) % 3]
    flat = np.ascontiguousarray(polygon[:, plane] - polygon[0, plane])
    found = mapbox_earcut.triangulate_float64(flat, np.array([len(polygon)], np.uint32))
    triangles = np.asarray(found, np.int64).reshape(-1, 3)
    if len(triangles) < len(polygon) - 2 and not _is_flat(polygon, normal):
        # What folds out of its plane has corners that lie on its outline there: a fan shows all of them.
        return np.stack(
            [np.zeros(len(polygon) - 2, np.int64), *(np.arange(k, len(polygon) - 2 + k) for k in (1, 2))], -1
        )
    # Either sense comes back; all are to be wound as the polygon.
    a, b, c = flat[triangles].transpose(1, 0, 2)
    turned = np.cross(np.pad(b - a, ((0, 0), (0, 1))), np.pad(c - a, ((0, 0), (0, 1))))[:, 2] < 0.0
    triangles[turned] = triangles[turned][:, ::-1]
    return triangles


def numbered(*attributes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Vertices of corners that have several numbers each, of a place, of texture coordinates, of a normal.

    Parameters
    ----------
    attributes : (corners,) int64, each
        What a corner takes of each list; -1 where nothing.

    Returns
    -------
    first : (v,) int64
        Of each vertex a corner that is it, in the order of the first attribute's numbers.
    vertex : (corners,) int64
        The vertex of each corner.
    """
    if len(attributes) == 1:
        _, first, vertex = np.unique(attributes[0], return_index=True, return_inverse=True)
    else:
        rows = np.stack(attributes, axis=1)
        _, first, vertex = np.unique(rows, axis=0, return_index=True, return_inverse=True)
    return first, vertex.reshape(-1)
