"""`deltalux dataset`: a scene under thousands of lights."""

from __future__ import annotations

import argparse
import os
from pathlib import Path
from typing import Any

from ..camera import Camera
from ..datasets.cameras import turntable
from ..datasets.encoding import FORMATS
from ..datasets.lights import ROTATIONS, LightRule
from ..datasets.run import LAYERS, SPLITS, check_dataset_folder, dataset
from ..images.writing import FAST, LEVELS
from ..light.skies import BUILTIN
from ..precomputation.preparation import COLUMNS
from ..precomputation.quality import QUALITIES
from ..scene.builtin.catalogue import SCENES
from ..scene.scene import Scene
from ..transport.transport import Transport
from .arguments import (
    add_command,
    read_background,
    read_bounces,
    read_exposure,
    read_size,
    read_terms,
    read_view,
    say,
    scene_of,
)

_RULE = LightRule()


def add(commands: Any) -> None:
    """The command and its arguments."""
    command = add_command(commands, "dataset", _dataset, "pictures of a scene under thousands of lights")
    command.add_argument("scene", metavar="SCENE|TRANSPORT", help=f"{', '.join(SCENES)}, a file, or a transport")
    command.add_argument("-o", "--output", required=True, metavar="FOLDER")
    _add_lights(command)
    _add_scene(command)
    _add_files(command)
    command.add_argument("--jobs", type=read_terms, metavar="N", help="processes; default: threads of this one")


def _add_lights(command: argparse.ArgumentParser) -> None:
    command.add_argument(
        "--env",
        action="append",
        metavar="ENV",
        help=f"may be given again; default: {', '.join(BUILTIN)}",
    )
    command.add_argument("--count", type=read_terms, metavar="N", help="lights that are drawn; default: 1000")
    command.add_argument("--seed", type=int, default=0, help="default: %(default)s")
    command.add_argument("--rotation", choices=ROTATIONS, help=f"of environments; default: {_RULE.rotation}")
    command.add_argument("--stops", type=float, help=f"of gain, up and down; default: {_RULE.stops:g}")
    command.add_argument("--crossfades", type=float, metavar="SHARE", help=f"of lights; default: {_RULE.crossfades:g}")
    command.add_argument("--lamps", type=float, metavar="SHARE", help=f"of lights; default: {_RULE.lamps:g}")
    command.add_argument("--lights", metavar="FILE", help="one on each line, in JSON, in the place of drawn ones")


def _add_scene(command: argparse.ArgumentParser) -> None:
    command.add_argument("--size", type=read_size, metavar="WxH", help="pixels; default: the camera's own")
    command.add_argument("--camera", type=read_view, metavar="PX,PY,PZ:TX,TY,TZ[:FOV]|NAME", help="the first")
    around = command.add_mutually_exclusive_group()
    around.add_argument("--turntable", type=read_terms, metavar="N", help="cameras around what the first looks at")
    around.add_argument("--cameras", metavar="FILE", help="a JSON list of cameras")
    command.add_argument("--columns", metavar="haar:N[+texels]|sh:N", help=f"of a scene; default: {COLUMNS}")
    command.add_argument("--quality", choices=QUALITIES, help="of a scene; default: publication")
    command.add_argument("--bounces", type=read_bounces, metavar="N|all", help="of a scene; default: 0")


def _add_files(command: argparse.ArgumentParser) -> None:
    command.add_argument("--format", choices=FORMATS, default="exr", help="default: %(default)s")
    command.add_argument("--float", action="store_true", help="floats of 32 bits in the place of 16")
    command.add_argument(
        "--compression", type=int, choices=LEVELS, default=FAST, metavar="0-9", help="default: %(default)s"
    )
    command.add_argument("--tar", action="store_true", help="tar files, as webdataset reads them")
    command.add_argument(
        "--layers", default="mask", metavar="NAME,...", help=f"of {', '.join(LAYERS)}, or none; default: %(default)s"
    )
    command.add_argument("--coefficients", action="store_true", help="keep V of every picture")
    command.add_argument(
        "--background", type=read_background, default="env", metavar="env|none|#rrggbb", help="default: %(default)s"
    )
    command.add_argument(
        "--exposure", type=_read_exposure, metavar="STOPS|each", help="of png16; default: by an even light, for all"
    )
    shares = ",".join(f"{name}={share:g}" for name, share in SPLITS.items())
    command.add_argument("--splits", type=_read_splits, metavar="NAME=SHARE,...", help=f"default: {shares}")
    command.add_argument(
        "--shard", type=read_terms, default=64, metavar="N", help="pictures a task; default: %(default)s"
    )


def _read_exposure(text: str) -> float | str:
    return text if text == "each" else read_exposure(text)


def _read_splits(text: str) -> dict[str, float]:
    try:
        return {name: float(share) for name, _, share in (part.partition("=") for part in text.split(","))}
    except ValueError:
        raise argparse.ArgumentTypeError(f"expected shares like train=0.9,test=0.1, got {text!r}") from None


def _dataset(chosen: argparse.Namespace) -> None:
    chosen.when_stopped = f"stopped; what is whole is in {chosen.output}, and the same command goes on from there"
    check_dataset_folder(Path(chosen.output).absolute())
    source, precomputing = _source(chosen)
    cameras: Any = chosen.cameras or ()
    if chosen.turntable is not None:
        cameras = turntable(source.camera, chosen.turntable)
    layers = () if chosen.layers == "none" else tuple(chosen.layers.split(","))
    made = dataset(
        source,
        chosen.output,
        _lights(chosen),
        chosen.count,
        seed=chosen.seed,
        cameras=cameras,
        layers=layers,
        format=chosen.format,
        half=not chosen.float,
        compression=chosen.compression,
        tar=chosen.tar,
        background=chosen.background,
        exposure=chosen.exposure,
        coefficients=chosen.coefficients,
        splits=chosen.splits,
        shard=chosen.shard,
        jobs=chosen.jobs,
        **precomputing,
    )
    say(made)


def _source(chosen: argparse.Namespace) -> tuple[Scene | Transport, dict[str, Any]]:
    """A scene with what its transport is to be, or a transport, which is what it is."""
    names = ("columns", "quality", "bounces")
    given = {name: getattr(chosen, name) for name in names if getattr(chosen, name) is not None}
    if chosen.scene in SCENES or not os.path.isdir(chosen.scene):
        return scene_of(chosen), given
    if given or chosen.size is not None or isinstance(chosen.camera, str):
        word = next(iter(given), "size" if chosen.size is not None else "camera NAME")
        raise ValueError(f"expected --{word} with a scene only, got the transport {chosen.scene}")
    transport = Transport.open(chosen.scene)
    if chosen.camera is not None:
        position, target, fov = chosen.camera
        own = transport.camera
        chosen.cameras = chosen.cameras or [Camera(position, target, own.up, fov, own.width, own.height)]
    return transport, {}


def _lights(chosen: argparse.Namespace) -> LightRule | str:
    drawn = {name: getattr(chosen, name) for name in ("rotation", "stops", "crossfades", "lamps")}
    drawn = {name: value for name, value in drawn.items() if value is not None}
    if chosen.env is not None:
        drawn["environments"] = tuple(chosen.env)
    if chosen.lights is None:
        return LightRule(**drawn)
    if drawn:
        word = next(iter(drawn)).replace("environments", "env")
        raise ValueError(f"expected --{word} where lights are drawn, got --lights {chosen.lights}")
    return str(chosen.lights)
