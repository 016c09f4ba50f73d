"""Distant light: an environment map, its rotation, and its blends, resampled to a cubemap when asked."""

from __future__ import annotations

import math
import operator
import os
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._core import (
    Behind,
    EnvironmentMap,
    environment_coefficients,
    environment_cubemap,
    environment_peaks,
    environment_radiance,
    harmonic_coefficients,
)
from ..checks import Vector, as_vector, count
from ..io import load_image
from ..rotation import IDENTITY, Matrix, as_matrix, rotation_matrix, unit_directions
from . import layouts, skies

_Layer = tuple[float, EnvironmentMap, Matrix]
"""A map, its weight in the sum, and how it is turned."""

_LARGEST_HALF = 65504.0
# The core's own limit, which it keeps as well.
_LARGEST_FACE = 2048


@dataclass(frozen=True)
class Peak:
    """A small bright light of an environment.

    Attributes
    ----------
    direction
        Towards it, of length 1.
    flux
        Its radiance times its solid angle in red, green and blue: the irradiance of a surface that faces it.
    """

    direction: Vector
    flux: Vector


class Environment:
    """Distant light of any kind: linear RGB radiance for every direction. Immutable.

    Made by `load`, `builtin`, `from_latlong` or `from_cubemap`; `rotated`, `mixed` and `scaled` make new ones, which
    share the maps. Axes are right-handed with +Y up. Lat-long images have u = atan2(x, -z) / 2π and v = acos(y) / π
    (Mitsuba's and OpenEXR's convention); cubemaps have the faces +X, -X, +Y, -Y, +Z, -Z in OpenGL's orientation.

    Attributes
    ----------
    name : str
        Where the light comes from, for titles and reports.

    Raises
    ------
    TypeError
        If it is called: the functions above make one.
    """

    __slots__ = ("_layers", "name")

    _layers: tuple[_Layer, ...]
    name: str

    def __init__(self) -> None:
        raise TypeError("use Environment.load, .builtin, .from_latlong or .from_cubemap")

    @classmethod
    def _of(cls, layers: Sequence[_Layer], name: str) -> Environment:
        self = object.__new__(cls)
        object.__setattr__(self, "_layers", tuple(layers))
        object.__setattr__(self, "name", name)
        return self

    def __setattr__(self, name: str, value: object) -> None:
        raise AttributeError("an Environment cannot be changed; rotated, mixed and scaled make new ones")

    def __repr__(self) -> str:
        return f"Environment({self.name!r})"

    @classmethod
    def load(cls, path: str | os.PathLike[str], layout: str | None = None, repair: str | None = None) -> Environment:
        """Read a .hdr or .exr file (or any image; 8-bit images are taken for sRGB).

        Parameters
        ----------
        path
            The file.
        layout
            ``"latlong"``, ``"vertical-cross"``, ``"horizontal-cross"``, ``"angular"`` (Debevec's light probe) or
            ``"cube"`` (a strip of six faces). Without it the EXR attribute ``envmap`` decides, then the proportions:
            2:1, 3:4, 4:3, 1:1 and 6:1 or 1:6. Crosses and probes look along -Z in their middle, +X to the right.
        repair
            ``"zero"`` turns NaN and infinite pixels black, with a warning that counts them.

        Returns
        -------
        Environment
            Its name is the file's.

        Raises
        ------
        FileNotFoundError, OSError
            The file cannot be opened.
        FileError
            It is not an image, or is truncated. A ``ValueError``.
        ValueError
            The layout is not recognised, or pixels are NaN or infinite (count, row and column of the first).
        """
        image, metadata = load_image(path)
        envmap = metadata.get("envmap")
        height, width = image.shape[:2]
        try:
            kind = layouts.recognise(width, height, envmap) if layout is None else layout
            pixels = layouts.convert(_finite(image, repair, halves="half" in metadata["format"]), kind, envmap)
        except ValueError as error:
            raise ValueError(f"{os.fspath(path)}: {error}") from None
        return cls._from_pixels(pixels, os.path.basename(os.fspath(path)))

    @classmethod
    def builtin(cls, name: str) -> Environment:
        """A procedural light.

        ``"sky"`` is a clear sky with a sun of true size and radiance (its dynamic range is above 1e5), ``"studio"`` a
        few small bright lamps on black, ``"hall"`` an interior with tall windows and many lamps.

        Parameters
        ----------
        name
            ``"sky"``, ``"studio"`` or ``"hall"``.

        Returns
        -------
        Environment
            The same object for the same name.

        Raises
        ------
        ValueError
            If there is no such light.
        """
        return _builtin(name)

    @classmethod
    def from_latlong(cls, array: ArrayLike, repair: str | None = None) -> Environment:
        """Light from a lat-long image.

        Parameters
        ----------
        array : (h, w, 3) real
            Linear RGB radiance; row 0 is at +Y, the middle column at +Z.
        repair
            As for `load`.

        Returns
        -------
        Environment
            It holds a copy in float32.

        Raises
        ------
        ValueError
            If the shape or the type is wrong, or pixels are NaN or infinite in float32.
        """
        pixels = _floats(array)
        if pixels.ndim != 3 or pixels.shape[2] != 3 or 0 in pixels.shape:
            raise ValueError(f"expected a lat-long image of shape (h, w, 3), got {pixels.shape}")
        return cls._from_pixels(_finite(pixels, repair), "lat-long array")

    @classmethod
    def from_cubemap(cls, array: ArrayLike, repair: str | None = None) -> Environment:
        """Light from the six faces of a cubemap, constant over each texel.

        Parameters
        ----------
        array : (6, n, n, 3) real
            Linear RGB radiance; faces +X, -X, +Y, -Y, +Z, -Z in OpenGL's orientation.
        repair
            As for `load`.

        Returns
        -------
        Environment
            It holds a copy in float32.

        Raises
        ------
        ValueError
            If the shape or the type is wrong, or pixels are NaN or infinite in float32.
        """
        pixels = _floats(array)
        if pixels.ndim != 4 or pixels.shape != (6, pixels.shape[1], pixels.shape[1], 3) or 0 in pixels.shape:
            raise ValueError(f"expected a cubemap of shape (6, n, n, 3), got {pixels.shape}")
        return cls._from_pixels(_finite(pixels, repair), "cubemap array")

    @classmethod
    def _from_pixels(cls, pixels: NDArray[np.float32], name: str) -> Environment:
        make = EnvironmentMap.from_latlong if pixels.ndim == 3 else EnvironmentMap.from_cubemap
        return cls._of([(1.0, make(np.ascontiguousarray(pixels)), IDENTITY)], name)

    def rotated(self, degrees: float, axis: str | ArrayLike = "y") -> Environment:
        """The light turned about an axis by the right-hand rule: L'(d) = L(R⁻¹ d).

        Turns are multiplied and no map is resampled until it is asked for, so that turns of turns lose nothing.

        Parameters
        ----------
        degrees
            Of the turn; quarter turns about an axis of space are exact.
        axis
            ``"x"``, ``"y"``, ``"z"`` or a 3-vector of any length.

        Returns
        -------
        Environment
            A new one, which shares the maps.

        Raises
        ------
        ValueError
            If the angle is not finite, or the axis is none.
        """
        turn = rotation_matrix(degrees, axis)
        layers = [(weight, light, as_matrix(turn @ np.array(own))) for weight, light, own in self._layers]
        return self._of(layers, self.name)

    def mixed(self, other: Environment, t: float) -> Environment:
        """The blend (1 - t) self + t other.

        Parameters
        ----------
        other
            The light that stands at t = 1.
        t
            Any finite number: beyond 0 and 1 the blend goes on as a line.

        Returns
        -------
        Environment
            A new one, which shares the maps.

        Raises
        ------
        TypeError
            If the other is no environment.
        ValueError
            If t is not finite.
        """
        if not isinstance(other, Environment):
            raise TypeError(f"expected an Environment to mix with, got {type(other).__name__}")
        if not math.isfinite(t):
            raise ValueError(f"expected a finite t, got {t}")
        layers = (*self.scaled(1.0 - t)._layers, *other.scaled(t)._layers)
        return self._of(layers, f"{self.name} and {other.name}")

    def scaled(self, factor: float) -> Environment:
        """The light times a factor.

        Parameters
        ----------
        factor
            Any finite number.

        Returns
        -------
        Environment
            A new one, which shares the maps.

        Raises
        ------
        ValueError
            If the factor is not finite.
        """
        if not math.isfinite(factor):
            raise ValueError(f"expected a finite factor, got {factor}")
        return self._of([(weight * factor, light, turn) for weight, light, turn in self._layers], self.name)

    def cubemap(self, size: int) -> NDArray[np.float32]:
        """Radiance averaged over a cubemap's texels.

        Unrotated, the average is exact; rotated, it is interpolated with positive weights. Constants stay constant, and
        bright lights, however small, keep their flux under every rotation (``rust/light/environment.rs`` says how).

        Parameters
        ----------
        size
            Texels along an edge of a face, 1 to 2048.

        Returns
        -------
        (6, size, size, 3) float32
            Linear RGB radiance; faces +X, -X, +Y, -Y, +Z, -Z in OpenGL's orientation.

        Raises
        ------
        ValueError
            If the size is out of range.
        """
        size = operator.index(size)
        if not 1 <= size <= _LARGEST_FACE:
            raise ValueError(f"expected a cubemap face of 1 to {_LARGEST_FACE} texels, got {size}")
        cubemap: NDArray[np.float32] = environment_cubemap(self._layers, size)
        return cubemap

    def peaks(self, k: int = 128, size: int = 64) -> list[Peak]:
        """Suns and lamps: the small bright lights that columns with texels take out of the wavelets.

        They are found once for each map, in what of it lies above four times its mean, and turn with it. What is
        smaller than a texel is one peak; a window is as many as it covers texels. A peak below 0.02 % of the map's flux
        is none.

        Parameters
        ----------
        k
            How many of each map of a blend, at most; there are never more than 256.
        size
            Texels along a face of the cubemap: how near lights are one.

        Returns
        -------
        list of Peak
            The largest first.

        Raises
        ------
        ValueError
            If a number is no whole one, or the size no power of two up to 512.
        """
        directions, fluxes = environment_peaks(self._layers, count("size", size), count("k", k))
        order = np.argsort(-np.abs(fluxes).max(axis=1, initial=0.0), kind="stable")
        return [Peak(as_vector(directions[i]), as_vector(fluxes[i])) for i in order]

    def radiance(self, directions: ArrayLike) -> NDArray[np.float32]:
        """Radiance from directions: what a camera sees behind the scene.

        Parameters
        ----------
        directions : (..., 3) real
            Towards the light, of any length.

        Returns
        -------
        (..., 3) float32
            Linear RGB radiance, interpolated between the pixels of the maps.

        Raises
        ------
        ValueError
            If the shape is wrong, or a direction is zero or not finite.
        """
        unit = unit_directions(directions)
        radiance: NDArray[np.float32] = environment_radiance(self._layers, unit.reshape(-1, 3))
        return radiance.reshape(unit.shape)

    def _behind(self, behind: Behind, picture: NDArray[np.float32]) -> None:
        """Adds to a picture (h, w, 3) what is seen of the light behind it, in place."""
        behind.add(self._layers, picture)

    # Light projects itself: columns ask for these two, and know nothing of maps and turns.

    def _haar(self, size: int, peaks: int | None = None) -> NDArray[np.float64]:
        """`Haar.coefficients`: the light in wavelets on faces of `size` x `size` texels, and its peaks in texels."""
        return environment_coefficients(self._layers, size, peaks)

    def _harmonics(self, order: int) -> NDArray[np.float64]:
        """`SphericalHarmonics.coefficients`: what the light is in harmonics of the degrees below `order`."""
        return harmonic_coefficients(self._layers, order)


