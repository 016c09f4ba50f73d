"""Textures: from the bytes of pictures to linear values, opacities and normals."""

from __future__ import annotations

import io
import warnings
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from .content import Content

LARGEST_TEXTURE = 8192 * 8192
_DEEP = ("I;16", "I;16B", "I;16L", "I;16N", "I")
"""Modes of grey pictures of 16 bits."""


def linear(encoded: Any) -> np.ndarray:
    """Linear values of sRGB ones in [0, 1] (IEC 61966-2-1), float32."""
    values = np.asarray(encoded, np.float64)
    found: np.ndarray = np.where(values <= 0.04045, values / 12.92, ((values + 0.055) / 1.055) ** 2.4)
    return found.astype(np.float32)


@dataclass(frozen=True)
class Picture:
    """A picture as it was decoded: levels of `most` at the most."""

    levels: np.ndarray
    """(h, w, 3), as they are stored."""
    alpha: np.ndarray | None
    """(h, w) in [0, 1]; None where the picture has none."""
    most: int

    @cached_property
    def linear(self) -> np.ndarray:
        """Linear values of sRGB: (h, w, 3) float32."""
        return np.asarray(linear(np.arange(self.most + 1) / self.most)[self.levels])

    @cached_property
    def grey(self) -> np.ndarray:
        """Means of the channels as they are, as opacities are stored: (h, w) float32 in [0, 1]."""
        return np.asarray(self.levels.mean(axis=2) / self.most, np.float32)

    def normals(self, scale: float) -> np.ndarray:
        """Vectors in the frame of the surface, x and y times `scale`: (h, w, 3) float32."""
        vectors = 2.0 * self.levels.astype(np.float64) / self.most - 1.0
        return np.asarray(vectors * (scale, scale, 1.0), np.float32)


def decoded(data: bytes) -> Picture:
    """A picture of any format that Pillow reads.

    Raises
    ------
    OSError, ValueError
        If it is no picture, too large, or not of 8 or 16 bits.
    """
    from PIL import Image

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", Image.DecompressionBombWarning)
            with Image.open(io.BytesIO(data)) as image:
                return _levels(image)
    except (Image.DecompressionBombWarning, Image.DecompressionBombError) as error:
        raise ValueError(str(error)) from None


def _levels(image: Any) -> Picture:
    if image.width * image.height > LARGEST_TEXTURE:
        raise ValueError(f"a texture has {image.width} x {image.height} pixels, more than {LARGEST_TEXTURE}")
    if image.mode in _DEEP:
        # Pillow would clip what is above 255.
        grey = np.asarray(image).astype(np.int64).clip(0, 65535).astype(np.uint16)
        return Picture(np.repeat(grey[:, :, None], 3, axis=2), None, 65535)
    if image.mode == "F":
        raise ValueError("a texture has floats for pixels; expected 8 or 16 bits")
    transparent = image.mode in ("RGBA", "LA", "PA", "La", "RGBa") or "transparency" in image.info
    pixels = np.asarray(image.convert("RGBA"))
    alpha = (pixels[:, :, 3] / 255.0).astype(np.float32) if transparent else None
    return Picture(pixels[:, :, :3], alpha, 255)


def read_picture(content: Content, path: Path | None, name: str) -> Picture | None:
    """The picture in a file; of one that cannot be read the reason is noted."""
    if path is None:
        content.leave_out("textures ignored", f"{name} cannot be read: it is not there, or not in the scene's folders")
        return None
    try:
        return decoded(content.read(path))
    except (OSError, ValueError) as error:
        content.leave_out("textures ignored", f"{name} cannot be read: {error}")
        return None
