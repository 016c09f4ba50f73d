"""Shards of a precomputation that others trace: other threads, processes, or machines that see the same files."""

from __future__ import annotations

from dataclasses import dataclass, replace

from .._core import TransportWriter
from ..scene.scene import Scene
from ..transport.entry import TILES_PER_SHARD
from .preparation import Prepared, Request
from .tracing import traced_tile

__all__ = ["Errand", "delivered", "errand_of", "hand_over"]

# What a process has prepared last, by its job: the shards of a run have one scene.
_prepared: dict[str, Prepared] = {}


@dataclass(frozen=True, eq=False)
class Errand:
    """One shard of a run.

    Attributes
    ----------
    path, job
        Of the run: where its transport will be, and all that decides what is in it.
    scene, request
        What is traced.
    part, number
        Which shard of what.
    threshold
        Of truncation.
    """

    path: str
    job: str
    scene: Scene
    request: Request
    part: str
    number: int
    threshold: float


def errand_of(path: str, job: str, prepared: Prepared, part: str, threshold: float) -> Errand:
    """The first of a run's errands. Neither nodes nor edges to be split are anybody's else business."""
    request = replace(prepared.request, between=None, refine=None)
    return Errand(path, job, prepared.scene, request, part, 0, threshold)


def hand_over(job: str, prepared: Prepared | None) -> None:
    """Lets errands within this process take what is prepared already; None: no longer."""
    _prepared.clear()
    if prepared is not None:
        _prepared[job] = prepared


def delivered(errand: Errand) -> int:
    """Traces a shard and writes it into the run's directory.

    Returns
    -------
    int
        Rays.
    """
    prepared = _prepared.get(errand.job)
    if prepared is None:
        prepared = Prepared(errand.scene, errand.request)
        hand_over(errand.job, prepared)
    first = errand.number * TILES_PER_SHARD
    numbers = range(first, min(first + TILES_PER_SHARD, prepared.tiles))
    tiles, rays = zip(*(traced_tile(prepared, tile, errand.threshold) for tile in numbers), strict=True)
    TransportWriter.deliver(errand.path, errand.job, errand.part, errand.number, list(tiles))
    return sum(rays)
