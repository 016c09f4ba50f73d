"""What a camera's pixels show of a response, before it is one picture: for who mixes surfaces otherwise."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from .receivers import Pixels

__all__ = ["Seen", "Shares"]


@dataclass(frozen=True)
class Seen:
    """Surfaces as pixels show them.

    Attributes
    ----------
    samples
        Each surface that a pixel shows.
    values
        What arrives at each sample, albedos out, (samples, 3).
    besides
        What is seen besides: lobes between vertices, and what surfaces give off; None where there is nothing.
    """

    samples: Pixels
    values: NDArray[np.float32]
    besides: NDArray[np.float32] | None

    def picture(self, values: NDArray[np.float32] | None = None) -> NDArray[np.float32]:
        """All of it on black, (height, width, 3), or with other values instead."""
        picture = self.samples.resolve(self.values if values is None else values)
        return picture if self.besides is None else picture + self.besides


@dataclass(frozen=True)
class Shares:
    """What pixels show of each row: the linear map from responses to pictures on black, and its transpose.

    Attributes
    ----------
    image_shape
        (height, width) of the picture.
    rows
        How many rows a response has.
    samples
        Each surface that a pixel shows.
    corners
        (samples, 3): the rows that a sample's value is mixed from; None where each sample is a row.
    weights
        (samples, 3) float64: by how much of each; None likewise.
    """

    image_shape: tuple[int, int]
    rows: int
    samples: Pixels
    corners: NDArray[np.intp] | None
    weights: NDArray[np.float64] | None

    @cached_property
    def _colours(self) -> NDArray[np.float64]:
        return np.asarray(self.samples.weight[:, None] * self.samples.albedo, np.float64)

    def picture(self, B: NDArray[np.floating]) -> NDArray[np.float64]:
        """The picture of a response, (height, width, 3), without what surfaces give off themselves."""
        taken = (
            B
            if self.corners is None or self.weights is None
            else np.einsum("sk,skc->sc", self.weights, B[self.corners])
        )
        values = taken * self._colours
        return _summed(self.samples.pixel, values, int(np.prod(self.image_shape))).reshape(*self.image_shape, 3)

    def back(self, picture: NDArray[np.floating]) -> NDArray[np.float64]:
        """The transpose: (rows, 3) of numbers at the pixels, (height, width, 3)."""
        values = picture.reshape(-1, 3)[self.samples.pixel] * self._colours
        if self.corners is None or self.weights is None:
            return values
        shares = self.weights[:, :, None] * values[:, None, :]
        return _summed(self.corners.ravel(), shares.reshape(-1, 3), self.rows)


def _summed(place: NDArray[np.integer], values: NDArray[np.float64], length: int) -> NDArray[np.float64]:
    return np.stack([np.bincount(place, own, length) for own in values.T], -1).astype(np.float64)
