"""Textures: from pictures to linear values, and from texture coordinates to colours."""

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


def bilinear(texture: np.ndarray, uv: np.ndarray) -> np.ndarray:
    """Texture values at (k, 2) coordinates with the origin at the lower left, repeating; (k, 3)."""
    height, width = texture.shape[:2]
    x = (uv[:, 0] % 1.0) * width - 0.5
    y = ((1.0 - uv[:, 1]) % 1.0) * height - 0.5
    column, row = np.floor(x).astype(np.int64), np.floor(y).astype(np.int64)
    fx, fy = (x - column)[:, None], (y - row)[:, None]
    left, right = column % width, (column + 1) % width
    above, below = row % height, (row + 1) % height
    upper = (1.0 - fx) * texture[above, left] + fx * texture[above, right]
    lower = (1.0 - fx) * texture[below, left] + fx * texture[below, right]
    return np.asarray((1.0 - fy) * upper + fy * lower)
