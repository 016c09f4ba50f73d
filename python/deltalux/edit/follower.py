"""One matrix of a studio and its follower."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..relight.relighter import Frame, Relighter
from ..transport.transport import Transport
from ..update.methods import Method

__all__ = ["Follower"]


class Follower:
    """Follows light over one matrix, or over factors that a mix adds, the same for all rows.

    Parameters
    ----------
    transport
        The matrix or the factors.
    method
        How it follows.
    light : (columns, 3) float64
        What it starts from, in full.
    mix : (factors,) float64
        Where there are factors.
    """

    def __init__(
        self,
        transport: Transport,
        method: Method,
        light: NDArray[np.float64],
        mix: NDArray[np.float64] | None = None,
    ) -> None:
        self.transport, self._mix, self._light = transport, mix, light
        self._relighter = Relighter(transport, method, mix=mix, steady=True)
        self.frame: Frame = self._relighter.step(light)

    def follow(self, light: NDArray[np.float64]) -> Frame:
        """Towards the light; what has arrived costs nothing."""
        if self._light is not light or not self.frame.converged:
            self.frame, self._light = self._relighter.step(light), light
        return self.frame

    def mix(self, mix: NDArray[np.float64]) -> Frame:
        """Another mix of the same responses."""
        if self._mix is None or not np.array_equal(mix, self._mix):
            self._mix = mix
            self.frame = self._relighter.mix(mix)
        return self.frame

    @cached_property
    def _longest(self) -> NDArray[np.float64]:
        """The norm of the longest row of each factor."""
        core, each = self.transport._core, np.eye(self.transport._core.factors, dtype=np.float32)
        rows = self.transport.shape[0]
        if len(each) == 1:
            return np.array([float(np.linalg.norm(core.error_factors(None)))])
        return np.array([float(np.linalg.norm(core.error_factors(np.tile(one, (rows, 1))))) for one in each])

    @property
    def longest(self) -> float:
        """No row of what is shown is longer."""
        return float(self._longest.sum() if self._mix is None else np.abs(self._mix) @ self._longest)
