"""Arrays of a sample as files of a format."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..checks import one_of
from ..images.writing import FAST, LEVELS, write_pixels

__all__ = ["FORMATS", "PICTURES", "Format"]

FORMATS = ("exr", "png16", "npz")
PICTURES = ("picture", "direct", "indirect")
"""What is radiance, and shown with an exposure."""
_SHARES = ("mask", "albedo")
"""What lies between 0 and 1."""
_WHOLE = ("depth", "position")
"""What half floats are too coarse for."""
_LARGEST_HALF = 65_504.0
_WHITE = 65_535.0


@dataclass(frozen=True)
class Format:
    """How arrays become files.

    Attributes
    ----------
    kind
        ``"exr"``, linear radiance; ``"png16"``, 16 bits of sRGB with an exposure, and what is no colour as EXR;
        ``"npz"``, all arrays of a sample in one file.
    half
        Half floats, but for depth, position and V.
    compression
        0, none, to 9, the slowest; nothing is lost.
    """

    kind: str = "exr"
    half: bool = True
    compression: int = FAST

    def __post_init__(self) -> None:
        one_of("format", self.kind, FORMATS)
        if isinstance(self.compression, bool) or self.compression not in LEVELS:
            raise ValueError(f"expected a compression from 0 to 9, got {self.compression!r}")

    @property
    def encoding(self) -> str:
        """What the numbers of a picture mean."""
        return "srgb" if self.kind == "png16" else "linear"

    def write(self, folder: Path, key: str, arrays: Mapping[str, NDArray[Any]], exposure: float) -> dict[str, str]:
        """Writes arrays by their names into a folder; returns the names of their files."""
        if self.kind == "npz":
            name = f"{key}.npz"
            self._write_npz(folder / name, {k: self._numbers(k, array) for k, array in arrays.items()})
            return dict.fromkeys(arrays, name)
        return {
            k: self._write_one(folder, key if k == "picture" else f"{key}.{k}", k, arrays[k], exposure) for k in arrays
        }

    def _write_one(self, folder: Path, stem: str, what: str, array: NDArray[Any], exposure: float) -> str:
        if array.ndim == 2 and what == "light":
            with open(folder / f"{stem}.npy", "wb") as file:
                np.save(file, array)
            return f"{stem}.npy"
        pixels = np.ascontiguousarray(array if array.ndim == 3 else array[..., None], np.float32)
        if self.kind == "png16" and what in PICTURES + _SHARES:
            shown = _srgb16(pixels, exposure) if what in PICTURES else _linear16(pixels)
            write_pixels(folder / f"{stem}.png", shown, "uint16", level=self.compression)
            return f"{stem}.png"
        # The library turns floats into halves as well, and takes longer.
        numbers = self._numbers(what, pixels)
        number = "half" if numbers.dtype == np.float16 else "float"
        write_pixels(folder / f"{stem}.exr", numbers, number, level=self.compression)
        return f"{stem}.exr"

    def _halved(self, what: str) -> bool:
        return self.half and what not in _WHOLE

    def _numbers(self, what: str, array: NDArray[Any]) -> NDArray[Any]:
        if array.dtype != np.float32 or not self._halved(what):
            return array
        return array.clip(-_LARGEST_HALF, _LARGEST_HALF).astype(np.float16)

    def _write_npz(self, path: Path, arrays: Mapping[str, NDArray[Any]]) -> None:
        """As `numpy.savez`, whose files know no level, and the time of day in some versions of Python."""
        method = zipfile.ZIP_DEFLATED if self.compression else zipfile.ZIP_STORED
        with zipfile.ZipFile(path, "w", method, compresslevel=self.compression) as archive:
            for name, array in arrays.items():
                data = io.BytesIO()
                np.save(data, array)
                # A name with a date is the first day of 1980.
                archive.writestr(zipfile.ZipInfo(f"{name}.npy"), data.getvalue(), method, self.compression)


def _srgb16(linear: NDArray[np.float32], exposure: float) -> NDArray[np.uint16]:
    """16 bits of sRGB; a fourth channel is alpha, and colours are not multiplied by it any more."""
    colours = np.nan_to_num(linear[..., :3])
    if linear.shape[2] == 4:
        alpha = linear[..., 3:].clip(0.0, 1.0)
        colours = np.divide(colours, alpha, out=np.zeros_like(colours), where=alpha > 0)
    lit = (colours * np.float32(2.0**exposure)).clip(0.0, 1.0)
    curved = np.where(lit <= 0.0031308, 12.92 * lit, 1.055 * lit ** np.float32(1 / 2.4) - np.float32(0.055))
    return (
        np.concatenate([_linear16(curved), _linear16(linear[..., 3:])], axis=2)
        if linear.shape[2] == 4
        else _linear16(curved)
    )


def _linear16(shares: NDArray[np.float32]) -> NDArray[np.uint16]:
    return np.ascontiguousarray(shares.clip(0.0, 1.0) * np.float32(_WHITE) + np.float32(0.5)).astype(np.uint16)
