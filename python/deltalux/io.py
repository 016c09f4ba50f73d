"""Images to files and to a display; how they are read stands in `images`."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Mapping, Sequence
from numbers import Real
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ._core import agx, display
from .checks import one_of
from .images.reading import load_image
from .images.writing import write_parts, write_pixels
from .mistakes import checked_path, described

__all__ = ["TONES", "auto_exposure", "load_image", "magnification", "save_image", "save_parts", "to_display", "write"]

TONES = ("srgb", "agx")
"""Curves from radiance to a display."""

_FORMATS = (".exr", ".hdr", ".png")


def to_display(image: ArrayLike, exposure: float = 0.0, tone: str = "srgb") -> NDArray[np.uint8]:
    """Map linear radiance to 8 bits of an sRGB display, times 2^exposure.

    Parameters
    ----------
    image : (h, w, 3), (h, w, 4) or (h, w) floats
        Linear radiance; NaN becomes black. A fourth channel is alpha, which colours are multiplied by.
    exposure
        In stops.
    tone
        ``"srgb"``: clipped to [0, 1], the sRGB curve, no other tone mapping; ``"agx"``: AgX, which shows 16 stops, of
        pictures in colour.

    Returns
    -------
    uint8 array of the same shape; colours are not multiplied by alpha any more, which is linear.

    Raises
    ------
    ValueError
        If there is no such tone, or a picture without colours is to be shown by AgX.
    """
    if tone != "srgb":
        one_of("tone", tone, TONES)
    if not (isinstance(exposure, Real) and math.isfinite(exposure)):
        raise ValueError(f"expected exposure to be a number of stops, got {exposure!r}; auto_exposure(picture) is one")
    linear = np.ascontiguousarray(image, np.float32)
    if linear.ndim == 3 and linear.shape[2] == 4:
        return _cut_out(linear, exposure, tone)
    if tone == "agx":
        if linear.ndim != 3 or linear.shape[2] != 3:
            raise ValueError(f"expected a picture of shape (h, w, 3) for AgX, got {linear.shape}")
        return agx(linear.ravel(), 2.0**exposure).reshape(linear.shape)
    return display(linear.ravel(), 2.0**exposure).reshape(linear.shape)


def _cut_out(image: NDArray[np.float32], exposure: float, tone: str) -> NDArray[np.uint8]:
    """A picture with alpha as displays and PNG have it: straight."""
    alpha = np.nan_to_num(image[..., 3:]).clip(0.0, 1.0)
    colours = np.divide(image[..., :3], alpha, out=np.zeros_like(image[..., :3]), where=alpha > 0)
    covered = np.asarray(255.0 * alpha + 0.5, np.uint8)
    return np.concatenate([to_display(colours, exposure, tone), covered], axis=2)


def save_image(
    path: str | os.PathLike[str],
    image: ArrayLike,
    attributes: Mapping[str, Any] | None = None,
    *,
    half: bool = False,
) -> None:
    """Write an image; an existing file is replaced only once the new one is whole.

    Parameters
    ----------
    path
        ``.exr`` (32-bit linear), ``.hdr`` (RGBE, which keeps 1 % of the largest channel) or ``.png`` (8-bit sRGB).
    image : (h, w, 3), (h, w, 4) or (h, w)
        Floats of linear radiance, multiplied by alpha where there is a fourth channel; for PNG the uint8 that
        `to_display` makes, so that no tone mapping is hidden.
    attributes
        Strings, integers and floats to be kept in the file (EXR).
    half
        Half floats in an EXR: half the bytes, and every number to 0.05 %.

    Raises
    ------
    ValueError
        Another format, shape or type.
    OSError
        The file cannot be written (no permission, disk full).
    FileNotFoundError
        There is no such directory.
    """
    target = Path(path)
    pixels = _writable(target, np.asarray(image))
    number = "uint8" if pixels.dtype == np.uint8 else "half" if half and target.suffix.lower() == ".exr" else "float"
    _publish(target, lambda beside: write_pixels(beside, pixels, number, attributes, target=target))


def save_parts(path: str | os.PathLike[str], parts: Sequence[tuple[str, Sequence[str], NDArray[Any], str]]) -> None:
    """Write a multi-part EXR of linear numbers; an existing file is replaced only once the new one is whole.

    Parameters
    ----------
    path
        ``.exr``
    parts
        Of each its name, those of its channels, pixels (h, w, channels), and ``"float"`` or ``"half"``.

    Raises
    ------
    OSError
        The file cannot be written (no permission, disk full).
    FileNotFoundError
        There is no such directory.
    """
    target = Path(path)
    _publish(target, lambda beside: write_parts(beside, parts, target=target))


def _publish(target: Path, write: Callable[[Path], None]) -> None:
    """Writes a file beside the target, so that the renaming stays within one file system; its suffix is the target's,
    as it chooses the format."""
    if not target.parent.is_dir():
        raise FileNotFoundError(f"expected a directory to write {target.name} into, but {target.parent} does not exist")
    beside = target.with_name(f".{target.stem}.tmp-{os.getpid()}{target.suffix}")
    try:
        write(beside)
        with open(beside, "rb") as whole:
            os.fsync(whole.fileno())
        os.replace(beside, target)
    finally:
        beside.unlink(missing_ok=True)


def _writable(target: Path, pixels: NDArray[Any]) -> NDArray[Any]:
    """The image as a contiguous (h, w, c) array of a type that its format holds."""
    suffix = target.suffix.lower()
    if suffix not in _FORMATS:
        raise ValueError(f"expected a file name ending in {', '.join(_FORMATS)}, got {target.name!r}")
    if pixels.ndim == 2:
        pixels = pixels[:, :, None]
    if pixels.ndim != 3 or pixels.shape[2] not in (1, 3, 4) or 0 in pixels.shape:
        raise ValueError(f"expected an image of shape (h, w, 3), (h, w, 4) or (h, w), got {pixels.shape}")
    if suffix == ".hdr" and pixels.shape[2] == 4:
        raise ValueError(f"expected .exr or .png for a picture with alpha, which {suffix} has no room for")
    if suffix == ".png":
        if pixels.dtype != np.uint8:
            raise ValueError(f"expected uint8 for PNG (see to_display), got {pixels.dtype}")
        return np.ascontiguousarray(pixels)
    if not np.issubdtype(pixels.dtype, np.floating):
        raise ValueError(f"expected linear radiance in floats for {suffix}, got {pixels.dtype}")
    return np.ascontiguousarray(pixels, np.float32)


def auto_exposure(image: NDArray[np.float32]) -> float:
    """The exposure that brings the 97th percentile of what is lit to nine tenths of white.

    Parameters
    ----------
    image : (h, w, 3) or (h, w, 4) float32
        Linear radiance.

    Returns
    -------
    float
        In stops, for `to_display`; 0 where nothing is lit.
    """
    lit = image[..., :3].max(axis=-1)
    lit = lit[lit > 0]
    return float(np.log2(0.9 / np.percentile(lit, 97))) if lit.size else 0.0


def magnification(difference: NDArray[np.float32], exposure: float) -> int:
    """The factor that makes a difference of two pictures plain to see.

    Parameters
    ----------
    difference : (h, w, 3) float32
        Of linear radiance.
    exposure
        In stops: how the pictures are shown.

    Returns
    -------
    int
        A power of two, 1 to 64.
    """
    large = float(np.percentile(np.abs(difference).max(axis=-1), 99)) * 2.0**exposure
    return int(2 ** np.clip(np.round(np.log2(0.5 / large)), 0, 6)) if large > 0 else 64


def write(path: str | os.PathLike[str], picture: ArrayLike, *, exposure: float = 0.0, tone: str = "srgb") -> None:
    """Write a picture: radiance as it is, or as a display shows it.

    Parameters
    ----------
    path
        ``.exr`` or ``.hdr`` for linear radiance, ``.png`` for 8 bits a colour.
    picture : (h, w, 3), (h, w, 4) or (h, w) floats
        Linear radiance; a fourth channel is alpha, which colours are multiplied by: as it is in an EXR, and in a PNG
        with colours of their own, as readers of either expect.
    exposure
        Stops, in a PNG.
    tone
        The curve of a PNG, as for `to_display`.

    Raises
    ------
    ValueError
        Another format, shape or type.
    OSError
        The file cannot be written.
    """
    checked_path(path, "a path, and then a picture")
    picture = _radiance(picture)
    shown = Path(path).suffix.lower() == ".png"
    save_image(path, to_display(picture, exposure, tone) if shown else np.asarray(picture, np.float32))


def _radiance(picture: ArrayLike) -> NDArray[Any]:
    """A picture, and nothing that only looks like one."""
    pixels = np.asarray(picture)
    if pixels.dtype.kind != "f":
        eight = "; save_image of deltalux.io writes those of a display" if pixels.dtype == np.uint8 else ""
        what = described(picture) if pixels.dtype.kind not in "iub" else f"an array of {pixels.dtype}"
        raise TypeError(f"expected a picture, linear radiance in floats, got {what}{eight}")
    if pixels.ndim == 2 and pixels.shape[1] == 3:
        raise ValueError(f"expected a picture, got {pixels.shape}, as of a product B; transport.image(B) makes one")
    return pixels
