"""Lamps over a studio's transport: what has been traced of each, and the light that arrives."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, Generic, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from .._core import Glints, Sights
from .._core import Lamp as CoreLamp
from ..light.environment import Environment
from ..light.lamps import Lamp, far_lamps
from ..transport.passing import StudioNodes
from ..transport.studio import EACH, StudioPart, StudioTransport

__all__ = ["Colours", "Kept", "Lighting", "Sources"]

_DIRECTIONS = 256
"""That an environment is taken apart into."""
Colours = NDArray[np.float64]
Value = TypeVar("Value")


class Kept(Generic[Value]):
    """What was made last, and what it was made of."""

    def __init__(self) -> None:
        self._of: Any = None
        self._value: Value | None = None

    def made(self, of: Any, make: Callable[[], Value]) -> Value:
        """The value; made anew where it was made of something else."""
        if self._value is None or self._of != of:
            self._value, self._of = make(), of
        return self._value


@dataclass(eq=False)
class Lit:
    """A part of a lamp as it has been traced."""

    lamp: CoreLamp
    sights: Sights
    view: Colours
    """Irradiance over pi of the rows of the view."""
    arrived: dict[str, Colours]
    """The same of the samples, and of the nodes, in the mean of their cells."""
    glints: dict[str, Glints] = field(default_factory=dict)
    """What of this part leaves the rows of each material through its model."""


class Sources(NamedTuple):
    """What shines, as far as it has been traced."""

    parts: tuple[tuple[float, Lit], ...]
    """Each with what it stands for: of a lamp that is half done, its parts stand for twice themselves."""
    done: bool

    def total(self, of: Callable[[Lit], Colours], shape: tuple[int, ...]) -> Colours:
        """The sum over all parts, in their order."""
        total = np.zeros(shape)
        for weight, lit in self.parts:
            total += weight * of(lit)
        return total


class Lighting:
    """Lamps, traced part by part and frame by frame.

    Parameters
    ----------
    transport
        Over whose rows and samples they shine.
    """

    def __init__(self, transport: StudioTransport) -> None:
        self.transport = transport
        self._lamps: Sequence[Lamp] = ()
        self._env: Environment | None = None
        self._parts: dict[Any, tuple[CoreLamp, ...]] = {}
        self._lit: dict[Any, list[Lit]] = {}
        self._view = Kept[Colours]()
        self._cells = {"samples": transport.cells}
        if isinstance(transport.between, StudioNodes):
            self._cells["nodes"] = transport.nodes
        self._arrived = {name: Kept[Colours]() for name in self._cells}

    @property
    def env(self) -> Environment | None:
        """What lies around the scene."""
        return self._env

    def set(self, lamps: Sequence[Lamp], env: Environment | None) -> None:
        """Other lamps; what is known of those that stay is kept.

        Parameters
        ----------
        lamps, env
            As of `Studio.set_lights`, which checks them.
        """
        self._lamps, self._env = tuple(lamps), env
        parts = {lamp: lamp._parts for lamp in lamps}
        around = {} if env is None else {env: self._parts.get(env) or far_lamps(env, _DIRECTIONS)}
        self._parts = {**parts, **around}
        self._lit = {key: self._lit.get(key, []) for key in self._parts}

    def traced(self) -> Sources:
        """Traces a part more of each lamp that is not done."""
        for key, parts in self._parts.items():
            lit = self._lit[key]
            if len(lit) < len(parts):
                lit.append(self._trace(parts[len(lit)]))
        weighed = []
        for key in (*self._lamps, *(() if self._env is None else (self._env,))):
            lit = self._lit[key]
            weighed += [(len(self._parts[key]) / len(lit), own) for own in lit]
        done = all(len(self._lit[key]) == len(parts) for key, parts in self._parts.items())
        return Sources(tuple(weighed), done)

    def _trace(self, lamp: CoreLamp) -> Lit:
        view = self.transport.view
        sights = view.sights(lamp)
        arrived = {name: own.irradiance(lamp, own.sights(lamp), together=EACH) for name, own in self._cells.items()}
        return Lit(lamp, sights, view.irradiance(lamp, sights), arrived)

    def view(self, sources: Sources) -> Colours:
        """Irradiance over pi of all rows."""
        shape = (len(self.transport.view), 3)
        return self._view.made(sources, lambda: sources.total(lambda lit: lit.view, shape))

    def arrived(self, name: str, sources: Sources) -> Colours:
        """The same of "samples", or of "nodes"."""
        shape = (len(self._cells[name]) // EACH, 3)
        return self._arrived[name].made(sources, lambda: sources.total(lambda lit: lit.arrived[name], shape))

    def glints(self, sources: Sources, part: StudioPart) -> list[tuple[float, Glints]]:
        """What of the lamps' own light leaves the rows of a material, whatever its gamma: of each part with what it
        stands for."""
        return [(weight, self._glints(part, lit)) for weight, lit in sources.parts]

    def _glints(self, part: StudioPart, lit: Lit) -> Glints:
        if part.name not in lit.glints:
            eyes, family = self.transport.eyes_of(part), part.family._core
            lit.glints[part.name] = self.transport.view.glints(lit.lamp, lit.sights, part.rows, eyes, family)
        return lit.glints[part.name]
