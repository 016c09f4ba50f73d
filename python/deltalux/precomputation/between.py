"""Light between surfaces: what is asked of it, and the nodes at which it is solved."""

from __future__ import annotations

import hashlib
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._core import Bounces, Emitters, FileError, Links, LitPoints, Receivers, Sources, TileData
from .._core import Camera as Rays
from .._core import Nodes as CoreNodes
from .._core import Scene as CoreScene
from ..checks import count
from ..columns import Columns
from ..scene.scene import Scene
from ..transport.plan import Solve
from ..transport.transport import Transport
from .quality import Quality

__all__ = [
    "ALL",
    "MOST_NODES",
    "RESIDUAL",
    "Between",
    "KnownNodes",
    "NodePart",
    "Nodes",
    "PlacedNodes",
    "between",
    "linked",
]

MOST_NODES = 32_768
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
        cap = MOST_NODES
    elif (cap := count("nodes", nodes)) < 1:
        raise ValueError(f"expected at least one node, got {cap}")
    return Between(number, float(residual), cap) if number else None


@dataclass(frozen=True)
class NodePart:
    """The nodes' part of a transport, and how it was solved but for what the receivers say."""

    tiles: list[TileData]
    rows: int
    quantum: int
    width: str
    tile_rows: int
    rays: int
    solve: Solve


