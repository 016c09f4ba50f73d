"""The command line: one file a command; here is what all of them share from the first argument to the exit status.

Every error that a user can cause is one sentence on standard error and exit status 2; Ctrl-C is 130.
"""

from __future__ import annotations

import faulthandler
import os
import sys
import time
import warnings
from collections.abc import Sequence
from typing import Any, NoReturn

from .._core import __version__, set_threads
from ..starting import INTERRUPTED, begun, ended
from . import dataset, demo, edit, precompute, relight, render, report, study, view
from .arguments import Parser

__all__ = ["main", "run"]


_LONG = 5.0
"""Seconds after which it is said how long a command took."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs one command and returns its exit status: 0, 2 after an error, 130 after Ctrl-C."""
    chosen, began = None, time.monotonic()
    try:
        begun()
        chosen = _parser().parse_args(arguments)
        with warnings.catch_warnings():
            warnings.simplefilter("always", UserWarning)
            warnings.showwarning = _warn
            if chosen.threads is not None:
                set_threads(chosen.threads)
            chosen.run(chosen)
        if (seconds := time.monotonic() - began) >= _LONG:
            print(f"deltalux: done in {seconds:.0f} s", file=sys.stderr)
    except KeyboardInterrupt:
        return _stop(INTERRUPTED, getattr(chosen, "when_stopped", "stopped"))
    except BrokenPipeError:
        # Whoever reads our output has enough of it; Python must not complain again at exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except (ValueError, OSError, MemoryError) as error:
        return _stop(2, f"error: {_sentence(error)}")
    return 0


def run() -> NoReturn:
    """The whole process of one command."""
    # A mapped file that somebody shortens ends the process: not without a word.
    if sys.__stderr__ is not None:
        faulthandler.enable(sys.__stderr__)
    status = main()
    ended()
    sys.exit(status)


def _stop(status: int, message: str) -> int:
    # A bar may be standing on the line.
    start = "\n" if status == INTERRUPTED and sys.stderr.isatty() else ""
    print(f"{start}deltalux: {message}", file=sys.stderr)
    return status


def _sentence(error: BaseException) -> str:
    """The message of an error on one line; of the system's errors, what happened and to which file."""
    if isinstance(error, MemoryError):
        return "there is not enough memory; take fewer pixels or columns"
    if isinstance(error, OSError) and error.strerror:
        where = f"{error.filename}: " if error.filename is not None else ""
        what = error.strerror.partition(" (os error ")[0]
        return f"{where}{what[0].lower()}{what[1:]}"
    return " ".join(str(error).split())


def _warn(message: Warning | str, *_: Any, **__: Any) -> None:
    print(f"deltalux: warning: {' '.join(str(message).split())}", file=sys.stderr)


def _parser() -> Parser:
    parser = Parser(
        prog="deltalux", description="Precomputed light transport of still scenes, relit as the light moves."
    )
    parser.add_argument("--version", action="version", version=f"deltalux {__version__}")
    commands = parser.add_subparsers(metavar="COMMAND", required=True, parser_class=Parser)
    for command in (dataset, demo, edit, precompute, relight, render, report, study, view):
        command.add(commands)
    return parser
