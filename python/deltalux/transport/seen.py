"""What a camera's pixels show of a response, before it is one picture: for who mixes surfaces otherwise."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .receivers import Pixels

__all__ = ["Seen"]


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