class PlacedNodes:
    """Nodes placed in a scene, to be solved.

    Attributes
    ----------
    bounces
        How many, or `ALL`.
    columns
        What their rows are measured in.
    seconds
        How long placing them took.
    """

    def __init__(
        self,
        core: CoreScene,
        scene: Scene,
        receivers: Receivers,
        camera: Rays,
        settings: Quality,
        columns: Columns,
        asked: Between,
    ) -> None:
        self._core, self._receivers, self._settings, self._asked = core, receivers, settings, asked
        self.bounces = asked.bounces
        # Wavelets, where receivers have texels besides.
        self.columns = str(columns).removesuffix("+texels")
        started = time.perf_counter()
        self._nodes = CoreNodes.place(core, receivers, camera, share=settings.spacing, cap=asked.cap)
        self.seconds = time.perf_counter() - started
        # A cell's colour is the mean of its points: textures are finer than nodes.
        colours = scene.reflectance_at(self._nodes.triangle, self._nodes.barycentric)
        self._albedo = np.ascontiguousarray(
            colours.reshape(len(self._nodes), CoreNodes.CELL, 3).mean(axis=1), np.float32
        )
        self._between: Bounces | None = None

    def __len__(self) -> int:
        return len(self._nodes)

    @property
    def channels(self) -> int:
        """1 where all surfaces are grey."""
        return Bounces.channels_of(self._albedo)

    @property
    def rays(self) -> int:
        """That placing them took."""
        return self._nodes.rays

    @property
    def why(self) -> str:
        """What they are, in words."""
        reach = " ".join(f"{x:.2f}" for x in self._albedo.mean(axis=0))
        colours = "red, green and blue, as albedos are coloured" if self.channels == 3 else "albedos in reach are grey"
        return f"{len(self):,} nodes x {self._settings.node_rays**2} rays; {colours} ({reach} in the mean)"

    def sources(self, progress: Callable[[int], None]) -> Sources:
        """The nodes as receivers take from them: form factors first."""
        side = self._settings.node_rays
        self._between = Bounces(self._core, self._nodes, self._albedo, side=side, progress=progress)
        return self._between.sources()

    def emitted(self, emitters: Emitters, progress: Callable[[int], None]) -> NDArray[np.float64]:
        """What their rows are under the light that surfaces give off by themselves."""
        assert self._between is not None
        asked = self._asked
        return self._between.emitted(
            self._core,
            emitters,
            # A node's cell has several points.
            side=self._settings.emission_rays // 2,
            bounces=None if asked.bounces == ALL else asked.bounces,
            residual=asked.residual,
            progress=progress,
        )

    def rows(self, links: Links, threshold: float, quantum: int, progress: Callable[[int], None]) -> NodePart:
        """Their rows, solved and truncated."""
        assert self._between is not None
        settings, asked = self._settings, self._asked
        made = self._between.rows(
            self._core,
            self._receivers,
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
        shot, lost = self._between.rays
        off = np.quantile(made.discretisation or [0.0], (0.5, 0.95, 1.0))
        solve = Solve(
            method="BiCGStab" if made.krylov else "Neumann",
            nodes=len(self),
            products=made.products,
            residual=made.residual,
            shares=tuple(made.shares),
            gathering=0.0,
            lost=lost / max(shot, 1),
            discretisation=(float(off[0]), float(off[1]), float(off[2])),
        )
        rays = self.rays + shot + made.rays
        return NodePart(made.tiles, made.rows, made.quantum, settings.width, made.tile_rows, rays, solve)


class KnownNodes:
    """Nodes that a transport of the same scene keeps, solved: placing them took no ray and no time."""

    rays, seconds = 0, 0.0

    def __init__(self, transport: Transport) -> None:
        part, kept = transport._core.nodes(), transport._core.beside("nodes")
        if part is None or kept is None or transport.solve is None:
            raise ValueError("expected a transport that keeps its nodes")
        self.columns, self._rows, self.channels, self._quantum, self._width, self._tile_rows, self._tiles = part
        self._kept, self._solve, self.bounces = _nodes_of(kept, self._rows), transport.solve, transport.bounces
        self._emitted = _emitted_of(kept, self._rows)
        # By what they are, not by where they lie.
        sizes = [size for name, size in transport.files if name.startswith("tiles-nodes")]
        about = repr((self._solve, self.bounces, self.columns, self._quantum, self._width, sizes))
        self.name = hashlib.blake2b(self._kept.tobytes() + about.encode(), digest_size=16).hexdigest()

    def __len__(self) -> int:
        return len(self._kept)

    @property
    def why(self) -> str:
        """What they are, in words."""
        return f"the {len(self):,} nodes of another view, with their rows"

    def sources(self, progress: Callable[[int], None]) -> Sources:
        """The nodes as receivers take from them."""
        return Sources(self._kept)

    def emitted(self, emitters: Emitters, progress: Callable[[int], None]) -> NDArray[np.float64]:
        """What their rows are under the light that surfaces give off by themselves, as it was."""
        if self._emitted is None:
            raise FileError("nodes.safetensors: expected emitted, as the scene gives off light")
        return self._emitted

    def rows(self, links: Links, threshold: float, quantum: int, progress: Callable[[int], None]) -> NodePart:
        """Their rows as they are."""
        return NodePart(self._tiles, self._rows, self._quantum, self._width, self._tile_rows, 0, self._solve)


def _nodes_of(arrays: Mapping[str, NDArray[Any]], rows: int) -> NDArray[np.float64]:
    """The kept nodes of a file, whoever wrote it: two rows each."""
    kept = arrays.get("kept")
    if kept is None or kept.dtype != np.float64 or kept.ndim != 2 or 2 * len(kept) != rows:
        raise FileError(f"nodes.safetensors: expected kept of float64 for each of {rows // 2} nodes")
    return kept


def _emitted_of(arrays: Mapping[str, NDArray[Any]], rows: int) -> NDArray[np.float64] | None:
    """What the rows of a file's nodes are under the light that surfaces give off; None where none does."""
    found = arrays.get("emitted")
    if found is not None and (found.dtype != np.float64 or found.shape != (rows, 3) or not np.isfinite(found).all()):
        raise FileError(f"nodes.safetensors: expected emitted of finite float64 and shape ({rows}, 3)")
    return found


Nodes = PlacedNodes | KnownNodes
"""Between which light bounces: what a plan and a run need of them is alike."""


def linked(
    sources: Sources,
    core: CoreScene,
    receivers: Receivers | LitPoints,
    settings: Quality,
    progress: Callable[[int], None],
) -> Links:
    """Links receivers to nodes."""
    return sources.links(core, receivers, side=_SEEN, audit=settings.audit, progress=progress)
