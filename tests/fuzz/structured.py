"""What bytes may mean besides a file: a list of calls of a relighter, or a mesh and rays."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import deltalux as dl
import numpy as np
from deltalux import _core
from numpy.typing import NDArray

CALLS, MESH = "calls.bin", "mesh.bin"
COLUMNS = dl.Haar(2)
NEAR = 1e-3
"""Rays that pass nearer to an edge, in extents of the mesh, may fall on either side."""

Floats = NDArray[np.float64]


@cache
def _transports() -> list[tuple[dl.Transport, Floats]]:
    """In 8 and 16 bits, truncated and not, with the dense matrix."""
    made = []
    for number, options in enumerate(({"width": "i8"}, {"width": "i16"}, {"width": "i8", "threshold": 0.05})):
        M = np.random.default_rng(number).normal(size=(40, 24)) * 0.1
        made.append((dl.Transport(_core.Transport.from_dense(M, columns="haar:2", tile_rows=16, **options)), M))
    return made


@cache
def _methods() -> list[dl.Method]:
    kinds = (dl.Incremental, dl.PerBand, dl.Nonlinear, dl.Linear)
    return [dl.Full(), *(kind(terms=terms) for kind in kinds for terms in (0, 1, 5))]


def play_calls(folder: Path) -> None:
    """Each byte is a call; every frame has the bits of a fresh product and is within its bound."""
    data = (folder / CALLS).read_bytes()
    rng = np.random.default_rng(list(data[:8]))
    transport, M = _transports()[rng.integers(3)]
    initial = (None, "full", "nonlinear")[rng.integers(3)]
    relighter = dl.Relighter(transport, _methods()[rng.integers(len(_methods()))], initial)
    light = np.zeros((24, 3))
    for byte in data[8:72]:
        match byte % 8:
            case 0 | 1:
                light = rng.normal(size=(24, 3)) * 10.0 ** (byte // 8 - 16)
            case 2:
                light = light * rng.choice([-1.0, 0.0, 0.5, 1024.0])
            case 3:
                light = light.copy()
                light[byte % 24] += rng.normal(size=3)
            case 4 | 5:
                refused = (light if byte % 8 == 4 else light[:-1]).copy()
                refused[byte % 23] = np.nan
                try:
                    relighter.step(refused)
                except ValueError:
                    continue
                raise AssertionError("a light was taken that should have been refused")
        frame = relighter.step(light)
        assert np.array_equal(frame.values, transport.multiply(relighter.values)), "other bits than a fresh product"
        error = np.abs(frame.values.astype(np.float64) - M @ light)
        assert (error <= relighter.bounds(frame)).all(), "beyond its bound"


def trace_mesh(folder: Path) -> None:
    """Bytes are corners on a grid, or half floats of whatever bits; rays among them against brute force."""
    data = (folder / MESH).read_bytes()
    data = data[: len(data) // 18 * 18]
    if data[:1] and data[0] % 2:
        corners = np.frombuffer(data, np.float16).astype(np.float64).reshape(-1, 3, 3)
    else:
        corners = np.frombuffer(data, np.int8).astype(np.float64).reshape(-1, 3, 3)
    triangles = np.arange(3 * len(corners), dtype=np.uint32).reshape(-1, 3)
    tracer = _core.Tracer(corners.reshape(-1, 3), triangles)
    if not len(corners):
        return
    low, high = corners.min((0, 1)), corners.max((0, 1))
    extent = (high - low).max()
    if extent == 0:
        return
    rng = np.random.default_rng(list(data[:8]))
    origins = low + rng.random((10, 3)) * extent
    ways = rng.normal(size=(10, 3))
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    # Each along its own normal and against it: all rays are above one of the two.
    normals = np.tile([0.0, 0.0, 1.0], (10, 1))
    seen = tracer.visibility(origins, normals, ways) | tracer.visibility(origins, -normals, ways)
    blocked, sure = brute_force((corners - low) / extent, (origins - low) / extent, ways)
    wrong = sure & (seen == blocked) & (np.abs(ways[:, None, 2]) > 1e-3)
    assert not wrong.any(), f"{wrong.sum()} of 100 rays differ from brute force"


def brute_force(corners: Floats, origins: Floats, ways: Floats) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Whether rays are blocked, and whether that is beyond doubt: (ways, origins) each."""
    a = corners[:, 0]
    sides = np.roll(corners, -1, axis=1) - corners
    normal = np.cross(sides[:, 0], sides[:, 1])
    area = np.linalg.norm(normal, axis=1)
    flat = area < 1e-12
    normal = normal / np.where(flat, 1, area)[:, None]
    towards = np.einsum("tk,wk->wt", normal, ways)
    height = np.einsum("tk,otk->ot", normal, a[None] - origins[:, None])
    along = height[None] / np.where(np.abs(towards) < 1e-9, 1e-9, towards)[:, None]
    meets = origins[None, :, None] + along[..., None] * ways[:, None, None]
    # How far inside each side of the triangle the plane is met.
    inwards = np.cross(normal[:, None], sides)
    inwards /= np.maximum(np.linalg.norm(inwards, axis=-1, keepdims=True), 1e-12)
    inside = np.einsum("tsk,wotsk->wots", inwards, meets[..., None, :] - corners).min(-1)
    hit = (inside > NEAR) & (along > NEAR)
    missed = (inside < -NEAR) | (along < -NEAR)
    # Edge on, or without an area, everything near is in doubt.
    doubtful = ~hit & ~missed | (np.abs(towards) < 0.01)[:, None] | flat
    blocked = (hit & ~(np.abs(towards) < 0.01)[:, None] & ~flat).any(-1)
    return blocked, blocked | ~doubtful.any(-1)
