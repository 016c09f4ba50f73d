"""How far a frame can be from the exact one, in parts, and how far it probably is."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from ..transport.transport import Transport

__all__ = ["Bound", "Doubt"]


class Bound(float):
    """No receiver's red, green or blue is further off than this number. It is a float that knows what it is made of.

    Attributes
    ----------
    pending
        What of it is light that was not sent yet; it falls to zero while the light stands still.
    truncation
        What of it the transport has lost, which no budget brings back.
    """

    pending: float
    truncation: float
    _frame: Doubt | None

    def __new__(cls, total: float, truncation: float = 0.0, frame: Doubt | None = None) -> Bound:
        self = super().__new__(cls, total)
        self.truncation = min(truncation, total)
        self.pending = total - self.truncation if self.truncation < total else 0.0
        self._frame = frame
        return self

    @property
    def relative(self) -> Bound:
        """The same over the root mean square of `Frame.values`: no relative L2 error is larger."""
        size = 0.0 if self._frame is None else self._frame.size()
        return Bound(_over(self, size), _over(self.truncation, size))

    @property
    def estimate(self) -> float:
        """The relative L2 error that the frame probably has: to a factor of two in nine of ten frames of the scenes and
        lights that it was worked out on; others were not tried.

        What is not sent counts by the norms of the columns of M that it goes through, as if its signs were independent.
        Truncation counts by its bound, over how much larger that was than the errors measured under the built-in lights
        when the transport was made: that is asked once of a transport, and takes a product for each of them.
        """
        return 0.0 if self._frame is None else _over(self._frame.error(self.truncation), self._frame.size())

    def describe(self) -> str:
        """The error in words.

        Returns
        -------
        str
            Such as "about 0.3 %, at most 4 %", of the picture.
        """
        return f"about {100 * self.estimate:.2g} %, at most {100 * self.relative:.2g} %"


class Doubt:
    """What a bound needs to know of its frame where more than the number is asked.

    Parameters
    ----------
    values
        B.
    remaining
        For each band and colour the norm of what is not applied of the light.
    transport
        M.
    pessimism
        How many times the bound of truncation is the error that truncation makes.
    """

    def __init__(
        self,
        values: NDArray[np.float32],
        remaining: Sequence[tuple[float, float, float]],
        transport: Transport,
        pessimism: Callable[[Transport], float],
    ) -> None:
        self._values, self._remaining, self._transport, self._pessimism = values, remaining, transport, pessimism

    def size(self) -> float:
        """The root mean square of B."""
        return float(np.sqrt(np.square(self._values, dtype=np.float64).mean()))

    def error(self, truncation: float) -> float:
        """The root mean square of what B is probably off."""
        squares = np.square(self._remaining).mean(axis=1)
        pending = np.sqrt(_gains(self._transport) @ squares)
        return float(np.hypot(pending, truncation / self._pessimism(self._transport)))


def _over(error: float, size: float) -> float:
    """No error is 0, whatever it is relative to."""
    if error == 0.0:
        return 0.0
    return error / size if 0.0 < size < math.inf else math.inf


def _gains(transport: Transport) -> NDArray[np.float64]:
    """For each band the mean square that a unit of light in it makes of a receiver."""
    columns = transport.columns
    squares = np.square(transport.column_norms) / (transport.shape[0] * transport.channels)
    of_band = np.bincount(columns.bands, squares) / np.bincount(columns.bands)
    return np.asarray(of_band)
