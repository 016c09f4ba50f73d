"""A choice of one's own: what a method is shown of a frame, and what it says is to be sent."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["Choice", "State"]


@dataclass(frozen=True, eq=False)
class State:
    """One frame as choosing sees it: where V is, where our copy of it is, and what columns are worth. Read-only.

    Attributes
    ----------
    target
        (columns, 3) float64: V, where the light now is.
    values
        (columns, 3) float64: V as applied so far.
    bands
        (columns,) integers: the band of every column, 0 the coarsest.
    areas
        (columns,) float64: texels under the support of every column.
    weights
        (columns,) float64: what a unit of change is worth, by the method's ``weight``.
    """

    target: NDArray[np.float64]
    values: NDArray[np.float64]
    bands: NDArray[np.intp]
    areas: NDArray[np.float64]
    weights: NDArray[np.float64]

    def __post_init__(self) -> None:
        # They are the caller's own, or the package's: looked at and not written.
        for name in ("target", "values", "bands", "areas", "weights"):
            view = getattr(self, name).view()
            view.flags.writeable = False
            object.__setattr__(self, name, view)

    @property
    def change(self) -> NDArray[np.float64]:
        """(columns, 3) float64: what is not yet applied."""
        return self.target - self.values

    def worth(self, *, anew: bool = False) -> NDArray[np.float64]:
        """What sending each column is worth: its weight times the sum of its change in the three colours.

        Parameters
        ----------
        anew
            As if its band started from zero: the whole light counts, not the change.

        Returns
        -------
        (columns,) float64
            The keys of Overbeck 2006, section 6.1.
        """
        moved = self.target if anew else self.change
        worth: NDArray[np.float64] = self.weights * np.abs(moved).sum(axis=1)
        return worth


@dataclass(frozen=True, eq=False)
class Choice:
    """What a frame is to do: bands that start anew, and columns in the order in which they are worth sending.

    Of the columns as many are sent as the method's budget allows; without a budget, all of them.

    Attributes
    ----------
    resets
        Bands that become zero before anything is sent.
    columns
        (m,) integers: the columns to send, the most important first; one that is named twice is sent once.
    """

    resets: Sequence[int] = ()
    columns: ArrayLike = ()

    def checked(self) -> tuple[list[int], NDArray[np.uint32]]:
        """The bands and the columns in their plain types.

        Returns
        -------
        bands, columns
            A list of int, and (m,) uint32.

        Raises
        ------
        ValueError
            If they are not whole numbers of 0 or more, or the columns are no list of them.
        """
        columns, resets = _numbers("columns", self.columns), _numbers("resets", self.resets)
        for name, numbers in (("columns", columns), ("resets", resets)):
            whole = numbers.size == 0 or (numbers.dtype.kind in "iu" and numbers.min() >= 0)
            if numbers.ndim != 1 or not whole or (numbers.size and numbers.max() >= 2**32):
                raise ValueError(
                    f"expected {name} of a choice as one list of whole numbers of 0 or more, got {numbers.dtype} of "
                    f"shape {numbers.shape}"
                )
        return [int(band) for band in resets], columns.astype(np.uint32)


def _numbers(name: str, numbers: ArrayLike) -> NDArray[Any]:
    try:
        return np.asarray(numbers)
    except ValueError as error:
        raise ValueError(f"expected {name} of a choice as one list of whole numbers of 0 or more: {error}") from None
