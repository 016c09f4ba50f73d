"""Fuzzing guided by coverage: libFuzzer chooses bytes by what they reach, beside `fuzz.py`, which harms what is valid.

    python tests/fuzz/guided.py --target tile --seconds 300 --out guided

The targets of the core are those of the crate in `guided/`, built with AddressSanitizer, debug assertions and checks
of overflow; they need a nightly Rust and a C++ compiler. Those of the readers in Python are in `guided/readers.py` and
need atheris (`pip install atheris`). What they begin with is made by `samples.py`; what they find worth keeping stays
in OUT/TARGET, where a later run goes on, and what crashes them in OUT/TARGET-faults.
"""

from __future__ import annotations

import argparse
import importlib.util
import os
import re
import resource
import shutil
import struct
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import NamedTuple

sys.path.insert(0, str(Path(__file__).parent))
import samples  # noqa: E402

HERE = Path(__file__).parent / "guided"
RUST = ("manifest", "tile", "radiance", "calls", "mesh")
PYTHON = ("gltf", "picture")
TARGETS = (*RUST, *PYTHON)
SECONDS, MEGABYTES = 10, 2048
"""What one input may take; the sanitizer's own memory is in it."""

_COVERAGE = ("level=4", "inline-8bit-counters", "pc-table", "trace-compares")


class Tried(NamedTuple):
    executions: int
    cpu: float
    """Seconds."""
    fault: str
    """What was said at the end, if there was a fault."""


def build(out: Path) -> Path:
    """The folder of the core's targets."""
    flags = ["-Zsanitizer=address", "-Cpasses=sancov-module"]
    flags += [f"-Cllvm-args=-sanitizer-coverage-{flag}" for flag in _COVERAGE]
    triple = next(
        line.removeprefix("host: ")
        for line in subprocess.run(["rustc", "-vV"], check=True, capture_output=True, text=True).stdout.splitlines()
        if line.startswith("host: ")
    )
    words = ["cargo", "+nightly", "build", "--locked", "--release", "--quiet", "--bins", "--target", triple]
    words += ["--manifest-path", str(HERE / "Cargo.toml"), "--target-dir", str(out / "build")]
    subprocess.run(words, check=True, env=os.environ | {"RUSTFLAGS": " ".join(flags)})
    return out / "build" / triple / "release"


def seed(target: str, out: Path) -> None:
    """What a target begins with, beside what it has found before."""
    corpus = out / target
    corpus.mkdir(parents=True, exist_ok=True)
    for number, data in enumerate(_seeds(target, out)):
        (corpus / f"seed-{number}").write_bytes(data)


def _seeds(target: str, out: Path) -> list[bytes]:
    if target in ("manifest", "tile"):
        found = []
        for number, base in enumerate(sorted(bases(out).iterdir())):
            files = samples.contents(base)
            text = files.pop("manifest.json")
            if target == "manifest":
                found.append(bytes([number]) + text)
            else:
                found += [bytes([number, k]) + data for k, data in enumerate(files.values())]
        return found
    if target == "radiance":
        split = bytes([2, 2, 0, 9]) + 4 * bytes([129 + 4, 7, 4, 1, 2, 3, 4])
        return [bytes([1, 0, 9]) + split, bytes([2, 0, 3]) + bytes([9, 8, 7, 6, 1, 1, 1, 2] * 2)]
    if target == "calls":
        lights = [struct.pack("<Bd", kind, value) for kind, value in ((0, 1.0), (12, -3e5), (5, 0.5), (6, 0.0))]
        return [bytes([which, 8 * which + k, 5, k % 3]) + b"".join(lights) for which in range(3) for k in range(8)]
    if target == "mesh":
        return [bytes([0, 1]) + bytes(range(0, 250, 3)) * 2, bytes([1, 2]) + struct.pack("<18f", *range(18))]
    if target == "gltf":
        files = samples.scenes()[0]["scene.glb"]
        length = int.from_bytes(files[12:16], "little")
        return [files[20 : 20 + length].rstrip() + b"\0" + files[28 + length :]]
    with tempfile.TemporaryDirectory() as folder:
        made = samples.pictures(Path(folder))
    return [bytes([kind]) + data for kind, files in enumerate(made) for data in files.values()]


def bases(out: Path) -> Path:
    """Whole transports, a folder each."""
    folder = out / "bases"
    if not folder.exists():
        with tempfile.TemporaryDirectory() as made:
            for number, files in enumerate(samples.transports(Path(made))):
                base = out / "bases.new" / f"{number:02}"
                base.mkdir(parents=True, exist_ok=True)
                for name, data in files.items():
                    (base / name).write_bytes(data)
        (out / "bases.new").rename(folder)
    return folder


def can_run(target: str) -> bool:
    """Whether what a target needs is there."""
    if target in PYTHON:
        return importlib.util.find_spec("atheris") is not None
    nightly = ["cargo", "+nightly", "--version"]
    return shutil.which("cargo") is not None and subprocess.run(nightly, capture_output=True).returncode == 0


def run(target: str, seconds: float, out: Path, number: int = 1) -> Tried:
    """One target for so long, in one process; `number` are its random numbers."""
    if not can_run(target):
        return Tried(0, 0.0, "")
    seed(target, out)
    program = [str(build(out) / target)] if target in RUST else [sys.executable, str(HERE / "readers.py"), target]
    faults = out / f"{target}-faults"
    faults.mkdir(exist_ok=True)
    words = [*program, f"-max_total_time={int(seconds)}", f"-seed={number}", f"-timeout={SECONDS}", "-max_len=65536"]
    words += [f"-rss_limit_mb={MEGABYTES}", "-print_final_stats=1", f"-artifact_prefix={faults}/", str(out / target)]
    scratch = tempfile.mkdtemp()
    # One thread, so that coverage is that of the input. The executable's own leaks at its end are no fault of a file.
    own = {"DELTALUX_BASES": str(bases(out)), "RAYON_NUM_THREADS": "1", "TMPDIR": scratch}
    own["ASAN_OPTIONS"] = "detect_leaks=0:allocator_may_return_null=1"
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run(words, capture_output=True, text=True, errors="replace", env=os.environ | own)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    shutil.rmtree(scratch)
    cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    found = re.search(r"number_of_executed_units: (\d+)", done.stderr)
    return Tried(int(found[1]) if found else 0, cpu, done.stderr[-3000:] if done.returncode else "")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--target", nargs="+", choices=TARGETS, default=list(TARGETS), help="by default all")
    parser.add_argument("--seconds", type=float, default=300.0, help="for each target; default: %(default)s")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", type=Path, default=Path("guided"), help="what is built, found and kept")
    given = parser.parse_args()
    failed = False
    for target in given.target:
        tried = run(target, given.seconds, given.out.absolute(), given.seed)
        print(f"{target}: {tried.executions} inputs in {tried.cpu:.0f} s of CPU", flush=True)
        if tried.fault:
            failed = True
            print(f"FAULT:\n{tried.fault}")
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
