"""`deltalux render`: one exact picture of a transport under a light, of vertices from any camera."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from ..camera import Camera
from ..io import TONES, save_image, to_display
from ..relight.backdrop import Backdrop
from ..relight.layers import save_layers
from ..transport.transport import Transport
from .arguments import (
    add_background,
    add_command,
    add_light,
    environment_of,
    read_camera,
    read_exposure,
    read_size,
    say,
)

_SUFFIXES = (".exr", ".png")


def add(commands: Any) -> None:
    """The command and its arguments."""
    command = add_command(commands, "render", _render, "one exact picture of a transport under a light")
    command.add_argument("transport", metavar="TRANSPORT")
    add_light(command, default="hall")
    command.add_argument(
        "--camera",
        type=read_camera,
        metavar="PX,PY,PZ:TX,TY,TZ[:FOV]",
        help="position, target, degrees, of a transport of vertices; default: that of its scene",
    )
    command.add_argument("--size", type=read_size, metavar="WxH", help="pixels; default: those of its scene")
    command.add_argument("--rotate", type=float, default=0.0, metavar="DEGREES", help="of the light about y")
    command.add_argument(
        "--exposure", type=read_exposure, metavar="STOPS", help="of a PNG; default: chosen by the picture"
    )
    command.add_argument("--tone", choices=TONES, default="srgb", help="curve of a PNG; default: %(default)s")
    command.add_argument(
        "--group",
        action="append",
        metavar="NAME=ENV",
        help="a light group, once for each: a multi-part EXR with a layer for each, albedo, normals, places and depth, "
        "or a .glb of vertices, for mixing",
    )
    add_background(command)
    command.add_argument("--half", action="store_true", help="half floats in an EXR")
    command.add_argument("-o", "--output", required=True, metavar="FILE", help="a .png or an .exr")


def _render(chosen: argparse.Namespace) -> None:
    path = Path(chosen.output)
    if chosen.group:
        return _render_groups(chosen, path)
    if path.suffix.lower() not in _SUFFIXES:
        raise ValueError(f"expected a .png or an .exr file to write, got {path.name!r}")
    exr = path.suffix.lower() == ".exr"
    if exr and chosen.exposure is not None:
        raise ValueError("expected --exposure with a PNG only: an EXR holds linear radiance")
    if chosen.half and not exr:
        raise ValueError("expected --half with an EXR only")
    transport = Transport.open(chosen.transport)
    env = environment_of(chosen.env or "hall", chosen).rotated(chosen.rotate)
    B = transport.multiply(transport.coefficients(env))
    view = None if chosen.camera is None and chosen.size is None else _camera(transport, chosen)
    backdrop = Backdrop(transport, chosen.background, view, catcher=chosen.catcher)
    about = {"software": "deltalux", "deltalux:environment": env.name}
    exposure = 0.0 if exr else chosen.exposure
    exposure = backdrop.exposure(B, env) if exposure is None else exposure
    picture = backdrop.picture(B, env, exposure)
    save_image(path, picture if exr else to_display(picture, exposure, chosen.tone), about, half=chosen.half)
    say(f"{path}: {picture.shape[1]} x {picture.shape[0]} pixels" + ("" if exr else f", {exposure:+.2f} stops"))


def _render_groups(chosen: argparse.Namespace, path: Path) -> None:
    named = [word.partition("=") for word in chosen.group]
    if not all(name and env for name, _, env in named):
        raise ValueError(f"expected --group as NAME=ENV, got {' '.join(chosen.group)}")
    transport = Transport.open(chosen.transport)
    view = None if chosen.camera is None and chosen.size is None else _camera(transport, chosen)
    groups = {name: environment_of(env, chosen).rotated(chosen.rotate) for name, _, env in named}
    save_layers(path, transport, groups, camera=view, half=chosen.half)
    say(f"{path}: {len(groups)} groups of light")


def _camera(transport: Transport, chosen: argparse.Namespace) -> Camera:
    """The camera that was asked for; what was not said of it is as in the scene."""
    camera = transport.camera
    if chosen.camera is not None:
        position, target, fov = chosen.camera
        camera = Camera(position, target, vertical_fov=fov, width=camera.width, height=camera.height)
    return camera if chosen.size is None else camera.resized(*chosen.size)
