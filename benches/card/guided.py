"""Fuzzing guided by coverage: the targets of `tests/fuzz/guided.py` in turn, each going on with what it has found.

It needs a nightly Rust and a C++ compiler, and for the readers in Python atheris; without that, those are not tried.
"""

from __future__ import annotations

from pathlib import Path

from .tally import Clock, Tally

WHAT = "inputs of coverage-guided fuzzing, under AddressSanitizer"
SHARE = 4.0


def run(clock: Clock, seed: int, folder: Path) -> Tally:
    import guided

    tally, target = Tally(), guided.TARGETS[seed % len(guided.TARGETS)]
    tried = guided.run(target, clock.left(), folder, seed + 1)
    tally.count(tried.executions, bool(tried.fault), f"{target}: {tried.fault}")
    tally.add(target, tried.executions)
    tally.add("seconds of CPU", tried.cpu)
    return tally
