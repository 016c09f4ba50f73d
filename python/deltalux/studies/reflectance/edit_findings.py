"""How far methods are from edits that they follow: the curve, its energy, and the picture, frame after frame."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...columns import Daubechies4
from ...relight.entrants import EXACT, Entrant, bi, nwa
from ...relight.relighter import Relighter
from ...transport.curves import CurvePart
from .edits import MODELS, Script, energy

__all__ = ["BUDGETS", "MEASURES", "Followed", "entrants", "follow_edits"]

Errors = NDArray[np.float64]

BUDGETS = ((30, "area"), (10, "area"), (30, "none"), (10, "none"))
"""Terms, and by what a change of a coefficient is weighed."""
MEASURES = ("peak", "energy", "picture")
"""Of a frame: the largest difference of the curve over its peak; the energy of the difference over that of the curve;
the difference of what the pearl reflects, relative L2."""


def entrants(terms: int, weight: str) -> tuple[Entrant, Entrant]:
    """BI and NWA of one budget."""
    kind = "" if weight == "area" else "unweighted"
    return bi(terms, kind, weight=weight), nwa(terms, kind, weight=weight)


@dataclass(frozen=True)
class Followed:
    """One edit of one model as a method followed it.

    Attributes
    ----------
    errors
        By `MEASURES`: (frames,) each, that before the edit included.
    moving
        Frames in which the curve moves.
    exact
        From the last of them on, after how many frames the curve is applied in full, that one included; None: never.
    curves, values
        (frames, 256), and what the pearl reflects, (frames, rows, 3).
    """

    errors: dict[str, Errors]
    moving: int
    exact: int | None
    curves: NDArray[np.float64]
    values: NDArray[np.float32]

    def mean(self, measure: str) -> float:
        """Over the frames in which the curve moves."""
        return float(self.errors[measure][1 : 1 + self.moving].mean())


def follow_edits(part: CurvePart, script: Script, rows: Sequence[Entrant]) -> dict[str, Followed]:
    """Each method behind one script, by its name; and "exact", which applies all of every frame."""
    d4 = Daubechies4()
    targets = [np.repeat(own[:, None], 3, axis=1) for own in d4.forward(script.curves(MODELS[part.name]).T).T]
    # Held against what all of V gives, in the units that exact sums have it in.
    curves, whole, _ = _followed(part, EXACT, targets)
    found = {}
    for row in (EXACT, *rows):
        shown, values, converged = _followed(part, row, targets)
        after = np.flatnonzero(converged[script.frames :])
        exact = int(after[0]) + 1 if after.size else None
        found[row.name] = Followed(_errors(shown, curves, values, whole), script.frames, exact, shown, values)
    return found


def _followed(
    part: CurvePart, row: Entrant, targets: Sequence[NDArray[np.float64]]
) -> tuple[NDArray[np.float64], NDArray[np.float32], list[bool]]:
    """The curve as it is applied, what the pearl reflects, and whether all is applied: frame after frame."""
    follower = Relighter(part.transport, row.method, row.initial)
    values, held, converged = [], [], []
    for V in targets:
        frame = follower.step(V)
        values.append(frame.values)
        held.append(follower.values[:, 0])
        converged.append(frame.converged)
    return Daubechies4().inverse(np.stack(held, axis=1)).T, np.stack(values), converged


def _errors(
    shown: NDArray[np.float64], curves: NDArray[np.float64], values: NDArray[np.float32], whole: NDArray[np.float32]
) -> dict[str, Errors]:
    off = np.abs(shown - curves)
    size = np.maximum(np.linalg.norm(whole, axis=(1, 2)), np.finfo(np.float32).tiny)
    return {
        "peak": off.max(axis=1) / curves.max(axis=1),
        "energy": energy(off) / energy(curves),
        "picture": np.linalg.norm(values.astype(np.float64) - whole, axis=(1, 2)) / size,
    }
