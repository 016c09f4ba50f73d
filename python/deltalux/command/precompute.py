"""`deltalux precompute`, which makes a transport of a scene, and `deltalux info`, which says what one holds."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from ..precomputation.between import RESIDUAL, between
from ..precomputation.preparation import COLUMNS, Request
from ..precomputation.quality import QUALITIES
from ..precomputation.room import check_folder_of
from ..precomputation.run import Precomputation
from ..progress import reporter
from ..scene.builtin.catalogue import SCENES
from ..transport.transport import Transport
from .arguments import add_command, add_scene, read_bounces, read_nodes, say, scene_of

_RESUME = "stopped; the same command resumes where it left off"


def add(commands: Any) -> None:
    """Both commands and their arguments."""
    command = add_command(commands, "precompute", _precompute, "trace the light transport of a scene")
    command.set_defaults(when_stopped=_RESUME)
    command.add_argument(
        "scene", metavar="SCENE", help=f"{', '.join(SCENES)}, or a .glb, .gltf, .obj, .ply or .stl file"
    )
    command.add_argument("-o", "--output", metavar="FILE", help="directory to make, by custom NAME.transport")
    command.add_argument(
        "--columns", default=COLUMNS, metavar="haar:N[+texels]|sh:N", help="basis of the light; default: %(default)s"
    )
    add_scene(command)
    command.add_argument("--quality", choices=QUALITIES, default="publication", help="default: %(default)s")
    command.add_argument("--tolerance", type=float, help="relative error of the image from truncation, such as 0.01")
    command.add_argument(
        "--bounces",
        type=read_bounces,
        default=0,
        metavar="N|all",
        help="of light between surfaces; default: %(default)s",
    )
    command.add_argument(
        "--residual", type=float, default=RESIDUAL, help="proved error of all bounces; default: %(default)s"
    )
    command.add_argument(
        "--nodes", type=read_nodes, default="auto", metavar="N|auto", help="at most so many for bounces; default: auto"
    )
    command.add_argument(
        "--receivers",
        choices=("pixels", "vertices"),
        default="pixels",
        help="of one camera, or of the mesh; default: %(default)s",
    )
    command.add_argument(
        "--normals",
        choices=("smooth", "flat"),
        default="smooth",
        help="as the scene brings them, or of its triangles; default: %(default)s",
    )
    command.add_argument(
        "--refine", type=float, metavar="SHARE", help="split edges where vertices differ by more, such as 0.01"
    )
    command.add_argument("--again", action="store_true", help="compute anew what is there already")
    command.add_argument("--plan", action="store_true", help="only say what would be computed and what it would cost")

    command = add_command(commands, "info", _info, "what a transport holds")
    command.add_argument("transport", metavar="TRANSPORT")
    command.add_argument("--verify", action="store_true", help="work out again what can be of what its files say")


def _precompute(chosen: argparse.Namespace) -> None:
    if chosen.output is None and not chosen.plan:
        raise ValueError("expected -o FILE, the transport to write, or --plan")
    if chosen.output is not None and not chosen.plan:
        check_folder_of(Path(chosen.output))
    scene = scene_of(chosen)
    bounces = between(chosen.bounces, chosen.residual, chosen.nodes)
    asked = Request(
        chosen.columns,
        chosen.quality,
        chosen.tolerance,
        chosen.receivers,
        chosen.normals,
        bounces,
        refine=chosen.refine,
    )
    tell = reporter(True, scene.name)
    request = Precomputation(scene, asked, progress=tell)
    made = None if chosen.again or chosen.plan or chosen.output is None else request.made(chosen.output)
    if made is not None:
        tell.clear()
        say(f"{made}\n{chosen.output} is there already, of this scene and these settings; --again computes it anew")
        return
    plan = request.plan
    tell.clear()
    say(plan)
    if chosen.output is not None and not chosen.plan:
        say(request.run(chosen.output, again=True))
        say(f"{chosen.output} is ready")


def _info(chosen: argparse.Namespace) -> None:
    transport = Transport.open(chosen.transport)
    if chosen.verify:
        say("\n".join(transport.verify()))
        return
    say(transport)
    say(transport.plan)
    columns, size = transport.columns, transport.column_bytes
    label, texels, last = columns.band_label.lower(), transport.texel_bytes, int(columns.bands[-1])
    say(f"  {'band':>4} {'columns':>8} {label:>22} {'MB':>9}")
    for band, name in enumerate(columns.band_names):
        own = columns.bands == band
        # Texels, the last band where there are any, hold bits and no entries.
        held = texels if texels and band == last else size[own].sum()
        say(f"  {band:>4} {own.sum():>8,} {name:>22} {held / 1e6:>9,.2f}")
    for name, length in transport.files:
        say(f"  {name}: {length:,} bytes")
