"""Bands and areas of columns by the name that the core knows them by."""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray

from .._core import column_bands
from ..checks import read_only

__all__ = ["bands_and_areas"]


@cache
def bands_and_areas(name: str) -> tuple[NDArray[np.intp], NDArray[np.float64]]:
    """The band of every column, and its area: (columns,) each, read-only and shared."""
    starts, areas = column_bands(name)
    return read_only(np.repeat(np.arange(len(starts) - 1), np.diff(starts))), read_only(areas)
