"""Clustered transport: building its two stages from a stored one, and the map of its clusters."""

from __future__ import annotations

import colorsys
import json
import os
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._core import Clusters, TransportWriter
from .._core import Transport as CoreTransport
from ..checks import count
from ..progress import Progress, reporter
from .entry import TILES_PER_SHARD
from .plan import Part, Plan

__all__ = ["build", "colours_of"]

REPRESENTATIVES, WEIGHTS = "representatives", "weights"
"""What the parts are called, and how plans say that they are made."""
_GOLDEN = (5**0.5 - 1) / 2


def build(
    source: CoreTransport,
    plan: Plan,
    path: str | os.PathLike[str],
    clusters: int,
    representatives: int,
    progress: bool | Progress,
) -> None:
    """Clusters the rows of a transport, and writes what comes of it; nothing is written before all is computed."""
    clusters, representatives = count("clusters", clusters), count("representatives", representatives)
    if "base" in (source.beside("scene") or {}):
        raise ValueError("expected rows that are shown by themselves to cluster, but these have factors of lobes")
    TransportWriter.check(path)
    rows, tell = source.rows, reporter(progress, f"{plan.scene}: clusters")
    made = Clusters(
        source,
        clusters=clusters,
        representatives=representatives,
        tolerance=plan.tolerance,
        progress=lambda done: tell(done, Clusters.STEPS * rows),
    )
    tell(Clusters.STEPS * rows, Clusters.STEPS * rows)
    stages = {REPRESENTATIVES: made.representatives, WEIGHTS: made.weights}
    job = {"clusters": clusters, "representatives": representatives, "of": source.files}
    writer, parts = TransportWriter(path, json.dumps(job)), []
    for name, stage in stages.items():
        tiles = stage.tiles()
        for first in range(0, len(tiles), TILES_PER_SHARD):
            writer.write_shard(name, first // TILES_PER_SHARD, tiles[first : first + TILES_PER_SHARD])
        shape = (stage.columns, stage.rows, stage.channels, stage.quantum, stage.width, stage.tile_rows)
        parts.append((name, *shape))
    done = _planned(plan, source, made, stages)
    writer.finish(
        parts=parts,
        receivers=source.receivers.permuted(made.order),
        camera=source.camera,
        plan=done.to_json(),
        scene=source.scene,
        first=1,
        link=made.link,
        beside=_beside(source, made.order),
    )
    tell.say(done.notes[-1])


def _beside(source: CoreTransport, order: NDArray[np.integer]) -> list[tuple[str, list[tuple[str, NDArray[Any]]]]]:
    """What the source keeps, with the rows of receivers by their new numbers."""
    kept = []
    if (emission := source.beside("emission")) is not None:
        kept.append(("emission", [(name, own[order]) for name, own in emission.items()]))
    arrays = source.beside("scene")
    if arrays is None:
        return kept
    if "corners" in arrays:
        place = np.empty(len(order), np.uint32)
        place[order] = np.arange(len(order), dtype=np.uint32)
        there = arrays["corners"] < len(order)
        arrays["corners"][there] = place[arrays["corners"][there]]
        arrays["shown"] = place[arrays["shown"]][order]
    return [("scene", list(arrays.items())), *kept]


def _planned(plan: Plan, source: CoreTransport, made: Clusters, stages: dict[str, CoreTransport]) -> Plan:
    """What was done, and what it took. What was measured of the source does not hold of it."""
    first, then = stages[REPRESENTATIVES], stages[WEIGHTS]
    sizes = np.bincount(made.labels)
    columns, bands = plan.parts[0].column_count, plan.parts[0].bands
    each = first.rows // len(sizes) - 1
    of = (
        (REPRESENTATIVES, first, columns, bands, f"rows that look alike share a mean and {each} representatives"),
        (WEIGHTS, then, then.shape[1], min(1 + each, 2), "what each row takes of those of its cluster"),
    )
    parts = [
        Part(
            name=name,
            make=name,
            rows=stage.rows,
            columns=stage.columns,
            column_count=columns,
            bands=bands,
            channels=1,
            factors=1,
            bounces=plan.parts[0].bounces,
            why=f"{why}; {stage.nbytes / 1e6:.1f} MB",
        )
        for name, stage, columns, bands, why in of
    ]
    subspaces, whole = made.error
    note = (
        f"{len(sizes):,} clusters of {sizes.min():,} to {sizes.max():,} rows: {100 * whole:.2g} % expected image error "
        f"against the transport that they are made of, {100 * subspaces:.2g} % of it before truncation and rounding; "
        f"{source.entries:,} groups of rows are now {first.entries:,} and {then.entries:,}"
    )
    return replace(plan, parts=parts, notes=[*plan.notes, note], errors={}, without={})


def colours_of(labels: NDArray[np.integer]) -> NDArray[np.float32]:
    """A colour for each row: clusters with neighbouring numbers look different.

    Parameters
    ----------
    labels
        (rows,): the number of each row's cluster.

    Returns
    -------
    (rows, 3) float32
        Linear RGB from 0 to 1.
    """
    table = [
        colorsys.hsv_to_rgb(k * _GOLDEN % 1, (0.5, 0.75, 1.0)[k % 3], (1.0, 0.55, 0.8, 0.35)[k % 4])
        for k in range(int(labels.max(initial=0)) + 1)
    ]
    return np.asarray(np.array(table, np.float32)[labels])
