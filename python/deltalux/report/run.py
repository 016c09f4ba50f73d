"""The report: every method of one table against the exact product, in error, run time and bytes, as a folder to read.

One list of methods, the reference in its first row (as in Probulator's experiments): all plots, tables, pictures and
verdicts come from it. `report` is the only function that a script needs.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from pathlib import Path

from numpy.typing import ArrayLike

from ..light.environment import Environment
from ..light.motion import Motion, ease
from ..output import check_folder, claim, slug
from ..pages.machine import require_release
from ..progress import Progress, Reporter, steps
from ..relight.entrants import BI_30, EXACT, NWA_30, NWA_100, PBI_30, Entrant, nwa, own, pbi
from ..relight.relighter import Relighter
from ..relight.replay import Replay, hold_still, replay, time_frames
from ..transport.transport import Transport
from ..update.methods import Method
from .gallery import Gallery
from .size_curve import size_curve
from .writer import write

__all__ = ["METHODS", "check_report", "ease", "report"]

_BUDGETS = (10, 30, 100, 300, 500)
_BY_TRANSPORT = "by transport"

METHODS: tuple[Entrant, ...] = (
    EXACT,
    *(nwa(terms) for terms in sorted((*_BUDGETS, 60))),
    BI_30,
    *(pbi(terms) for terms in _BUDGETS),
    *(pbi(terms, _BY_TRANSPORT, family=f"PBI {_BY_TRANSPORT}", weight="transport") for terms in (30, 100)),
)
"""What is compared; the first row is the reference."""

STRIP = (EXACT.name, NWA_30.name, NWA_100.name, BI_30.name, PBI_30.name)
MOVING = (EXACT.name, NWA_30.name, BI_30.name, PBI_30.name)
SAVED = (EXACT.name, PBI_30.name)
THREADS = (1, 2)
# One does not move.
FEWEST_FRAMES = 2


def _frame_names(slug: str, motion: Motion) -> dict[tuple[str, int], str]:
    return {(name, frame): f"{slug}-frame-{frame:04d}-{name}" for name in SAVED for frame, _ in motion.moments}


def _file_names(envs: Sequence[Environment], motion: Motion) -> list[str]:
    """Every file that a report may write."""
    names = ["index.html", "frames.csv", "methods.csv", "bytes.csv", "error-against-bytes.png"]
    for k, env in enumerate(envs):
        prefix = slug(env.name, k)
        kinds = (
            "error-against-frame.png",
            "error-against-time.png",
            "resets.png",
            "terms.png",
            "strip.png",
            "animation.webp",
        )
        names += [f"{prefix}-{kind}" for kind in kinds]
        names += [f"{stem}{suffix}" for stem in _frame_names(prefix, motion).values() for suffix in (".png", ".exr")]
    return names


def check_report(env: Environment | Sequence[Environment], folder: str | os.PathLike[str], motion: Motion) -> None:
    """What `report` would refuse, found at once and with nothing written.

    Parameters
    ----------
    env
        The light, or several.
    folder
        Where the report would go.
    motion
        How the light would move.

    Raises
    ------
    ValueError, OSError
        As `report`.
    """
    require_release()
    if motion.frames < FEWEST_FRAMES:
        raise ValueError(f"expected light that moves for {FEWEST_FRAMES} frames or more, got {motion.frames}")
    check_folder(folder, _file_names(_environments(env), motion))


def _environments(env: Environment | Sequence[Environment]) -> list[Environment]:
    envs = [env] if isinstance(env, Environment) else list(env)
    if not envs:
        raise ValueError("expected at least one environment")
    return envs


def report(
    transport: Transport,
    env: Environment | Sequence[Environment],
    folder: str | os.PathLike[str],
    *,
    rotate: float = 45.0,
    frames: int = 100,
    hold: int = 25,
    axis: str | ArrayLike = "y",
    methods: Sequence[Method] = (),
    progress: bool | Progress = True,
) -> Path:
    """Replays a rotating light with every method of `METHODS` and writes what was measured.

    Parameters
    ----------
    transport
        M.
    env
        The light, or several; each gets a chapter.
    folder
        Made if it is not there. Files in it that are not ours are never overwritten.
    rotate, frames, hold, axis
        The motion: degrees, turned with `ease` in this many frames, and frames of standing still.
    methods
        Methods of one's own, which take part beside those of the table.
    progress
        True: a bar on standard error. A callable: progress(done, total), for each part of the work anew.

    Returns
    -------
    Path
        The page, index.html. Beside it are frames.csv, methods.csv, bytes.csv, the plots, a strip and an animation for
        every environment, and relit frames as PNG and EXR.

    Raises
    ------
    ValueError
        If an argument cannot be used, or this is a debug build.
    OSError
        If the folder cannot be written or holds files of others under our names.
    """
    envs, motion = _environments(env), Motion(rotate, frames, hold, axis)
    check_report(envs, folder, motion)
    rows = (*METHODS, *own(methods))
    path = claim(folder, _file_names(envs, motion))
    chapters = []
    # Errors, run times on some numbers of threads, and pictures, of each light; the page.
    step_of = steps(progress, "report", len(envs) * (2 + len(THREADS)) + 1)
    for k, light in enumerate(envs):
        prefix = slug(light.name, k)
        result, gallery = _measure(transport, light, motion, rows, step_of)
        errors = {(name, frame): result.records[name][frame].image_l2 for name in STRIP for frame, _ in motion.moments}
        step = step_of(f"{light.name}: pictures")
        step(0, 3)
        gallery.save_strip(path / f"{prefix}-strip.png", errors)
        step(1, 3)
        gallery.save_frames(path, _frame_names(prefix, motion), light.name)
        step(2, 3)
        gallery.save_animation(path / f"{prefix}-animation.webp")
        step(3, 3)
        chapters.append((prefix, result, gallery.exposure or 0.0, _frame_names(prefix, motion)))
    step = step_of("plots and page")
    write(path, transport, motion, rows, chapters, size_curve(transport, envs, motion))
    step(1, 1)
    return path / "index.html"


def _measure(
    transport: Transport, env: Environment, motion: Motion, rows: Sequence[Entrant], step_of: Callable[[str], Reporter]
) -> tuple[Replay, Gallery]:
    """Errors and pictures first; then run times, with nothing beside them, on one thread and on two."""
    gallery = Gallery(transport, motion, STRIP, MOVING)
    result = replay(transport, env, motion, rows, show=gallery.show, progress=step_of(f"{env.name}: errors"))
    followers: dict[str, Relighter] = {}
    for threads in THREADS:
        tell = step_of(f"{env.name}: times, {threads} thread{'s' * (threads > 1)}")
        result.seconds[threads], followers = time_frames(transport, env, motion, rows, threads=threads, progress=tell)
    result.still = hold_still(transport, env, motion, PBI_30, followers[PBI_30.name], result.records[PBI_30.name])
    return result, gallery
