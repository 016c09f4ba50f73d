"""`kill -9` at random moments of whatever saves: nothing is lost, nothing half-done is taken for whole, and the same
call goes on and ends with the same bytes."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable
from contextlib import redirect_stdout
from pathlib import Path

import numpy as np

from .saves import SAVES, beginning, expected, wrong
from .tally import Clock, Tally

WHAT = "`kill -9` while saving, then the same call again"
SHARE = 1.0

KILLS = 6
"""At most, before a run is left to end."""
PATIENCE = 60.0
"""Seconds that a run may take."""


def forked(work: Callable[[], None]) -> int:
    """A child that does some work and ends with 0, or 1 after an exception."""
    child = os.fork()
    if child:
        return child
    status = 1
    try:
        with open(os.devnull, "w") as nowhere, redirect_stdout(nowhere):
            work()
        status = 0
    except Exception as error:
        print(f"{type(error).__name__}: {error}", flush=True)
    finally:
        os._exit(status)


def ended(child: int, seconds: float) -> int | None:
    """The exit status, or None if it is still at work."""
    until = time.monotonic() + seconds
    while True:
        process, status = os.waitpid(child, os.WNOHANG)
        if process:
            return os.waitstatus_to_exitcode(status)
        if time.monotonic() >= until:
            return None
        time.sleep(0.0005)


def kill(child: int) -> None:
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)


def trial(name: str, folder: Path, rng: np.random.Generator, takes: float, tally: Tally) -> None:
    """One save, killed a few times and then left to end."""
    own = beginning(name, folder)
    for _ in range(rng.integers(1, KILLS + 1)):
        child = forked(lambda: SAVES[name].work(own, 1))
        status = ended(child, rng.uniform(0, 1.2 * takes))
        if status is None:
            kill(child)
        what = wrong(name, own, ended=status == 0)
        tally.count(1, bool(what) or status not in (None, 0), f"{name}: {what or f'ended with {status}'}")
        tally.add("killed", status is None)
        if status == 0:
            return
    child = forked(lambda: SAVES[name].work(own, 1))
    status = ended(child, PATIENCE)
    if status is None:
        kill(child)
    what = wrong(name, own, ended=True)
    tally.count(0, bool(what) or status != 0, f"{name}, taken up again: {what or f'ended with {status}'}")


def run(clock: Clock, seed: int, folder: Path) -> Tally:
    tally, rng, takes = Tally(), np.random.default_rng(seed), {}
    for name in SAVES:
        expected(name, folder)
        own, started = beginning(name, folder), time.monotonic()
        # Measured in a child as well: the first call in a process makes its pool.
        child = forked(lambda name=name, own=own: SAVES[name].work(own, 1))
        if ended(child, PATIENCE) is None:
            kill(child)
            tally.count(1, 1, f"{name} hangs in a process that was forked")
        takes[name] = time.monotonic() - started
    while clock.left():
        for name in SAVES:
            trial(name, folder, rng, takes[name], tally)
    return tally
