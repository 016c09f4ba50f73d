"""Rotations and directions: plain geometry that lights and columns share."""

from __future__ import annotations

import math
from numbers import Real

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .mistakes import described

Matrix = tuple[tuple[float, float, float], ...]


IDENTITY: Matrix = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


_AXES = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}


def rotation_matrix(degrees: float, axis: str | ArrayLike) -> NDArray[np.float64]:
    """The matrix of a rotation (Rodrigues); quarter turns about an axis of space are exact."""
    if not isinstance(degrees, Real):
        raise TypeError(f"expected an angle in degrees, and then an axis, got {described(degrees)}")
    if not math.isfinite(degrees):
        raise ValueError(f"expected a finite angle in degrees, got {degrees}")
    if isinstance(axis, str):
        if axis not in _AXES:
            raise ValueError(f"expected axis 'x', 'y', 'z' or a 3-vector, got {axis!r}")
        axis = _AXES[axis]
    vector = np.asarray(axis, np.float64)
    length = np.linalg.norm(vector) if vector.shape == (3,) else 0.0
    if not (np.isfinite(length) and length > 0):
        raise ValueError(f"expected axis 'x', 'y', 'z' or a 3-vector other than zero, got {axis!r}")
    x, y, z = vector / length
    quarters, rest = divmod(degrees % 360.0, 90.0)
    if rest == 0.0:
        cosine, sine = ((1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0))[int(quarters) % 4]
    else:
        cosine, sine = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    across = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) * cosine + sine * across + (1.0 - cosine) * np.outer((x, y, z), (x, y, z))


def as_matrix(matrix: NDArray[np.float64]) -> Matrix:
    """A rotation as nested tuples, made orthogonal again where products of rotations have drifted from it."""
    if np.abs(matrix @ matrix.T - np.eye(3)).max() > 1e-15:
        matrix = matrix @ (1.5 * np.eye(3) - 0.5 * matrix.T @ matrix)
    return tuple((float(a), float(b), float(c)) for a, b, c in matrix)


def unit_directions(directions: ArrayLike) -> NDArray[np.float64]:
    """Directions (..., 3) of any length, checked and made unit: (..., 3) float64, contiguous."""
    array = np.asarray(directions, np.float64)
    if array.ndim == 0 or array.shape[-1] != 3:
        raise ValueError(f"expected directions of shape (..., 3), got {array.shape}")
    length = np.linalg.norm(array, axis=-1, keepdims=True)
    if not np.all(np.isfinite(length) & (length > 0)):
        raise ValueError("expected finite directions other than (0, 0, 0)")
    unit: NDArray[np.float64] = np.ascontiguousarray(array / length)
    return unit
