"""Texture coordinates to values: samplers, and pictures that are filtered over what a pixel shows of them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["WRAPS", "Sampler", "bilinear", "filtered"]

WRAPS = ("repeat", "clamp", "mirror")
# Samples along a footprint that is longer than wide.
_MOST_SAMPLES = 16


@dataclass(frozen=True)
class Sampler:
    """How a picture goes on beyond its borders, and what lies between its texels.

    Parameters
    ----------
    wrap
        Along u and along v: "repeat", "clamp" or "mirror".
    nearest
        Whether the nearest texel speaks alone where the picture is magnified.
    """

    wrap: tuple[str, str] = ("repeat", "repeat")
    nearest: bool = False


_PLAIN = Sampler()


def _inside(texel: NDArray[np.int64], size: int, wrap: str) -> NDArray[np.int64]:
    if wrap == "clamp":
        return np.clip(texel, 0, size - 1)
    if wrap == "mirror":
        at = texel % (2 * size)
        return np.minimum(at, 2 * size - 1 - at)
    return texel % size


def bilinear(texture: np.ndarray, uv: np.ndarray, sampler: Sampler = _PLAIN) -> np.ndarray:
    """Texture values at (k, 2) coordinates with the origin at the lower left; (k, channels)."""
    height, width = texture.shape[:2]
    u, v = uv[:, 0], 1.0 - uv[:, 1]
    # Whole turns change nothing, and leave more digits to what is left.
    u, v = (at % 1.0 if wrap == "repeat" else at for at, wrap in zip((u, v), sampler.wrap, strict=True))
    if sampler.nearest:
        column, row = np.floor(u * width).astype(np.int64), np.floor(v * height).astype(np.int64)
        return np.asarray(texture[_inside(row, height, sampler.wrap[1]), _inside(column, width, sampler.wrap[0])])
    x, y = u * width - 0.5, v * height - 0.5
    column, row = np.floor(x).astype(np.int64), np.floor(y).astype(np.int64)
    fx, fy = (x - column)[:, None], (y - row)[:, None]
    left, right = (_inside(at, width, sampler.wrap[0]) for at in (column, column + 1))
    above, below = (_inside(at, height, sampler.wrap[1]) for at in (row, row + 1))
    upper = (1.0 - fx) * texture[above, left] + fx * texture[above, right]
    lower = (1.0 - fx) * texture[below, left] + fx * texture[below, right]
    return np.asarray((1.0 - fy) * upper + fy * lower)


def filtered(texture: np.ndarray, uv: np.ndarray, steps: np.ndarray, sampler: Sampler = _PLAIN) -> NDArray[np.floating]:
    """The means of a texture over parallelograms: up to 16 samples along the longer side, as wide as the shorter one.

    Parameters
    ----------
    texture : (h, w, channels)
    uv : (k, 2)
        Their middles, origin at the lower left.
    steps : (k, 2, 2)
        How far their two sides lead in texture coordinates.
    sampler : Sampler
        Of the picture; where it is magnified it is looked up as `bilinear` does.

    Returns
    -------
    (k, channels)
        The picture's mean is kept, whatever its size.
    """
    height, width = texture.shape[:2]
    lengths = np.linalg.norm(steps * (width, height), axis=2)
    longer = lengths.argmax(axis=1)
    every = np.arange(len(uv))
    length, breadth = lengths[every, longer], lengths[every, 1 - longer]
    small = length > 1.0
    found = bilinear(texture, uv, sampler)
    if not small.any():
        return found
    count = np.ceil(length / np.maximum(breadth, 1.0)).clip(1, _MOST_SAMPLES).astype(np.int64)
    # In texels of a level of the pyramid a sample is as wide as one of them.
    level = np.log2(np.maximum(np.maximum(length / count, breadth), 1.0))
    along = steps[every, longer]
    smooth = Sampler(sampler.wrap)
    found[small] = 0.0
    for number, picture in enumerate(_pyramid(texture, int(np.ceil(level[small].max())))):
        # Between two levels both speak, by how near they are.
        share = np.clip(1.0 - np.abs(level - number), 0.0, 1.0)
        for samples in np.unique(count[small & (share > 0.0)]):
            here = np.flatnonzero(small & (share > 0.0) & (count == samples))
            for k in range(samples):
                at = uv[here] + ((k + 0.5) / samples - 0.5) * along[here]
                found[here] += (share[here] / samples)[:, None] * bilinear(picture, at, smooth)
    return found


def _pyramid(texture: np.ndarray, levels: int) -> Iterator[np.ndarray]:
    """The texture, and again and again half as large, down to one texel; that one for all further levels."""
    yield texture
    for _ in range(levels):
        for axis in (0, 1):
            texture = _halved(texture, axis)
        yield texture


def _halved(texture: np.ndarray, axis: int) -> np.ndarray:
    """Means over equal parts along an axis, half as many as texels: exact for odd numbers too."""
    size = texture.shape[axis]
    if size == 1:
        return texture
    parts = size // 2
    sums = np.insert(np.cumsum(texture, axis=axis, dtype=np.float64), 0, 0.0, axis=axis)
    ends = np.linspace(0.0, size, parts + 1)
    whole = np.minimum(np.floor(ends).astype(np.int64), size - 1)
    rest = (ends - whole).reshape([-1 if k == axis else 1 for k in range(texture.ndim)])
    at = (1.0 - rest) * sums.take(whole, axis) + rest * sums.take(whole + 1, axis)
    return np.asarray(np.diff(at, axis=axis) * (parts / size), texture.dtype)
