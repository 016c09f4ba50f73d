"""Threads that share everything, beside busy processes, children and Ctrl-C: `tests/python/stress.py`."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

from . import ROOT
from .tally import Clock, Tally

WHAT = "calls by 2 to 8 threads on shared objects, beside busy processes, forks and Ctrl-C"
SHARE = 1.5

STARTING = 900.0
"""Seconds that may pass before threads begin, and until a hang is noticed."""


def run(clock: Clock, seed: int, folder: Path) -> Tally:
    tally, threads = Tally(), (8, 2, 4)[seed % 3]
    words = ["--seconds", max(clock.left() - 10, 5), "--threads", threads, "--seed", seed, "--patience", 10]
    program = ROOT / "tests/python/stress.py"
    command, seconds = [sys.executable, str(program), *map(str, words)], clock.left() + STARTING
    done = subprocess.run(command, capture_output=True, text=True, timeout=seconds)
    found = re.search(r"^(\d+) calls", done.stdout, re.MULTILINE)
    tally.count(int(found[1]) if found else 0, done.returncode != 0, (done.stdout + done.stderr)[-2000:])
    return tally
