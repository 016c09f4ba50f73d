"""The texels of a cubemap: where they lie, and how much of the sphere each covers."""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray

from ..checks import read_only

__all__ = ["texel_directions", "texel_solid_angles"]


@cache
def texel_directions(size: int) -> NDArray[np.float64]:
    """Unit vectors to the middles of texels, row by row, face after face (+X, -X, +Y, -Y, +Z, -Z): (6 size^2, 3)."""
    at = (2 * np.arange(size) + 1) / size - 1
    t, s = np.meshgrid(at, at, indexing="ij")
    one = np.ones_like(s)
    faces = [(one, -t, -s), (-one, -t, s), (s, one, t), (s, -one, -t), (s, -t, one), (-s, -t, -one)]
    points = np.stack([np.stack(face, -1) for face in faces]).reshape(-1, 3)
    return read_only(points / np.linalg.norm(points, axis=1, keepdims=True))


@cache
def texel_solid_angles(size: int) -> NDArray[np.float64]:
    """Solid angles of the same texels: (6 size^2,), 4 pi in all."""
    edge = 2 * np.arange(size + 1) / size - 1
    x, y = np.meshgrid(edge, edge)
    # Of the rectangle from the middle of a face to a corner.
    corner = np.arctan2(x * y, np.sqrt(x * x + y * y + 1))
    face = corner[1:, 1:] + corner[:-1, :-1] - corner[1:, :-1] - corner[:-1, 1:]
    return read_only(np.tile(face.ravel(), 6))
