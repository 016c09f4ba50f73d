"""`deltalux study`: what the papers claim of moving light and of the methods, measured."""

from __future__ import annotations

import argparse
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

from ..columns import Haar, parse
from ..output import check_folder
from ..precomputation.run import precompute
from ..progress import Reporter, steps
from ..scene.builtin.catalogue import SCENES
from ..scene.scene import Scene
from ..studies import STUDIES, check_study, study
from ..studies.shape import Study
from ..transport.transport import Transport
from .arguments import add_command, add_light, add_motion, environment_of, motion_of, read_size, say, scene_of
from .own import add_own

_STUDY_LIGHT = "hall"


def add(commands: Any) -> None:
    """The command and its arguments."""
    command = add_command(
        commands, "study", _study, "what the papers claim of moving light and of the methods, measured"
    )
    command.set_defaults(when_stopped="stopped; the same command keeps the transports, and begins the rest anew")
    command.add_argument("study", choices=STUDIES, metavar="NAME", help=", ".join(STUDIES))
    add_light(command, several=True, default=_STUDY_LIGHT)
    traces = ", ".join(f"for {name} {study.traces}" for name, study in STUDIES.items() if study.traces)
    scenes = (
        f"{', '.join(SCENES)}, a file, or a transport; may be given again; default: none, the light alone; {traces}"
    )
    command.add_argument("--scene", action="append", default=[], metavar="SCENE", help=scenes)
    command.add_argument(
        "--size", type=read_size, default=(128, 128), metavar="WxH", help="of scenes; default: 128x128"
    )
    command.add_argument("--columns", metavar="haar:N", help=f"default: {_columns()}")
    add_motion(command, rotate=45.0, hold=25)
    add_own(command, f" (in {', '.join(name for name, study in STUDIES.items() if study.takes_methods)})")
    command.add_argument("-o", "--output", metavar="FOLDER", help="default: deltalux-study-NAME")


def _columns() -> str:
    """What most studies measure light in, and what the others do."""
    usual = Study.columns
    others = (f"for {name} {study.columns}" for name, study in STUDIES.items() if study.columns != usual)
    return ", ".join([str(usual), *others])


def _study(chosen: argparse.Namespace) -> None:
    """One study; scenes that are not transports yet are traced into its folder first, if it does not trace them."""
    name, motion = chosen.study, motion_of(chosen)
    folder = Path(chosen.output or f"deltalux-study-{name}")
    envs = [environment_of(env, chosen) for env in chosen.env or [_STUDY_LIGHT]]
    chosen.columns = chosen.columns or str(STUDIES[name].columns)
    columns, own = parse(chosen.columns), chosen.method
    if not isinstance(columns, Haar):
        raise ValueError(f"studies follow wavelets: expected --columns haar:N, got {columns}")
    if STUDIES[name].needs_scene and not chosen.scene:
        raise ValueError(f"the study {name} looks at pictures: expected --scene SCENE")
    if not chosen.scene:
        check_study(name, folder, envs, motion=motion, columns=columns, methods=own)
    check_folder(folder)
    traced = STUDIES[name].traces
    scenes = [_study_scene(scene, chosen) for scene in chosen.scene or [traced]] if traced else []
    step_of = steps(True, name, 1 + (0 if traced else len(chosen.scene)))
    transports = [] if traced else [_study_transport(scene, chosen, folder, step_of) for scene in chosen.scene]
    tell = step_of("study")
    page = study(
        name, folder, envs, transports, scene=scenes, motion=motion, columns=columns, methods=own, progress=tell
    )
    say(f"{page.parent.absolute()} holds the study; open {page.absolute()} in a browser")


def _study_scene(name: str, chosen: argparse.Namespace) -> Scene:
    """A scene that the study traces itself, seen in the size that was asked for."""
    if name not in SCENES and os.path.isdir(name):
        raise ValueError(f"the study {chosen.study} traces scenes itself: expected a scene, got the transport {name}")
    chosen.scene, chosen.camera = name, None
    return scene_of(chosen)


def _study_transport(
    name: str, chosen: argparse.Namespace, folder: Path, step_of: Callable[[str], Reporter]
) -> Transport:
    """A transport as it is; a scene traced with one ray a texel, truncated to one percent."""
    tell = step_of(Path(name).stem)
    if name not in SCENES and os.path.isdir(name):
        return Transport.open(name)
    chosen.scene, chosen.camera = name, None
    path = folder / f"{Path(name).stem}.transport"
    folder.mkdir(parents=True, exist_ok=True)
    return precompute(scene_of(chosen), path, columns=chosen.columns, quality="preview", tolerance=0.01, progress=tell)
