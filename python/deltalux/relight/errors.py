"""How far a picture, or a light, is from the exact one."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray


def relative_errors(found: NDArray[Any], exact: NDArray[Any]) -> tuple[float, float, float]:
    """sum |d| / sum |exact|, then sqrt(sum d^2 / sum exact^2), then max |d| over the root mean square of `exact`."""
    d = np.asarray(found, np.float64) - exact
    square = float(np.square(exact, dtype=np.float64).sum())
    size = np.sqrt(square / exact.size)
    worst = float(np.abs(d).max(initial=0.0))
    return (
        _ratio(float(np.abs(d).sum()), float(np.abs(exact).sum(dtype=np.float64))),
        float(np.sqrt(_ratio(float(np.square(d).sum()), square))),
        _ratio(worst, float(size)),
    )


def errors_of_lights(
    found: NDArray[Any], exact: NDArray[Any], weight: NDArray[Any] | float = 1.0
) -> NDArray[np.float64]:
    """Relative L2 error of (k, rows, 3) under each of k lights, weighted; lights that reach nothing are left out."""
    d = np.square((found.astype(np.float64) - exact) * weight).sum(axis=(1, 2))
    size = np.square(exact.astype(np.float64) * weight).sum(axis=(1, 2))
    lit = size > 0
    return np.asarray(np.sqrt(d[lit] / size[lit]) if lit.any() else np.zeros(1))


def _ratio(error: float, size: float) -> float:
    """No error is 0, whatever it is relative to; an error relative to nothing is infinite."""
    if error == 0.0:
        return 0.0
    return error / size if size > 0 else float("inf")
