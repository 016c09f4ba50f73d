"""Ctrl-C while the command line is still being imported: one line and the exit status 130, where Python prints a
traceback and some packages go on as if nothing had been asked.

It lies under all other modules, and is imported before them.
"""

from __future__ import annotations

import os
import signal
import sys
from pathlib import Path
from types import FrameType

__all__ = ["INTERRUPTED", "begun", "ended"]

INTERRUPTED = 130
"""The exit status after Ctrl-C."""


def _leave(number: int, frame: FrameType | None) -> None:
    """Ends the process at once: nothing has been begun that would have to be ended well."""
    os.write(2, b"deltalux: stopped\n")
    os._exit(INTERRUPTED)


def _is_command_line() -> bool:
    """Whether this process was started as `deltalux` or as `python -m deltalux`, and is no program that imports us."""
    words = sys.orig_argv
    by_module = "-m" in words and words[words.index("-m") + 1 :][:1] == ["deltalux"]
    return by_module or (bool(sys.argv) and Path(sys.argv[0]).stem == "deltalux")


def _begin() -> None:
    """Takes Ctrl-C, where the process is the command line and nobody else does."""
    if _is_command_line() and signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, _leave)


def begun() -> None:
    """Gives it back to Python, once there is somebody to catch a `KeyboardInterrupt`."""
    if signal.getsignal(signal.SIGINT) is _leave:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def ended() -> None:
    """Lets a process that is done end as it was about to, whatever comes in between."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


_begin()
