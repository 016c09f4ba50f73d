"""Too little memory is a `MemoryError` or a refusal, and never the end of the process."""

import subprocess
import sys
import textwrap

import pytest

HEAD = """
    import resource, sys
    from pathlib import Path
    import deltalux as dl
    import numpy as np
    from deltalux import _core

    M = np.ones((64, 24))
    transport = dl.Transport(_core.Transport.from_dense(M, columns="haar:2", tile_rows=32))
    scene = dl.Scene.builtin("cornell")
    box = scene.traced()
    env = dl.Environment.from_latlong(np.ones((16, 32, 3)))
    up = np.broadcast_to(np.array([0.0, 0.0, 1.0]), (4_000_000, 3)).copy()
    transport.multiply(np.ones((24, 3)))
    tracer = _core.Tracer(scene.vertices.astype(float), scene.triangles)
    lights = np.ones((60_000, 24, 3))
    rays, fewer = (scene.camera.resized(size, size).rays() for size in (4000, 1500))
    corners = np.zeros((3_000_000, 3))
    triangles = np.zeros((1_000_000, 3), np.uint32)

    pages = int(Path("/proc/self/statm").read_text().split()[0])
    most = pages * resource.getpagesize() + ({room} << 20)
    resource.setrlimit(resource.RLIMIT_AS, (most, most))
    try:
        {call}
    except (MemoryError, ValueError) as error:
        print(type(error).__name__, error)
        # The object is as usable as before.
        transport.multiply(np.ones((24, 3)))
        print("goes on")
"""
CALLS = {
    "products": "transport.multiply(lights)",
    "directions": "dl.brdf.GGX(0.3).evaluate(up, up)",
    "cubemap": "env.cubemap(2048)",
    "visibility": "tracer.visibility(up[:30_000], up[:30_000], up[:30_000])",
    "pixels": "box.receivers(rays, edges=True)",
    "tree": "_core.Scene(corners, triangles, np.zeros(1_000_000, np.uint32))",
    "scene": "dl.precompute(scene.with_camera(scene.camera.resized(4000, 4000)), 'never.transport', progress=False)",
}
MORE = {
    # These were asked for at a sixth and at two thirds of what they take.
    "cubemap, a fourth": ("env.cubemap(2048)", 900),
    "pixels, three fourths": ("box.receivers(fewer, edges=True)", 700),
}
"""Calls, and for how many MiB there is room where it is not 64."""


@pytest.mark.skipif(sys.platform != "linux", reason="the limit is one of Linux")
def test_what_there_is_no_memory_for_is_refused():
    """It ended the process with SIGABRT, where Python expects a `MemoryError`."""
    running = {
        name: subprocess.Popen(
            [sys.executable, "-c", textwrap.dedent(HEAD).replace("{call}", call).replace("{room}", str(room))],
            stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        )
        for name, (call, room) in ({name: (call, 64) for name, call in CALLS.items()} | MORE).items()
    }  # fmt: skip
    for name, process in running.items():
        said, complaint = process.communicate(timeout=120)
        assert process.returncode == 0, (name, process.returncode, complaint)
        assert "goes on" in said and ("MemoryError" in said or name == "scene"), (name, said)
