"""A method as the core takes it: names, numbers and weights instead of a class."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .methods import Full, HarmonicOrder, Incremental, Linear, Method, Nonlinear, PerBand

_NAMES: dict[type, str] = {
    Full: "full",
    Linear: "linear",
    Nonlinear: "nonlinear",
    Incremental: "incremental",
    PerBand: "per-band",
    HarmonicOrder: "harmonic-order",
}


def settings(
    method: Method,
    areas: NDArray[np.float64],
    column_norms: ArrayLike | None = None,
    column_bytes: ArrayLike | None = None,
    band_norms: ArrayLike | None = None,
    *,
    milliseconds_cost: float | None = None,
) -> dict[str, Any]:
    """A method as the core takes it: its weights as numbers, its budget as one of three.

    ``milliseconds_cost`` is what a budget in milliseconds buys, in the unit of ``column_bytes``.
    """
    if type(method) not in _NAMES:
        raise ValueError(f"expected an update method such as PerBand(terms=30), got {method!r}")
    timed = getattr(method, "milliseconds", None) is not None
    if timed and milliseconds_cost is None:
        raise ValueError("a budget in milliseconds needs a Relighter, which measures time; give terms= or error=")
    columns = len(areas)
    norms = _per_column("column_norms", column_norms, columns)
    costs = _per_column("column_bytes", column_bytes, columns)
    error = getattr(method, "error", None)
    if error is not None and band_norms is None:
        raise ValueError("a budget in error needs band_norms, the largest row norm of M in every band")
    # More terms than there are candidates are all of them.
    terms = 3 * columns if isinstance(method, Full) else method.terms
    return {
        "method": _NAMES[type(method)],
        "terms": terms if terms is None else min(terms, 3 * columns),
        "cost": milliseconds_cost if timed else None,
        "error": error,
        "factors": [] if band_norms is None else np.asarray(band_norms, np.float64).tolist(),
        "weights": _weights(getattr(method, "weight", "none"), areas, norms, costs),
        "costs": costs,
        "test": getattr(method, "test", "simple"),
        "norm": getattr(method, "norm", "l1"),
        "fixed": min(getattr(method, "fixed", None) or 0, columns),
        "tolerance": getattr(method, "tolerance", 0.0),
        "separate": getattr(method, "channels", "joint") == "separate",
    }


def _weights(
    name: str, areas: NDArray[np.float64], norms: NDArray[np.float64] | None, costs: NDArray[np.float64] | None
) -> NDArray[np.float64]:
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


def _per_column(name: str, numbers: ArrayLike | None, columns: int) -> NDArray[np.float64] | None:
    if numbers is None:
        return None
    array = np.ascontiguousarray(numbers, np.float64)
    if array.shape != (columns,):
        raise ValueError(f"expected {name} of shape ({columns},), got {array.shape}")
    return array
