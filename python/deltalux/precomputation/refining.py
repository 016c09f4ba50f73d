"""A finer mesh where vertices would blur what falls on it: edges between rows that differ are split."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from .._core import DirectPass, Receivers
from ..scene.scene import Scene

__all__ = ["MOST", "refined"]

_COLUMNS = "haar:8"
"""Coarse light tells where shadows have their edges."""
_ROUNDS = 10
MOST = 200_000
"""Triangles of a refined scene that had fewer than a quarter of them."""


def refined(scene: Scene, limit: float, normals: str) -> Scene:
    """A scene of the same surfaces in more triangles.

    An edge is split where the rows at its ends differ by more than ``limit / sqrt(area)`` of a row in the mean, `area`
    being the share of the scene's surface in the triangles that meet there: the longest first, as long as the scene has
    no more than `MOST` triangles, or four times its own. Both triangles at an edge are split, so that no gap opens.

    Parameters
    ----------
    scene
        To be seen at its vertices.
    limit
        Above 0; the smaller, the finer.
    normals
        As for `precompute`.

    Returns
    -------
    Scene
    """
    most = max(MOST, 4 * len(scene.triangles))
    for _ in range(_ROUNDS):
        numbers, lengths = _too_long(scene, limit, normals)
        room = most - len(scene.triangles)
        if len(numbers) == 0 or room <= 0:
            break
        # An edge between two triangles makes two more of them.
        longest = np.argsort(-lengths, kind="stable")[: max(room // 2, 1)]
        scene = _split(scene, numbers[longest])
    return scene


def _edges(scene: Scene) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """For each side of each triangle the number of its edge, (t, 3); and of each edge the places of its ends."""
    _, place = np.unique(scene.vertices, axis=0, return_inverse=True)
    corners = place.reshape(-1)[scene.triangles]
    ends = np.sort(np.stack([corners, np.roll(corners, -1, axis=1)], -1), axis=2).reshape(-1, 2)
    edges, number = np.unique(ends, axis=0, return_inverse=True)
    return number.reshape(-1, 3), edges


def _too_long(scene: Scene, limit: float, normals: str) -> tuple[NDArray[np.intp], NDArray[np.float64]]:
    """The edges to be split, and their lengths."""
    core = scene.traced(scene.camera.position)
    rows = core.vertices(scene.triangles, shading=normals, normals=scene.normals)
    number, edges = _edges(scene)
    apart = np.zeros(len(edges))
    for pairs, own in _pairs(rows, number):
        contrast = DirectPass(core, rows, columns=_COLUMNS, edge_side=0).contrast(pairs)
        np.maximum.at(apart, own, contrast)
    p = scene.vertices[scene.triangles]
    areas = 0.5 * np.linalg.norm(np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]), axis=1)
    around = np.bincount(number.reshape(-1), np.repeat(areas, 3), len(edges)) / areas.sum()
    length = np.zeros(len(edges))
    length[number.reshape(-1)] = np.linalg.norm(np.roll(p, -1, axis=1) - p, axis=2).reshape(-1)
    found = np.flatnonzero(apart * np.sqrt(around) > limit)
    return found, length[found]


def _pairs(rows: Receivers, number: NDArray[np.intp]) -> list[tuple[NDArray[np.uint32], NDArray[np.intp]]]:
    """The rows at the ends of each side of each triangle, where there are any, and the edges that they belong to."""
    sides = rows.corners.reshape(-1, 2, 3)
    pairs = np.stack([sides, np.roll(sides, -1, axis=2)], -1)
    there = (sides != np.iinfo(np.uint32).max).all(axis=2)
    own = np.broadcast_to(number[:, None, :], sides.shape)
    return [(np.ascontiguousarray(pairs[there].reshape(-1, 2)), own[there].reshape(-1))]


def _split(scene: Scene, chosen: NDArray[np.intp]) -> Scene:
    """The scene with the middles of some edges as vertices."""
    number, edges = _edges(scene)
    asked = np.zeros(len(edges), bool)
    asked[chosen] = True
    cut = asked[number]
    # A middle for each side that is cut; the two triangles at it may have vertices of their own there.
    ends = np.stack([scene.triangles, np.roll(scene.triangles, -1, axis=1)], -1)
    low, high = np.sort(ends[cut], axis=1).T
    both, of = np.unique(np.stack([low, high], -1), axis=0, return_inverse=True)
    middle = np.zeros(cut.shape, np.int64)
    middle[cut] = len(scene.vertices) + of.reshape(-1)

    def mean(array: np.ndarray) -> np.ndarray:
        return np.concatenate([array, 0.5 * (array[both[:, 0]] + array[both[:, 1]])])

    a, b, c = scene.triangles.T.astype(np.int64)
    ab, bc, ca = middle.T
    made: list[NDArray[np.int64]] = []
    parent: list[NDArray[np.intp]] = []
    for case in range(8):
        here = np.flatnonzero((cut * (1, 2, 4)).sum(axis=1) == case)
        for corners in _PATTERNS[case]:
            names = {"a": a, "b": b, "c": c, "x": ab, "y": bc, "z": ca}
            made.append(np.stack([names[corner][here] for corner in corners], -1))
            parent.append(here)
    triangles, of_triangle = np.concatenate(made), np.concatenate(parent)
    order = np.argsort(of_triangle, kind="stable")
    return replace(
        scene,
        vertices=mean(scene.vertices),
        triangles=triangles[order].astype(np.uint32),
        material=scene.material[of_triangle[order]],
        uv=None if scene.uv is None else mean(scene.uv),
        normals=None if scene.normals is None else mean(scene.normals),
        colours=None if scene.colours is None else mean(scene.colours),
        tangents=None if scene.tangents is None else mean(scene.tangents),
        opacity=None if scene.opacity is None else mean(scene.opacity),
    )


_PATTERNS = {
    0: ("abc",),
    1: ("axc", "xbc"),
    2: ("aby", "ayc"),
    4: ("abz", "zbc"),
    3: ("xby", "axy", "ayc"),
    6: ("zyc", "abz", "byz"),
    5: ("axz", "xbz", "zbc"),
    7: ("axz", "xby", "zyc", "xyz"),
}
"""Triangles in the place of one with corners a, b, c, by which sides are cut (1: ab, 2: bc, 4: ca), at x, y, z."""
