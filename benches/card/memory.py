"""Too little memory, at a random limit for each call: a `MemoryError`, a refusal, or the result; never an abort."""

from __future__ import annotations

import os
import resource
from collections.abc import Callable
from pathlib import Path

import deltalux as dl
import numpy as np
from deltalux import _core

from .kills import PATIENCE, ended, forked, kill
from .tally import Clock, Tally

WHAT = "large calls under a limit of memory (RLIMIT_AS)"
SHARE = 0.5

SAID = 7
"""Exit status of a `MemoryError` or a refusal."""
MB = 1 << 20

Case = tuple[Callable[[], object], int]


def cases(folder: Path) -> dict[str, Case]:
    """Calls, and about how many bytes each needs."""
    rng = np.random.default_rng(0)
    M = 0.05 * rng.normal(size=(4000, 96)) * (rng.random((4000, 96)) < 0.5)
    transport = dl.Transport(_core.Transport.from_dense(M, columns="haar:4", tile_rows=1024))
    lights, ways = np.ones((1500, 96, 3)), np.tile([0.0, 0.0, 1.0], (2_000_000, 1))
    corners = rng.random((300_000, 3))
    triangles = np.arange(300_000, dtype=np.uint32).reshape(-1, 3)
    scene = dl.Scene.builtin("cornell")
    box = scene.traced()
    env = dl.Environment.from_latlong(np.ones((64, 128, 3)))
    dense = rng.normal(size=(20_000, 384))
    rays = scene.camera.resized(1500, 1500).rays()
    large, path = scene.with_camera(scene.camera.resized(700, 700)), folder / "a.transport"
    tracer = _core.Tracer(scene.vertices.astype(np.float64), scene.triangles.astype(np.uint32))
    return {
        "multiply": (lambda: transport.multiply(lights), 220 * MB),
        "from_dense": (lambda: _core.Transport.from_dense(dense, columns="haar:8"), 250 * MB),
        "brdf": (lambda: dl.brdf.GGX(0.3).evaluate(ways, ways), 160 * MB),
        "cubemap": (lambda: env.cubemap(2048), 600 * MB),
        "tree": (lambda: _core.Scene(corners, triangles, np.zeros(len(triangles), np.uint32)), 60 * MB),
        "pixels": (lambda: box.receivers(rays, edges=True), 500 * MB),
        "visibility": (lambda: tracer.visibility(ways[:20_000], ways[:20_000], ways[:20_000]), 900 * MB),
        "sparse": (lambda: transport.to_scipy(), 20 * MB),
        "precompute": (lambda: dl.precompute(large, path, columns="haar:4", progress=False), 300 * MB),
    }  # fmt: skip


def limited(call: Callable[[], object], room: int) -> None:
    """Makes a call where only so many bytes more may be had."""
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    most = pages * resource.getpagesize() + room
    resource.setrlimit(resource.RLIMIT_AS, (most, most))
    try:
        call()
    except (MemoryError, ValueError, OSError):
        os._exit(SAID)


def run(clock: Clock, seed: int, folder: Path) -> Tally:
    tally, rng = Tally(), np.random.default_rng(seed)
    dl.set_threads(2)
    all_cases = cases(folder)
    while clock.left():
        for name, (call, needs) in all_cases.items():
            # Stacks of threads, and what the allocator takes in one piece, come first.
            room = int(150 * MB + rng.uniform(0, 1.3) * needs)
            child = forked(lambda call=call, room=room: limited(call, room))
            status = ended(child, PATIENCE)
            if status is None:
                kill(child)
            tally.count(1, status not in (0, SAID), f"{name} with {room // MB} MB: ended with {status}")
            tally.add("refused", status == SAID)
    return tally
