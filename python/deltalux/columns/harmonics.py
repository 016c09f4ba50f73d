"""Spherical harmonics."""

from __future__ import annotations

import operator
from dataclasses import dataclass
from functools import cache, cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._core import column_bands, harmonic_projection, harmonic_rotation, harmonic_values, harmonic_window
from ..checks import read_only
from ..mistakes import instead_of
from ..rotation import rotation_matrix, unit_directions

if TYPE_CHECKING:
    from ..light.environment import Environment


@dataclass(frozen=True)
class SphericalHarmonics:
    """Real, orthonormal spherical harmonics of the degrees l = 0 to order - 1.

    The polar axis is +Z and there is no Condon-Shortley sign: Y_l^m is proportional to P_l^m(z) cos(m phi) for m >= 0
    and to ``P_l^|m|(z) sin(|m| phi)`` for m < 0, phi = atan2(y, x); Y_1 is sqrt(3 / 4 pi) (y, z, x). Column l^2 + l + m
    is Y_l^m, so that a lower order is the first columns of a higher one. In terms of scipy, with theta = acos(z):
    (-1)^m sqrt(2) Re of ``sph_harm_y(l, m, theta, phi)`` for m > 0, that itself for m = 0, and (-1)^m sqrt(2) Im of
    ``sph_harm_y(l, -m, theta, phi)`` for m < 0.

    Parameters
    ----------
    order
        Degrees, from 1 to 30; order^2 columns.

    Raises
    ------
    ValueError
        If the order is not such a number.
    """

    order: int

    def __post_init__(self) -> None:
        try:
            object.__setattr__(self, "order", operator.index(self.order))
        except TypeError:
            raise ValueError(f"an order of spherical harmonics must be a whole number, got {self.order!r}") from None
        if self.order < 1:
            raise ValueError(f"an order of spherical harmonics must be at least 1, got {self.order}")
        column_bands(str(self))

    def __str__(self) -> str:
        return f"sh:{self.order}"

    @property
    def columns(self) -> int:
        """How many columns there are: order^2."""
        return self.order**2

    @property
    def face(self) -> int:
        """Texels along a face of the cubemap that receivers look at and light is projected from: 64."""
        return 64

    # Properties, and the cache beside them, as in `Haar`.

    @property
    def bands(self) -> NDArray[np.intp]:
        """The degree l of every column: (columns,), ascending, read-only."""
        return _bands_and_areas(self.order)[0]

    @property
    def areas(self) -> NDArray[np.float64]:
        """1 for every column, since all cover the whole sphere: (columns,) float64, read-only."""
        return _bands_and_areas(self.order)[1]

    @cached_property
    def band_names(self) -> tuple[str, ...]:
        """Each band by its degree l."""
        return tuple(str(degree) for degree in range(self.order))

    @property
    def band_label(self) -> str:
        """What the names of bands are, as the label of an axis."""
        return "Degree of a harmonic"

    def coefficients(self, env: Environment) -> NDArray[np.float64]:
        """V: what the environment's radiance is in these columns.

        Each map of the environment is projected once, unrotated, as a cubemap with 64 x 64 texels a face; its rotation
        then turns the coefficients (Ivanic and Ruedenberg 1996), always those of the original.

        Parameters
        ----------
        env
            The light.

        Returns
        -------
        (columns, 3) float64
            The integral over the sphere of radiance times each function.

        Raises
        ------
        TypeError
            If it is no environment.
        """
        if not hasattr(env, "_harmonics"):
            raise instead_of("Environment", env)
        return env._harmonics(self.order)

    def project(self, cubemap: ArrayLike) -> NDArray[np.float64]:
        """The coefficients of a cubemap that is constant over each texel.

        Parameters
        ----------
        cubemap : (6, n, n, 3) real
            Faces +X, -X, +Y, -Y, +Z, -Z in OpenGL's orientation; n is even.

        Returns
        -------
        (columns, 3) float64
            The integral over the sphere of the map times each function.

        Raises
        ------
        ValueError
            If the shape is wrong, or n is odd.
        """
        faces = np.ascontiguousarray(cubemap, np.float32)
        if faces.ndim != 4 or faces.shape != (6, faces.shape[1], faces.shape[1], 3):
            raise ValueError(f"expected a cubemap of shape (6, n, n, 3), got {faces.shape}")
        return harmonic_projection(self.order, faces)

    def evaluate(self, directions: ArrayLike) -> NDArray[np.float64]:
        """All functions in directions; ``evaluate(directions) @ V`` is the light that the coefficients V describe.

        Parameters
        ----------
        directions : (..., 3) real
            Of any length.

        Returns
        -------
        (..., columns) float64
            Y_l^m in column l^2 + l + m.

        Raises
        ------
        ValueError
            If the shape is wrong, or a direction is zero or not finite.
        """
        unit = unit_directions(directions)
        return harmonic_values(self.order, unit.reshape(-1, 3)).reshape(*unit.shape[:-1], self.columns)

    def rotated(self, V: ArrayLike, degrees: float, axis: str | ArrayLike = "y") -> NDArray[np.float64]:
        """The coefficients of the light turned about an axis, as `Environment.rotated` turns it.

        Turn the original coefficients by the whole angle every frame: turns of turns add up their rounding. (Ivanic and
        Ruedenberg 1996, with the corrections of 1998.)

        Parameters
        ----------
        V : (columns, 3) real
            The light before.
        degrees
            Of the turn, by the right-hand rule.
        axis
            ``"x"``, ``"y"``, ``"z"`` or a 3-vector of any length.

        Returns
        -------
        (columns, 3) float64
            The light after.

        Raises
        ------
        ValueError
            If the shape is wrong, the angle is not finite, or the axis is none.
        """
        return harmonic_rotation(self._checked(V), rotation_matrix(degrees, axis).tolist())

    def windowed(self, V: ArrayLike, width: float | None = None) -> NDArray[np.float64]:
        """The coefficients under a Hanning window, degree l times cos^2(pi l / 2 width): less ringing, less sharp.

        Parameters
        ----------
        V : (columns, 3) real
            The light.
        width
            In degrees l, from which on all is 0; by default the order.

        Returns
        -------
        (columns, 3) float64
            The light under the window.

        Raises
        ------
        ValueError
            If the shape is wrong, or the width is not a positive number.
        """
        return harmonic_window(self._checked(V), float(self.order if width is None else width))

    def _checked(self, V: ArrayLike) -> NDArray[np.float64]:
        array = np.ascontiguousarray(V, np.float64)
        if array.shape != (self.columns, 3):
            raise ValueError(f"expected coefficients of shape ({self.columns}, 3), got {array.shape}")
        return array


@cache
def _bands_and_areas(order: int) -> tuple[NDArray[np.intp], NDArray[np.float64]]:
    degrees = np.arange(order)
    return read_only(np.repeat(degrees, 2 * degrees + 1)), read_only(np.ones(order**2))
