"""The command line: arguments become settings, settings become calls; nothing is computed here.

Every error that a user can cause is one sentence on standard error and exit status 2; Ctrl-C is 130.
"""

from __future__ import annotations

import argparse
import os
import sys
import warnings
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NoReturn

from . import _core
from .camera import Camera
from .columns import Haar, parse
from .demo import COLUMNS, FOLDER, SIZE, demo
from .environment import Environment
from .frames import FORMATS, Film, check_frames, relight_frames
from .methods import WEIGHTS, Full, HarmonicOrder, Incremental, Linear, Method, Nonlinear, PerBand
from .motion import Motion
from .output import check_folder
from .plan import QUALITIES
from .precompute import plan, precompute
from .report import check_report, report
from .scene import Scene
from .scenes import SCENES
from .sequences import SEQUENCES, make
from .skies import BUILTIN
from .studies import STUDIES, check_study, study
from .transport import Transport

__all__ = ["main"]

_RESUME = "stopped; the same command resumes where it left off"
_STUDY_LIGHT = "hall"
_METHODS: dict[str, Callable[..., Method]] = {
    "nwa": Nonlinear,
    "bi": Incremental,
    "pbi": PerBand,
    "linear": Linear,
    "harmonic-order": HarmonicOrder,
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs one command and returns its exit status: 0, 2 after an error, 130 after Ctrl-C."""
    chosen = None
    try:
        chosen = _parser().parse_args(arguments)
        with warnings.catch_warnings():
            warnings.simplefilter("always", UserWarning)
            warnings.showwarning = _warn
            if chosen.threads is not None:
                _core.set_threads(chosen.threads)
            chosen.run(chosen)
    except KeyboardInterrupt:
        return _stop(130, getattr(chosen, "when_stopped", "stopped"))
    except BrokenPipeError:
        # Whoever reads our output has enough of it; Python must not complain again at exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except (ValueError, OSError, MemoryError) as error:
        return _stop(2, f"error: {_sentence(error)}")
    return 0


def _stop(status: int, message: str) -> int:
    # A bar may be standing on the line.
    start = "\n" if status == 130 and sys.stderr.isatty() else ""
    print(f"{start}deltalux: {message}", file=sys.stderr)
    return status


def _sentence(error: BaseException) -> str:
    """The message of an error on one line; of the system's errors, what happened and to which file."""
    if isinstance(error, MemoryError):
        return "there is not enough memory; take fewer pixels or columns"
    if isinstance(error, OSError) and error.strerror:
        where = f"{error.filename}: " if error.filename is not None else ""
        what = error.strerror.partition(" (os error ")[0]
        return f"{where}{what[0].lower()}{what[1:]}"
    return " ".join(str(error).split())


def _warn(message: Warning | str, *_: Any, **__: Any) -> None:
    print(f"deltalux: warning: {' '.join(str(message).split())}", file=sys.stderr)


class _Parser(argparse.ArgumentParser):
    """Errors in arguments look like all others."""

    def error(self, message: str) -> NoReturn:
        raise ValueError(f"{message} ({self.prog} --help says more)")


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(
        prog="deltalux", description="Precomputed light transport of still scenes, relit as the light moves."
    )
    parser.add_argument("--version", action="version", version=f"deltalux {_core.__version__}")
    commands = parser.add_subparsers(metavar="COMMAND", required=True, parser_class=_Parser)

    command = _command(commands, "demo", _demo, "a plant under a turning sky, from triangles to a page, in two minutes")
    command.set_defaults(when_stopped="stopped; the same command resumes the precomputation where it left off")
    command.add_argument("-o", "--output", default=FOLDER, metavar="FOLDER", help="default: %(default)s")
    command.add_argument("--size", type=_size, default=SIZE, metavar="WxH", help=f"default: {SIZE[0]}x{SIZE[1]}")
    command.add_argument("--columns", default=COLUMNS, metavar="haar:N", help="default: %(default)s")
    command.add_argument("--frames", type=int, default=100, help="default: %(default)s")
    command.add_argument("--hold", type=int, default=25, help="frames of standing still; default: %(default)s")

    command = _command(commands, "precompute", _precompute, "trace the light transport of a scene")
    command.set_defaults(when_stopped=_RESUME)
    command.add_argument(
        "scene", metavar="SCENE", help=f"{', '.join(SCENES)}, or a .glb, .gltf, .obj, .ply or .stl file"
    )
    command.add_argument("-o", "--output", metavar="FILE", help="directory to make, by custom NAME.transport")
    command.add_argument("--size", type=_size, metavar="WxH", help="pixels; default: the scene's own camera")
    command.add_argument(
        "--columns", default="haar:64", metavar="haar:N|sh:N", help="basis of the light; default: %(default)s"
    )
    command.add_argument("--camera", type=_camera, metavar="PX,PY,PZ:TX,TY,TZ[:FOV]", help="position, target, degrees")
    command.add_argument("--quality", choices=QUALITIES, default="publication", help="default: %(default)s")
    command.add_argument("--tolerance", type=float, help="relative error of the image from truncation, such as 0.01")
    command.add_argument("--plan", action="store_true", help="only say what would be computed and what it would cost")

    command = _command(commands, "info", _info, "what a transport holds")
    command.add_argument("transport", metavar="TRANSPORT")

    command = _command(commands, "relight", _relight, "frames of a transport under a moving light")
    command.add_argument("transport", metavar="TRANSPORT")
    _add_light(command)
    command.add_argument("--sequence", choices=SEQUENCES, default="rotation", help="default: %(default)s")
    command.add_argument("--other", metavar="ENV", help="what --sequence interpolation ends with; default: hall")
    _add_motion(command, rotate=180.0, hold=0)
    command.add_argument("--method", choices=("full", *_METHODS), default="pbi", help="default: %(default)s")
    budget = command.add_mutually_exclusive_group()
    budget.add_argument("--terms", type=int, help="columns a frame; default: 30")
    budget.add_argument("--milliseconds", type=float, metavar="MS", help="time a frame, instead of --terms")
    budget.add_argument("--error", type=float, metavar="RADIANCE", help="bound on the error, instead of --terms")
    command.add_argument("--weight", choices=WEIGHTS, help="what a change is worth; default: the method's own, area")
    command.add_argument("--exposure", type=float, metavar="STOPS", help="of the PNGs; default: chosen by the light")
    command.add_argument("--format", choices=FORMATS, default="png", help="default: %(default)s")
    command.add_argument("-o", "--output", required=True, metavar="FOLDER")

    command = _command(commands, "report", _report, "all methods against the exact product: error, run time, bytes")
    command.add_argument("transport", metavar="TRANSPORT")
    _add_light(command, several=True)
    _add_motion(command, rotate=45.0, hold=25)
    command.add_argument("-o", "--output", required=True, metavar="FOLDER")

    command = _command(commands, "study", _study, "what the papers claim of moving light and of the methods, measured")
    command.set_defaults(when_stopped="stopped; transports so far resume when the same command runs again")
    command.add_argument("study", choices=STUDIES, metavar="NAME", help=", ".join(STUDIES))
    _add_light(command, several=True, default=_STUDY_LIGHT)
    scenes = f"{', '.join(SCENES)}, a file, or a transport; may be given again; default: none, the light alone"
    command.add_argument("--scene", action="append", default=[], metavar="SCENE", help=scenes)
    command.add_argument("--size", type=_size, default=(128, 128), metavar="WxH", help="of scenes; default: 128x128")
    command.add_argument("--columns", default="haar:64", metavar="haar:N", help="default: %(default)s")
    _add_motion(command, rotate=45.0, hold=25)
    command.add_argument("-o", "--output", metavar="FOLDER", help="default: deltalux-study-NAME")
    return parser


def _command(commands: Any, name: str, run: Callable[[argparse.Namespace], None], what: str) -> argparse.ArgumentParser:
    command: argparse.ArgumentParser = commands.add_parser(name, help=what, description=what.capitalize() + ".")
    command.set_defaults(run=run)
    command.add_argument("--threads", type=_threads, metavar="N", help="default: all processors")
    return command


def _add_light(command: argparse.ArgumentParser, several: bool = False, default: str | None = None) -> None:
    names = f"{', '.join(BUILTIN)}, or a .hdr or .exr file"
    names += "; may be given again for more chapters" if several else ""
    names += f"; default: {default}" if default else ""
    action = "append" if several else "store"
    command.add_argument("--env", action=action, metavar="ENV", help=names, required=several and default is None)
    layouts = ("latlong", "vertical-cross", "horizontal-cross", "angular", "cube")
    command.add_argument("--layout", choices=layouts, help="of the file; default: recognised")
    command.add_argument("--repair", choices=("zero",), help="make NaN and infinite pixels black")


def _add_motion(command: argparse.ArgumentParser, rotate: float, hold: int) -> None:
    eased = f"eased in and out; default: {rotate:g}"
    command.add_argument("--rotate", type=float, metavar="DEGREES", help=eased)
    command.add_argument("--axis", type=_axis, metavar="x|y|z|X,Y,Z", help="default: y, which is up")
    command.add_argument("--frames", type=int, default=100, help="default: %(default)s")
    command.add_argument("--hold", type=int, default=hold, help="frames of standing still; default: %(default)s")
    command.set_defaults(turn=rotate)


def _motion(chosen: argparse.Namespace) -> Motion:
    rotate, axis = (chosen.turn if chosen.rotate is None else chosen.rotate), chosen.axis or "y"
    return Motion(rotate, chosen.frames, chosen.hold, axis)


def _size(text: str) -> tuple[int, int]:
    width, by, height = text.partition("x")
    if not (by and width.isdecimal() and height.isdecimal()):
        raise argparse.ArgumentTypeError(f"expected a size like 512x512, got {text!r}")
    return int(width), int(height)


def _threads(text: str) -> int:
    if not text.isdecimal():
        raise argparse.ArgumentTypeError(f"expected a number of threads, got {text!r}")
    return int(text)


def _vector(text: str) -> tuple[float, float, float]:
    x, y, z = (float(part) for part in text.split(","))
    return x, y, z


def _axis(text: str) -> str | tuple[float, float, float]:
    if text in ("x", "y", "z"):
        return text
    try:
        return _vector(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"expected x, y, z or three numbers like 0,1,0, got {text!r}") from None


def _camera(text: str) -> tuple[tuple[float, float, float], tuple[float, float, float], float]:
    parts = text.split(":")
    try:
        position, target = (_vector(part) for part in parts[:2])
        (fov,) = (float(part) for part in parts[2:]) if len(parts) > 2 else (40.0,)
    except ValueError:
        raise argparse.ArgumentTypeError(f"expected a camera like 0,1,5:0,1,0:40, got {text!r}") from None
    return position, target, fov


def _scene(chosen: argparse.Namespace) -> Scene:
    """A built-in scene or a file, seen as asked."""
    name = chosen.scene
    if name not in SCENES and not Path(name).suffix and not os.path.exists(name):
        raise ValueError(f"expected a scene of {', '.join(SCENES)}, or a file, got {name!r}")
    camera = None
    if chosen.camera is not None:
        position, target, fov = chosen.camera
        camera = Camera(position, target, vertical_fov=fov)
    if chosen.size is not None and camera is not None:
        camera = camera.resized(*chosen.size)
    scene = Scene.builtin(name, camera) if name in SCENES else Scene.load(name, camera)
    return scene if chosen.size is None else scene.with_camera(scene.camera.resized(*chosen.size))


def _environment(name: str, chosen: argparse.Namespace) -> Environment:
    if name in BUILTIN:
        return Environment.builtin(name)
    if not Path(name).suffix and not os.path.exists(name):
        raise ValueError(f"expected an environment of {', '.join(BUILTIN)}, or a file, got {name!r}")
    return Environment.load(name, layout=chosen.layout, repair=chosen.repair)


def _demo(chosen: argparse.Namespace) -> None:
    page = demo(
        chosen.output, size=chosen.size, columns=chosen.columns, frames=chosen.frames, hold=chosen.hold, say=_say
    )
    _say(f"{page.parent.absolute()} holds the pictures, plots and tables; open {page.absolute()} in a browser")


def _precompute(chosen: argparse.Namespace) -> None:
    if chosen.output is None and not chosen.plan:
        raise ValueError("expected -o FILE, the transport to write, or --plan")
    scene = _scene(chosen)
    settings = {"columns": chosen.columns, "quality": chosen.quality, "tolerance": chosen.tolerance}
    _say(plan(scene, **settings))
    if not chosen.plan:
        _say(precompute(scene, chosen.output, **settings))
        _say(f"{chosen.output} is ready")


def _info(chosen: argparse.Namespace) -> None:
    transport = Transport.open(chosen.transport)
    _say(transport)
    _say(transport.plan)
    columns, size = transport.columns, transport.column_bytes
    label = columns.band_label.lower()
    _say(f"  {'band':>4} {'columns':>8} {label:>22} {'MB':>9}")
    for band, name in enumerate(columns.band_names):
        own = columns.bands == band
        _say(f"  {band:>4} {own.sum():>8,} {name:>22} {size[own].sum() / 1e6:>9,.2f}")
    for name, length in transport._core.files:
        _say(f"  {name}: {length:,} bytes")


def _relight(chosen: argparse.Namespace) -> None:
    method, film = _method(chosen), _film(chosen)
    transport = Transport.open(chosen.transport)
    check_frames(chosen.output, film, chosen.format)
    chosen.when_stopped = f"stopped; the frames so far are in {chosen.output}"
    _say(relight_frames(transport, film, chosen.output, method, exposure=chosen.exposure, kind=chosen.format))


def _film(chosen: argparse.Namespace) -> Film:
    """The frames of a sequence; what belongs to another sequence is refused."""
    name = chosen.sequence
    for option, home in (("rotate", "rotation"), ("axis", "rotation"), ("other", "interpolation")):
        if getattr(chosen, option) is not None and name != home:
            raise ValueError(f"expected --{option} with --sequence {home} only, got --sequence {name}")
    if name == "sunrise":
        if chosen.env is not None or chosen.hold:
            raise ValueError("expected no --env and no --hold with --sequence sunrise, which makes a sky of its own")
        sky = Environment.builtin("sky")
        _, noon, _ = make(name, sky, 3)
        return Film(make(name, sky, chosen.frames), chosen.frames, noon)
    if chosen.env is None:
        raise ValueError(f"expected --env ENV, the light, with --sequence {name}")
    env = _environment(chosen.env, chosen)
    if name == "rotation":
        motion = _motion(chosen)
        return Film((motion.light(env, k) for k in range(len(motion.angles))), len(motion.angles), env, motion.angles)
    options = {"other": _environment(chosen.other, chosen)} if chosen.other is not None else {}
    return Film(make(name, env, chosen.frames, hold=chosen.hold, **options), chosen.frames + chosen.hold, env)


def _method(chosen: argparse.Namespace) -> Method:
    budgets = {name: getattr(chosen, name) for name in ("terms", "milliseconds", "error")}
    given = {name: value for name, value in budgets.items() if value is not None}
    if chosen.method == "full":
        if given:
            raise ValueError(f"expected no --{next(iter(given))} with --method full, which sends all that differs")
        return Full()
    weight = {} if chosen.weight is None else {"weight": chosen.weight}
    # Harmonic order has a number of terms of its own, which another budget takes the place of.
    return _METHODS[chosen.method](**{"terms": None, **(given or {"terms": 30})}, **weight)


def _report(chosen: argparse.Namespace) -> None:
    motion = _motion(chosen)
    envs, transport = [_environment(name, chosen) for name in chosen.env], Transport.open(chosen.transport)
    check_report(envs, chosen.output, motion)
    page = report(
        transport, envs, chosen.output, rotate=motion.rotate, frames=motion.frames, hold=motion.hold, axis=motion.axis
    )
    _say(f"{page.parent.absolute()} holds the report; open {page.absolute()} in a browser")


def _study(chosen: argparse.Namespace) -> None:
    """One study; scenes that are not transports yet are traced into its folder first."""
    name, motion = chosen.study, _motion(chosen)
    folder = Path(chosen.output or f"deltalux-study-{name}")
    envs = [_environment(env, chosen) for env in chosen.env or [_STUDY_LIGHT]]
    columns = parse(chosen.columns)
    if not isinstance(columns, Haar):
        raise ValueError(f"studies follow wavelets: expected --columns haar:N, got {columns}")
    if STUDIES[name].needs_scene and not chosen.scene:
        raise ValueError(f"the study {name} looks at pictures: expected --scene SCENE")
    if not chosen.scene:
        check_study(name, folder, envs, motion=motion, columns=columns)
    check_folder(folder)
    transports = [_study_transport(scene, chosen, folder) for scene in chosen.scene]
    page = study(name, folder, envs, transports, motion=motion, columns=columns)
    _say(f"{page.parent.absolute()} holds the study; open {page.absolute()} in a browser")


def _study_transport(name: str, chosen: argparse.Namespace, folder: Path) -> Transport:
    """A transport as it is; a scene traced with one ray a texel, truncated to one percent."""
    if name not in SCENES and os.path.isdir(name):
        return Transport.open(name)
    chosen.scene, chosen.camera = name, None
    path = folder / f"{Path(name).stem}.transport"
    folder.mkdir(parents=True, exist_ok=True)
    return precompute(_scene(chosen), path, columns=chosen.columns, quality="preview", tolerance=0.01)


def _say(what: object) -> None:
    print(what, flush=True)
