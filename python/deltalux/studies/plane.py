"""Error and run time of every method, weight and budget on one moving light: what maps and comparisons rest on."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from ..environment import Environment
from ..methods import Full, Incremental, Method, Nonlinear, PerBand
from ..progress import Progress
from ..relight import Relighter
from ..replay import Row, relative_errors
from ..transport import Transport

__all__ = ["MAKERS", "WEIGHTS", "Candidate", "Point", "best_within", "candidates", "measure"]

WEIGHTS = ("area", "transport", "cost")
MAKERS: dict[str, Callable[..., Method]] = {"NWA": Nonlinear, "BI": Incremental, "PBI": PerBand}


@dataclass(frozen=True)
class Candidate:
    """A method with a weight and a budget in terms; the exact product has none."""

    family: str
    weight: str
    terms: int | None

    @property
    def row(self) -> Row:
        """As methods are listed elsewhere. NWA keeps nothing, so it need not start from an exact product."""
        if self.terms is None:
            return Row("exact", "exact", Full())
        initial = None if self.family == "NWA" else "full"
        return Row(str(self), self.family, MAKERS[self.family](self.terms, weight=self.weight), initial)

    def __str__(self) -> str:
        return f"{self.family}-{self.terms} {self.weight}" if self.terms else self.family


def candidates(terms: Sequence[int]) -> list[Candidate]:
    """All pairs of a method and a weight at these budgets, after the exact product."""
    grid = [Candidate(family, weight, n) for family in MAKERS for weight in WEIGHTS for n in terms]
    return [Candidate("exact", "", None), *grid]


@dataclass(frozen=True)
class Point:
    """One candidate: its mean image error (relative L2), and the time of its frames."""

    candidate: Candidate
    error: float
    milliseconds: float
    """Median."""
    p95: float


def measure(
    transport: Transport, frames: Sequence[Environment], asked: Sequence[Candidate], skip: int, progress: Progress
) -> list[Point]:
    """Every candidate over the same frames, of which the first `skip` are not counted.

    Candidates take turns frame by frame, so that what disturbs one disturbs all, and every frame finds cold caches.
    """
    rows = [candidate.row for candidate in asked]
    relighters = [Relighter(transport, row.method, row.initial) for row in rows]
    errors, seconds = np.zeros((2, len(rows), len(frames)))
    for k, env in enumerate(frames):
        progress(k, len(frames))
        exact = transport.image(transport.multiply(transport.coefficients(env)))
        for j, relighter in enumerate(relighters):
            frame = relighter.step(env)
            seconds[j, k] = frame.seconds
            if k >= skip:
                errors[j, k] = relative_errors(transport.image(frame.values), exact)[1]
    p50, p95 = 1e3 * np.quantile(seconds[:, skip:], (0.5, 0.95), axis=1)
    means = errors[:, skip:].mean(axis=1)
    return [Point(asked[j], float(means[j]), float(p50[j]), float(p95[j])) for j in range(len(rows))]


def best_within(points: Sequence[Point], milliseconds: float) -> Point | None:
    """The least error among those whose median frame is in time."""
    in_time = [point for point in points if point.milliseconds <= milliseconds]
    return min(in_time, key=lambda point: point.error, default=None)
