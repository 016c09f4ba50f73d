"""How many suns and lamps of a moving light go through texel columns: few while it moves, all once it stands still."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..columns import Haar
from ..columns.haar import PEAKS

if TYPE_CHECKING:
    from ..columns.inner import AnyColumns
    from ..light.environment import Environment
    from ..update.methods import Method

__all__ = ["PeakSplit"]

_TERMS_A_PEAK = 8
"""A peak that moves leaves four texels and enters four: a frame of fewer terms for each would never catch up."""


class PeakSplit:
    """The split of a light into wavelets and texels, frame by frame.

    Any number of peaks describes the same light; more of them reach an image with less error from truncation, and cost
    more terms where they move. So a frame sends no more than its budget follows, measured where the budget is terms, by
    what the frames before have sent where it is time; and each time that a light which stands still has been applied,
    twice as many, until all are sent. A budget in error, and the exact product, send all at once.

    Parameters
    ----------
    columns
        That the light is measured in.
    method
        Whose budget it is.
    """

    def __init__(self, columns: AnyColumns, method: Method) -> None:
        self._all = columns
        self._columns = columns if isinstance(columns, Haar) and columns.texels else None
        self._timed = method.milliseconds is not None
        if method.terms is not None or self._timed:
            self._moving = min(PEAKS, max(1, (method.terms or 0) // _TERMS_A_PEAK))
        else:
            self._moving = PEAKS
        self._peaks = self._moving
        self._light: object = None
        self._converged = False

    def coefficients(self, env: Environment) -> tuple[NDArray[np.float64], bool]:
        """V, split as this frame can follow it, and whether all peaks are."""
        if self._columns is None:
            return self._all.coefficients(env), True
        if env._layers != self._light:
            self._peaks = self._moving
        elif self._converged:
            self._peaks = min(2 * self._peaks, PEAKS)
        self._light, peaks = env._layers, self._peaks
        return self._columns.coefficients(env, peaks), peaks == PEAKS

    def note(self, sent: int, converged: bool) -> None:
        """Takes note of how many columns a frame sent, and whether the light as split has been applied."""
        self._converged = converged
        if self._timed and not converged:
            # By powers of two, and up only where there is room: another split is another light to follow.
            follows = max(1, sent // _TERMS_A_PEAK)
            while self._moving > follows:
                self._moving //= 2
            if follows >= 4 * self._moving:
                self._moving = min(2 * self._moving, PEAKS)
