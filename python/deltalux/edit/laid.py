"""Pictures in the place of a material's numbers: k_d, k_s and colours that differ over a surface (Nguyen 2010, Fig. 9).

None of them is part of a matrix, so that they are swapped like any other look.
"""

from __future__ import annotations

import os
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..checks import Vector, as_vector
from ..images.reading import load_image
from ..transport.coordinates import Coordinates

__all__ = ["Laid", "Share", "at", "largest", "share_of"]


class Laid:
    """A picture laid over a material by its texture coordinates.

    Parameters
    ----------
    picture : (h, w, 3) float32
        Of numbers of 0 or more; row 0 is the top.
    coordinates
        Where the rows, samples and nodes of a studio lie in it.
    """

    def __init__(self, picture: NDArray[np.float32], coordinates: Coordinates) -> None:
        self.picture, self._coordinates = picture, coordinates
        self._looked_up: dict[str, NDArray[np.float64]] = {}

    def at(self, of: str) -> NDArray[np.float64]:
        """Its values: see `Coordinates.colours`."""
        if of not in self._looked_up:
            self._looked_up[of] = self._coordinates.colours(self.picture, of)
        return self._looked_up[of]

    def __repr__(self) -> str:
        height, width = self.picture.shape[:2]
        return f"<picture of {width} x {height}>"


Share = Vector | Laid
"""Red, green and blue, the same all over a surface or as a picture says."""


def share_of(name: str, value: ArrayLike | str | os.PathLike[str], coordinates: Coordinates | None) -> Share:
    """What a user gives for k_d, k_s or a colour.

    Raises
    ------
    ValueError
        If it is not finite, below 0 or of another shape; or a picture where a studio has no texture coordinates.
    OSError
        If a file cannot be read.
    """
    given: Any = load_image(value)[0] if isinstance(value, str | os.PathLike) else value
    array = np.asarray(given, np.float64)
    fits = array.shape in ((), (3,)) or (array.ndim in (2, 3) and array.shape[2:] in ((), (1,), (3,)) and array.size)
    if not fits or not np.isfinite(array).all() or (array < 0).any():
        expected = "one or three finite numbers of 0 or more, or a picture of them, (h, w) or (h, w, 3)"
        raise ValueError(f"expected {name} to be {expected}, got {_told(value)}")
    if array.ndim < 2:
        return as_vector(np.broadcast_to(array, 3))
    if coordinates is None:
        raise ValueError(f"expected {name} to be numbers, as this studio's scene has no texture coordinates")
    whole = np.broadcast_to(array if array.ndim == 3 else array[..., None], (*array.shape[:2], 3))
    return Laid(np.array(whole, np.float32), coordinates)


def _told(value: Any) -> str:
    shape = np.shape(value)
    return f"an array of shape {shape}" if len(shape) > 1 else repr(value)


def at(share: Share, of: str, own: NDArray[Any]) -> NDArray[np.float64]:
    """Its values at some rows, samples or nodes: see `Coordinates.colours`; three numbers are the same at all."""
    return share.at(of)[own] if isinstance(share, Laid) else np.asarray(share, np.float64)


def largest(share: Share) -> NDArray[np.float64]:
    """The largest red, green and blue of it."""
    return share.picture.max(axis=(0, 1)).astype(np.float64) if isinstance(share, Laid) else np.asarray(share)
