"""How far a method's pictures are from the exact ones as the light moves, and how they flicker."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...light.motion import Motion

__all__ = ["Track", "turning"]


class Track:
    """Series over the frames of one method, each relative to the frame's exact picture, in the L2 norm.

    Attributes
    ----------
    errors
        The error image.
    edges
        The same of differences between neighbouring pixels: shadows' edges rather than smooth shading.
    flicker
        What the error image changes by from the frame before. A picture that lacks something lacks something else in
        the next frame: that, too, is in it, though it is no flicker to the eye.
    unrest
        The second difference in time of the pictures themselves: what jumps, and not what moves evenly. Exact pictures
        have an unrest of their own to compare with.
    """

    def __init__(self) -> None:
        self.errors: list[float] = []
        self.edges: list[float] = []
        self.flicker: list[float] = []
        self.unrest: list[float] = []
        self._error: NDArray[np.float32] | None = None
        self._shown: list[NDArray[np.float32]] = []

    def add(self, picture: NDArray[np.float32], exact: NDArray[np.float32]) -> None:
        """Takes the next frame."""
        size, error = _norm(exact), picture - exact
        self.errors.append(_share(_norm(error), size))
        self.edges.append(_share(_slopes(error), _slopes(exact)))
        self.flicker.append(0.0 if self._error is None else _share(_norm(error - self._error), size))
        self._error = error
        self._shown = [*self._shown, picture][-3:]
        jump = np.diff(np.stack(self._shown), 2, axis=0) if len(self._shown) == 3 else np.zeros(1)
        self.unrest.append(_share(_norm(jump), size))

    def mean(self, what: str, frames: slice) -> float:
        """The mean of one series, in percent."""
        return 100 * float(np.mean(getattr(self, what)[frames]))


def turning(motion: Motion) -> slice:
    """The frames in which the light has moved; the first, if it never does."""
    return slice(min(1, motion.stop), motion.stop + 1)


def _norm(array: NDArray[Any]) -> float:
    return float(np.sqrt(np.square(array, dtype=np.float64).sum()))


def _slopes(picture: NDArray[Any]) -> float:
    return float(np.hypot(_norm(np.diff(picture, axis=0)), _norm(np.diff(picture, axis=1))))


def _share(part: float, whole: float) -> float:
    """Nothing is 0, whatever it is relative to."""
    return part / whole if part > 0 else 0.0
