"""An image from a file, as linear Rec.709 radiance, upright, in the frame that its header says."""

from __future__ import annotations

import os
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._core import FileError
from ..plain import open_plain, read_plain
from . import attributes, colour, radiance
from .channels import Choice, choose
from .oiio import MAX_MEGABYTES, library, reason

__all__ = ["load_image"]

Image = NDArray[np.float32]


def load_image(path: str | os.PathLike[str], layer: str | None = None) -> tuple[Image, dict[str, Any]]:
    """Read an image as linear RGB.

    Parameters
    ----------
    path
        Any format that OpenImageIO reads; its content decides, not its name. Alpha is dropped, gray becomes three
        channels, and images of 8 or 16 bits are taken for sRGB and made linear, unless the file says otherwise. What is
        done with what a header says stands in ``deltalux/images/attributes.py``.
    layer
        The name of a layer; without it the channels R, G and B, else the only layer that may be light.

    Returns
    -------
    pixels : (h, w, 3) float32
        Rows from the top, linear Rec.709. NaN and infinite values are passed on as they stand.
    metadata : dict
        ``"format"`` (the file's own number type), ``"channels"`` (names), ``"notes"`` (what was converted, in words)
        and, where the file says so, ``"envmap"``: ``"latlong"`` or ``"cube"``.

    Raises
    ------
    FileNotFoundError, OSError
        The file is not there, or may not be read.
    FileError
        It is not an image, is truncated or damaged, holds nothing that is light, or would take more than 4 GB of
        memory. A ``ValueError``.
    """
    name = os.fspath(path)
    # The operating system says best why a file cannot be opened.
    with open_plain(name) as file:
        own = file.read(len(radiance.MAGIC)) == radiance.MAGIC
    # Room is made for as much as there is: a read of at most so much would ask for all of that.
    data = read_plain(name, MAX_MEGABYTES << 20) if own else b""
    try:
        if not own:
            return _by_library(name, layer)
        if layer is not None:
            raise ValueError(f"expected no layer of a Radiance picture, which has one, got {layer!r}")
        return radiance.decode(data, MAX_MEGABYTES << 20)
    except (FileError, OSError):
        raise
    except UnicodeDecodeError as error:
        raise FileError(f"{name}: truncated or damaged image (corrupt text)") from error
    except ValueError as error:
        raise FileError(f"{name}: {error}") from None


def _by_library(name: str, layer: str | None) -> tuple[Image, dict[str, Any]]:
    oiio = library()
    asked = oiio.ImageSpec()
    asked.attribute("oiio:UnassociatedAlpha", 1)
    try:
        image = oiio.ImageInput.open(name, asked)
    except UnicodeDecodeError as error:
        raise FileError(f"{name}: not an image that can be read (corrupt header)") from error
    if image is None:
        raise FileError(f"{name}: not an image that can be read ({reason(oiio.geterror())})")
    try:
        return _read(image, name, layer)
    finally:
        image.close()
        oiio.geterror()  # What is not collected is printed at exit.


def _read(image: Any, name: str, layer: str | None) -> tuple[Image, dict[str, Any]]:
    chosen = choose(_parts(image), layer)
    image.seek_subimage(chosen.part, 0)
    spec = image.spec()
    left, top, width, height = attributes.window(spec, image.format_name())
    for wide, high in ((spec.width, spec.height), (width, height)):
        if wide * high * max(spec.nchannels, 3) * 4 > MAX_MEGABYTES << 20:
            size = f"{wide}x{high} with {spec.nchannels} channels"
            raise ValueError(f"{size} would take more than {MAX_MEGABYTES} MB")
    number, names = str(spec.format), tuple(spec.channelnames)
    pixels, said = colour.linear(_colours(_pixels(image, spec, chosen), spec, chosen), spec, number)
    notes = [] if said in ("sRGB", "linear Rec.709") else [f"converted from {said}"]
    if chosen.layer:
        notes.append(f"of the layer {chosen.layer!r}")
    if (left, top, width, height) != (0, 0, spec.width, spec.height):
        pixels = _placed(pixels, left, top, width, height)
        notes.append(f"{spec.width}x{spec.height} pixels set into {width}x{height} at column {left}, row {top}")
    turned = attributes.orientation(spec)
    if turned != 1:
        pixels, notes = _upright(pixels, turned), [*notes, f"turned upright (orientation {turned})"]
    metadata: dict[str, Any] = {"format": number, "channels": names, "notes": notes, "pose": attributes.pose(spec)}
    kind = attributes.envmap(spec)
    return np.ascontiguousarray(pixels), metadata if kind is None else {**metadata, "envmap": kind}


def _parts(image: Any) -> list[tuple[str, list[str]]]:
    """The names of all parts and of their channels."""
    parts: list[tuple[str, list[str]]] = []
    while image.seek_subimage(len(parts), 0):
        spec = image.spec()
        if spec.deep:
            raise ValueError("expected flat pixels, got a deep image, whose samples lie in depth")
        name = attributes.text(spec, "oiio:subimagename") or attributes.text(spec, "view")
        parts.append((name, list(spec.channelnames)))
    image.geterror()
    return parts


def _pixels(image: Any, spec: Any, chosen: Choice) -> Image:
    """The chosen channels, (h, w, n)."""
    first, last = min(chosen.channels), max(chosen.channels) + 1
    pixels = image.read_image(chosen.part, 0, first, last, "float")
    if pixels is None:
        raise ValueError(f"truncated or damaged image ({reason(image.geterror() or library().geterror())})")
    pixels = np.asarray(pixels, np.float32).reshape(spec.height, spec.width, last - first)
    return pixels[:, :, [channel - first for channel in chosen.channels]]


def _colours(pixels: Image, spec: Any, chosen: Choice) -> Image:
    if chosen.kind == "chroma":
        own = spec.getattribute("chromaticities")
        return colour.from_chroma(pixels, colour.REC709 if own is None else own)
    return np.repeat(pixels, 3, axis=2) if chosen.kind == "grey" else pixels


def _placed(pixels: Image, left: int, top: int, width: int, height: int) -> Image:
    """Pixels in their frame: black around them, and what lies beyond it cut."""
    rows, columns = slice(max(top, 0), top + pixels.shape[0]), slice(max(left, 0), left + pixels.shape[1])
    whole = np.zeros((height, width, 3), np.float32)
    inside = whole[rows, columns]
    if inside.size == 0:
        raise ValueError(f"expected pixels within their frame of {width}x{height}, got all beyond it")
    shown = pixels[max(-top, 0) :, max(-left, 0) :]
    inside[:] = shown[: inside.shape[0], : inside.shape[1]]
    return whole


def _upright(pixels: Image, orientation: int) -> Image:
    """Undoes what EXIF and TIFF call orientation 2 to 8."""
    if orientation >= 5:
        pixels = pixels.swapaxes(0, 1)
    if orientation in (3, 4, 7, 8):
        pixels = pixels[::-1]
    return pixels[:, ::-1] if orientation in (2, 3, 6, 7) else pixels
