"""Properties under other random numbers than those of the suite: those of proptest, and those of Hypothesis.

All properties of the Rust suite, then those of three files of the Python suite, and again while there is time: with as
many examples as each asks for. An example that does not meet what its property assumes is none.
"""

from __future__ import annotations

import itertools
import os
import re
import subprocess
import sys
from pathlib import Path

from . import ROOT
from .tally import Clock, Tally

WHAT = "examples of properties, by proptest and Hypothesis"
SHARE = 3.0

USUAL = 256
"""Examples of a property where its block says nothing."""


def rust_properties() -> dict[str, int]:
    """The properties of the Rust suite, and how many examples each asks for."""
    found = {}
    for path in sorted((ROOT / "tests/rust").glob("*.rs")):
        for block in re.findall(r"^proptest! \{\n(.*?)^\}", path.read_text(), re.DOTALL | re.MULTILINE):
            said = re.search(r"proptest_config\(.*?(?:cases: |with_cases\()(\d+)", block)
            for name in re.findall(r"#\[test\]\n\s+fn (\w+)\(", block):
                found[f"{path.stem}::{name}"] = int(said[1]) if said else USUAL
    return found


def python_files() -> list[Path]:
    """Files of the Python suite that have properties."""
    return [path for path in sorted((ROOT / "tests/python").glob("test_*.py")) if "@given(" in path.read_text()]


def of_rust(seed: int, tally: Tally) -> None:
    properties = rust_properties()
    words = ["cargo", "test", "--locked", "--quiet", "--test", "suite", "--", "--exact", *properties]
    own = {"PROPTEST_RNG_SEED": str(seed)}
    ran = subprocess.run(words, cwd=ROOT, capture_output=True, text=True, env=os.environ | own)
    passed = re.search(r"test result: \w+\. (\d+) passed; (\d+) failed", ran.stdout)
    if passed is None or int(passed[1]) + int(passed[2]) != len(properties):
        tally.count(1, 1, f"seed {seed}: expected {len(properties)} properties: {(ran.stdout + ran.stderr)[-600:]}")
        return
    lost = set(re.findall(r"^    (\w+::\w+)$", ran.stdout, re.MULTILINE))
    examples = sum(count for name, count in properties.items() if name not in lost)
    # Of a property that failed nobody knows how many examples did not.
    tally.count(examples + len(lost), len(lost), f"seed {seed}: {sorted(lost)} {ran.stdout[-600:]}")
    tally.add("by proptest", examples)


def of_python(path: Path, seed: int, tally: Tally) -> None:
    words = [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", str(path), "-m", "hypothesis"]
    words += [f"--hypothesis-seed={seed}", "--hypothesis-profile=card", "--hypothesis-show-statistics"]
    ran = subprocess.run(words, cwd=ROOT, capture_output=True, text=True)
    examples = sum(map(int, re.findall(r"- (\d+) passing\b", ran.stdout)))
    # A file that has properties and counts none has not been read.
    failed = int(ran.returncode != 0 or not examples)
    tally.count(examples + failed, failed, f"{path.name}, seed {seed}: {ran.stdout[-900:]}")
    tally.add("by Hypothesis", examples)


def run(clock: Clock, seed: int, folder: Path) -> Tally:
    tally, files = Tally(), python_files()
    for number in itertools.count(1000 * (seed + 1)):
        of_rust(number, tally)
        # The files in turn, from another one on in every turn.
        for k in range(3):
            if clock.left():
                of_python(files[(3 * number + k) % len(files)], number, tally)
        if not clock.left():
            return tally
    raise AssertionError("a count never ends")
