"""Pixels into a file by OpenImageIO, as they are: nothing is renamed, and nothing forced to the disk."""

from __future__ import annotations

import zlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import radiance
from .oiio import library, reason

__all__ = ["FAST", "LEVELS", "write_parts", "write_pixels"]

LEVELS = range(10)
"""Of compression: 0 is none, 9 the slowest. All are lossless."""
FAST = 1
"""Written in half the time of the libraries' own level or less, and hardly larger. Measured at 512 x 512, ms and kB:
PNG 18 and 223 (level 6: 71 and 184); EXR 34 and 3,008 (46 and 3,003), in half floats 14 and 751 (19 and 722)."""

_UNDATED = "1970:01:01 00:00:00"
"""OpenEXR files are dated where nobody says otherwise, and the same call is to leave the same bytes."""
_PNG = b"\x89PNG\r\n\x1a\n"
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
    spec.attribute("DateTime", _UNDATED)
    for key, value in (attributes or {}).items():
        spec.attribute(key, value)
    _write(path, [(spec, pixels)], target or path)


def write_parts(path: Path, parts: Sequence[tuple[str, Sequence[str], NDArray[Any], str]], *, target: Path) -> None:
    """Writes a file of several parts.

    Parameters
    ----------
    path
        Of the file, ``.exr``.
    parts
        Of each its name, those of its channels, pixels (h, w, channels), and "float" or "half".
    target
        What errors call the file.

    Raises
    ------
    OSError
        If it cannot be written.
    """
    images = []
    for name, channels, pixels, number in parts:
        height, width = pixels.shape[:2]
        spec = library().ImageSpec(width, height, len(channels), number)
        spec.channelnames = tuple(channels)
        spec.attribute("compression", f"zip:{FAST}")
        spec.attribute("oiio:subimagename", name)
        spec.attribute("oiio:ColorSpace", "lin_rec709_scene")
        spec.attribute("software", "deltalux")
        spec.attribute("DateTime", _UNDATED)
        images.append((spec, np.ascontiguousarray(pixels, np.float32)))
    _write(path, images, target)


def _write(path: Path, images: Sequence[tuple[Any, NDArray[Any]]], name: Path) -> None:
    """Pixels after pixels into one file."""
    oiio = library()
    with open(path, "wb"):
        pass  # As for reading: the system's own reason.
    writer = oiio.ImageOutput.create(str(path))
    specs = [spec for spec, _ in images]
    if writer is None or not writer.open(str(path), specs[0] if len(specs) == 1 else specs):
        raise OSError(f"{name}: cannot be written ({reason(writer.geterror() if writer else oiio.geterror())})")
    written = True
    for number, (spec, pixels) in enumerate(images):
        written = written and (number == 0 or writer.open(str(path), spec, "AppendSubimage"))
        written = written and writer.write_image(pixels)
    failure = writer.geterror()
    if not (writer.close() and written):
        raise OSError(f"{name}: cannot be written ({reason(failure or writer.geterror())})")
    # What is closed still holds the last bytes back, until it goes.
    del writer
    if not _is_whole(path, len(images)):
        raise OSError(f"{name}: cannot be written (a part of it did not reach the disk)")


def _is_whole(path: Path, parts: int) -> bool:
    """Whether all of a file is there that was just written: the library does not say when the last bytes of it fail, as
    they do on a full disk."""
    if path.suffix == ".png":
        return _is_whole_png(path.read_bytes())
    if path.suffix == ".hdr":
        try:
            return bool(radiance.decode(path.read_bytes(), 1 << 40))
        except ValueError:
            return False
    file = library().ImageInput.open(str(path))
    if file is None:
        return False
    # What is compressed has sums of its own, and what comes last was written last.
    read = [
        file.seek_subimage(k, 0) and file.read_scanline(file.spec().height - 1, 0) is not None for k in range(parts)
    ]
    file.close()
    return all(read) and (path.suffix != ".exr" or _is_whole_exr(path.read_bytes(), parts))


def _is_whole_exr(data: bytes, parts: int) -> bool:
    """Whether the table of lines says where every one of them is: it is written last, over zeros, and the library reads
    a file without it by searching for them.

    Of scan lines (OpenEXR, technical introduction): after magic and version the headers, of several parts ended by an
    empty one; the table, a 64-bit place for each chunk; the chunks, each (of several parts its part,) its line, its
    length and as many bytes.
    """
    at = 8
    for _ in range(parts):
        while data[at]:
            # Name, type, length and value of an attribute.
            at = data.index(0, data.index(0, at) + 1) + 1
            at += 4 + int.from_bytes(data[at : at + 4], "little")
        at += 1
    at += parts > 1
    first = int.from_bytes(data[at : at + 8], "little")
    if not at < first <= len(data):
        return False
    table = np.sort(np.frombuffer(data[at:first], "<u8"))
    lengths = 12 if parts > 1 else 8
    for begin, end in zip(table, [*table[1:], len(data)], strict=True):
        length = int.from_bytes(data[int(begin) + lengths - 4 : int(begin) + lengths], "little")
        if int(begin) + lengths + length != end:
            return False
    return True


def _is_whole_png(data: bytes) -> bool:
    """All chunks with their sums, to the last one, which ends the file."""
    at, kind = len(_PNG), b""
    while kind != b"IEND" and at + 12 <= len(data):
        length, kind = int.from_bytes(data[at : at + 4], "big"), data[at + 4 : at + 8]
        end = at + 8 + length
        if zlib.crc32(data[at + 4 : end]) != int.from_bytes(data[end : end + 4], "big"):
            return False
        at = end + 4
    return data.startswith(_PNG) and kind == b"IEND" and at == len(data)


def _share_threads(oiio: Any, small: bool) -> None:
    """A small picture is compressed before threads have begun: alone it takes 0.8 CPU-ms less, at 160 x 160."""
    if _told != [small]:
        oiio.attribute("threads", 1 if small else 0)
        oiio.attribute("exr_threads", -1 if small else 0)
        _told[:] = [small]
