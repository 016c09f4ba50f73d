"""`deltalux demo`: a plant under a turning sky, from triangles to a page, in two minutes on two cores."""

from __future__ import annotations

import argparse
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

from ..light.environment import Environment
from ..light.motion import Motion
from ..output import nearest
from ..precomputation.preparation import Request
from ..precomputation.room import check_room
from ..precomputation.run import Precomputation
from ..progress import Progress, steps
from ..report import check_report, report
from ..scene.scene import Scene
from ..viewer.export import export
from .arguments import add_command, read_size, say

__all__ = ["add", "demo"]

FOLDER = "deltalux-demo"
# As large as two cores finish in two minutes.
SIZE = (128, 128)
COLUMNS = "haar:32"
QUALITY = "publication"
_TRANSPORT = "plant.transport"
_LIVE = "live"
"""The page that relights by itself."""


def add(commands: Any) -> None:
    """The command and its arguments."""
    command = add_command(
        commands, "demo", _run, "a plant under a turning sky, from triangles to a page, in two minutes"
    )
    command.set_defaults(when_stopped="stopped; the same command resumes the precomputation, and begins the rest anew")
    command.add_argument("-o", "--output", default=FOLDER, metavar="FOLDER", help="default: %(default)s")
    command.add_argument("--size", type=read_size, default=SIZE, metavar="WxH", help=f"default: {SIZE[0]}x{SIZE[1]}")
    command.add_argument("--columns", default=COLUMNS, metavar="haar:N", help="default: %(default)s")
    command.add_argument("--frames", type=int, default=100, help="default: %(default)s")
    command.add_argument("--hold", type=int, default=25, help="frames of standing still; default: %(default)s")


def _run(chosen: argparse.Namespace) -> None:
    page = demo(
        chosen.output, size=chosen.size, columns=chosen.columns, frames=chosen.frames, hold=chosen.hold, say=say
    )
    say(f"{page.parent.absolute()} holds the pictures, plots and tables; open {page.absolute()} in a browser")


def demo(
    folder: str | os.PathLike[str] = FOLDER,
    *,
    size: tuple[int, int] = SIZE,
    columns: str = COLUMNS,
    frames: int = 100,
    hold: int = 25,
    progress: bool | Progress = True,
    say: Callable[[object], None] = print,
) -> Path:
    """Builds the plant, precomputes its transport, replays a turning sky and a turning hall, and writes the report.

    The sky has one sun, which is most of its light; the hall has many windows and lamps, as the papers' cathedral.

    Returns
    -------
    Path
        The page, index.html; the transport lies beside it, and a page that relights by itself, live/index.html.

    Raises
    ------
    ValueError, OSError
        As `precompute` and `report`.
    """
    path = Path(folder)
    motion = Motion(frames=frames, hold=hold)
    envs = [Environment.builtin("sky"), Environment.builtin("hall")]
    scene = Scene.builtin("plant")
    scene = scene.with_camera(scene.camera.resized(*size))
    check_report(envs, path, motion)
    step_of = steps(progress, "demo", 3)
    tell = step_of("transport")
    request = Precomputation(scene, Request(columns, QUALITY), progress=tell)
    check_room(request.plan, nearest(path) / _TRANSPORT)
    tell.clear()
    say(request.plan)
    path.mkdir(parents=True, exist_ok=True)
    transport = request.run(path / _TRANSPORT)
    live = export(scene, path / _LIVE, {env.name: env for env in envs}, step_of("live page"))
    page = report(transport, envs, path, frames=frames, hold=hold, progress=step_of("report"))
    say(transport)
    say(live)
    return page
