"""Directions of the pixels of light on the sphere: on the faces of a cube, whose angles are here too, and lat-long."""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray

from .checks import read_only

__all__ = ["FACES", "face_directions", "face_points", "latlong_directions", "texel_solid_angles"]

FACES = np.array(
    [
        [[0, 0, -1], [0, -1, 0], [1, 0, 0]],
        [[0, 0, 1], [0, -1, 0], [-1, 0, 0]],
        [[1, 0, 0], [0, 0, 1], [0, 1, 0]],
        [[1, 0, 0], [0, 0, -1], [0, -1, 0]],
        [[1, 0, 0], [0, -1, 0], [0, 0, 1]],
        [[-1, 0, 0], [0, -1, 0], [0, 0, -1]],
    ]
)
"""(right, down, out) of the faces +X, -X, +Y, -Y, +Z, -Z in OpenGL's orientation, which is the package's own."""


def face_points(n: int) -> NDArray[np.float64]:
    """Points on the faces of the cube [-1, 1]^3 behind the centres of n x n texels: (6, n, n, 3)."""
    along = (2 * np.arange(n) + 1 - n) / n
    right, down, out = (FACES[:, None, None, k].astype(np.float64) for k in range(3))
    return out + along[None, None, :, None] * right + along[None, :, None, None] * down


def face_directions(n: int) -> NDArray[np.float64]:
    """Unit directions of the centres of n x n texels a face: (6, n, n, 3)."""
    points = face_points(n)
    return np.asarray(points / np.linalg.norm(points, axis=-1, keepdims=True))


@cache
def texel_solid_angles(n: int) -> NDArray[np.float64]:
    """Solid angles of the same texels, face after face and row by row: (6 n^2,), 4 pi in all."""
    edge = 2 * np.arange(n + 1) / n - 1
    x, y = np.meshgrid(edge, edge)
    # Of the rectangle from the middle of a face to a corner.
    corner = np.arctan2(x * y, np.sqrt(x * x + y * y + 1))
    face = corner[1:, 1:] + corner[:-1, :-1] - corner[1:, :-1] - corner[:-1, 1:]
    return read_only(np.tile(face.ravel(), 6))


def latlong_directions(height: int, width: int) -> NDArray[np.float64]:
    """Unit directions of the pixel centres of a lat-long picture, row 0 at +Y, its middle column at +Z: (h, w, 3)."""
    theta = np.pi * (np.arange(height) + 0.5)[:, None] / height
    phi = 2 * np.pi * (np.arange(width) + 0.5) / width
    x, z = np.sin(theta) * np.sin(phi), -np.sin(theta) * np.cos(phi)
    return np.stack([x, np.broadcast_to(np.cos(theta), x.shape), z], axis=-1)
