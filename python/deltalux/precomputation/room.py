"""Room on the disk and in memory, looked at before any work."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

from ..transport.plan import Plan


def check_room(plan: Plan, path: Path) -> None:
    """Refuses, before any work, what would not fit on the disk or in memory.

    Raises
    ------
    ValueError
        With the number that is needed and the number that there is.
    """
    folder = path.absolute().parent
    if not folder.is_dir():
        raise FileNotFoundError(f"expected a directory to write {path.name} into, but {folder} does not exist")
    free = shutil.disk_usage(folder).free
    if plan.bytes_on_disk > free:
        raise ValueError(
            f"{plan.scene} would take about {plan.bytes_on_disk / 1e6:,.0f} MB on disk, "
            f"but only {free / 1e6:,.0f} MB are free at {folder}; take fewer pixels or columns, or a lower quality"
        )
    memory = _available_memory()
    if memory is not None and plan.bytes_in_memory > memory:
        raise ValueError(
            f"{plan.scene} would need about {plan.bytes_in_memory / 1e6:,.0f} MB of memory, "
            f"but only {memory / 1e6:,.0f} MB are available; take fewer columns or fewer threads"
        )


def _available_memory() -> float | None:
    """Bytes that this process may still take: the least of what is free and what its limits allow; None if unknown."""
    limits: list[float] = []
    try:
        fields = dict(line.split(":") for line in Path("/proc/meminfo").read_text().splitlines())
        limits.append(float(fields["MemAvailable"].split()[0]) * 1024)
    except (OSError, KeyError, ValueError):
        if hasattr(os, "sysconf") and "SC_AVPHYS_PAGES" in os.sysconf_names:
            limits.append(float(os.sysconf("SC_AVPHYS_PAGES")) * os.sysconf("SC_PAGE_SIZE"))
    try:
        import resource

        soft, _ = resource.getrlimit(resource.RLIMIT_AS)
        if soft != resource.RLIM_INFINITY:
            used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
            limits.append(float(soft - used))
    except (ImportError, OSError, ValueError):
        pass
    return min(limits) if limits else None
