"""`deltalux view`: a transport in the browser, under a light that is moved by hand."""

from __future__ import annotations

import argparse
import os
import threading
import webbrowser
from pathlib import Path
from typing import Any

from ..transport.transport import Transport
from ..update.methods import PerBand
from ..viewer.handle import View, lights_of
from ..viewer.relit import Relit
from ..viewer.requests import opened, read_session
from .arguments import add_command, add_light, environment_of, say
from .own import OWN, read_own

_LIGHTS = (".hdr", ".exr", ".pic")


def add(commands: Any) -> None:
    """The command and its arguments."""
    command = add_command(commands, "view", _view, "a transport in the browser, under a light that is moved by hand")
    command.add_argument("transport", metavar="TRANSPORT")
    add_light(command, several=True, default="hall")
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
    subject = Relit(Transport.open(chosen.transport), lights, PerBand(terms=30), own, chosen.transport)
    with View(subject, Path(chosen.transport).name, host=chosen.host, port=chosen.port) as view:
        if session is not None:
            opened(view._stage, session)
        say(view.url)
        say("The view is open; Ctrl-C ends it.")
        if not chosen.no_browser:
            webbrowser.open(view.url)
        threading.Event().wait()


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