@cache
def _builtin(name: str) -> Environment:
    """One map for all who ask: what is prepared for resampling is then shared as well."""
    if name not in skies.BUILTIN:
        raise ValueError(f"expected a built-in environment of {', '.join(skies.BUILTIN)}, got {name!r}")
    return Environment._from_pixels(skies.BUILTIN[name](), name)


def _floats(array: ArrayLike) -> NDArray[np.float32]:
    """The array as float32; what float32 cannot hold becomes infinite and is reported as such."""
    pixels = np.asarray(array)
    if pixels.dtype.kind not in "fiu":
        raise ValueError(f"expected an array of real numbers, got dtype {pixels.dtype}")
    with np.errstate(over="ignore"):
        return pixels.astype(np.float32)


def _finite(pixels: NDArray[np.float32], repair: str | None, halves: bool = False) -> NDArray[np.float32]:
    """Refuse or, on request, blacken pixels that are not finite; warn of negative ones, which are kept."""
    if repair not in (None, "zero"):
        raise ValueError(f'expected repair=None or "zero", got {repair!r}')
    bad = np.asarray(~np.isfinite(pixels).all(axis=-1))
    if bad.any():
        first = np.argwhere(bad)[0]
        where = f"row {first[-2]}, column {first[-1]}" + (f" of face {first[0]}" if bad.ndim == 3 else "")
        what = f"{np.count_nonzero(bad)} pixels are NaN or infinite, the first at {where}"
        if np.isinf(pixels).any():
            limit = f"half floats end at {_LARGEST_HALF:g}" if halves else "the file or array may have overflowed"
            what += f" (infinite ones: {limit})"
        if repair is None:
            raise ValueError(f'{what}; repair="zero" makes them black')
        warnings.warn(f"{what}; they are taken as black", stacklevel=3)
        pixels = np.where(bad[..., None], np.float32(0), pixels)
    negative = np.count_nonzero((pixels < 0).any(axis=-1))
    if negative:
        what = f"{negative} pixels are negative (ringing of compression or filters?)"
        warnings.warn(f"{what}; they are kept", stacklevel=3)
    return pixels
