"""Columns between two stages of a transport: what the second stage is multiplied by is no light, but a response."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NoReturn

import numpy as np
from numpy.typing import NDArray

from .._core import column_bands
from .bands import bands_and_areas
from .daubechies4 import Daubechies4
from .lamps import Lamps
from .parse import Columns, parse

if TYPE_CHECKING:
    from ..light.environment import Environment

__all__ = ["AnyColumns", "Inner", "parse_any"]

_KINDS = {"tree": "Samples under a wavelet", "representatives": "Means and representatives"}


@dataclass(frozen=True)
class Inner:
    """Haar wavelets over a tree of surface samples, or the representatives of clusters.

    Parameters
    ----------
    name
        ``"tree:4096"``, of so many samples, or ``"representatives:398x25"``, clusters by representatives of each.

    Raises
    ------
    ValueError
        If the name is none of these.
    """

    name: str

    def __post_init__(self) -> None:
        if self.name.partition(":")[0] not in _KINDS:
            raise ValueError(f'expected columns like "tree:4096" or "representatives:398x25", got {self.name!r}')
        column_bands(self.name)

    def __str__(self) -> str:
        return self.name

    @property
    def columns(self) -> int:
        """How many columns there are."""
        return len(self.areas)

    @property
    def bands(self) -> NDArray[np.intp]:
        """The band of every column, 0 the coarsest: (columns,), ascending, read-only."""
        return bands_and_areas(self.name)[0]

    @property
    def areas(self) -> NDArray[np.float64]:
        """Samples under the support of every column, or 1: (columns,) float64, read-only."""
        return bands_and_areas(self.name)[1]

    @property
    def band_names(self) -> tuple[str, ...]:
        """Each band by the samples under its wavelets; or the means of clusters, and their representatives."""
        count = int(self.bands[-1]) + 1
        if not self.name.startswith("tree"):
            return ("means", "representatives")[:count]
        return tuple(f"{self.areas[k]:,.0f}" for k in np.searchsorted(self.bands, np.arange(count)))

    @property
    def band_label(self) -> str:
        """What the names of bands are, as the label of an axis."""
        return _KINDS[self.name.partition(":")[0]]

    def coefficients(self, env: Environment) -> NoReturn:
        """Refuses: what is measured in these columns is no light.

        Parameters
        ----------
        env
            Any.

        Raises
        ------
        ValueError
            Always.
        """
        raise ValueError(f"expected columns that light is measured in, but {self} are those of a response")


AnyColumns = Columns | Inner | Daubechies4 | Lamps


def parse_any(text: str) -> AnyColumns:
    """Reads what ``str(columns)`` writes, of whatever columns.

    Parameters
    ----------
    text
        Such as ``"haar:64"``, ``"sh:20"``, ``"tree:4096"``, ``"d4:3"`` or ``"lamps:50"``, whose directions a name does
        not say.

    Returns
    -------
    Haar, SphericalHarmonics, Inner, Daubechies4 or Lamps

    Raises
    ------
    ValueError
        If the text names no columns.
    """
    kind, _, number = text.partition(":")
    if kind == "d4" and number.isascii() and number.isdigit():
        return Daubechies4(int(number))
    if kind == "lamps" and number.isascii() and number.isdigit():
        return Lamps.restored(int(number), {})
    return Inner(text) if kind in _KINDS else parse(text)
