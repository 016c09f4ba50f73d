"""Room on the disk and in memory, looked at before any long work."""

from __future__ import annotations

import errno
import os
import shutil
from pathlib import Path

from .._core import threads
from ..scene.scene import Scene
from ..transport.plan import Plan

# Bytes: for each pixel that is looked at, and the row that it becomes until receivers are written; each triangle in the
# tree; and the interpreter with all that it loads.
PIXEL, TRIANGLE, INTERPRETER = 400.0, 400.0, 120e6
# A gather sample with its cell; and of each sample and function what a thread's bundle of 64 rows takes.
SAMPLE, BUNDLE_BYTES = 64 * 64.0, 64 * 4.0
_JOB = "job.txt"


def check_request(scene: Scene) -> None:
    """Refuses, before any ray, what would not even fit in memory while its receivers are found.

    Raises
    ------
    ValueError
        With the number that is needed and the number that there is.
    """
    pixels = scene.camera.width * scene.camera.height
    _check_memory(scene.name, INTERPRETER + PIXEL * pixels + TRIANGLE * len(scene.triangles))


def check_gathering(scene: Scene, gather: int, functions: int) -> None:
    """The same of rows over gather samples, which are dense while they are made.

    Raises
    ------
    ValueError
        With the number that is needed and the number that there is.
    """
    each = BUNDLE_BYTES * gather * (functions + 1)
    needed = INTERPRETER + TRIANGLE * len(scene.triangles) + SAMPLE * gather + threads() * each
    _check_memory(scene.name, needed, "fewer pixels, gather samples or threads")


def check_folder_of(path: Path) -> Path:
    """The directory that a transport will lie in; it must exist, and be one that may be written to."""
    folder = path.absolute().parent
    if path.is_file():
        raise FileExistsError(f"{path}: expected the directory of a transport or nothing, found a file")
    if not folder.is_dir():
        raise FileNotFoundError(f"expected a directory to write {path.name} into, but {folder} does not exist")
    if not os.access(folder, os.W_OK):
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(folder))
    return folder


def claim(path: Path, what: str, job: str) -> None:
    """Makes the directory of a run, or takes over one of the same kind: what was finished of the same job stays.

    Raises
    ------
    FileExistsError
        If something else is there.
    """
    kept, said = path / _JOB, f"{what}\n{job}"
    found = kept.read_text(encoding="utf-8") if kept.is_file() else None
    empty = path.is_dir() and not any(path.iterdir())
    if path.exists() and not empty and (found is None or found.partition("\n")[0] != what):
        raise FileExistsError(f"expected no file or {what} at {path}, but something else is there")
    if path.exists() and found != said:
        shutil.rmtree(path)
    path.mkdir(exist_ok=True)
    kept.write_text(said, encoding="utf-8")


def check_room(plan: Plan, path: Path) -> None:
    """Refuses, before any long work, what would not fit on the disk or in memory.

    Raises
    ------
    ValueError
        With the number that is needed and the number that there is.
    """
    folder = check_folder_of(path)
    free = shutil.disk_usage(folder).free
    if plan.bytes_on_disk > free:
        raise ValueError(
            f"{plan.scene} would take about {plan.bytes_on_disk / 1e6:,.0f} MB on disk, "
            f"but only {free / 1e6:,.0f} MB are free at {folder}; take fewer pixels or columns, or a lower quality"
        )
    _check_memory(plan.scene, plan.bytes_in_memory)


def _check_memory(name: str, needed: float, less: str = "fewer pixels, columns or threads") -> None:
    memory = _available_memory()
    if memory is not None and needed > memory:
        raise ValueError(
            f"{name} would need about {needed / 1e6:,.0f} MB of memory, "
            f"but only {memory / 1e6:,.0f} MB are available; take {less}"
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
