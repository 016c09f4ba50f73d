"""Distant light: an environment map, its rotation, and its blends, resampled to a cubemap when asked."""

from __future__ import annotations

import math
import operator
import os
import warnings
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cache, lru_cache
from numbers import Real
from typing import Any, cast

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
from ..checks import Vector, as_vector, count, one_of, real_array
from ..images.encoded import encoded
from ..io import auto_exposure, load_image, to_display
from ..mistakes import checked_path, described, instead_of, kind_of, near, refuse_kind
from ..rotation import IDENTITY, Matrix, as_matrix, rotation_matrix, unit_directions
from ..sphere import latlong_directions
from . import discs, layouts, skies
from .pixels import floats, repaired

_Layer = tuple[Vector, EnvironmentMap, Matrix]
"""A map, its weight in the sum in each colour, and how it is turned."""

_WHITE = (1.0, 1.0, 1.0)

# The core's own limit, which it keeps as well.
_LARGEST_FACE = 2048

ROWS = ("centre", "edge")
"""Where the rows of a lat-long image lie."""


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

    Made by `load`, `builtin`, `from_latlong` or `from_cubemap`; `rotated`, `mixed`, `scaled` and `tinted` make new
    ones, as do ``env * 2``, ``env * (1, 0.9, 0.8)`` and ``env + other``. Axes are right-handed with +Y up. Lat-long
    images have u = atan2(x, -z) / 2π and v = acos(y) / π; cubemaps have the faces +X, -X, +Y, -Y, +Z, -Z in OpenGL's
    orientation.

    Where rows and columns of a lat-long image of h x w lie, against others' conventions:

    ========== ===================== ===================== ===========================================================
    whose      row i at v            column j at u         here
    ========== ===================== ===================== ===========================================================
    Mitsuba 3  i / (h - 1)           (j + 1/2) / w         ``rows="edge"``
    OpenEXR    i / (h - 1)           j / (w - 1)           ``rows="edge"``; columns differ by half a texel at most
    Blender    (i + 1/2) / h         (j + 1/2) / w         ``rows="centre"``; its middle is +X, ours +Z: `rotated` by 90
    ========== ===================== ===================== ===========================================================

    Files are taken to hold areas, as cameras, stitchers and Blender write them; arrays, points, as Mitsuba's bitmaps.

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

    def __init__(self, *_: object, **__: object) -> None:
        raise TypeError("use Environment.load(path), .builtin(name), .from_latlong(array) or .from_cubemap(array)")

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

    def _repr_png_(self) -> bytes:
        picture = self.radiance(latlong_directions(128, 256))
        return encoded(to_display(picture, auto_exposure(picture)))

    def __reduce__(self) -> tuple[Any, ...]:
        # A map that several layers share is pickled once: pickle knows arrays that it has seen.
        content = {id(light): light.pixels() for _, light, _ in self._layers}
        layers = [(weight, content[id(light)], turn) for weight, light, turn in self._layers]
        return _restored, (layers, self.name)

    def __copy__(self) -> Environment:
        return self

    def __deepcopy__(self, memo: dict[int, Any]) -> Environment:
        return self

    def __mul__(self, factor: float | ArrayLike) -> Environment:
        return self.scaled(float(factor)) if isinstance(factor, Real) else self.tinted(cast(ArrayLike, factor))

    __rmul__ = __mul__
    # Or an array would take each of its numbers times the light.
    __array_ufunc__ = None

    def __add__(self, other: Environment) -> Environment:
        if not isinstance(other, Environment):
            raise instead_of("Environment", other)
        return self._of((*self._layers, *other._layers), f"{self.name} and {other.name}")

    def __radd__(self, nothing: int) -> Environment:
        """What `sum` begins with adds nothing."""
        return self if nothing == 0 else NotImplemented

    @classmethod
    def load(
        cls,
        path: str | os.PathLike[str],
        layout: str | None = None,
        repair: str | None = None,
        *,
        layer: str | None = None,
        rows: str = "centre",
    ) -> Environment:
        """Read a .hdr or .exr file (or any image; those of whole numbers are taken for sRGB, with a warning).

        What a header says of its pixels is applied: orientation, windows, exposures, colours
        (``deltalux/images/attributes.py`` lists all of it).

        Parameters
        ----------
        path
            The file.
        layout
            ``"latlong"``, ``"vertical-cross"``, ``"horizontal-cross"``, ``"angular"`` (Debevec's light probe) or
            ``"cube"`` (a strip of six faces). Without it the EXR attribute ``envmap`` decides, then the proportions:
            2:1, 3:4, 4:3, 1:1 and 6:1 or 1:6, and crosses that were padded to a square. Crosses and probes look along
            -Z in their middle, +X to the right.
        repair
            ``"clip"`` turns infinite values into 65,504, the largest half float, and NaN black; ``"zero"`` turns pixels
            black that have either; ``"positive"`` lifts negative values to 0; ``"clamp"`` does what ``"clip"`` and
            ``"positive"`` do. A warning says what changed.
        layer
            The layer of an EXR file that is the light; by default the channels R, G and B, or the only layer that may
            be.
        rows
            Of a lat-long image: ``"centre"`` or ``"edge"`` (the table above).

        Returns
        -------
        Environment
            Its name is the file's.

        Raises
        ------
        FileNotFoundError, OSError
            The file cannot be opened.
        FileError
            It is not an image, is truncated, or holds nothing that is light. A ``ValueError``.
        ValueError
            The layout is not recognised, or pixels are NaN or infinite (count, row and column of the first).
        """
        checked_path(path, "the path of an image (from_latlong takes an array)")
        if path in skies.BUILTIN and not os.path.exists(path):
            raise FileNotFoundError(f"{path}: there is no such file; dl.Environment.builtin({path!r}) is a light")
        refuse_kind(path, "a light")
        image, metadata = load_image(path, layer)
        envmap = metadata.get("envmap")
        if metadata["format"].startswith("uint"):
            warnings.warn(
                f"{os.fspath(path)}: colours made for a display, whose brightest are cut; as light they are too even",
                stacklevel=2,
            )
        try:
            pixels, kind = layouts.recognise(image, envmap) if layout is None else (image, layout)
            pixels = layouts.convert(repaired(pixels, repair, halves="half" in metadata["format"]), kind, envmap)
            env = cls._from_pixels(pixels, os.path.basename(os.fspath(path)), rows)
        except ValueError as error:
            raise ValueError(f"{os.fspath(path)}: {error}") from None
        # The middle of a picture is at +Z and its right at -X: first about the middle, and then that is raised.
        pitch, roll = metadata.get("pose", (0.0, 0.0))
        return env.rotated(roll, "z").rotated(-pitch, "x") if pitch or roll else env

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
    def from_latlong(
        cls, array: ArrayLike, repair: str | None = None, *, rows: str = "edge", encoding: str | None = None
    ) -> Environment:
        """Light from a lat-long image.

        Parameters
        ----------
        array : (h, w, 3) real
            Linear RGB radiance; row 0 is at +Y, the middle column at +Z.
        repair
            As for `load`.
        rows
            ``"edge"``: the first and the last row are the poles, as in Mitsuba; ``"centre"``: rows are bands of equal
            height, as in Blender.
        encoding
            ``"srgb"``: colours of a display, whole numbers of 8 or 16 bits or floats from 0 to 1.

        Returns
        -------
        Environment
            It holds a copy in float32.

        Raises
        ------
        ValueError
            If the shape or the type is wrong, whole numbers come without an encoding, or pixels are NaN or infinite in
            float32.
        """
        pixels = floats(array, encoding)
        if pixels.ndim != 3 or pixels.shape[2] != 3 or 0 in pixels.shape:
            raise ValueError(f"expected a lat-long image of shape (h, w, 3), got {pixels.shape}")
        return cls._from_pixels(repaired(pixels, repair), "lat-long array", rows)

    @classmethod
    def from_cubemap(cls, array: ArrayLike, repair: str | None = None, *, encoding: str | None = None) -> Environment:
        """Light from the six faces of a cubemap, constant over each texel.

        Parameters
        ----------
        array : (6, n, n, 3) real
            Linear RGB radiance; faces +X, -X, +Y, -Y, +Z, -Z in OpenGL's orientation.
        repair
            As for `load`.
        encoding
            As for `from_latlong`.

        Returns
        -------
        Environment
            It holds a copy in float32.

        Raises
        ------
        ValueError
            If the shape or the type is wrong, whole numbers come without an encoding, or pixels are NaN or infinite in
            float32.
        """
        pixels = floats(array, encoding)
        if pixels.ndim != 4 or pixels.shape != (6, pixels.shape[1], pixels.shape[1], 3) or 0 in pixels.shape:
            raise ValueError(f"expected a cubemap of shape (6, n, n, 3), got {pixels.shape}")
        return cls._from_pixels(repaired(pixels, repair), "cubemap array")

    @classmethod
    def disc(cls, azimuth: float, elevation: float, radius: float) -> Environment:
        """A round light at infinity, of radiance 1 on black: a sun, a lamp, a softbox.

        Parameters
        ----------
        azimuth, elevation
            Where its middle stands, in degrees: from -Z towards +X, and above the horizon.
        radius
            In degrees, above 0 and up to 90. What is smaller than a texel of its map gives its light all the same.

        Returns
        -------
        Environment
            Discs of one radius share a map: moving one costs what turning a light does.

        Raises
        ------
        ValueError
            If a number is not finite or out of its range.
        """
        if not (math.isfinite(azimuth) and math.isfinite(elevation) and 0.0 < radius <= 90.0):
            raise ValueError(
                f"expected finite degrees and a radius above 0 and up to 90, got {azimuth}, {elevation} and {radius}"
            )
        return _even_disc(float(radius)).rotated(elevation, "x").rotated(-azimuth, "y")

    @classmethod
    def painted(cls, dabs: Iterable[tuple[float, float, float, Sequence[float]]]) -> Environment:
        """What a round brush leaves on black.

        Parameters
        ----------
        dabs
            Of each its azimuth, elevation and radius in degrees, and its colour, linear RGB radiance. Where they cross,
            the brighter is seen.

        Returns
        -------
        Environment

        Raises
        ------
        ValueError
            If a number is not finite or out of its range.
        """
        paint = np.zeros((6, discs.FACE, discs.FACE, 3), np.float32)
        for azimuth, elevation, radius, colour in dabs:
            own = np.asarray(colour, np.float32)
            finite = math.isfinite(azimuth) and math.isfinite(elevation) and np.isfinite(own).all()
            if own.shape != (3,) or not finite or not 0.0 < radius <= 90.0:
                raise ValueError(
                    "expected dabs of azimuth, elevation, a radius above 0 and up to 90 degrees, and three colours, "
                    f"got {azimuth}, {elevation}, {radius} and {colour!r}"
                )
            paint = discs.dabbed(paint, [(azimuth, elevation)], radius, own)
        return cls._from_pixels(paint, "painted")

    @classmethod
    def _from_pixels(cls, pixels: NDArray[np.float32], name: str, rows: str = "centre") -> Environment:
        one_of("rows", rows, ROWS)
        return cls._of([(_WHITE, _map(pixels, rows == "edge"), IDENTITY)], name)

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
            raise instead_of("Environment", other)
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
        if not (isinstance(factor, Real) and math.isfinite(factor)):
            more = "" if isinstance(factor, Real) else "; tinted takes three"
            raise ValueError(f"expected a finite factor, got {described(factor)}{more}")
        return self._times((factor, factor, factor))

    def tinted(self, colour: ArrayLike) -> Environment:
        """The light times a colour.

        Parameters
        ----------
        colour
            Three finite numbers: factors of red, green and blue.

        Returns
        -------
        Environment
            A new one, which shares the maps.

        Raises
        ------
        ValueError
            If these are not three finite numbers.
        """
        tint = real_array("colour", colour, np.float32)
        if tint.shape != (3,) or not np.isfinite(tint).all():
            raise ValueError(f"expected three finite factors, of red, green and blue, got {colour!r}")
        return self._times(as_vector(tint))

    def _times(self, factors: Vector) -> Environment:
        layers = [(as_vector(np.multiply(own, factors)), light, turn) for own, light, turn in self._layers]
        return self._of(layers, self.name)

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
        read = "; dl.Environment.load(path) reads a file" if kind_of(str(name)) else near(name, skies.BUILTIN)
        raise ValueError(f"expected a built-in environment of {', '.join(skies.BUILTIN)}, got {name!r}{read}")
    return Environment._from_pixels(skies.BUILTIN[name](), name)


@lru_cache(maxsize=16)
def _even_disc(radius: float) -> Environment:
    return Environment._from_pixels(discs.even_disc(radius), f"disc of {radius:g} degrees")


def _restored(layers: Sequence[tuple[Vector, tuple[NDArray[np.float32], bool], Matrix]], name: str) -> Environment:
    """A pickled environment."""
    maps = {id(pixels): _map(pixels, edge) for _, (pixels, edge), _ in layers}
    return Environment._of([(weight, maps[id(pixels)], turn) for weight, (pixels, _), turn in layers], name)


def _map(pixels: NDArray[np.float32], edge: bool) -> EnvironmentMap:
    """A map of lat-long pixels or six faces."""
    pixels = np.ascontiguousarray(pixels)
    return EnvironmentMap.from_latlong(pixels, edge) if pixels.ndim == 3 else EnvironmentMap.from_cubemap(pixels)
