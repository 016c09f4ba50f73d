"""Approximation: a copy of V that follows it within a budget. It needs no scene, only vectors."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._core import Approximation as CoreApproximation
from ..mistakes import no_columns
from .choice import State
from .methods import Method
from .settings import asked, per_column, settings, weights_of

__all__ = ["Approximation", "ColumnBands", "Update"]


class ColumnBands(Protocol):
    """All that choosing knows of columns; `Haar` and `SphericalHarmonics` are two."""

    @property
    def bands(self) -> NDArray[Any]:
        """The band of every column: (columns,) integers from 0 on that never descend."""
        ...

    @property
    def areas(self) -> NDArray[Any]:
        """Texels under the support of every column: (columns,) numbers."""
        ...


@dataclass(frozen=True, eq=False)
class Update:
    """What one frame sends: first the bands in `resets` become zero, then ``values[columns] += changes``.

    Attributes
    ----------
    resets
        Bands that start anew, ascending. A band that holds nothing needs no reset and is not listed.
    columns
        (m,) uint32, ascending, each column once.
    changes
        (m, 3) float64: light minus the value that it replaces, zero after a reset.
    """

    resets: tuple[int, ...]
    columns: NDArray[np.uint32]
    changes: NDArray[np.float64]


class Approximation:
    """A copy of V, `values`, that follows it by the choice of a method (Overbeck 2006, Fig. 6.1).

    Parameters
    ----------
    columns
        The columns of V: `Haar`, `SphericalHarmonics`, or anything with ``bands`` and ``areas``.
    method
        How columns are chosen, and how many: `Full`, `Linear`, `Nonlinear`, `Incremental`, `PerBand`, `HarmonicOrder`,
        or a `Method` of one's own.
    initial
        (columns, 3): the values to start from, exactly. None: black.
    column_norms
        (columns,): the norm of every column of M, for ``weight="transport"`` and ``weight="cost"``.
    column_bytes
        (columns,): what sending each column costs, such as its bytes of M, for ``weight="cost"``.
    band_norms
        (bands,): the largest norm that a row of M has in each band, for a budget in error.

    Raises
    ------
    TypeError
        If there are no columns.
    ValueError
        If something is missing, of the wrong shape, or not finite.

    Notes
    -----
    A column is worth weight * (\\|red\\| + \\|green\\| + \\|blue\\|) of its change, or of its light where its band is
    reset; of equal ones the lower goes first. Light that stands still is reached bit for bit. A step that raises
    leaves everything as it was.
    """

    def __init__(
        self,
        columns: ColumnBands,
        method: Method,
        initial: ArrayLike | None = None,
        *,
        column_norms: ArrayLike | None = None,
        column_bytes: ArrayLike | None = None,
        band_norms: ArrayLike | None = None,
    ) -> None:
        if not hasattr(columns, "bands"):
            raise no_columns(columns)
        starts, areas = _bands(columns)
        self.columns = columns
        self.method = method
        norms = per_column("column_norms", column_norms, len(areas))
        costs = per_column("column_bytes", column_bytes, len(areas))
        chosen = settings(method, areas, column_norms=norms, column_costs=costs, band_norms=band_norms)
        self._areas, self._weights = areas, weights_of(method, areas, norms, costs)
        self._core = CoreApproximation(starts, areas.tolist(), chosen)
        if initial is not None:
            self._core.set_values(_coefficients(initial, len(areas)))

    def step(self, target: ArrayLike) -> Update:
        """Brings the values nearer to the light, within the budget.

        Parameters
        ----------
        target
            (columns, 3): V, where the light now is.

        Returns
        -------
        Update
            What was sent.

        Raises
        ------
        ValueError
            If the shape is wrong or a coefficient is NaN, infinite or beyond 1e90; nothing has changed then.
        """
        V, given = _coefficients(target, len(self._core)), None
        if self.method.is_own:
            V = V.copy()  # Looked at twice: what another thread writes meanwhile is in neither look or in both.
            state = State(V, self.values, np.asarray(self.columns.bands), self._areas, self._weights)
            given = asked(self.method, state)
        columns, changes, resets = self._core.step(V, given)
        return Update(tuple(resets), columns, changes)

    @property
    def values(self) -> NDArray[np.float64]:
        """V as applied so far: a copy, (columns, 3) float64."""
        return self._core.values()

    def is_converged(self, target: ArrayLike) -> bool:
        """Whether the values are exactly this light.

        Parameters
        ----------
        target
            (columns, 3): V.

        Returns
        -------
        bool

        Raises
        ------
        ValueError
            If the shape is wrong.
        """
        return self._core.is_converged(_coefficients(target, len(self._core)))


def _bands(columns: ColumnBands) -> tuple[list[int], NDArray[np.float64]]:
    """First column of every band, the number of columns, and the areas."""
    bands, areas = np.asarray(columns.bands), np.ascontiguousarray(columns.areas, np.float64)
    if bands.ndim != 1 or bands.shape != areas.shape or not len(bands) or bands.dtype.kind not in "iu":
        raise ValueError(
            "expected columns with .bands (integers) and .areas of one length, "
            f"got {bands.dtype} {bands.shape} and {areas.shape}"
        )
    if bands[0] < 0 or np.any(bands[1:] < bands[:-1]):
        raise ValueError("expected columns in order of their bands, coarse to fine, from band 0 on")
    return np.searchsorted(bands, np.arange(int(bands[-1]) + 2)).tolist(), areas


def _coefficients(array: ArrayLike, columns: int) -> NDArray[np.float64]:
    numbers = np.asarray(array)
    if numbers.shape != (columns, 3) or numbers.dtype.kind not in "fiu":
        raise ValueError(
            f"expected coefficients of shape ({columns}, 3) and real type, got {numbers.shape} {numbers.dtype}"
        )
    return np.ascontiguousarray(numbers, np.float64)
