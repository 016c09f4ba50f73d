"""`deltalux view`: a transport in the browser, under a light that is moved by hand."""

from __future__ import annotations

import argparse
import os
import threading
import webbrowser
from pathlib import Path
from typing import Any

from ..precomputation.room import check_folder_of
from ..scene.builtin.catalogue import SCENES
from ..scene.scene import Scene
from ..transport.transport import Transport
from ..viewer.export import export
from ..viewer.handle import View, lights_of, opened, subject_of
from ..viewer.preview import small
from ..viewer.requests import read_session, resume
from ..viewer.server import check_installed
from .arguments import add_command, add_light, add_scene, environment_of, say, scene_of
from .own import OWN, read_own

_OF_SCENES = {
    "size": "size", "camera": "camera", "scene": "within", "up": "up", "ground": "ground", "output": "output",
}  # fmt: skip
_LIGHTS = (".hdr", ".exr", ".pic")


def add(commands: Any) -> None:
    """The command and its arguments."""
    command = add_command(commands, "view", _view, "a transport in the browser, under a light that is moved by hand")
    command.add_argument(
        "transport", metavar="TRANSPORT|SCENE", help="of a scene a small picture is there in seconds, and grows finer"
    )
    add_scene(command)
    command.add_argument("-o", "--output", metavar="FILE", help="where the finest transport of a scene goes")
    add_light(command, several=True, default="hall, and all that are built in to choose from")
    command.add_argument("--export", metavar="FOLDER", help="write a page that relights by itself, and open nothing")
    command.add_argument("--session", metavar="FILE", help="what an earlier view has saved")
    command.add_argument(
        "--method", type=read_own, action="append", default=[], metavar=OWN, help="a method of your own to choose"
    )
    command.add_argument("--port", type=int, help="default: 8765, or another where that is taken")
    command.add_argument(
        "--host",
        default="127.0.0.1",
        help="an address that others can reach; whoever knows the token may then connect; default: this machine alone",
    )
    command.add_argument("--no-browser", action="store_true", help="do not open one")


def _view(chosen: argparse.Namespace) -> None:
    if chosen.port is not None and not 0 <= chosen.port < 65536:
        raise ValueError(f"expected a port from 0 to 65535, got {chosen.port}")
    session = None if chosen.session is None else read_session(Path(chosen.session))
    paths = _paths(chosen.env or [])
    given = {path: environment_of(path, chosen) for path in paths}
    lights = lights_of(list(given.values()), {env.name: path for path, env in given.items()})
    own = {one.__name__.lower(): one for one in chosen.method}
    scene = _scene(chosen)
    if chosen.export is not None:
        say(export(_exported(scene, chosen), Path(chosen.export), lights.sources))
        return
    try:
        check_installed()
    except ModuleNotFoundError as error:
        raise ValueError(str(error)) from None
    transport = opened(chosen.transport) if scene is None else small(scene, progress=True)
    if (given or own) and not isinstance(transport, Transport):
        raise ValueError("expected --env and --method with a transport whose light moves: here materials and lamps do")
    subject = subject_of(transport, lights, None, own, chosen.transport)
    with View(subject, Path(chosen.transport).name, host=chosen.host, port=chosen.port) as view:
        if scene is not None:
            view.refine(scene, None if chosen.output is None else Path(chosen.output))
        if session is not None:
            resume(view._stage, session)
        say(view.url)
        say("The view is open; Ctrl-C ends it.")
        if not chosen.no_browser:
            webbrowser.open(view.url)
        threading.Event().wait()


def _scene(chosen: argparse.Namespace) -> Scene | None:
    """The scene that was given; None of a transport."""
    path = Path(chosen.transport)
    if path.is_dir() or (path.suffix == "" and not path.exists() and chosen.transport not in SCENES):
        for option, dest in _OF_SCENES.items():
            if getattr(chosen, dest):
                raise ValueError(f"expected --{option} with a scene only")
        return None
    if chosen.output is not None:
        check_folder_of(Path(chosen.output))
    chosen.scene = chosen.transport
    return scene_of(chosen)


def _exported(scene: Scene | None, chosen: argparse.Namespace) -> Scene | Transport:
    """What a page relights by itself."""
    for option in ("session", "port", "output"):
        if getattr(chosen, option) is not None:
            raise ValueError(f"expected no --{option} with --export, which opens nothing")
    transport = scene or opened(chosen.transport)
    if not isinstance(transport, (Scene, Transport)):
        raise ValueError("expected a scene or a transport whose light moves to export")
    return transport


def _paths(given: list[str]) -> list[str]:
    """Environments, those of folders included."""
    found: list[str] = []
    for name in given:
        if os.path.isdir(name):
            inside = sorted(own for own in Path(name).iterdir() if own.suffix.lower() in _LIGHTS)
            if not inside:
                raise ValueError(f"{name}: expected a folder with .hdr or .exr files")
            found += [str(own) for own in inside]
        else:
            found.append(name)
    return found
