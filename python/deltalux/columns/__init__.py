"""Columns: the basis in which V is measured, its bands and the area of every column's support.

`Haar` wavelets on a cubemap, or `SphericalHarmonics`, for light; `Lamps` for pictures that were taken under one light
at a time; `Daubechies4` for curves of reflectance.
"""

from .daubechies4 import Daubechies4
from .haar import Haar
from .harmonics import SphericalHarmonics
from .lamps import Lamps
from .parse import Columns, parse

__all__ = ["Columns", "Daubechies4", "Haar", "Lamps", "SphericalHarmonics", "parse"]
