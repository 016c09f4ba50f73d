"""Least squares over what is not negative, with a certificate of how far from the least a point can be.

    F(x) = 1/2 |A x - b|^2 + sum toll x,  x >= 0

By accelerated projected gradients that start anew where they overshoot (Nesterov 1983; O'Donoghue and Candes 2015, by
their gradient rule).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["Problem", "Solution", "convex_shortfall", "curvature", "solve", "tolled_shortfall"]

_Array = NDArray[np.float64]
_MARGIN = 1.05
"""By how much more a step allows for than the curvature that was seen."""
_LOOKS = 4


@dataclass(frozen=True)
class Problem:
    """What is to be as small as it can be.

    Attributes
    ----------
    normal
        x to A^T A x.
    target
        A^T b.
    energy
        |b|^2.
    toll
        What each part of x costs.
    shortfall
        (x, A^T A x) to how far F(x) is above the least, at most.
    """

    normal: Callable[[_Array], _Array]
    target: _Array
    energy: float
    toll: _Array
    shortfall: Callable[[Problem, _Array, _Array], float]

    def objective(self, x: _Array, image: _Array) -> float:
        """F(x), where image is A^T A x."""
        return 0.5 * self.missed(x, image) + _dot(self.toll, x)

    def missed(self, x: _Array, image: _Array) -> float:
        """|A x - b|^2."""
        return _dot(x, image) - 2 * _dot(x, self.target) + self.energy


def convex_shortfall(least: float, solved: Callable[[_Array], float]) -> Callable[[Problem, _Array, _Array], float]:
    """Where A^T A has a part P that can be solved for: by strong convexity.

    With g the gradient at x, every z >= 0 has F(z) >= F(x) + g (z - x) + 1/2 (z - x) P (z - x). Where g_j > 0, its term
    is at least -g_j x_j, which is taken where x_j is small; of the others, r, the least of all z is -1/2 r P^-1 r.

    Parameters
    ----------
    least
        About how curved P is: below which x counts as small.
    solved
        r to r P^-1 r.
    """

    def shortfall(problem: Problem, x: _Array, image: _Array) -> float:
        gradient = image - problem.target + problem.toll
        ends = (gradient > 0) & (2 * least * x < gradient)
        return _dot(gradient[ends], x[ends]) + 0.5 * solved(np.where(ends, 0.0, gradient))

    return shortfall


def tolled_shortfall(problem: Problem, x: _Array, image: _Array) -> float:
    """Where each part of x has its toll: by Fenchel's dual, -1/2 |u|^2 - u b for any u with -A^T u below all tolls.

    u is the largest multiple of A x - b that they allow, or the best one.
    """
    square, against = problem.missed(x, image), _dot(x, problem.target) - problem.energy
    steepest = float(((problem.target - image) / problem.toll).max())
    best = max(-against / square, 0.0) if square > 0 else 0.0
    scale = min(best, 1 / steepest) if steepest > 0 else best
    return problem.objective(x, image) + 0.5 * scale**2 * square + scale * against


@dataclass(frozen=True)
class Solution:
    """The best point that was found.

    Attributes
    ----------
    x
        It.
    objective, bound
        F(x), and what no other point is below.
    iterations
        Products with A and its transpose.
    """

    x: _Array
    objective: float
    bound: float
    iterations: int


def solve(
    problem: Problem, start: _Array, steepest: float, gap: float, iterations: int, tell: Callable[[int], object]
) -> Solution:
    """Iterates until the objective is within `gap` of the bound, or until the user interrupts it.

    Parameters
    ----------
    problem
        To be solved.
    start
        Where to begin; what of it is negative counts as zero.
    steepest
        About the largest curvature of A^T A; what is seen of more is allowed for.
    gap
        In the unit of the objective.
    iterations
        At most.
    tell
        Told of how many are done.
    """
    x = np.maximum(start, 0.0)
    image, done = problem.normal(x), 1
    objective = problem.objective(x, image)
    found = Solution(x, objective, objective - problem.shortfall(problem, x, image), done)
    ahead, ahead_image, pace = x, image, 1.0
    try:
        while done < iterations and found.objective - found.bound > gap:
            gradient = ahead_image - problem.target + problem.toll
            new = np.maximum(ahead - gradient / (_MARGIN * steepest), 0.0)
            new_image, done = problem.normal(new), done + 1
            moved = new - ahead
            seen, square = _dot(moved, new_image - ahead_image), _dot(moved, moved)
            if seen > _MARGIN * steepest * square:
                steepest = seen / square
                continue
            objective = problem.objective(new, new_image)
            bound = max(objective - problem.shortfall(problem, new, new_image), found.bound)
            better = new if objective <= found.objective else found.x
            found = Solution(better, min(objective, found.objective), bound, done)
            # Where the way on turns against the way that was gone, it starts anew without a run-up.
            pace = 1.0 if _dot(ahead - new, new - x) > 0 else pace
            longer = 0.5 + np.sqrt(0.25 + pace**2)
            run = (pace - 1) / longer
            ahead, ahead_image = new + run * (new - x), new_image + run * (new_image - image)
            x, image, pace = new, new_image, longer
            tell(done)
    except KeyboardInterrupt:
        pass
    return found


def curvature(normal: Callable[[_Array], _Array], start: _Array) -> float:
    """About the largest curvature of A^T A: by a few powers."""
    x, largest = np.abs(start), 0.0
    for _ in range(_LOOKS):
        length = np.sqrt(_dot(x, x))
        if length == 0:
            break
        x = normal(x / length)
        largest = np.sqrt(_dot(x, x))
    return float(largest)


def _dot(a: _Array, b: _Array) -> float:
    return float(np.vdot(a, b))
