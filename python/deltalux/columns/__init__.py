"""Columns: the basis in which V is measured, its bands and the area of every column's support.

`Haar` wavelets on a cubemap, or `SphericalHarmonics`.
"""

from .haar import Haar
from .harmonics import SphericalHarmonics
from .parse import Columns, parse

__all__ = ["Columns", "Haar", "SphericalHarmonics", "parse"]
