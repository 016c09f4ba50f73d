"""Radiance pictures (.hdr, .pic): the header, which says more of its pixels than other readers look at.

Source: Ward, "Radiance file formats" (radsite.lbl.gov/radiance/refer/filefmts.pdf): radiance is the pixel over the
product of all EXPOSURE and COLORCORR lines; the resolution line gives eight orders of rows and columns.
"""

from __future__ import annotations

import re
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._core import radiance_scanlines
from . import colour

Image = NDArray[np.float32]

MAGIC = b"#?"
_FORMATS = ("32-bit_rle_rgbe", "32-bit_rle_xyze")
# Headers are short; what never ends is none.
_LONGEST = 1 << 16
_RESOLUTION = re.compile(r"([+-])([XY])\s+(\d+)\s+([+-])([XY])\s+(\d+)\s*")


def decode(data: bytes, most: int) -> tuple[Image, dict[str, Any]]:
    """The pixels of a Radiance picture, upright and in linear Rec.709, and what its header said.

    Parameters
    ----------
    data
        The whole file.
    most
        Bytes that the pixels may take in float32.

    Returns
    -------
    pixels : (h, w, 3) float32
    metadata : dict

    Raises
    ------
    ValueError
        If it is no Radiance picture, is truncated or damaged, or is too large.
    """
    variables, resolution, body = _header(data)
    first, lines, second, length = _resolution(resolution)
    if lines * length * 12 > most:
        raise ValueError(f"{resolution} would take more than {most >> 20} MB")
    stored = radiance_scanlines(body, lines, length)
    scale: Image = np.exp2(stored[..., 3].astype(np.float32) - np.float32(136))
    scale[stored[..., 3] == 0] = 0
    pixels: Image = stored[..., :3] * scale[..., None]
    kind = _format(variables)
    notes: list[str] = []
    for name in ("EXPOSURE", "COLORCORR"):
        factor = _product(variables, name)
        if (factor != 1).any():
            pixels, notes = pixels / factor, [*notes, f"divided by {name} {_words(factor)}"]
    if kind == "32-bit_rle_xyze":
        pixels, notes = colour.apply(colour.XYZ_TO_REC709, pixels), [*notes, "converted from CIE XYZ"]
    elif "PRIMARIES" in variables:
        primaries = _numbers("PRIMARIES", variables["PRIMARIES"][-1], 8)
        # Some writers put zeros where they know of none.
        if primaries.any() and not np.allclose(primaries, colour.REC709, atol=2e-3):
            pixels = colour.apply(colour.from_chromaticities(primaries), pixels)
            notes.append(f"converted from the primaries {_words(primaries)}")
    upright = _upright(pixels, first, second)
    if (first, second) != ("-Y", "+X"):
        notes.append(f"stored as {resolution}")
    return np.ascontiguousarray(upright), {"format": "rgbe", "channels": ("R", "G", "B"), "notes": notes}


def _header(data: bytes) -> tuple[dict[str, list[str]], str, bytes]:
    """Its variables, the resolution line, and what follows."""
    variables: dict[str, list[str]] = {}
    at = 0
    while True:
        end = data.find(b"\n", at, _LONGEST)
        if end < 0:
            raise ValueError("expected a Radiance picture, found a header without an end")
        line = data[at:end].decode("latin-1").strip()
        at = end + 1
        if not line:
            break
        name, equals, value = line.partition("=")
        if equals:
            variables.setdefault(name.strip().upper(), []).append(value.strip())
    end = data.find(b"\n", at, _LONGEST)
    if end < 0:
        raise ValueError("expected a Radiance picture, found no resolution line")
    return variables, data[at:end].decode("latin-1").strip(), data[end + 1 :]


def _resolution(line: str) -> tuple[str, int, str, int]:
    """The axis along which scanlines follow each other, their number, the axis along them, and their length."""
    found = _RESOLUTION.fullmatch(line)
    if found is None or found[2] == found[5] or not (int(found[3]) and int(found[6])):
        raise ValueError(f"expected a resolution line such as -Y 512 +X 1024, got {line!r}")
    return found[1] + found[2], int(found[3]), found[4] + found[5], int(found[6])


def _upright(pixels: Image, first: str, second: str) -> Image:
    """Y grows upwards and X to the right; the picture's first row is the highest."""
    if first[1] == "X":
        pixels, first, second = pixels.swapaxes(0, 1), second, first
    return pixels[:: 1 if first[0] == "-" else -1, :: 1 if second[0] == "+" else -1]


def _format(variables: dict[str, list[str]]) -> str:
    kind = variables.get("FORMAT", [_FORMATS[0]])[-1].lower()
    if kind not in _FORMATS:
        raise ValueError(f"expected FORMAT of {' or '.join(_FORMATS)}, got {kind!r}")
    return kind


def _product(variables: dict[str, list[str]], name: str) -> Image:
    """The product of all lines of a name, for each colour."""
    lines = variables.get(name, [])
    factors = [_numbers(name, line, 1 if name == "EXPOSURE" else 3) for line in lines]
    product = np.prod([np.broadcast_to(factor, 3) for factor in factors], axis=0) if factors else np.ones(3)
    if not (np.isfinite(product) & (product > 0)).all():
        raise ValueError(f"expected positive numbers of {name}, got {', '.join(lines)}")
    return np.asarray(product, np.float32)


def _numbers(name: str, line: str, count: int) -> NDArray[np.float64]:
    try:
        numbers = np.array([float(word) for word in line.split()])
    except ValueError:
        numbers = np.zeros(0)
    if len(numbers) != count:
        raise ValueError(f"expected {count} numbers of {name}, got {line!r}")
    return numbers


def _words(numbers: NDArray[Any]) -> str:
    distinct = numbers[:1] if (numbers == numbers[0]).all() else numbers
    return " ".join(f"{number:g}" for number in distinct)
