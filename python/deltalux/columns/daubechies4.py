"""Daubechies-4 wavelets of BRDF curves."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NoReturn

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._core import CURVE, column_bands, daubechies4_forward, daubechies4_inverse
from ..checks import count
from .bands import bands_and_areas

if TYPE_CHECKING:
    from ..light.environment import Environment

__all__ = ["Daubechies4"]


@dataclass(frozen=True)
class Daubechies4:
    """Wavelets of curves of 256 samples, orthonormal on an interval: nothing leaks from one end to the other.

    Columns are numbered band by band, coarse to fine; in each band those of the first factor come first. A band is a
    level, or of the three finest the eighth of it at the highlight, the next eighth, or the rest.

    Parameters
    ----------
    factors
        So many functions that a curve may be multiplied by, each with 256 columns: V is an outer product. At most 16.

    Raises
    ------
    ValueError
        If their number is no such one.
    """

    factors: int = 1

    def __post_init__(self) -> None:
        object.__setattr__(self, "factors", count("factors", self.factors))
        column_bands(str(self))

    def __str__(self) -> str:
        return f"d4:{self.factors}"

    @property
    def columns(self) -> int:
        """How many columns there are: 256 for each factor."""
        return self.factors * CURVE

    @property
    def bands(self) -> NDArray[np.intp]:
        """The band of every column, 0 the coarsest: (columns,), ascending, read-only."""
        return bands_and_areas(str(self))[0]

    @property
    def areas(self) -> NDArray[np.float64]:
        """Samples of the curve under every column: (columns,) float64, read-only."""
        return bands_and_areas(str(self))[1]

    @property
    def band_names(self) -> tuple[str, ...]:
        """Each band by the samples under its wavelets; coarse to fine."""
        count = int(self.bands[-1]) + 1
        return tuple(f"{self.areas[k]:,.0f}" for k in np.searchsorted(self.bands, np.arange(count)))

    @property
    def band_label(self) -> str:
        """What the names of bands are, as the label of an axis."""
        return "Samples under a wavelet"

    def forward(self, curves: ArrayLike) -> NDArray[np.float64]:
        """Coefficients of curves, of one factor.

        Parameters
        ----------
        curves : (256, k) real
            Samples, one curve a column.

        Returns
        -------
        (256, k) float64
            Band by band.

        Raises
        ------
        ValueError
            If the shape is wrong.
        """
        return daubechies4_forward(np.ascontiguousarray(curves, np.float64))

    def inverse(self, coefficients: ArrayLike) -> NDArray[np.float64]:
        """Curves of coefficients, of one factor.

        Parameters
        ----------
        coefficients : (256, k) real
            As `forward` gives them.

        Returns
        -------
        (256, k) float64
            Samples.

        Raises
        ------
        ValueError
            If the shape is wrong.
        """
        return daubechies4_inverse(np.ascontiguousarray(coefficients, np.float64))

    def product(self, weights: ArrayLike, coefficients: ArrayLike) -> NDArray[np.float64]:
        """V: the outer product of what factors are weighted by and the coefficients of a curve, colour by colour.

        Parameters
        ----------
        weights : (factors, k) real
            Of each factor.
        coefficients : (256, k) real
            As `forward` gives them.

        Returns
        -------
        (columns, k) float64
            Band by band.

        Raises
        ------
        ValueError
            If a shape is wrong.
        """
        of_factor, of_curve = np.asarray(weights, np.float64), np.asarray(coefficients, np.float64)
        if of_factor.shape != (self.factors, *of_curve.shape[1:]) or of_curve.shape[:1] != (CURVE,):
            raise ValueError(
                f"expected weights ({self.factors}, k) and coefficients ({CURVE}, k), got {of_factor.shape} and "
                f"{of_curve.shape}"
            )
        outer = of_factor[:, None, :] * of_curve
        starts = column_bands(str(Daubechies4()))[0]
        bands = [outer[:, start:end] for start, end in zip(starts[:-1], starts[1:], strict=True)]
        return np.concatenate([band.reshape(-1, outer.shape[2]) for band in bands])

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
        raise ValueError(f"expected columns that light is measured in, but {self} are those of curves: dl.BrdfEditor")
