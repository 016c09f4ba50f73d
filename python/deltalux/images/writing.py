"""Pixels into a file by OpenImageIO, as they are: nothing is renamed, and nothing forced to the disk."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from .oiio import library, reason

__all__ = ["FAST", "LEVELS", "write_pixels"]

LEVELS = range(10)
"""Of compression: 0 is none, 9 the slowest. All are lossless."""
FAST = 1
"""Written in half the time of the libraries' own level or less, and hardly larger. Measured at 512 x 512, ms and kB:
PNG 18 and 223 (level 6: 71 and 184); EXR 34 and 3,008 (46 and 3,003), in half floats 14 and 751 (19 and 722)."""

_SMALL = 1 << 20
"""Numbers."""
_AVERAGE = 64
"""The one filter of PNG that is tried: all five take twice the time, and save 1 %."""

_told: list[bool] = []
"""What the library was told last: whether a picture is small."""


def write_pixels(
    path: Path,
    pixels: NDArray[Any],
    number: str,
    attributes: Mapping[str, Any] | None = None,
    *,
    level: int = FAST,
    target: Path | None = None,
) -> None:
    """Writes a picture.

    Parameters
    ----------
    path
        Of the file; its ending chooses the format.
    pixels
        (h, w, c), contiguous, of a type that the format holds.
    number
        What the file holds: "uint8", "uint16", "half" or "float".
    attributes
        Strings, integers and floats to be kept in the file (EXR).
    level
        Of compression, one of `LEVELS`.
    target
        What errors call the file, where it is to be renamed.

    Raises
    ------
    OSError
        If it cannot be written.
    """
    oiio = library()
    height, width, channels = pixels.shape
    spec = oiio.ImageSpec(width, height, channels, number)
    _share_threads(oiio, pixels.size < _SMALL)
    spec.attribute("png:compressionLevel", level)
    spec.attribute("png:filter", _AVERAGE)
    spec.attribute("compression", f"zip:{level}" if level else "none")
    display = pixels.dtype.kind == "u"
    if display:
        # Straight already: what is not said to be is divided by alpha once more.
        spec.attribute("oiio:UnassociatedAlpha", 1)
    spec.attribute("oiio:ColorSpace", "srgb_rec709_scene" if display else "lin_rec709_scene")
    for key, value in (attributes or {}).items():
        spec.attribute(key, value)
    name = target or path
    with open(path, "wb"):
        pass  # As for reading: the system's own reason.
    writer = oiio.ImageOutput.create(str(path))
    if writer is None or not writer.open(str(path), spec):
        raise OSError(f"{name}: cannot be written ({reason(writer.geterror() if writer else oiio.geterror())})")
    written = writer.write_image(pixels)
    failure = writer.geterror()
    if not (writer.close() and written):
        raise OSError(f"{name}: cannot be written ({reason(failure or writer.geterror())})")


def _share_threads(oiio: Any, small: bool) -> None:
    """A small picture is compressed before threads have begun: alone it takes 0.8 CPU-ms less, at 160 x 160."""
    if _told != [small]:
        oiio.attribute("threads", 1 if small else 0)
        oiio.attribute("exr_threads", -1 if small else 0)
        _told[:] = [small]
