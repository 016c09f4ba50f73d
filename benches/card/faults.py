"""Seeded faults: patches of tests/faults, each with the test that must fail where it is applied.

One a turn, in a copy of the tree and a target folder of its own, as each is a build. A test passes without the fault in
every run of the suite.
"""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path

from . import ROOT
from .tally import Clock, Tally

WHAT = "seeded faults that the named test of the Rust suite has caught"
SHARE = 0.1

NEEDED = ("rust", "tests", "benches", "Cargo.toml", "Cargo.lock", "README.md")


def test_of(patch: Path) -> str:
    """The filter of the test that a patch names."""
    return next(
        line.removeprefix("Test: cargo ") for line in patch.read_text().splitlines() if line.startswith("Test: ")
    )


def caught(patch: Path, folder: Path) -> tuple[bool, str]:
    """Whether the test fails under a fault, and what was said."""
    tree = folder / "tree"
    shutil.rmtree(tree, ignore_errors=True)
    tree.mkdir(parents=True)
    for name in NEEDED:
        source = ROOT / name
        (shutil.copytree if source.is_dir() else shutil.copy2)(source, tree / name)
    applied = subprocess.run(["git", "apply", "--unsafe-paths", str(patch)], cwd=tree, capture_output=True, text=True)
    if applied.returncode:
        return False, f"does not apply: {applied.stderr}"
    words = [
        "cargo",
        "test",
        "--locked",
        "--quiet",
        "--test",
        "suite",
        "--target-dir",
        str(folder / "target"),
        test_of(patch),
    ]
    own = {"PROPTEST_RNG_SEED": "1", "CARGO_INCREMENTAL": "1"}
    ran = subprocess.run(words, cwd=tree, capture_output=True, text=True, env=os.environ | own)
    # Where it does not even build, nothing has been caught.
    return "test result: FAILED" in ran.stdout, (ran.stdout + ran.stderr)[-600:]


def run(clock: Clock, seed: int, folder: Path) -> Tally:
    tally, patches = Tally(), sorted((ROOT / "tests/faults").glob("*.patch"))
    if seed < len(patches):
        fault, said = caught(patches[seed], folder)
        tally.count(1, not fault, f"{patches[seed].stem}: {said}")
    return tally
