"""Ghosts: light that is shown where there is none, measured in the bands of a Haar pyramid.

In every block of every band, the detail energy that is shown beyond what the exact one has there; summed over all, and
relative to the energy of all exact detail. Where the exact one has none, that is all that is shown; detail that is
missing, as in a blurred picture, is no ghost. The measure needs no threshold, and the exact one has none of it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...columns import Haar
from ..case import Light, band_starts

__all__ = ["cubemap_ghosts", "image_ghosts"]

_LEVELS = 4
"""Levels of the pyramid of an image: blocks of 2 x 2 to 16 x 16 pixels."""


def cubemap_ghosts(columns: Haar, shown: Light, exact: Light) -> float:
    """Ghosts in coefficients `shown` where those of the light are `exact`.

    By Parseval the energy of a band-pass image over a block is that of its three wavelets.
    """
    # Band 0 begins with the six scaling functions, which are no detail.
    starts = [6, *band_starts(columns)[1:], columns.columns]
    bands = [slice(first, last) for first, last in zip(starts[:-1], starts[1:], strict=True)]
    return _ghosts([_energy(shown[band], 3) for band in bands], [_energy(exact[band], 3) for band in bands])


def _energy(coefficients: NDArray[np.float64], group: int) -> NDArray[np.float64]:
    """Energy of every `group` neighbouring coefficients, over all colours."""
    return np.asarray(np.square(coefficients).sum(axis=1).reshape(-1, group).sum(axis=1))


def image_ghosts(shown: NDArray[np.float32], exact: NDArray[np.float32]) -> float:
    """The same of two images (h, w, 3), on the whole blocks of 16 x 16 pixels that they hold."""
    return _ghosts(_pyramid(shown), _pyramid(exact))


def _pyramid(image: NDArray[np.float32]) -> list[NDArray[np.float64]]:
    """Detail energy of every block of every level, fine to coarse (the orthonormal 2D Haar transform)."""
    side = 2**_LEVELS
    height, width = (length // side * side for length in image.shape[:2])
    rest, energies = image[:height, :width].astype(np.float64), []
    for _ in range(_LEVELS):
        a, b, c, d = rest[::2, ::2], rest[::2, 1::2], rest[1::2, ::2], rest[1::2, 1::2]
        details = ((a - b + c - d) / 2, (a + b - c - d) / 2, (a - b - c + d) / 2)
        energies.append(np.sum([np.square(detail).sum(axis=2) for detail in details], axis=0).reshape(-1))
        rest = (a + b + c + d) / 2
    return energies


def _ghosts(shown: list[NDArray[np.float64]], exact: list[NDArray[np.float64]]) -> float:
    beyond = sum(float(np.maximum(of - reference, 0).sum()) for of, reference in zip(shown, exact, strict=True))
    energy = sum(float(reference.sum()) for reference in exact)
    return beyond / energy if energy > 0 else 0.0
