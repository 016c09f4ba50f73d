"""Columns: the basis in which V is measured, its bands and the area of every column's support."""

from __future__ import annotations

import operator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import _core
from .environment import Environment

__all__ = ["Haar", "parse"]


@dataclass(frozen=True)
class Haar:
    """2D Haar wavelets on the six faces of a cubemap, orthonormal on the sphere.

    Columns are numbered band by band, coarse to fine. Band 0 holds the scaling functions and the coarsest wavelets.

    Parameters
    ----------
    size
        Texels along an edge of a face: a power of two, at most 512.

    Raises
    ------
    ValueError
        If the size is not such a number.
    """

    size: int

    def __post_init__(self) -> None:
        try:
            object.__setattr__(self, "size", operator.index(self.size))
        except TypeError:
            raise ValueError(f"a Haar cubemap face must be a whole number of texels wide, got {self.size!r}") from None
        if self.size < 1:
            raise ValueError(f"a Haar cubemap face must be at least 1 texel wide, got {self.size}")
        _core.column_bands(str(self))

    def __str__(self) -> str:
        return f"haar:{self.size}"

    @property
    def columns(self) -> int:
        """How many columns there are: 6 size^2."""
        return 6 * self.size**2

    @cached_property
    def bands(self) -> NDArray[np.intp]:
        """The band of every column, 0 the coarsest: (columns,), ascending, read-only."""
        starts, _ = _core.column_bands(str(self))
        return _read_only(np.repeat(np.arange(len(starts) - 1), np.diff(starts)))

    @cached_property
    def areas(self) -> NDArray[np.float64]:
        """Texels under the support of every column: (columns,) float64, read-only."""
        return _read_only(_core.column_bands(str(self))[1])

    def coefficients(self, env: Environment) -> NDArray[np.float64]:
        """V: what the environment's radiance is in these columns.

        Returns
        -------
        (columns, 3) float64
            The integral over the sphere of radiance times the orthonormal wavelet; its square sums to the integral of
            the squared radiance.
        """
        return _core.environment_coefficients(env._parts, self.size)


def parse(text: str) -> Haar:
    """Reads what ``str(columns)`` writes, such as ``"haar:64"``.

    Raises
    ------
    ValueError
        If the text names no columns.
    """
    kind, _, size = text.partition(":")
    if kind != "haar" or not (size.isascii() and size.isdigit()):
        raise ValueError(f'expected columns like "haar:64", got {text!r}')
    return Haar(int(size))


def _read_only(array: NDArray[Any]) -> NDArray[Any]:
    array.flags.writeable = False
    return array
