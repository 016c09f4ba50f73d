"""Arguments that several commands share: how they are read, and what they are turned into."""

from __future__ import annotations

import argparse
import math
import os
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any, NoReturn

from ..camera import Camera
from ..light.environment import ROWS, Environment
from ..light.layouts import LAYOUTS
from ..light.motion import Motion
from ..light.pixels import REPAIRS
from ..light.skies import BUILTIN
from ..mistakes import near, refuse_kind
from ..relight.backdrop import checked_backdrop
from ..scene.builtin.catalogue import SCENES
from ..scene.scene import Scene

STOPS = 64
"""Of exposure, either way."""

# More of them only wait for each other.
_THREADS_A_PROCESSOR = 16


class Parser(argparse.ArgumentParser):
    """Errors in arguments look like all others, and name what was probably meant."""

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        # What begins with a minus and a digit is a value, such as -1,0,5:0,0,0, and no option.
        self._negative_number_matcher = re.compile(r"-[\d.]")

    def error(self, message: str) -> NoReturn:
        unknown = re.search(r"unrecognized arguments: --([\w-]+)", message)
        # Dashes, which all have, make none alike.
        names = [name[2:] for name in self.options() if name.startswith("--")]
        meant = near(unknown[1], names).replace("'", "'--", 1) if unknown else ""
        raise ValueError(f"{message}{meant} ({self.prog} --help says more)")

    def parse_known_args(  # pyright: ignore[reportIncompatibleMethodOverride]
        self, args: Any = None, namespace: Any = None
    ) -> tuple[Any, list[str]]:
        """As argparse has it, but that each command answers itself for what it does not know."""
        known, unknown = super().parse_known_args(args, namespace)
        if unknown:
            self.error(f"unrecognized arguments: {' '.join(unknown)}")
        return known, unknown

    def options(self) -> list[str]:
        """The names of its options."""
        return [name for action in self._actions for name in action.option_strings]

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        if action.choices is not None and value not in action.choices:
            what = f"expected one of {', '.join(map(str, action.choices))}, got {value!r}{near(value, action.choices)}"
            raise argparse.ArgumentError(action, what)


class Once(argparse.Action):
    """An option that says one thing, and is refused when it is given again."""

    def __call__(self, parser: Any, chosen: argparse.Namespace, value: Any, option: str | None = None) -> None:
        before = getattr(chosen, self.dest)
        if before is not None:
            raise argparse.ArgumentError(self, f"expected one, got {before!r} and {value!r}")
        setattr(chosen, self.dest, value)


def add_command(
    commands: Any, name: str, run: Callable[[argparse.Namespace], None], what: str
) -> argparse.ArgumentParser:
    """A command of this name, with the arguments that every command takes."""
    command: argparse.ArgumentParser = commands.add_parser(name, help=what, description=what.capitalize() + ".")
    command.set_defaults(run=run)
    command.add_argument("--threads", type=read_threads, metavar="N", help="default: all processors")
    return command


def add_scene(command: argparse.ArgumentParser) -> None:
    """The arguments of how a scene is read and seen."""
    command.add_argument("--size", type=read_size, metavar="WxH", help="pixels; default: the scene's own camera")
    command.add_argument(
        "--camera",
        type=read_view,
        metavar="PX,PY,PZ:TX,TY,TZ[:FOV]|NAME",
        help="position, target, degrees; or a camera of the file",
    )
    command.add_argument(
        "--scene", dest="within", metavar="NAME", help="of a glTF file with several: its name or number"
    )
    command.add_argument("--up", choices=("y", "z"), help="axis that points upwards in the file; default: y")
    command.add_argument(
        "--ground", action="store_true", help="a grey plane under the scene, which may catch its shadow (--catcher)"
    )


def add_light(command: argparse.ArgumentParser, several: bool = False, default: str | None = None) -> None:
    """The arguments of a light: an environment, or several, and how its file is read."""
    names = f"{', '.join(BUILTIN)}, or a .hdr or .exr file"
    names += "; may be given again for more chapters" if several else ""
    names += f"; default: {default}" if default else ""
    command.add_argument(
        "--env", action="append" if several else Once, metavar="ENV", help=names, required=several and default is None
    )
    command.add_argument("--layout", choices=LAYOUTS, help="of the file; default: recognised")
    command.add_argument("--layer", metavar="NAME", help="of an EXR file; default: R, G and B, or the only one")
    command.add_argument("--rows", choices=ROWS, default="centre", help="of a lat-long file; default: %(default)s")
    command.add_argument("--repair", choices=REPAIRS, help="NaN and infinite pixels to black, to 65504; negative ones")


def add_motion(command: argparse.ArgumentParser, rotate: float, hold: int) -> None:
    """The arguments of a rotation."""
    eased = f"eased in and out; default: {rotate:g}"
    command.add_argument("--rotate", type=float, metavar="DEGREES", help=eased)
    command.add_argument("--axis", type=read_axis, metavar="x|y|z|X,Y,Z", help="default: y, which is up")
    command.add_argument("--frames", type=int, default=100, help="default: %(default)s")
    command.add_argument("--hold", type=int, default=hold, help="frames of standing still; default: %(default)s")
    command.set_defaults(turn=rotate)


def motion_of(chosen: argparse.Namespace) -> Motion:
    """The rotation that was asked for."""
    rotate, axis = (chosen.turn if chosen.rotate is None else chosen.rotate), chosen.axis or "y"
    return Motion(rotate, chosen.frames, chosen.hold, axis)


