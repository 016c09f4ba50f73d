"""One study by its name: what would be refused, found before any work, and the work."""

from __future__ import annotations

import os
from collections.abc import Sequence
from concurrent.futures import Executor
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

from ..columns import Haar
from ..light.environment import Environment
from ..light.motion import Motion
from ..output import check_folder, claim, slug
from ..progress import Progress, Reporter, reporter, steps
from ..relight.entrants import own
from ..scene.scene import Scene
from ..tasks import checked_executor, completed
from ..transport.transport import Transport
from ..update.methods import Method
from .case import Case
from .catalogue import STUDIES
from .shape import Study
from .sheet import PAGE, Sheet

__all__ = ["check_study", "study"]

_FEWEST_FRAMES = 8
_PICTURE = (128, 128)
"""Of the built-in scene that a study traces."""


def check_study(
    name: str,
    folder: str | os.PathLike[str],
    env: Environment | Sequence[Environment],
    transport: Transport | Sequence[Transport] = (),
    *,
    scene: Scene | Sequence[Scene] = (),
    motion: Motion | None = None,
    columns: Haar | None = None,
    methods: Sequence[Method] = (),
) -> list[tuple[str, Case]]:
    """What `study` would refuse, found at once and with nothing written.

    Parameters
    ----------
    name, folder, env, transport, scene, motion, columns, methods
        As `study`.

    Returns
    -------
    list of (str, Case)
        The chapters that the study would have: the beginning of their files' names, and what each looks at.

    Raises
    ------
    ValueError, OSError
        As `study`.
    """
    if name not in STUDIES:
        raise ValueError(f"expected a study of {', '.join(STUDIES)}, got {name!r}")
    envs = [env] if isinstance(env, Environment) else list(env)
    transports = [transport] if isinstance(transport, Transport) else list(transport)
    scenes = [scene] if isinstance(scene, Scene) else list(scene)
    if not envs:
        raise ValueError("expected at least one environment")
    motion = motion or Motion()
    if motion.frames < _FEWEST_FRAMES or motion.rotate == 0:
        raise ValueError(f"expected light that moves for {_FEWEST_FRAMES} frames or more, got {motion}")
    dark = [light.name for light in envs if not light.cubemap(1).any()]
    if dark:
        raise ValueError(f"expected light, but {dark[0]} is black: errors are relative to it")
    _check_seen(name, transports, scenes)
    if methods and not STUDIES[name].takes_methods:
        taking = ", ".join(name for name, study in STUDIES.items() if study.takes_methods)
        raise ValueError(f"methods of one's own take part in the studies {taking}, not in {name!r}")
    others = own(methods)
    cases = [Case(light, motion, _haar(found), found, others) for found in transports for light in envs]
    columns = columns or STUDIES[name].columns
    if traced := STUDIES[name].traces:
        scenes = scenes or [_builtin(traced)]
        cases = [Case(light, motion, columns, own=others, scene=found) for found in scenes for light in envs]
    if subject := STUDIES[name].subject:
        cases = [Case(envs[0], motion, columns, subject=subject)]
    cases = cases or [Case(light, motion, columns, own=others) for light in envs]
    chapters = [(slug(case.name, k), case) for k, case in enumerate(cases)]
    check_folder(folder, _names(STUDIES[name], chapters))
    return chapters


def _check_seen(name: str, transports: Sequence[Transport], scenes: Sequence[Scene]) -> None:
    """Studies look at transports, or at scenes that they trace, or at light alone."""
    chosen = STUDIES[name]
    if chosen.needs_scene and not transports:
        raise ValueError(f"the study {name!r} looks at pictures: expected a scene")
    if chosen.subject and (transports or scenes):
        raise ValueError(f"the study {name!r} looks at {chosen.subject}: expected no scene")
    if chosen.traces and transports:
        raise ValueError(f"the study {name!r} traces scenes itself: expected a scene, got {transports[0]}")
    if scenes and not chosen.traces:
        raise ValueError(f"the study {name!r} looks at transports: expected one of {scenes[0].name}, got the scene")
    if chosen.needs_texels:
        _check_texels(name, transports)
    if chosen.refuses_texels and any(found.texel_bytes for found in transports):
        raise ValueError(f"the study {name!r} looks at wavelets alone: expected a transport in columns like haar:64")


