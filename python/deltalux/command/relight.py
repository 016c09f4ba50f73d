"""`deltalux relight`: frames of a transport under a moving light."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from contextlib import nullcontext
from pathlib import Path
from typing import Any

from ..io import TONES
from ..light.environment import Environment
from ..light.sequences import SEQUENCES, make
from ..mistakes import near
from ..relight.film import FORMATS, Film, check_frames, relight_frames
from ..relight.video import check_video, video
from ..transport.transport import Transport
from ..update.methods import WEIGHTS, Full, HarmonicOrder, Incremental, Linear, Method, Nonlinear, PerBand
from .arguments import (
    add_background,
    add_command,
    add_light,
    add_motion,
    environment_of,
    motion_of,
    read_exposure,
    read_exposure_or_lock,
    read_milliseconds,
    read_terms,
    say,
)
from .own import OWN, read_own

# What --exposure lock keeps, in the folder that holds those of the runs.
_LOCK = ".deltalux-exposure"

_METHODS: dict[str, Callable[..., Method]] = {
    "nwa": Nonlinear,
    "bi": Incremental,
    "pbi": PerBand,
    "linear": Linear,
    "harmonic-order": HarmonicOrder,
}


def add(commands: Any) -> None:
    """The command and its arguments."""
    command = add_command(commands, "relight", _relight, "frames of a transport under a moving light")
    command.add_argument("transport", metavar="TRANSPORT")
    add_light(command)
    command.add_argument("--sequence", choices=SEQUENCES, default="rotation", help="default: %(default)s")
    command.add_argument("--other", metavar="ENV", help="what --sequence interpolation ends with; default: hall")
    add_motion(command, rotate=180.0, hold=0)
    names = ", ".join(("full", *_METHODS))
    command.add_argument(
        "--method", type=_read_method, default="pbi", metavar="METHOD", help=f"{names}, or {OWN}; default: %(default)s"
    )
    budget = command.add_mutually_exclusive_group()
    budget.add_argument("--terms", type=read_terms, help="columns a frame; default: 30")
    budget.add_argument("--milliseconds", type=read_milliseconds, metavar="MS", help="time a frame, instead of --terms")
    budget.add_argument("--error", type=float, metavar="RADIANCE", help="bound on the error, instead of --terms")
    command.add_argument("--weight", choices=WEIGHTS, help="what a change is worth; default: the method's own, area")
    exposure = "of the PNGs; lock: that of the last run beside this one; default: chosen by the light"
    command.add_argument("--exposure", type=read_exposure_or_lock, metavar="STOPS|lock", help=exposure)
    command.add_argument("--tone", choices=TONES, default="srgb", help="curve of the PNGs; default: %(default)s")
    command.add_argument("--video", metavar="FILE", help="a .mp4 or .webp of all frames as well")
    add_background(command)
    command.add_argument("--format", choices=FORMATS, default="png", help="default: %(default)s")
    command.add_argument("--half", action="store_true", help="half floats in the EXRs: half the bytes")
    command.add_argument("-o", "--output", required=True, metavar="FOLDER")


def _relight(chosen: argparse.Namespace) -> None:
    method, film = _method(chosen), _film(chosen)
    if chosen.output.rstrip("/").endswith(".transport"):
        raise ValueError(f"expected a folder for frames, got {chosen.output}, the name of a transport")
    transport = Transport.open(chosen.transport)
    check_frames(chosen.output, film, chosen.format)
    chosen.when_stopped = f"stopped; the frames so far are in {chosen.output}, and the same command begins anew"
    if chosen.half and chosen.format == "png":
        raise ValueError("expected --half with --format exr or both, got png, which has 8 bits")
    if chosen.video is not None:
        check_video(chosen.video)
    locked = Path(chosen.output).absolute().parent / _LOCK
    exposure = _locked(locked) if chosen.exposure == "lock" else chosen.exposure
    options = {
        "exposure": exposure,
        "kind": chosen.format,
        "half": chosen.half,
        "tone": chosen.tone,
        "background": chosen.background,
        "catcher": chosen.catcher,
    }
    with video(chosen.video) if chosen.video is not None else nullcontext() as reel:
        relit = relight_frames(transport, film, chosen.output, method, reel=reel, **options)
    if chosen.exposure == "lock":
        locked.write_text(f"{relit.exposure!r}\n", encoding="utf-8")
    say(relit)


def _locked(path: Path) -> float | None:
    """The exposure that an earlier run kept; None where there was none, and this one chooses."""
    try:
        return read_exposure(path.read_text(encoding="utf-8").strip())
    except FileNotFoundError:
        return None
    except argparse.ArgumentTypeError as error:
        raise ValueError(f"{path}: {error}; remove it to choose anew") from None


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
    env = environment_of(chosen.env, chosen)
    if name == "rotation":
        motion = motion_of(chosen)
        return Film((motion.light(env, k) for k in range(len(motion.angles))), len(motion.angles), env, motion.angles)
    options = {"other": environment_of(chosen.other, chosen)} if chosen.other is not None else {}
    return Film(make(name, env, chosen.frames, hold=chosen.hold, **options), chosen.frames + chosen.hold, env)


def _read_method(text: str) -> str | type[Method]:
    """A name, or a class of one's own."""
    if text.lower() in ("full", *_METHODS):
        return text.lower()
    if ":" in text or text.endswith(".py"):
        return read_own(text)
    names = ", ".join(("full", *_METHODS))
    meant = near(text, ("full", *_METHODS))
    raise argparse.ArgumentTypeError(f"expected a method of {names}, or {OWN}, got {text!r}{meant}")


def _method(chosen: argparse.Namespace) -> Method:
    budgets = {name: getattr(chosen, name) for name in ("terms", "milliseconds", "error")}
    given = {name: value for name, value in budgets.items() if value is not None}
    if chosen.method == "full":
        if given:
            raise ValueError(f"expected no --{next(iter(given))} with --method full, which sends all that differs")
        return Full()
    weight = {} if chosen.weight is None else {"weight": chosen.weight}
    make = _METHODS[chosen.method] if isinstance(chosen.method, str) else chosen.method
    # Harmonic order has a number of terms of its own, which another budget takes the place of.
    return make(**{"terms": None, **(given or {"terms": 30})}, **weight)
