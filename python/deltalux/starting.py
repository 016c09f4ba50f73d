"""Ctrl-C while the command line is still being imported: one line and the exit status 130, where Python prints a
traceback and some packages go on as if nothing had been asked.

It lies under all other modules, is imported before them, and imports next to nothing itself: until it is there, Ctrl-C
is Python's own, and the package's first lines catch it. Hence `_signal`, which is built in, where `signal` reads two
files.
"""

import _signal  # type: ignore[import-not-found]  # no stubs describe it
import os
import sys

__all__ = ["INTERRUPTED", "begun", "ended", "interrupted"]

INTERRUPTED = 130
"""The exit status after Ctrl-C."""


def _leave(number: int, frame: object) -> None:
    """Ends the process at once: nothing has been begun that would have to be ended well."""
    os.write(2, b"deltalux: stopped\n")
    os._exit(INTERRUPTED)


def _is_command_line() -> bool:
    """Whether this process was started as `deltalux` or as `python -m deltalux`, and is no program that imports us."""
    words = sys.orig_argv
    by_module = "-m" in words and words[words.index("-m") + 1 :][:1] == ["deltalux"]
    name = os.path.basename(sys.argv[0]) if sys.argv else ""
    return by_module or name in ("deltalux", "deltalux.exe")


def interrupted() -> None:
    """Ends the command line, where Ctrl-C was quicker than this module; any other process hears of it as ever."""
    if _is_command_line():
        _leave(_signal.SIGINT, None)


def begun() -> None:
    """Gives Ctrl-C back to Python, once there is somebody to catch a `KeyboardInterrupt`."""
    if _signal.getsignal(_signal.SIGINT) is _leave:
        _signal.signal(_signal.SIGINT, _signal.default_int_handler)


def ended() -> None:
    """Lets a process that is done end as it was about to, whatever comes in between."""
    _signal.signal(_signal.SIGINT, _signal.SIG_IGN)


# Where the process is the command line, and nobody else takes Ctrl-C.
if _is_command_line() and _signal.getsignal(_signal.SIGINT) is _signal.default_int_handler:
    _signal.signal(_signal.SIGINT, _leave)
