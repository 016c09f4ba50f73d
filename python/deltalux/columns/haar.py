"""Haar wavelets on a cubemap."""

from __future__ import annotations

import operator
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from .._core import column_bands, haar_without_texels
from ..checks import count
from ..mistakes import instead_of
from ..sphere import texel_solid_angles
from .bands import bands_and_areas

if TYPE_CHECKING:
    from ..light.environment import Environment

PEAKS = 128
"""Peaks of a map that are sent through texels, where nothing else is said."""


def blocks_under(columns: Haar, chosen: NDArray[np.uint32], band: int) -> NDArray[np.int64]:
    """Which of the 6 x 4^band blocks of a band of wavelets lie under those of some columns that are in it.

    Band 0 begins with the six scaling functions; then, as in all bands, three wavelets a block, face by face.
    """
    own = chosen[columns.bands[chosen] == band].astype(np.int64) - np.searchsorted(columns.bands, band)
    return np.asarray(np.where(own < 6, own, (own - 6) // 3) if band == 0 else own // 3)


@dataclass(frozen=True)
class Haar:
    """2D Haar wavelets on the six faces of a cubemap, orthonormal on the sphere.

    Columns are numbered band by band, coarse to fine. Band 0 holds the scaling functions and the coarsest wavelets.

    Parameters
    ----------
    size
        Texels along an edge of a face: a power of two, at most 512.
    texels
        Whether the texels themselves follow as columns, in one band more. Then suns and lamps are taken out of the
        wavelets, and go through transport that is not truncated.

    Raises
    ------
    ValueError
        If the size is not such a number.
    """

    size: int
    texels: bool = False

    def __post_init__(self) -> None:
        try:
            object.__setattr__(self, "size", operator.index(self.size))
        except (TypeError, AttributeError):
            raise ValueError(f"a Haar cubemap face must be a whole number of texels wide, got {self.size!r}") from None
        if self.size < 1:
            raise ValueError(f"a Haar cubemap face must be at least 1 texel wide, got {self.size}")
        column_bands(str(self))

    def __str__(self) -> str:
        return f"haar:{self.size}+texels" if self.texels else f"haar:{self.size}"

    @property
    def columns(self) -> int:
        """How many columns there are: 6 size^2, and as many texels."""
        return 2 * self.wavelets if self.texels else self.wavelets

    @property
    def wavelets(self) -> int:
        """How many of the columns are wavelets, which come first: 6 size^2."""
        return 6 * self.size**2

    @property
    def face(self) -> int:
        """Texels along a face of the cubemap that receivers look at: the size."""
        return self.size

    # Properties, and the cache beside them: a type checker does not take a `cached_property` for a property, which is
    # what `Approximation` asks of columns.

    @property
    def bands(self) -> NDArray[np.intp]:
        """The band of every column, 0 the coarsest: (columns,), ascending, read-only."""
        return bands_and_areas(str(self))[0]

    @property
    def areas(self) -> NDArray[np.float64]:
        """Texels under the support of every column: (columns,) float64, read-only.

        Of a texel column it is the size: a face's mean, over size^2 texels, sends receivers size times as much.
        """
        return bands_and_areas(str(self))[1]

    @property
    def solid_angles(self) -> NDArray[np.float64]:
        """Solid angles of the cubemap's texels, row by row, face after face: (wavelets,) float64, read-only."""
        return texel_solid_angles(self.size)

    @cached_property
    def band_names(self) -> tuple[str, ...]:
        """Each band by the texels under its wavelets, as the papers name them; coarse to fine."""
        wavelets = int(self.bands[-1]) + (not self.texels)
        names = (f"{(self.size >> band) ** 2:,}" for band in range(wavelets))
        return (*names, "texels") if self.texels else tuple(names)

    @property
    def band_label(self) -> str:
        """What the names of bands are, as the label of an axis."""
        return "Texels under a wavelet"

    def coefficients(self, env: Environment, peaks: int | None = None) -> NDArray[np.float64]:
        """V: what the environment's radiance is in these columns.

        Parameters
        ----------
        env
            The light; averaged over the texels of the cubemap first.
        peaks
            Where there are texels: so many of each map's largest peaks, at most, are sent through them
            (`Environment.peaks`); None: 128.

        Returns
        -------
        (columns, 3) float64
            The integral over the sphere of radiance times the orthonormal wavelet; its square sums to the integral of
            the squared radiance. In texels: radiance times the root of the solid angle, of the peaks alone.

        Raises
        ------
        TypeError
            If it is no environment.
        ValueError
            If the number of peaks is negative, or there are no texels to send peaks through.
        """
        if not hasattr(env, "_haar"):
            raise instead_of("Environment", env)
        if not self.texels:
            if peaks is not None:
                raise ValueError(f"expected columns with texels to send peaks through, got {self}")
            return env._haar(self.size)
        return env._haar(self.size, PEAKS if peaks is None else count("peaks", peaks))

    def without_texels(self, V: NDArray[np.float64]) -> NDArray[np.float64]:
        """The same light in wavelets alone, however it was split.

        Parameters
        ----------
        V
            (columns, 3) float64.

        Returns
        -------
        (wavelets, 3) float64
            V itself where there are no texels.

        Raises
        ------
        ValueError
            If the shape is not that of these columns.
        """
        return haar_without_texels(self.size, V) if self.texels else V
