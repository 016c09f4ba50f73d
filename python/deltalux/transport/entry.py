"""What an entry of M takes, and how rows lie together (FORMAT.md).

These numbers belong to the Rust core; here is the one Python copy of them.
"""

from __future__ import annotations

__all__ = ["ENTRY_BYTES", "GROUP", "TILE_ROWS"]

GROUP = 16
"""Neighbouring rows that an entry holds."""
ENTRY_BYTES = {"i8": 2 + GROUP, "i16": 2 + 2 * GROUP}
"""By the width of the integers: the group's number, and its values."""
TILE_ROWS = 8192
"""Rows of a tile, as `precompute` makes them."""
