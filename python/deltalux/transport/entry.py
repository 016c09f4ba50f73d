"""What an entry of M takes, and how rows lie together (FORMAT.md). The core's numbers, where the core has them."""

from __future__ import annotations

from .._core import GROUP, TILES_PER_SHARD, entry_bytes

__all__ = ["GROUP", "TILES_PER_SHARD", "TILE_ROWS", "entry_bytes"]

TILE_ROWS = 8192
"""Rows of a tile, as `precompute` makes them."""
