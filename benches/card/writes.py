"""Disks that fail: each call of the system that saving makes fails once, with ENOSPC, EIO or EINTR, and files may not
grow beyond a byte (short writes, then EFBIG). What was there stays, the error is an `OSError`, and the next run ends
well.

Calls are made to fail by `strace -e inject`; without strace only files that may not grow are left.
"""

from __future__ import annotations

import os
import resource
import shutil
import signal
import subprocess
from collections.abc import Callable, Iterator
from itertools import count
from pathlib import Path

import numpy as np

from .kills import PATIENCE, ended, kill
from .saves import SAVES, beginning, contents, expected, wrong
from .tally import Clock, Tally

WHAT = "failing system calls while saving (ENOSPC, EIO, EINTR, EFBIG), then the same call again"
SHARE = 1.0

CALLS = ("write", "pwrite64", "fsync", "rename", "renameat2", "mkdir", "unlink", "ftruncate")
ERRORS = ("ENOSPC", "EIO")
REFUSED, OTHERWISE = 3, 4
"""Exit statuses: of an `OSError`, and of any other exception."""

Before = Callable[[], None]
Attach = Callable[[int], "subprocess.Popen[bytes] | None"]


def attempt(work: Before, attach: Attach, before: Before) -> int | None:
    """The exit status of a child that does some work once it is attached to."""
    go, say = os.pipe()
    child = os.fork()
    if not child:
        status = OTHERWISE
        try:
            os.close(say)
            os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
            os.dup2(1, 2)
            os.read(go, 1)
            before()
            work()
            status = 0
        except OSError:
            status = REFUSED
        finally:
            os._exit(status)
    os.close(go)
    tracer = attach(child)
    os.write(say, b"x")
    os.close(say)
    status = ended(child, PATIENCE)
    if status is None:
        kill(child)
    if tracer is not None:
        tracer.wait()
    return status


def by_strace(call: str, error: str, number: int, log: Path) -> Callable[[int], subprocess.Popen[bytes]]:
    """Lets one call fail in a process; what failed is in a log."""

    def attach(process: int) -> subprocess.Popen[bytes]:
        what = ["-e", f"trace={call}", "-e", f"inject={call}:error={error}:when={number}"]
        words = ["strace", "-f", "-o", str(log), "-p", str(process), *what]
        tracer = subprocess.Popen(words, stderr=subprocess.PIPE)
        assert tracer.stderr is not None
        assert b"attached" in tracer.stderr.readline()
        return tracer

    return attach


def no_larger(length: int) -> Before:
    """Lets files grow to so many bytes."""

    def before() -> None:
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (length, length))

    return before


def check(name: str, own: Path, status: int | None, what: str, tally: Tally) -> None:
    """What a save that may have failed has left, and whether the next one ends well."""
    fault = "" if status in (0, REFUSED) else f"ended with {status}"
    fault = fault or wrong(name, own, ended=status == 0)
    left = [file for file in contents(own) if Path(file).name.startswith((".tmp", ".a"))]
    fault = fault or (f"left {left}" if left and status == REFUSED and "unlink" not in what else "")
    again = attempt(lambda: SAVES[name].work(own, 1), lambda process: None, lambda: None)
    fault = fault or ("" if again == 0 else f"the next run ended with {again}")
    fault = fault or wrong(name, own, ended=True)
    tally.count(1, bool(fault), f"{name}, {what}: {fault}")


def each_call(name: str, folder: Path, call: str, error: str) -> Iterator[tuple[Path, int | None, str]]:
    """Lets the first call fail, the second, ... until none is left to fail: what that left, and how it ended."""
    log = folder / "calls"
    for number in count(1):
        own = beginning(name, folder)
        status = attempt(lambda own=own: SAVES[name].work(own, 1), by_strace(call, error, number, log), lambda: None)
        if b"INJECTED" not in log.read_bytes():
            return
        yield own, status, f"{error} of {call} {number}"


def run(clock: Clock, seed: int, folder: Path) -> Tally:
    tally, rng = Tally(), np.random.default_rng(seed)
    for name in SAVES:
        expected(name, folder)
    cases = [(name, call, error) for name in SAVES for call in CALLS for error in ERRORS]
    cases += [(name, "write", "EINTR") for name in SAVES]
    if shutil.which("strace") is None:
        cases = []
    for number in range(len(cases)):
        # As many a turn as there is time for; the next turn begins elsewhere.
        name, call, error = cases[(number + 11 * seed) % len(cases)]
        for own, status, what in each_call(name, folder, call, error):
            check(name, own, status, what, tally)
            if not clock.left():
                return tally
    while clock.left():
        name = str(rng.choice(list(SAVES)))
        own, length = beginning(name, folder), int(2 ** rng.uniform(0, 16))
        status = attempt(lambda name=name, own=own: SAVES[name].work(own, 1), lambda process: None, no_larger(length))
        check(name, own, status, f"files of {length} bytes", tally)
    return tally
