"""How diffuse light passes between surfaces while lamps move: over nodes, or by D and M_s."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..transport.passing import Gathered, StudioNodes
from ..transport.studio import StudioTransport
from ..update.methods import Method
from .follower import Follower
from .lighting import Colours, Lighting, Sources

__all__ = ["Carried", "Carrier", "Received", "bound_of", "carrier"]

Reflectance = Callable[[str], Colours]
"""Diffuse reflectances under the looks of materials: of the "samples", or of the "nodes"."""


@dataclass(frozen=True, eq=False)
class Received:
    """What rows of the view receive of surfaces."""

    values: NDArray[np.floating]
    """Irradiance over pi, (rows, 3)."""
    bound: float
    """How far it may be from all that there is to receive."""
    converged: bool
    """Whether all of it has been sent."""


@dataclass(frozen=True, eq=False)
class Carried:
    """What lamps and surfaces together make of the light of gather samples."""

    light: Colours
    """L over the tree of the samples."""
    unsure: float
    """The norm of what it may be off by."""
    received: Received | None
    """By the view, where that is known already."""


class OverNodes:
    """Light at nodes is a function of the lamps: nothing of it is approximated, and no product is kept."""

    def __init__(self, transport: StudioTransport, nodes: StudioNodes) -> None:
        self._transport, self._nodes = transport, nodes

    def carried(self, lighting: Lighting, sources: Sources, reflectance: Reflectance) -> Carried:
        """Pass after pass: irradiance and radiosity, as rows take them; samples are a pass behind the view."""
        transport, nodes = self._transport, self._nodes
        rho, arriving = reflectance("nodes"), lighting.arrived("nodes", sources)
        count = len(nodes)
        rows = np.zeros((2 * count, 3))
        behind = rows
        for number in range(transport.passes + 1):
            if number == transport.passes:
                behind = rows.copy()
            leaving = rho * arriving
            arriving = nodes.factors.passed(leaving)
            rows[:count] += arriving
            rows[count:] += leaving
        direct = lighting.arrived("samples", sources)
        light = reflectance("samples") * (direct + nodes.samples.taken(behind))
        return Carried(transport.tree.forward(light), 0.0, Received(nodes.view.taken(rows), 0.0, True))

    def received(self, carried: Carried) -> Received:
        """By the view."""
        assert carried.received is not None
        return carried.received


class OverSamples:
    """L = L_d + rho M_s L_d + .. in full; D follows by the method."""

    def __init__(self, transport: StudioTransport, gathered: Gathered, method: Method) -> None:
        self._transport, self._gathered, self._method = transport, gathered, method
        self._follower: Follower | None = None
        self._known: tuple[object, Received] | None = None

    def carried(self, lighting: Lighting, sources: Sources, reflectance: Reflectance) -> Carried:
        """Bounces between samples, and how far they may be from untruncated ones."""
        transport, (kept, lost) = self._transport, self._norms
        rho, areas = reflectance("samples"), transport.areas
        passing = rho * lighting.arrived("samples", sources)
        whole, off, unsure = passing.copy(), np.zeros(len(rho)), np.zeros(len(rho))
        for _ in range(transport.passes):
            V = transport.tree.forward(passing)
            passing = rho * self._gathered.bounces.multiply(V)
            # No sum of a row and light is larger than their norms make it: of what is off, and of what the row lost.
            length = np.sqrt((areas * off**2).sum())
            off = rho.max(axis=1) * (kept * length + lost * np.sqrt((V**2).sum(axis=0).max()))
            whole, unsure = whole + passing, unsure + off
        return Carried(transport.tree.forward(whole), float(np.sqrt((areas * unsure**2).sum())), None)

    @cached_property
    def _norms(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Of the rows of M_s: their norms, and those of what they lost."""
        core = self._gathered.bounces._core
        kept, lost = (np.sqrt((own.astype(np.float64) ** 2).sum(axis=1)) for own in (core.kept(), core.dropped()))
        return kept, lost

    def received(self, carried: Carried) -> Received:
        """By the view."""
        if self._follower is None:
            self._follower = Follower(self._gathered.diffuse, self._method, carried.light)
        frame = self._follower.follow(carried.light)
        if self._known is None or self._known[0] is not frame:
            self._known = frame, Received(frame.values, bound_of(self._follower, carried.unsure), frame.converged)
        return self._known[1]


Carrier = OverNodes | OverSamples
"""Both ways are asked alike."""


def carrier(transport: StudioTransport, method: Method) -> Carrier:
    """The one that a transport was made for."""
    between = transport.between
    if isinstance(between, StudioNodes):
        return OverNodes(transport, between)
    return OverSamples(transport, between, method)


def bound_of(follower: Follower, unsure: float) -> float:
    """How far what a follower shows may be off, where its light may be off by so much."""
    return follower.frame.bound + follower.longest * unsure
