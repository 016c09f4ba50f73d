"""Textures: from pictures to linear values."""

from __future__ import annotations

from typing import Any

import numpy as np

LARGEST_TEXTURE = 8192 * 8192


def linear_texture(image: Any) -> np.ndarray:
    """The linear values of an 8-bit sRGB picture (PIL), (h, w, 3) float32; ValueError if it is too large."""
    if image.width * image.height > LARGEST_TEXTURE:
        raise ValueError(f"a texture has {image.width} x {image.height} pixels, more than {LARGEST_TEXTURE}")
    encoded = np.asarray(image.convert("RGBA"))[:, :, :3]
    # IEC 61966-2-1, by table.
    levels = np.arange(256) / 255.0
    table = np.where(levels <= 0.04045, levels / 12.92, ((levels + 0.055) / 1.055) ** 2.4)
    linear: np.ndarray = table.astype(np.float32)[encoded]
    return linear
