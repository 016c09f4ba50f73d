"""Mutants of `rust/update` and `rust/transport`: one operator changed, or a function that returns at once.

All are in one build of the Rust suite (`tests/mutants`), which is run for some of them in every turn, in an order by
chance. One that no test notices lives: a test is missing, or nothing that is computed has changed. It is counted and
listed in `lived.txt`, and is no failure of the card.
"""

from __future__ import annotations

import json
import os
import re
import resource
import shutil
import subprocess
from pathlib import Path
from random import Random
from typing import NamedTuple

from . import ROOT
from .tally import Clock, Tally

WHAT = "mutants of `rust/update` and `rust/transport` under the Rust suite"
SHARE = 4.0

FOLDERS = ("rust/update", "rust/transport")
NEEDED = ("rust", "tests", "benches", "Cargo.toml", "Cargo.lock", "README.md")
A_TURN = 200
"""Mutants that a turn has at most."""
FIRST = ("update::", "response::", "transport::", "sight::")
"""What kills most, and takes least, is run first; then the rest."""
BLIND = ("basis::", "brdf::", "harmonics::", "light::", "radiance::", "scene::", "vertices::")
"""But for what knows nothing of those folders,"""
SLOW = ("bounces::closed_rooms", "bounces::links_sum", "file::forged_headers", "file::no_flipped_bit")
"""and what takes longer than all others together: the score is the lower for it."""
PATIENCE = 4.0
"""How many times as long as without a mutant the tests may take, before that counts as noticed."""
MEMORY = 8 << 30


class Mutant(NamedTuple):
    number: int
    file: str
    line: int
    what: str


def build(folder: Path) -> tuple[Path, list[Mutant]]:
    """The suite with all mutants that compile, and which those are."""
    tree, target, kept = folder / "tree", folder / "target", folder / "build.json"
    files = [path for name in ("rust", "tests/rust", "tests/mutants") for path in sorted((ROOT / name).rglob("*.rs"))]
    sources = {str(path.relative_to(ROOT)): path.stat().st_mtime for path in files}
    if kept.exists():
        known = json.loads(kept.read_text())
        if known["sources"] == sources:
            return Path(known["suite"]), [Mutant(*mutant) for mutant in known["mutants"]]
    tool = ["cargo", "build", "--locked", "--quiet", "--manifest-path", str(ROOT / "tests/mutants/Cargo.toml")]
    subprocess.run([*tool, "--target-dir", str(target / "tool")], check=True)
    left_out: set[int] = set()
    while True:
        shutil.rmtree(tree, ignore_errors=True)
        tree.mkdir(parents=True)
        for name in NEEDED:
            source = ROOT / name
            (shutil.copytree if source.is_dir() else shutil.copy2)(source, tree / name)
        words = [str(target / "tool/debug/mutants"), str(tree), *FOLDERS]
        own = {"LEFT_OUT": ",".join(map(str, sorted(left_out)))}
        told = subprocess.run(words, check=True, capture_output=True, text=True, env=os.environ | own).stdout
        words = ["cargo", "test", "--locked", "--test", "suite", "--no-run", "--message-format", "json"]
        done = subprocess.run([*words, "--target-dir", str(target)], cwd=tree, capture_output=True, text=True)
        messages = [json.loads(line) for line in done.stdout.splitlines() if line.startswith("{")]
        if done.returncode == 0:
            suite = next(m["executable"] for m in messages if m.get("executable") and m["target"]["name"] == "suite")
            mutants = [line.split("\t") for line in told.splitlines()]
            made = [Mutant(int(number), file, int(line), what) for number, file, line, what in mutants]
            kept.write_text(json.dumps({"sources": sources, "suite": suite, "mutants": made}))
            return Path(suite), made
        # What a mutant makes of the types about it is seen where the compiler complains.
        wrong = {number for message in messages for number in _blamed(tree, message)}
        if not wrong - left_out:
            raise RuntimeError(f"the suite with mutants does not build: {done.stderr[-2000:]}")
        left_out |= wrong


def _blamed(tree: Path, message: dict) -> set[int]:
    """The numbers of the mutants that an error points at."""
    own = message.get("message", {})
    if message.get("reason") != "compiler-message" or own.get("level") != "error":
        return set()
    found = set()
    for span in own["spans"]:
        lines = (tree / span["file_name"]).read_text().splitlines()
        # The whole of the expression, from where its number stands.
        for first in range(span["line_start"] - 1, max(span["line_start"] - 12, -1), -1):
            numbers = re.findall(r"crate::mutant\((\d+)", "\n".join(lines[first : span["line_end"]]))
            if numbers:
                found |= set(map(int, numbers))
                break
    return found


def notices(suite: Path, tree: Path, number: int, seconds: tuple[float, float]) -> bool:
    """Whether any test fails, or ends the process, or takes too long."""
    rest = [f"--skip={name}" for name in (*FIRST, *BLIND, *SLOW)]
    own = {"MUTANT": str(number), "PROPTEST_RNG_SEED": "1", "RUST_BACKTRACE": "0", "RAYON_NUM_THREADS": "2"}
    for tests, most in ((list(FIRST), seconds[0]), (rest, seconds[1])):
        try:
            words = [str(suite), "--quiet", *tests]
            done = subprocess.run(
                words, cwd=tree, capture_output=True, env=os.environ | own, timeout=most, preexec_fn=_limited
            )
        except subprocess.TimeoutExpired:
            return True
        if done.returncode:
            return True
    return False


def _limited() -> None:
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


def run(clock: Clock, seed: int, folder: Path) -> Tally:
    tally = Tally()
    suite, mutants = build(folder)
    # As long as both parts take together, without a mutant.
    started = clock.left()
    if notices(suite, folder / "tree", 0, (1e4, 1e4)):
        tally.count(1, 1, "the suite fails without a mutant")
        return tally
    patience = PATIENCE * (started - clock.left()) + 60
    Random(1).shuffle(mutants)
    for mutant in mutants[seed * A_TURN : (seed + 1) * A_TURN]:
        if not clock.left():
            break
        killed = notices(suite, folder / "tree", mutant.number, (patience, patience))
        tally.count(1)
        tally.add("killed" if killed else "lived", 1)
        if not killed:
            with open(folder / "lived.txt", "a", encoding="utf-8") as file:
                file.write(f"{mutant.file}:{mutant.line}: {mutant.what}\n")
    return tally
