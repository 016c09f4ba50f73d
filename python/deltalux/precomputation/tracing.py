"""One tile of the direct pass."""

from __future__ import annotations

from collections.abc import Callable

from .._core import TileData
from ..transport.entry import TILE_ROWS
from .preparation import QUANTUM, Prepared

__all__ = ["traced_tile"]


def traced_tile(
    prepared: Prepared, tile: int, threshold: float, tell: Callable[[int], None] | None = None
) -> tuple[TileData, int]:
    """A tile by its number, and the rays that it took; `tell` is told of its rows."""
    first = tile * TILE_ROWS
    data, first_rays, edge_rays = prepared.direct.tile(
        first,
        min(TILE_ROWS, prepared.count - first),
        threshold=threshold,
        quantum=QUANTUM,
        width=prepared.settings.width,
        progress=tell,
    )
    return data, first_rays + edge_rays
