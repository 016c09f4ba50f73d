"""What a study looks at: a light, how it moves, its columns, and the scene it falls on where there is one."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..columns import Columns, Haar
from ..light.environment import Environment
from ..light.motion import Motion
from ..relight.entrants import Entrant
from ..transport.transport import Transport
from ..update.approximation import Approximation, Update

if TYPE_CHECKING:
    from ..scene.scene import Scene

__all__ = ["Case", "Light", "Moment", "band_starts", "follow", "light_errors", "lights"]

Light = NDArray[np.float64]
"""Coefficients, (columns, 3)."""


@dataclass(frozen=True)
class Case:
    """One chapter of a study."""

    env: Environment
    motion: Motion
    columns: Haar
    transport: Transport | None = None
    own: tuple[Entrant, ...] = ()
    """Methods of one's own that take part."""
    scene: Scene | None = None
    """What a study traces itself, in several ways."""
    subject: str | None = None
    """What a study looks at that is neither light nor a scene."""

    @property
    def name(self) -> str:
        """The light, and the scene if there is one; or what is looked at in their place."""
        if self.subject is not None:
            return self.subject
        if self.scene is not None:
            return f"{self.env.name} on {self.scene.name}"
        return self.env.name if self.transport is None else f"{self.env.name} on {self.transport.plan.scene}"


class Moment(NamedTuple):
    """One frame of a follower: what it held before, what it was sent, and what it holds."""

    before: Light
    update: Update
    values: Light


def lights(env: Environment, motion: Motion, columns: Columns) -> list[Light]:
    """V in every frame; frames that stand still share one array."""
    frames: list[Light] = []
    for k, angle in enumerate(motion.angles):
        still = k > motion.stop
        frames.append(frames[-1] if still else columns.coefficients(env.rotated(angle, motion.axis)))
    return frames


def follow(columns: Columns, row: Entrant, frames: Sequence[Light]) -> Iterator[Moment]:
    """A method behind a moving light; those that start full hold the first frame's light exactly."""
    approximation = Approximation(columns, row.method, frames[0] if row.initial == "full" else None)
    values = approximation.values
    for light in frames:
        before = values
        update = approximation.step(light)
        values = approximation.values
        yield Moment(before, update, values)


def band_starts(columns: Columns) -> NDArray[np.intp]:
    """The first column of every band, where `np.add.reduceat` begins its sums."""
    return np.asarray(np.searchsorted(columns.bands, np.arange(int(columns.bands[-1]) + 1)))


def light_errors(columns: Columns, values: Light, light: Light) -> tuple[float, float]:
    """The papers' error of light, sum of area |dL| over sum of area |L| on orthonormal coefficients; and plain L2."""
    change = values - light
    l1 = _weighted_l1(columns, change) / _weighted_l1(columns, light)
    return l1, float(np.sqrt(np.square(change).sum() / np.square(light).sum()))


def _weighted_l1(columns: Columns, coefficients: Light) -> float:
    # einsum: a call of BLAS would wake its threads for a vector.
    return float(np.einsum("i,ij->", columns.areas, np.abs(coefficients)))
