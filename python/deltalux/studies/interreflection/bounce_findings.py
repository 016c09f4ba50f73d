"""What is measured of light between surfaces, in one scene under one light."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...transport.plan import Solve
from .furnaces import Ball, Furnace

__all__ = ["ENOUGH", "TERMS", "Findings", "Shot"]

ENOUGH = 6
"""Bounces that are taken for many."""
TERMS = 100
"""Of the light, where only the largest are looked at."""


@dataclass(frozen=True)
class Shot:
    """A picture, what is wrong with it, and what its transport took."""

    picture: NDArray[np.float32]
    error: float
    """Relative L2, against the picture that it is compared with."""
    missing: float
    """Of the light of that picture, as a share."""
    seconds: float
    nbytes: int
    solve: Solve | None

    @property
    def of_nodes(self) -> Solve:
        """How it was solved: ValueError where nothing bounces."""
        if self.solve is None:
            raise ValueError("expected light between surfaces, got direct light alone")
        return self.solve

    @property
    def residual(self) -> float:
        """Proved, of all bounces."""
        return self.of_nodes.residual


@dataclass(frozen=True)
class Findings:
    """All of it."""

    counts: dict[int | str, Shot]
    """By bounces, from 0 to "all", against all."""
    nodes: list[Shot]
    """With `ENOUGH` bounces, from few nodes to many, against the most."""
    milliseconds: list[float]
    """Of a frame over direct light, and with `ENOUGH` bounces."""
    few_terms: list[float]
    """The error of the `TERMS` largest terms of the light: of direct light, and of what has bounced."""
    furnaces: list[Furnace]
    balls: list[Ball]

    @property
    def whole(self) -> Shot:
        """All bounces."""
        return self.counts["all"]

    def steps(self) -> list[tuple[str, float]]:
        """Which bounces, and their share of all light of the picture that has bounced."""
        sums = [float(shot.picture.sum(dtype=np.float64)) for shot in self.counts.values()]
        bounced, names = sums[-1] - sums[0], list(self.counts)
        found = []
        for (before, after), less, more in zip(zip(names, names[1:], strict=False), sums, sums[1:], strict=False):
            name = f"beyond {before}" if after == "all" else str(after)
            if isinstance(before, int) and isinstance(after, int) and after > before + 1:
                name = f"{before + 1} to {after}"
            found.append((name, (more - less) / bounced if bounced > 0 else 0.0))
        return found

    def of_bounced(self, shot: Shot) -> float:
        """The error of a picture with fewer nodes, relative to the light that has bounced."""
        exact = self.nodes[-1].picture.astype(np.float64)
        bounced = np.linalg.norm(exact - self.counts[0].picture)
        return float(np.linalg.norm(shot.picture - exact) / bounced) if bounced > 0 else 0.0

    def beyond_direct(self, shot: Shot) -> tuple[float, float]:
        """Megabytes and seconds that light between surfaces takes."""
        direct = self.counts[0]
        return (shot.nbytes - direct.nbytes) / 1e6, max(shot.seconds - direct.seconds, 0.0)