def add_background(command: argparse.ArgumentParser) -> None:
    """The arguments of what pictures show behind the scene, and through its ground."""
    command.add_argument(
        "--background",
        type=read_background,
        default="env",
        metavar="env|none|#rrggbb",
        help="behind the scene, none: files with alpha; default: %(default)s",
    )
    command.add_argument("--catcher", action="store_true", help="of the ground show only the shadow on it")


def read_background(text: str) -> str:
    """The environment, nothing, or a colour."""
    try:
        return checked_backdrop(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from None


def read_size(text: str) -> tuple[int, int]:
    """A size in pixels, such as 512x512."""
    width, by, height = text.lower().partition("x")
    if not (by and width.isdecimal() and height.isdecimal()):
        raise argparse.ArgumentTypeError(f"expected a size like 512x512, got {text!r}")
    return int(width), int(height)


def read_threads(text: str) -> int:
    """A number of threads, of which a machine runs as many as it has processors at once."""
    most = _THREADS_A_PROCESSOR * (os.cpu_count() or 1)
    if not text.isdecimal() or int(text) > most:
        raise argparse.ArgumentTypeError(f"expected 0 to {most} threads, on {os.cpu_count()} processors, got {text!r}")
    return int(text)


def read_milliseconds(text: str) -> float:
    """A budget in time."""
    try:
        budget = float(text)
    except ValueError:
        budget = 0.0
    if not 0.0 < budget < math.inf:
        raise argparse.ArgumentTypeError(f"expected more than 0 milliseconds a frame, got {text!r}")
    return budget


def read_terms(text: str) -> int:
    """A budget in columns."""
    if not text.isdecimal() or int(text) == 0:
        raise argparse.ArgumentTypeError(f"expected at least 1 column a frame, got {text!r}")
    return int(text)


def read_exposure_or_lock(text: str) -> float | str:
    """Stops, or lock."""
    return text if text == "lock" else read_exposure(text)


def read_exposure(text: str) -> float:
    """Stops."""
    try:
        stops = float(text)
    except ValueError:
        stops = math.inf
    if not abs(stops) <= STOPS:
        raise argparse.ArgumentTypeError(f"expected an exposure from -{STOPS} to {STOPS} stops, got {text!r}")
    return stops


def read_bounces(text: str) -> int | str:
    """A number of bounces, or all."""
    return _number_or("all", text, "a number of bounces")


def read_nodes(text: str) -> int | str:
    """The most nodes, or auto."""
    return _number_or("auto", text, "a number of nodes")


def _number_or(word: str, text: str, what: str) -> int | str:
    if text != word and not text.isdecimal():
        raise argparse.ArgumentTypeError(f"expected {what} or {word!r}, got {text!r}")
    return word if text == word else int(text)


def _vector(text: str) -> tuple[float, float, float]:
    x, y, z = (float(part) for part in text.split(","))
    return x, y, z


def read_axis(text: str) -> str | tuple[float, float, float]:
    """An axis by its name or by its three numbers."""
    if text in ("x", "y", "z"):
        return text
    try:
        return _vector(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"expected x, y, z or three numbers like 0,1,0, got {text!r}") from None


def read_view(text: str) -> str | tuple[tuple[float, float, float], tuple[float, float, float], float]:
    """A camera, or the name of one in the file."""
    return read_camera(text) if "," in text else text


def read_camera(text: str) -> tuple[tuple[float, float, float], tuple[float, float, float], float]:
    """Position, target and field of view in degrees."""
    parts = text.split(":")
    try:
        position, target = (_vector(part) for part in parts[:2])
        (fov,) = (float(part) for part in parts[2:]) if len(parts) > 2 else (40.0,)
    except ValueError:
        raise argparse.ArgumentTypeError(f"expected a camera like 0,1,5:0,1,0:40, got {text!r}") from None
    return position, target, fov


def scene_of(chosen: argparse.Namespace) -> Scene:
    """A built-in scene or a file, seen as asked."""
    name = chosen.scene
    if name not in SCENES and not Path(name).suffix and not os.path.exists(name):
        raise ValueError(f"expected a scene of {', '.join(SCENES)}, or a file, got {name!r}{near(name, SCENES)}")
    refuse_kind(name, "a scene")
    camera = chosen.camera
    if isinstance(camera, tuple):
        position, target, fov = camera
        camera = Camera(position, target, vertical_fov=fov)
    if chosen.size is not None and isinstance(camera, Camera):
        camera = camera.resized(*chosen.size)
    up, within = getattr(chosen, "up", None) or "y", getattr(chosen, "within", None)
    if name not in SCENES:
        scene = Scene.load(name, camera, up=up, scene=within)
    elif isinstance(camera, str) or up != "y" or within is not None:
        raise ValueError(f"expected --up, --scene and the name of a camera with a file only, got {name}")
    else:
        scene = Scene.builtin(name, camera)
    scene = scene.with_ground() if getattr(chosen, "ground", False) else scene
    return scene if chosen.size is None else scene.with_camera(scene.camera.resized(*chosen.size))


def environment_of(name: str, chosen: argparse.Namespace) -> Environment:
    """A built-in light or a file."""
    if name in BUILTIN:
        return Environment.builtin(name)
    if not Path(name).suffix and not os.path.exists(name):
        raise ValueError(
            f"expected an environment of {', '.join(BUILTIN)}, or a file, got {name!r}{near(name, BUILTIN)}"
        )
    return Environment.load(name, chosen.layout, chosen.repair, layer=chosen.layer, rows=chosen.rows)


def say(what: object) -> None:
    """A line of what the user asked for, on standard output."""
    print(what, flush=True)
