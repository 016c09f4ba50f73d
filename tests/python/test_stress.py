"""Threads, processes and signals at once for a few seconds; `benches/reliability.py` goes on for minutes."""

import signal
import subprocess
import sys
from pathlib import Path

import deltalux as dl
import pytest

STRESS = Path(__file__).with_name("stress.py")


@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="needs fork and signals")
def test_everything_at_once_neither_hangs_nor_fails():
    words = ["--seconds", "3", "--threads", "8", "--seed", "1", "--no-spawn"]
    done = subprocess.run([sys.executable, str(STRESS), *words], capture_output=True, text=True, timeout=280)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "calls: " in done.stdout


def fork(work) -> int:
    """The exit status of a child that does some work within twenty seconds."""
    import os
    import time

    child = os.fork()
    if not child:
        try:
            work()
            os._exit(0)
        finally:
            os._exit(1)
    until = time.monotonic() + 20
    while time.monotonic() < until:
        process, status = os.waitpid(child, os.WNOHANG)
        if process:
            return os.waitstatus_to_exitcode(status)
        time.sleep(0.01)
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    raise AssertionError("the child hangs")


@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="needs fork")
def test_a_forked_child_writes_and_reads_pictures(tmp_path):
    """The EXR library's threads do not survive a fork, and a child waited for them for ever."""
    import numpy as np

    picture = np.ones((300, 300, 3), np.float32)

    def work():
        dl.write(tmp_path / "a.exr", picture)
        dl.Environment.load(tmp_path / "a.exr")

    work()
    assert fork(work) == 0


@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="needs fork")
def test_a_forked_child_makes_curves(tmp_path):
    """Rows of lobes were made in a pool of threads that a child does not have."""
    import test_curves

    scene, light = test_curves.plane_scene(6), dl.Environment.builtin("hall")
    pearl = {"pearl": test_curves.PEARL}

    def work():
        options = {"quality": "preview", "progress": False}
        dl.precompute_curves(scene, tmp_path / "a.curves", env=light, materials=pearl, **options)

    work()
    assert fork(work) == 0


@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="needs fork")
def test_a_forked_child_does_not_keep_a_folder_locked(tmp_path):
    """The child has the lock's file open as well, and a run that had ended seemed to be writing still."""
    import os
    import time

    from deltalux import _core

    writer = _core.TransportWriter(tmp_path / "a.transport", "{}")
    child = os.fork()
    if not child:
        time.sleep(30)
        os._exit(0)
    try:
        del writer
        _core.TransportWriter(tmp_path / "a.transport", "{}")
    finally:
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)
