"""Round lights at infinity, and what a round brush leaves on the sphere of directions, as cubemaps."""

from __future__ import annotations

from collections.abc import Iterable
from functools import cache

import numpy as np
from numpy.typing import NDArray

from ..sphere import face_directions
from . import skies

__all__ = ["FACE", "Place", "dabbed", "disc", "even_disc"]

FACE = 128
"""Texels along an edge of the maps that lights are drawn on."""
_FINE = 256
_SMALL = 6.0
"""Degrees below which a disc is drawn on finer maps."""

Place = tuple[float, float]
"""Azimuth, from -Z towards +X, and elevation, in degrees."""


def disc(place: Place, radius: float, face: int = FACE) -> NDArray[np.float32]:
    """The share of each texel that a disc covers, its edge a texel wide: (6, face, face)."""
    cosine = _centres(face) @ skies.toward(*np.radians(place)).astype(np.float32)
    width = np.pi / 2 / face
    near = cosine > np.cos(min(np.radians(radius) + width, np.pi))
    away = np.arccos(np.minimum(cosine[near], 1))
    cover = np.zeros(cosine.shape, np.float32)
    cover[near] = np.clip((np.radians(radius) - away) / width + 0.5, 0, 1)
    return cover


def even_disc(radius: float) -> NDArray[np.float32]:
    """A disc around -Z that gives the light of one of radiance 1, however small it is beside a texel: (6, n, n, 3)."""
    face = _FINE if radius < _SMALL else FACE
    cover = disc((0.0, 0.0), radius, face)
    # A texel's solid angle goes with the cube of the cosine at its face.
    angles = (2.0 / face) ** 2 * np.abs(_centres(face)).max(axis=-1).astype(np.float64) ** 3
    wanted = 2.0 * np.pi * (1.0 - np.cos(np.radians(radius)))
    return np.asarray(np.repeat(cover[..., None], 3, axis=-1) * (wanted / (cover * angles).sum()), np.float32)


def dabbed(
    map: NDArray[np.float32], places: Iterable[Place], radius: float, colour: NDArray[np.float32]
) -> NDArray[np.float32]:
    """A map (6, n, n, 3) after a round brush has touched places; where dabs cross, the brighter is seen."""
    for place in places:
        map = np.maximum(map, disc(place, radius, map.shape[1])[..., None] * colour)
    return map


@cache
def _centres(face: int) -> NDArray[np.float32]:
    """Directions of the texels of the maps that lights are drawn on; every dab of paint asks for them."""
    return face_directions(face).astype(np.float32)
