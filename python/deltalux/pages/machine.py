"""What a figure must be read with: the machine, the build and the versions."""

from __future__ import annotations

import datetime
import os
import platform
import sys
from pathlib import Path

import numpy as np

from .._core import DEBUG_BUILD, __version__

__all__ = ["machine", "require_release"]


def require_release() -> None:
    """Refuses to time a debug build.

    Raises
    ------
    ValueError
        If the core was built without optimisation.
    """
    if DEBUG_BUILD:
        raise ValueError("expected a release build of deltalux, got a debug build: its run times mean nothing")


def machine() -> dict[str, str]:
    """Names and values for the page."""
    usable = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    return {
        "processor": _processor(),
        "cores": f"{usable} usable of {os.cpu_count()}",
        "memory": _memory(),
        "system": f"{platform.system()} {platform.release()}, {platform.machine()}",
        "deltalux": f"{__version__}, release build",
        "Python": f"{platform.python_version()} ({platform.python_implementation()})",
        "numpy": np.__version__,
        "date": datetime.datetime.now(datetime.UTC).strftime("%Y-%m-%d %H:%M UTC"),
        "command": " ".join([Path(sys.argv[0]).name, *sys.argv[1:]]),
    }


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
        return next(line.split(":", 1)[1].strip() for line in lines if line.startswith("model name"))
    except (OSError, StopIteration):
        return platform.processor() or platform.machine()


def _memory() -> str:
    try:
        total = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    except (AttributeError, ValueError, OSError):
        return "unknown"
    return f"{total / 2**30:.1f} GiB"
