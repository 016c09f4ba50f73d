"""Seeded faults: patches of tests/faults, each with the test that must fail where it is applied.

One a turn, in a copy of the tree and a target folder that all share, so that each costs no more than what it changes. A
test passes without the fault in every run of the suite; that patches apply is held by `tests/python/test_faults.py`.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

from . import ROOT
from .tally import Clock, Tally

WHAT = "seeded faults that the named test has caught"
SHARE = 0.1

FAULTS = ROOT / "tests/faults"
NEEDED = ("rust", "tests", "benches", "python", "Cargo.toml", "Cargo.lock", "README.md", "pyproject.toml")


def test_of(patch: Path) -> tuple[str, str]:
    """`cargo` or `pytest`, and the test that a patch names."""
    line = next(line for line in patch.read_text().splitlines() if line.startswith("Test: "))
    kind, name = line.removeprefix("Test: ").split()
    return kind, name


def caught(patch: Path, folder: Path) -> tuple[bool, str]:
    """Whether the test fails under a fault, and what was said."""
    tree = folder / "tree"
    for name in NEEDED:
        shutil.rmtree(tree / name, ignore_errors=True)
        source, copy = ROOT / name, tree / name
        copy.parent.mkdir(parents=True, exist_ok=True)
        # Copies keep their times, so that cargo sees what has changed and nothing else.
        (shutil.copytree if source.is_dir() else shutil.copy2)(source, copy)
    applied = subprocess.run(["git", "apply", "--unsafe-paths", str(patch)], cwd=tree, capture_output=True, text=True)
    if applied.returncode:
        return False, f"does not apply: {applied.stderr}"
    kind, name = test_of(patch)
    if kind == "cargo":
        words = ["cargo", "test", "--locked", "--quiet", "--test", "suite", name]
        words[2:2] = ["--target-dir", str(folder / "target")]
        sign = "test result: FAILED"
    else:
        words = [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", name]
        sign = "\nFAILED "
    own = {"PROPTEST_RNG_SEED": "1", "CARGO_INCREMENTAL": "1", "PYTHONPATH": str(tree / "python")}
    ran = subprocess.run(words, cwd=tree, capture_output=True, text=True, env=os.environ | own)
    # Where it does not even build, or there is no such test, nothing has been caught.
    return sign in ran.stdout, (ran.stdout + ran.stderr)[-600:]


def run(clock: Clock, seed: int, folder: Path) -> Tally:
    tally, patches = Tally(), sorted(FAULTS.glob("*.patch"))
    if seed < len(patches):
        fault, said = caught(patches[seed], folder)
        tally.count(1, not fault, f"{patches[seed].stem}: {said}")
    return tally
