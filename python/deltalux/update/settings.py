"""A method as the core takes it: its rule, its budget, and its weights as numbers."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._core import Settings
from .choice import Choice, State
from .methods import Method

__all__ = ["asked", "per_column", "settings", "weights_of"]


def settings(
    method: Method,
    areas: NDArray[np.float64],
    *,
    column_norms: ArrayLike | None = None,
    column_costs: ArrayLike | None = None,
    band_norms: ArrayLike | None = None,
    timed: bool = False,
) -> Settings:
    """All that choosing is told of one stage.

    ``timed`` says that somebody measures time, and sets a budget in milliseconds anew in every frame.
    """
    if not isinstance(method, Method):
        raise ValueError(f"expected an update method such as PerBand(terms=30), got {method!r}")
    if method.milliseconds is not None and not timed:
        raise ValueError("a budget in milliseconds needs a Relighter, which measures time; give terms= or error=")
    if method.error is not None and band_norms is None:
        raise ValueError("a budget in error needs band_norms, the largest row norm of M in every band")
    columns = len(areas)
    norms, costs = per_column("column_norms", column_norms, columns), per_column("column_bytes", column_costs, columns)
    # More terms than there are candidates are all of them; so are those of a method without a budget.
    within = method.milliseconds is None and method.error is None
    terms = min(3 * columns if method.terms is None else method.terms, 3 * columns) if within else None
    return Settings(
        method.core(),
        weights=weights_of(method, areas, norms, costs),
        terms=terms,
        cost=0.0 if method.milliseconds is not None else None,
        error=method.error,
        factors=None if band_norms is None else np.ascontiguousarray(band_norms, np.float64),
        costs=costs,
        separate=method.channels == "separate",
    )


def weights_of(
    method: Method, areas: NDArray[np.float64], norms: NDArray[np.float64] | None, costs: NDArray[np.float64] | None
) -> NDArray[np.float64]:
    """What a unit of change in every column is worth, (columns,) float64."""
    name = method.weight
    if name == "area":
        return areas
    if name == "root-area":
        return np.sqrt(areas)
    if name == "none":
        return np.ones_like(areas)
    if norms is None:
        raise ValueError(f"weight={name!r} needs column_norms, the norms of the columns of M")
    if name == "transport":
        return norms
    if costs is None:
        raise ValueError(f"weight={name!r} needs column_bytes, the bytes of the columns of M")
    return norms / np.sqrt(np.maximum(costs, 1.0))


def asked(method: Method, state: State) -> tuple[list[int], NDArray[np.uint32]]:
    """What a method of one's own says of a frame, checked."""
    choice = method.choose(state)
    if not isinstance(choice, Choice):
        raise ValueError(f"expected {type(method).__name__}.choose to return a Choice, got {choice!r}")
    return choice.checked()


def per_column(name: str, numbers: ArrayLike | None, columns: int) -> NDArray[np.float64] | None:
    if numbers is None:
        return None
    array = np.ascontiguousarray(numbers, np.float64)
    if array.shape != (columns,):
        raise ValueError(f"expected {name} of shape ({columns},), got {array.shape}")
    return array