def _builtin(name: str) -> Scene:
    scene = Scene.builtin(name)
    return scene.with_camera(scene.camera.resized(*_PICTURE))


def _check_texels(name: str, transports: Sequence[Transport]) -> None:
    for transport in transports:
        texels = isinstance(transport.columns, Haar) and transport.columns.texels
        if not texels or transport.audit is None:
            raise ValueError(
                f"the study {name!r} looks at texels and at untruncated rows: expected a transport in columns like "
                f"haar:64+texels with some thousand rows or more, got {transport}"
            )


def _haar(transport: Transport) -> Haar:
    if isinstance(transport.columns, Haar):
        return transport.columns
    raise ValueError(f"studies follow wavelets: expected a transport in haar columns, got {transport.columns}")


def _names(chosen: Study, chapters: Sequence[tuple[str, Case]]) -> list[str]:
    """Every file that a study may write."""
    kinds = [f"{chapter}-{kind}" for chapter, case in chapters for kind in chosen.files(case)]
    return [PAGE, *kinds]


def study(
    name: str,
    folder: str | os.PathLike[str],
    env: Environment | Sequence[Environment],
    transport: Transport | Sequence[Transport] = (),
    *,
    scene: Scene | Sequence[Scene] = (),
    motion: Motion | None = None,
    columns: Haar | None = None,
    methods: Sequence[Method] = (),
    progress: bool | Progress = True,
    executor: Executor | None = None,
) -> Path:
    """Runs one study of `STUDIES` and writes what it finds.

    Parameters
    ----------
    name
        A key of `STUDIES`.
    folder
        Made if it is not there. Files in it that are not ours are never overwritten.
    env
        The light, or several; each gets a chapter. Studies of reflectance alone look at none.
    transport
        The scenes to look at, in Haar columns; with none, the light alone is studied where the study can do so.
    motion
        The rotation; by default 45 degrees in 100 frames, then 25 still.
    scene
        What a study of light between surfaces traces, in several ways, in the place of a transport; by default a
        built-in scene.
    columns
        What light is measured in where there is no transport; by default the study's own, as a rule `Haar(64)`, the
        papers' 24,576 wavelets.
    methods
        Methods of one's own that take part, in studies that compare methods.
    progress
        True: a bar on standard error. A callable: progress(done, total), for each chapter anew.
    executor
        Who does the chapters, each a task: processes of `concurrent.futures`, Dask's or MPI's, whose workers see the
        same files. What is told is then how many are done.

    Returns
    -------
    Path
        The page, index.html.

    Raises
    ------
    ValueError
        If there is no such study, it needs a scene that is not given, or the transport has other columns than Haar.
    OSError
        If the folder cannot be written or holds files of others under our names.
    """
    chapters = check_study(name, folder, env, transport, scene=scene, motion=motion, columns=columns, methods=methods)
    chosen = STUDIES[name]
    names = _names(chosen, chapters)
    sheet = Sheet(claim(folder, names), chosen.title, chosen.intro, names)
    if checked_executor(executor) is not None:
        tasks = [_Chapter(name, Path(folder).absolute(), names, chapter, case) for chapter, case in chapters]
        tell, found = reporter(progress, name), {}
        with closing(completed(_alone, tasks, executor)) as finished:
            for number, own in finished:
                found[number] = own
                tell(len(found), len(tasks))
        for number in range(len(tasks)):
            sheet.append(found[number])
        return sheet.save()
    step_of = steps(progress, name, len(chapters))
    for chapter, case in chapters:
        sheet.chapter(chapter, case.name)
        chosen.run(case, sheet, step_of(case.name))
    return sheet.save()


@dataclass(frozen=True, eq=False)
class _Chapter:
    """A chapter as a task: which study, where its files go, and what it looks at."""

    study: str
    folder: Path
    names: Sequence[str]
    chapter: str
    case: Case


def _alone(task: _Chapter) -> Sheet:
    """A chapter on a sheet of its own."""
    chosen = STUDIES[task.study]
    sheet = Sheet(task.folder, chosen.title, chosen.intro, task.names)
    sheet.chapter(task.chapter, task.case.name)
    chosen.run(task.case, sheet, Reporter())
    return sheet
