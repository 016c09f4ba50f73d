"""Files that are harmed, and calls at random: `tests/fuzz/fuzz.py`, each target for its part of the time."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

from . import ROOT
from .tally import Clock, Tally

WHAT = "files that were harmed, and calls at random"
SHARE = 2.0

PATIENCE = 120
"""Seconds that a file may take: others are at work on the machine, and the card comes last."""
FUZZ = ROOT / "tests/fuzz/fuzz.py"


def run(clock: Clock, seed: int, folder: Path) -> Tally:
    import fuzz

    tally, seconds = Tally(), clock.left() / len(fuzz.TARGETS)
    for target in fuzz.TARGETS:
        words = ["--target", target, "--seed", 1000 + seed, "--seconds", seconds, "--keep", folder / "fuzz-faults"]
        words += ["--most", PATIENCE]
        done = subprocess.run(
            [sys.executable, str(FUZZ), *map(str, words)], capture_output=True, text=True, timeout=seconds + 1000
        )
        found = re.search(r": (\d+) files", done.stdout)
        files = int(found[1]) if found else 0
        tally.count(files, done.returncode != 0, f"{target}: {(done.stdout + done.stderr)[-600:]}")
        tally.add(target, files)
    return tally
