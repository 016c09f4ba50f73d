"""Ctrl-C at random moments of the command line, from its first millisecond on: one line, the exit status 130, no
traceback, and the same command goes on and ends well."""

from __future__ import annotations

import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import deltalux as dl
import numpy as np

from .tally import Clock, Tally

WHAT = "Ctrl-C at random moments of `deltalux precompute`"
SHARE = 0.7

SOON = 5.0
"""Seconds within which it ends."""


def command(path: Path) -> list[str]:
    words = ["precompute", "cornell", "-o", str(path), "--size", "96x96", "--columns", "haar:16", "--bounces", "1"]
    return [sys.executable, "-m", "deltalux", *words]


def heard(path: Path, after: float) -> tuple[int, str, float]:
    """The exit status, standard error, and how long it took to leave, after so many seconds."""
    # A shell that runs things in the background has them ignore Ctrl-C.
    own = {"preexec_fn": lambda: signal.signal(signal.SIGINT, signal.default_int_handler)}
    child = subprocess.Popen(command(path), stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, **own)
    time.sleep(after)
    child.send_signal(signal.SIGINT)
    asked = time.monotonic()
    _, said = child.communicate(timeout=60)
    return child.returncode, said, time.monotonic() - asked


def fault(status: int, said: str, took: float) -> str:
    """What is wrong with how it ended; nothing where Python itself had not begun, or all was done."""
    lines = said.splitlines()
    if status == 0 or "deltalux" not in said:
        return ""
    stopped = status == 130 and lines[-1].startswith("deltalux: stopped") and "Traceback" not in said
    return "" if stopped and took < SOON else f"ended with {status} after {took:.2f} s: {said[-500:]}"


def run(clock: Clock, seed: int, folder: Path) -> Tally:
    tally, rng, path = Tally(), np.random.default_rng(seed), folder / "a.transport"
    started = time.monotonic()
    shutil.rmtree(path, ignore_errors=True)
    subprocess.run(command(path), capture_output=True, check=True)
    whole = time.monotonic() - started
    while clock.left():
        shutil.rmtree(path, ignore_errors=True)
        for _ in range(4):
            after = rng.uniform(0, 1.1 * whole)
            status, said, took = heard(path, after)
            what = fault(status, said, took)
            tally.count(1, bool(what), f"after {after:.3f} s: {what}")
            tally.see("seconds until it left", took)
            tally.add("before Python had begun", status not in (0, 130) and "deltalux: stopped" not in said)
        done = subprocess.run(command(path), capture_output=True, text=True)
        whole_again = done.returncode == 0 and dl.Transport.open(path).shape[0] > 0
        tally.count(0, not whole_again, f"the same command again: {done.stderr[-500:]}")
    return tally
