"""What a transport says of itself, worked out again where that is possible: `Transport.verify`."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from .._core import FileError
from .._core import Transport as CoreTransport

if TYPE_CHECKING:
    from .transport import Transport

__all__ = ["verified"]

_UNDER = 1 + 2.0**-20
"""Norms are rounded up when they are written: those worked out again may only round otherwise by this factor."""


def verified(transport: Transport) -> Iterator[str]:
    """What `Transport.verify` gives, line by line."""
    yield _files(transport)
    yield _texels(transport._core)
    yield from _clusters(transport)
    yield _audit(transport)
    yield _scene(transport)
    yield "believed: what rows lost where no audit is, weights and albedo of receivers, plan"


def _files(transport: Transport) -> str:
    """All that opening checks, of the files as they are now."""
    if transport._path is None:
        raise ValueError("expected a transport in a file, but this one is in memory only")
    again = CoreTransport.open(transport._path)
    count, size = len(again.files), sum(length for _, length in again.files)
    return f"files: {count} of {size / 1e6:,.1f} MB have their digests and keep every promise"


def _texels(core: CoreTransport) -> str:
    """Norms of texel columns, which no entry stands for."""
    found = core.texel_norms()
    if found is None:
        return "texel columns: none"
    kept, _ = core.stated_norms()
    short = np.flatnonzero(found > kept[:, -1] * _UNDER)
    if len(short):
        row = int(short[0])
        raise FileError(f"expected {found[row]:.6g} or more kept of row {row} in texels, found {kept[row, -1]:.6g}")
    return f"texel columns: {len(found):,} rows are no longer than is said"


def _clusters(transport: Transport) -> Iterator[str]:
    """Norms of the rows that two stages stand for, which no entry holds; nothing where there are none."""
    found = transport._core.represented(_UNDER)
    if found is None:
        return
    pairs, broken = found
    if broken is not None:
        row, norm, said = broken
        raise FileError(f"expected {norm:.6g} or more kept of row {row} by both stages in a band, found {said:.6g}")
    rows = len(transport.receivers) * pairs
    yield f"clusters: {rows:,} rows that two stages stand for are no longer than is said"


def _audit(transport: Transport) -> str:
    """What rows lost, of those that are kept as they were traced."""
    found = transport.audit
    if found is None:
        return "audit: none was kept"
    if not transport._core.is_single:
        return "audit: of one matrix alone it can be held against"
    numbers, traced = found
    kept, lost = transport._core.stated_norms()
    bands = np.asarray(transport.columns.bands)
    count = int(bands[-1]) + 1
    _, rounding = traced._core.stated_norms()
    rows = [(place, int(row)) for place, row in enumerate(numbers) if row < len(kept)]
    for place, row in rows:
        off = (traced._core.row(place).astype(np.float64) - transport._core.row(row)) ** 2
        for channel in range(off.shape[1]):
            norms = np.sqrt(np.bincount(bands, off[:, channel], count))
            said = lost[row, channel :: off.shape[1]].astype(np.float64) + rounding[place, channel :: off.shape[1]]
            if (norms > said * _UNDER).any():
                band = int(np.argmax(norms - said))
                less = f"expected {norms[band]:.6g} or more lost of row {row} in band {band}"
                raise FileError(f"{less}, found {said[band]:.6g}")
    return f"audit: {len(rows):,} rows that were traced whole have lost no more than is said"


def _scene(transport: Transport) -> str:
    """Its digest."""
    if transport._core.beside("scene") is None:
        return "scene: none is kept"
    _ = transport.surface
    return "scene: triangles, materials and camera have the digest of the manifest"
