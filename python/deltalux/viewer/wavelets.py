"""Where on the cubemap columns lie, as a page draws them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..columns.haar import Haar, blocks_under

__all__ = ["squares"]


def squares(columns: Haar, sent: NDArray[np.uint32], most: int) -> list[list[int]]:
    """Face, x, y, edge in texels, and band of the squares under columns: each once, coarse to fine, at most so many."""
    size, bands = columns.size, columns.bands
    found: list[NDArray[np.int64]] = []
    for band in np.unique(bands[sent]):
        if columns.texels and band == bands[-1]:
            side, blocks = size, sent[sent >= columns.wavelets].astype(np.int64) - columns.wavelets
        else:
            side, blocks = 2 ** int(band), blocks_under(columns, sent, band)
        blocks = np.unique(blocks)
        face, place = blocks // side**2, blocks % side**2
        edge = np.full_like(face, size // side)
        found.append(np.stack([face, place % side * edge, place // side * edge, edge, np.full_like(face, band)], 1))
    listed = np.concatenate(found)[:most].tolist() if found else []
    return [[int(value) for value in row] for row in listed]
