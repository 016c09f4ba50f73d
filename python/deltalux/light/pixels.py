"""Pixels that may become light: what is no number is refused or, on request, repaired, and what changed is said."""

from __future__ import annotations

import warnings

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..checks import one_of
from ..images.colour import from_srgb
from ..mistakes import described

REPAIRS = ("zero", "clip", "positive", "clamp")
ENCODINGS = ("linear", "srgb")

_LARGEST_HALF = 65504.0


def floats(array: ArrayLike, encoding: str | None = None) -> NDArray[np.float32]:
    """An array as linear radiance in float32; what float32 cannot hold becomes infinite, and is reported as such.

    Parameters
    ----------
    array
        Real numbers.
    encoding
        ``"srgb"``: whole numbers of 8 or 16 bits, or floats from 0 to 1, that were made for a display.

    Raises
    ------
    ValueError
        If they are no real numbers, or whole ones of which nobody said what they mean.
    """
    one_of("encoding", encoding, (None, *ENCODINGS))
    pixels = np.asarray(array)
    if encoding == "srgb" and pixels.dtype in (np.uint8, np.uint16):
        return from_srgb(pixels.astype(np.float32) / np.iinfo(pixels.dtype).max)
    if pixels.dtype.kind in "iu" and encoding is None:
        raise ValueError(
            f"expected linear radiance in floats, got an array of {pixels.dtype}: if it holds colours of a display, "
            'such as those of a JPEG or PNG, give encoding="srgb"; if it holds radiance, give array.astype(float)'
        )
    if pixels.dtype.kind not in "fiu":
        what = described(array) if pixels.dtype.kind in "OU" else f"dtype {pixels.dtype}"
        raise ValueError(f"expected an array of real numbers, got {what}")
    with np.errstate(over="ignore"):
        numbers = pixels.astype(np.float32)
    return from_srgb(numbers) if encoding == "srgb" else numbers


def repaired(pixels: NDArray[np.float32], repair: str | None, halves: bool = False) -> NDArray[np.float32]:
    """Refuses pixels that are not finite, or repairs them; warns of negative ones, or lifts them to black.

    Parameters
    ----------
    pixels : (..., h, w, 3) float32
        Of an image, or of faces.
    repair
        One of `REPAIRS`: see `Environment.load`.
    halves
        Whether they were half floats.

    Raises
    ------
    ValueError
        If pixels are not finite and nothing was asked for that makes them so.
    """
    one_of("repair", repair, (None, *REPAIRS))
    bad = np.asarray(~np.isfinite(pixels).all(axis=-1))
    if bad.any():
        what = _not_finite(pixels, bad, halves)
        if repair in (None, "positive"):
            raise ValueError(f'{what}; repair="clip" makes infinite ones {_LARGEST_HALF:g}, repair="zero" black')
        if repair != "zero":
            pixels = np.nan_to_num(pixels, nan=0.0, posinf=_LARGEST_HALF, neginf=-_LARGEST_HALF)
            _warn(f"{what}; infinite values are taken as {_LARGEST_HALF:g}, and what is no number as black")
        else:
            pixels = np.where(bad[..., None], np.float32(0), pixels)
            _warn(f"{what}; they are taken as black")
    negative = np.asarray((pixels < 0).any(axis=-1))
    if negative.any():
        what = f"{np.count_nonzero(negative)} pixels are negative (ringing of compression or filters?)"
        if repair not in ("positive", "clamp"):
            _warn(f'{what}; they are kept, and repair="positive" makes them black')
        else:
            taken = float(-pixels[pixels < 0].sum(dtype=np.float64))
            share = taken / max(float(np.abs(pixels).sum(dtype=np.float64)), np.finfo(float).tiny)
            pixels = np.maximum(pixels, np.float32(0))
            _warn(f"{what}; their negative values, {100 * share:.2g} % of all that the pixels hold, are taken as 0")
    return pixels


def _warn(what: str) -> None:
    # To whoever called `load`, `from_latlong` or `from_cubemap`.
    warnings.warn(what, stacklevel=4)


def _not_finite(pixels: NDArray[np.float32], bad: NDArray[np.bool_], halves: bool) -> str:
    first = np.argwhere(bad)[0]
    where = f"row {first[-2]}, column {first[-1]}" + (f" of face {first[0]}" if bad.ndim == 3 else "")
    what = f"{np.count_nonzero(bad)} pixels are NaN or infinite, the first at {where}"
    if np.isinf(pixels).any():
        limit = f"half floats end at {_LARGEST_HALF:g}" if halves else "the file or array may have overflowed"
        what += f" (infinite ones: {limit})"
    return what
