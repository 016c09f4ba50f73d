"""The reliability card: what no push has the time for: `python benches/reliability.py --hours 2 --out card`.

Every row of the card is a file of `benches/card/`. They take turns, in processes of their own, each for its share of
the time, and with other random numbers at every turn. After each turn the sums are written to OUT/card.json and the
table to OUT/card.md; a run into the same folder goes on with the sums that are there. What did not survive is listed
below the table, and the exit status is then 1.
"""

from __future__ import annotations

import argparse
import importlib
import json
import os
import subprocess
import sys
import time
from dataclasses import asdict
from pathlib import Path

from card.tally import Clock, Tally

ROWS = (
    "rays",
    "frames",
    "bounds",
    "threads",
    "kills",
    "writes",
    "interrupts",
    "memory",
    "fuzzing",
    "mitsuba",
    "guided",
    "properties",
    "mutants",
    "faults",
)
FIRST, LATER = 20.0, 60.0
"""Seconds of a row with a share of 1, in the first turn and in later ones."""
PATIENCE = 1800.0
"""Seconds beyond its time after which a row is said to hang."""


def turn(name: str, seconds: float, seed: int, folder: Path) -> Tally:
    """One row in a process of its own."""
    into, started = folder / f"{name}.json", time.monotonic()
    into.unlink(missing_ok=True)
    words = ["--row", name, "--seconds", seconds, "--seed", seed, "--out", folder]
    # Threads of numpy's small products wait for each other where others are at work too: ten times as long as one.
    own = os.environ | dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"), "1")
    with open(folder / f"{name}.log", "a") as log:
        child = subprocess.Popen([sys.executable, __file__, *map(str, words)], stdout=log, stderr=log, env=own)
        try:
            ended = f"ended with {child.wait(seconds + PATIENCE)}"
        except subprocess.TimeoutExpired:
            ended = f"was still at work {PATIENCE:g} s after its time"
            child.kill()
            child.wait()
    tally = Tally(**json.loads(into.read_text())) if into.exists() else Tally(1, 1, [f"seed {seed}: {ended}"])
    tally.seconds = time.monotonic() - started
    return tally


def row(name: str, seconds: float, seed: int, folder: Path) -> None:
    """What such a process does."""
    own = folder / name
    own.mkdir(parents=True, exist_ok=True)
    tally = importlib.import_module(f"card.{name}").run(Clock(seconds), seed, own)
    _write(folder / f"{name}.json", json.dumps(asdict(tally)))


def _write(path: Path, text: str) -> None:
    beside = path.with_name(f".{path.name}")
    beside.write_text(text, encoding="utf-8")
    os.replace(beside, path)


def _count(number: float) -> str:
    return f"{number:,.0f}" if number == int(number) else f"{number:.3g}"


def table(sums: dict[str, Tally]) -> str:
    """The card."""
    lines = ["| row | tried | survived | seconds | |", "|---|---|---|---|---|"]
    for name, tally in sums.items():
        what = importlib.import_module(f"card.{name}").WHAT
        notes = [f"{key}: {_count(figure)}" for key, figure in (tally.sums | tally.most).items()]
        survived = "all" if not tally.lost else f"all but {tally.lost:,}"
        lines.append(f"| {what} | {tally.tried:,} | {survived} | {tally.seconds:,.0f} | {'; '.join(notes)} |")
    lines += ["", f"{sum(tally.seconds for tally in sums.values()) / 3600:.2f} hours in all.", ""]
    for name, tally in sums.items():
        lines += [f"- {name}: {' '.join(fault.split())}" for fault in tally.faults]
    return "\n".join(lines) + "\n"


def go_on(hours: float, folder: Path, names: list[str]) -> dict[str, Tally]:
    """Turn after turn, with the sums of earlier runs."""
    folder.mkdir(parents=True, exist_ok=True)
    file = folder / "card.json"
    kept = json.loads(file.read_text()) if file.exists() else {"turns": {}, "sums": {}}
    turns, sums = kept["turns"], {name: Tally(**own) for name, own in kept["sums"].items()}
    clock = Clock(3600 * hours)
    while clock.left():
        for name in names:
            if not clock.left():
                break
            seed = turns.get(name, 0)
            share = importlib.import_module(f"card.{name}").SHARE
            seconds = min((LATER if seed else FIRST) * share, clock.left())
            sums.setdefault(name, Tally()).join(turn(name, seconds, seed, folder))
            turns[name] = seed + 1
            _write(
                file, json.dumps({"turns": turns, "sums": {key: asdict(own) for key, own in sums.items()}}, indent=1)
            )
            _write(folder / "card.md", table(sums))
            print(f"{name}, turn {seed}: {sums[name].tried:,} tried, {sums[name].lost:,} lost", flush=True)
    return sums


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--hours", type=float, default=2.0)
    parser.add_argument("--out", type=Path, default=Path("card"), help="folder of the sums and the table")
    parser.add_argument("--rows", nargs="+", choices=ROWS, default=list(ROWS), help="by default all")
    parser.add_argument("--row", choices=ROWS, help=argparse.SUPPRESS)
    parser.add_argument("--seconds", type=float, help=argparse.SUPPRESS)
    parser.add_argument("--seed", type=int, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.row is not None:
        row(given.row, given.seconds, given.seed, given.out)
        return 0
    sums = go_on(given.hours, given.out.absolute(), given.rows)
    print(table(sums))
    return int(any(tally.lost for tally in sums.values()))


if __name__ == "__main__":
    sys.exit(main())
