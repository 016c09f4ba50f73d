"""Images in files: the only module that imports OpenImageIO (when it is first needed).

OpenImageIO reports failure by return values that look like data (None, zeros, empty arrays), so every return is checked
here and its reason asked for; nothing else of the package talks to it.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ._core import FileError, display

_MAX_MEGABYTES = 4096
"""The largest image that is read, decoded."""

__all__ = ["auto_exposure", "load_image", "magnification", "save_image", "to_display"]

_FORMATS = (".exr", ".hdr", ".png")

# Lossless all the same, and written in half the time or less. Measured at 512 x 512, ms and kB: PNG 18 and 223 (level
# 6: 71 and 184); EXR 34 and 3,008 (46 and 3,003), in half floats 14 and 751 (19 and 722).
_FAST = {"png:compressionLevel": 1, "compression": "zip:1"}


def _oiio() -> ModuleType:
    import OpenImageIO

    # Headers are hostile: the library's own limit grows with the machine's memory.
    OpenImageIO.attribute("limits:imagesize_MB", _MAX_MEGABYTES)
    return OpenImageIO


def _reason(error: str) -> str:
    """One line of the library's account of an error."""
    return " ".join(error.split()) or "unknown reason"


def load_image(path: str | os.PathLike[str]) -> tuple[NDArray[np.float32], dict[str, Any]]:
    """Read an image as linear RGB.

    Parameters
    ----------
    path
        Any format that OpenImageIO reads; its content decides, not its name. Alpha is dropped, gray becomes three
        channels, and images of 8 or 16 bits are taken for sRGB and made linear.

    Returns
    -------
    pixels : (h, w, 3) float32
        Rows from the top. NaN and infinite values are passed on as they stand.
    metadata : dict
        ``"format"`` (the file's own number type), ``"channels"`` (names) and, where the file says so, ``"envmap"``:
        ``"latlong"`` or ``"cube"``.

    Raises
    ------
    FileNotFoundError, OSError
        The file is not there, or may not be read.
    FileError
        It is not an image, is truncated or damaged, or would take more than 4 GB of memory. A ``ValueError``.
    """
    name = os.fspath(path)
    with open(name, "rb"):
        pass  # The operating system says best why a file cannot be opened.
    oiio = _oiio()
    try:
        image = oiio.ImageInput.open(name)
    except UnicodeDecodeError as error:
        raise FileError(f"{name}: not an image that can be read (corrupt header)") from error
    if image is None:
        raise FileError(f"{name}: not an image that can be read ({_reason(oiio.geterror())})")
    try:
        spec = image.spec()
        if spec.width * spec.height * spec.nchannels * 4 > _MAX_MEGABYTES << 20:
            size = f"{spec.width}x{spec.height} with {spec.nchannels} channels"
            raise FileError(f"{name}: {size} would take more than {_MAX_MEGABYTES} MB")
        pixels = image.read_image(0, 0, 0, spec.nchannels, "float")
        if pixels is None:
            raise FileError(f"{name}: truncated or damaged image ({_reason(image.geterror() or oiio.geterror())})")
        number, names = str(spec.format), tuple(spec.channelnames)
        metadata = {"format": number, "channels": names, **_envmap(spec)}
    except UnicodeDecodeError as error:
        raise FileError(f"{name}: truncated or damaged image (corrupt text)") from error
    finally:
        image.close()
        oiio.geterror()  # What is not collected is printed at exit.

    pixels = _three_channels(np.asarray(pixels, np.float32), names)
    if number.startswith("uint"):
        pixels = _from_srgb(pixels)
    return np.ascontiguousarray(pixels), metadata


def _envmap(spec: Any) -> dict[str, str]:
    """The EXR attribute ``envmap``, as OpenImageIO hands it on."""
    kinds = {"LatLong Environment": "latlong", "CubeFace Environment": "cube"}
    kind = kinds.get(spec.get_string_attribute("textureformat"))
    return {} if kind is None else {"envmap": kind}


def _three_channels(pixels: NDArray[np.float32], names: tuple[str, ...]) -> NDArray[np.float32]:
    """Red, green and blue by name, else the first three channels, else the first as gray."""
    if pixels.ndim == 2:
        pixels = pixels[:, :, None]
    if all(colour in names for colour in "RGB"):
        return pixels[:, :, [names.index(colour) for colour in "RGB"]]
    return pixels[:, :, :3] if pixels.shape[2] >= 3 else np.repeat(pixels[:, :, :1], 3, axis=2)


def _from_srgb(values: NDArray[np.float32]) -> NDArray[np.float32]:
    linear = np.where(values <= 0.04045, values / 12.92, ((values + 0.055) / 1.055) ** 2.4)
    return linear.astype(np.float32)


def to_display(image: ArrayLike, exposure: float = 0.0) -> NDArray[np.uint8]:
    """Map linear radiance to 8-bit sRGB: times 2^exposure, clipped to [0, 1], sRGB curve. No other tone mapping.

    Parameters
    ----------
    image : (h, w, 3) or (h, w) floats
        Linear radiance; NaN becomes black.
    exposure
        In stops.

    Returns
    -------
    uint8 array of the same shape.
    """
    linear = np.ascontiguousarray(image, np.float32)
    return display(linear.ravel(), 2.0**exposure).reshape(linear.shape)


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
    image : (h, w, 3) or (h, w)
        Floats of linear radiance; for PNG the uint8 that `to_display` makes, so that no tone mapping is hidden.
    attributes
        Strings, integers and floats to be kept in the file (EXR).
    half
        Half floats in an EXR: half the bytes, and every number to 0.05 %.

    Raises
    ------
    ValueError
        Another format, shape or type.
    OSError
        The file cannot be written (no permission, no such directory, disk full).
    """
    target = Path(path)
    pixels = _writable(target, np.asarray(image))
    oiio = _oiio()
    height, width, channels = pixels.shape
    number = "uint8" if pixels.dtype == np.uint8 else "half" if half and target.suffix.lower() == ".exr" else "float"
    spec = oiio.ImageSpec(width, height, channels, number)
    for key, value in _FAST.items():
        spec.attribute(key, value)
    spec.attribute("oiio:ColorSpace", "srgb_rec709_scene" if pixels.dtype == np.uint8 else "lin_rec709_scene")
    for key, value in (attributes or {}).items():
        spec.attribute(key, value)

    # Beside the target, so that the renaming stays within one file system; the suffix chooses the format.
    beside = target.with_name(f".{target.stem}.tmp-{os.getpid()}{target.suffix}")
    try:
        with open(beside, "wb"):
            pass  # As for reading: the system's own reason.
        writer = oiio.ImageOutput.create(str(beside))
        if writer is None or not writer.open(str(beside), spec):
            raise OSError(f"{target}: cannot be written ({_reason(writer.geterror() if writer else oiio.geterror())})")
        written = writer.write_image(pixels)
        reason = writer.geterror()
        if not (writer.close() and written):
            raise OSError(f"{target}: cannot be written ({_reason(reason or writer.geterror())})")
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
    if pixels.ndim != 3 or pixels.shape[2] not in (1, 3) or 0 in pixels.shape:
        raise ValueError(f"expected an image of shape (h, w, 3) or (h, w), got {pixels.shape}")
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
    image : (h, w, 3) float32
        Linear radiance.

    Returns
    -------
    float
        In stops, for `to_display`; 0 where nothing is lit.
    """
    lit = image.max(axis=-1)
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
