"""Error and run time of every method, weight and budget on one moving light: what maps and comparisons rest on."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from ...light.environment import Environment
from ...progress import Progress
from ...relight.entrants import EXACT, Entrant
from ...relight.errors import relative_errors
from ...relight.relighter import Relighter
from ...transport.transport import Transport
from ...update.methods import Incremental, Method, Nonlinear, PerBand

__all__ = ["MAKERS", "WEIGHTS", "Candidate", "Point", "best_within", "candidates", "measure"]

WEIGHTS = ("area", "transport", "cost")
MAKERS: dict[str, Callable[..., Method]] = {"NWA": Nonlinear, "BI": Incremental, "PBI": PerBand}


@dataclass(frozen=True)
class Candidate:
    """A method with a weight and a budget in terms; the exact product has none. Or one that is given as it is."""

    family: str
    weight: str
    terms: int | None
    own: Entrant | None = None

    @property
    def row(self) -> Entrant:
        """As methods are listed elsewhere. NWA keeps nothing, so it need not start from an exact product."""
        if self.own is not None:
            return self.own
        if self.terms is None:
            return EXACT
        initial = None if self.family == "NWA" else "full"
        return Entrant(str(self), self.family, MAKERS[self.family](self.terms, weight=self.weight), initial)

    def __str__(self) -> str:
        if self.own is not None:
            return self.own.name
        return f"{self.family}-{self.terms} {self.weight}" if self.terms else self.family


def candidates(terms: Sequence[int]) -> list[Candidate]:
    """All pairs of a method and a weight at these budgets, after the exact product."""
    grid = [Candidate(family, weight, n) for family in MAKERS for weight in WEIGHTS for n in terms]
    return [Candidate(EXACT.family, "", None), *grid]


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

    Each runs alone, as one follower in a program does, and twice, the second time in the opposite order, so that a
    disturbance does not stand for a candidate: its time is the lesser of the two medians.
    """
    exact = [transport.image(transport.multiply(transport.coefficients(env))) for env in frames[skip:]]
    errors, p50, p95 = np.zeros((3, len(asked)))
    for turn, order in enumerate((range(len(asked)), reversed(range(len(asked))))):
        for done, j in enumerate(order):
            progress(turn * len(asked) + done, 2 * len(asked))
            row = asked[j].row
            relighter, seconds = Relighter(transport, row.method, row.initial), []
            for k, env in enumerate(frames):
                frame = relighter.step(env)
                seconds.append(frame.seconds)
                if turn == 0 and k >= skip:
                    errors[j] += relative_errors(transport.image(frame.values), exact[k - skip])[1] / len(exact)
            times = 1e3 * np.quantile(seconds[skip:], (0.5, 0.95))
            if turn == 0 or times[0] < p50[j]:
                p50[j], p95[j] = times
    return [Point(asked[j], float(errors[j]), float(p50[j]), float(p95[j])) for j in range(len(asked))]


def best_within(points: Sequence[Point], milliseconds: float) -> Point | None:
    """The least error among those whose median frame is in time."""
    in_time = [point for point in points if point.milliseconds <= milliseconds]
    return min(in_time, key=lambda point: point.error, default=None)
