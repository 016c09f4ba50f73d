"""Light between surfaces: what is asked of it, and the nodes at which it is solved."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from .._core import Bounces, Links, NodeRows, Nodes
from ..checks import count

if TYPE_CHECKING:
    from .preparation import Prepared

__all__ = ["ALL", "RESIDUAL", "Between", "Interreflection", "between"]

_MOST_NODES = 32_768
"""Where no other number is asked: F and the rows of nodes grow with them."""
_MOST_BOUNCES = 1_000
RESIDUAL = 1e-3
"""Of all bounces, where no other is asked."""
ALL = -1
"""All bounces, as plans and transports count them."""
_SEEN = 8
"""Rays of a receiver along a side, by which it is audited and gathers."""


@dataclass(frozen=True)
class Between:
    """What is asked of light between surfaces.

    Attributes
    ----------
    bounces
        How many, or `ALL`.
    residual
        Of all bounces: the proved error of a column, relative to its largest value.
    cap
        The most nodes.
    """

    bounces: int
    residual: float
    cap: int


def between(bounces: int | str, residual: float, nodes: int | str) -> Between | None:
    """Checks what is asked; None where no bounce is."""
    if bounces == "all":
        number = ALL
    elif isinstance(bounces, str):
        raise ValueError(f'expected bounces to be a number of 0 or more, or "all", got {bounces!r}')
    else:
        number = count("bounces", bounces)
    if number > _MOST_BOUNCES:
        raise ValueError(f'expected at most {_MOST_BOUNCES:,} bounces, or "all", got {number:,}')
    if isinstance(residual, bool) or not isinstance(residual, (int, float)) or not 0 < residual < 1:
        raise ValueError(f"expected a residual above 0 and below 1 (0.001 is 0.1 %), got {residual!r}")
    if isinstance(nodes, str):
        if nodes != "auto":
            raise ValueError(f'expected nodes to be "auto" or the most there may be, got {nodes!r}')
        cap = _MOST_NODES
    elif (cap := count("nodes", nodes)) < 1:
        raise ValueError(f"expected at least one node, got {cap}")
    return Between(number, float(residual), cap) if number else None


class Interreflection:
    """Nodes of a scene, and what comes of them.

    Parameters
    ----------
    prepared
        The scene whose receivers are found.
    asked
        Of light between its surfaces.
    """

    def __init__(self, prepared: Prepared, asked: Between) -> None:
        self.asked, self._prepared = asked, prepared
        started = prepared.clock()
        self.nodes = Nodes.place(prepared.core, **prepared.view, share=prepared.settings.spacing, cap=asked.cap)
        self.seconds = prepared.clock() - started
        count = len(self.nodes)
        # A cell's colour is the mean of its points: textures are finer than nodes.
        colours = prepared.scene.albedo_at(self.nodes.triangle, self.nodes.barycentric)
        self.albedo = np.ascontiguousarray(colours.reshape(count, Nodes.CELL, 3).mean(axis=1), np.float32)

    @property
    def columns(self) -> str:
        """What nodes' rows are measured in: wavelets, where receivers have texels besides."""
        return str(self._prepared.columns).removesuffix("+texels")

    @property
    def channels(self) -> int:
        """1 where all surfaces are grey."""
        return Bounces.channels_of(self.albedo)

    @property
    def rays_a_node(self) -> int:
        """Of the form factors."""
        return self._prepared.settings.node_rays**2

    def between_nodes(self, progress: Callable[[int], None]) -> Bounces:
        """Form factors: how light passes between nodes."""
        side = self._prepared.settings.node_rays
        return Bounces(self._prepared.core, self.nodes, self.albedo, side=side, progress=progress)

    def links(self, bounces: Bounces, progress: Callable[[int], None]) -> Links:
        """From nodes to receivers."""
        prepared = self._prepared
        audit = prepared.settings.audit
        return bounces.links(prepared.core, prepared.rows, side=_SEEN, audit=audit, progress=progress)

    def rows(
        self, bounces: Bounces, links: Links, threshold: float, quantum: int, progress: Callable[[int], None]
    ) -> NodeRows:
        """The nodes' rows, solved and truncated."""
        settings, asked = self._prepared.settings, self.asked
        return bounces.rows(
            self._prepared.core,
            links,
            columns=self.columns,
            edge_side=settings.edge_side,
            bounces=None if asked.bounces == ALL else asked.bounces,
            residual=asked.residual,
            threshold=threshold,
            quantum=quantum,
            width=settings.width,
            progress=progress,
        )
