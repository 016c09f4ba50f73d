"""Checks of arguments: what cannot be used is refused in a sentence, and what can comes back in its plain type."""

from __future__ import annotations

import math
import operator
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt
from numpy.typing import NDArray

from .mistakes import near

Scalar = TypeVar("Scalar", bound=np.generic)
Vector = tuple[float, float, float]


def read_only(array: NDArray[Scalar]) -> NDArray[Scalar]:
    """The array itself, which nobody can change any more."""
    array.flags.writeable = False
    return array


def one_of(name: str, value: Any, choices: tuple[str | None, ...]) -> None:
    """Refuses a value that is none of the choices."""
    if not (value is None or isinstance(value, str)) or value not in choices:
        known = ", ".join(map(repr, choices))
        raise ValueError(f"expected {name} to be one of {known}, got {value!r}{near(value, choices)}")


def count(name: str, value: Any) -> int:
    """A whole number of 0 or more; a truth value is none."""
    try:
        number = operator.index(value)
    except TypeError:
        number = -1
    if number < 0 or isinstance(value, bool):
        raise ValueError(f"expected {name} to be a whole number of 0 or more, got {value!r}")
    return number


def amount(name: str, value: Any) -> float:
    """A finite number of 0 or more."""
    try:
        number = float(value)
    except (TypeError, ValueError):
        number = math.nan
    if not 0.0 <= number < math.inf:
        raise ValueError(f"expected {name} to be a finite number of 0 or more, got {value!r}")
    return number


def real_array(name: str, values: npt.ArrayLike, dtype: npt.DTypeLike) -> np.ndarray:
    """The values as an array of `dtype`, or a ValueError for ragged lists, text, complex numbers and booleans."""
    array = np.asarray(values)
    if array.dtype.kind not in "fiu":
        raise ValueError(f"{name} must be real numbers, got dtype {array.dtype}")
    return array.astype(dtype)


def as_vector(array: np.ndarray) -> Vector:
    """Three numbers as a tuple of floats."""
    x, y, z = (float(value) for value in array)
    return (x, y, z)
