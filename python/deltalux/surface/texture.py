"""Texture coordinates to colours."""

from __future__ import annotations

import numpy as np


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
