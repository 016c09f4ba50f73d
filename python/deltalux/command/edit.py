"""`deltalux edit`: a session of edits, played over a transport of curves, in a studio, or as a demo."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from ..edit.editor import BrdfEditor
from ..edit.jewels import FRESNEL, MATERIALS, edits, jewels
from ..edit.session import play, read_session
from ..edit.studio import Studio
from ..edit.studio_session import play_studio, read_studio_session
from ..output import check_folder
from ..precomputation.curves import precompute_curves
from ..progress import reporter, steps
from ..transport.curves import CurveTransport
from ..transport.studio import FOLDER as STUDIO
from ..transport.studio import StudioTransport
from ..update.methods import Incremental
from .arguments import add_command, add_light, environment_of, read_size, read_terms, say

_DEMO = "demo"
_FOLDER, _LIGHT, _SIZE, _TERMS = "deltalux-edit", "hall", (216, 162), 30


def add(commands: Any) -> None:
    """The command and its arguments."""
    command = add_command(commands, "edit", _run, "edits of reflectance under a light that stands still")
    command.set_defaults(when_stopped="stopped; the same command resumes the precomputation where it left off")
    command.add_argument(
        "transport",
        metavar="TRANSPORT",
        help=f"a transport of curves, a studio, or {_DEMO}: pearl earrings, in two minutes",
    )
    command.add_argument(
        "--session",
        metavar="FILE",
        help="edits as JSON (deltalux.edit.session; of a studio: deltalux.edit.studio_session)",
    )
    command.add_argument(
        "--terms", type=read_terms, help=f"columns a frame and material; default: {_TERMS}, in a studio all of them"
    )
    add_light(command, default=f"{_LIGHT}, of the {_DEMO}")
    command.add_argument("--size", type=read_size, metavar="WxH", help=f"of the {_DEMO}; default: 216x162")
    command.add_argument("-o", "--output", default=_FOLDER, metavar="FOLDER", help="default: %(default)s")


def _run(chosen: argparse.Namespace) -> None:
    folder, method = check_folder(chosen.output), Incremental(terms=_TERMS if chosen.terms is None else chosen.terms)
    if chosen.transport == _DEMO:
        page = _demo(chosen, folder, method)
    elif chosen.session is None or chosen.env is not None or chosen.size is not None:
        raise ValueError(f"expected --session FILE, and --env and --size with {_DEMO} only")
    elif (Path(chosen.transport) / STUDIO.manifest).exists():
        session = read_studio_session(chosen.session)
        studio = Studio(StudioTransport.open(chosen.transport), None if chosen.terms is None else method)
        page = play_studio(studio, session, folder, "A session in a studio", reporter(True, "edit"))
    else:
        edits_asked = read_session(chosen.session)
        editor = BrdfEditor(CurveTransport.open(chosen.transport), method)
        page = play(editor, edits_asked, folder, "A session of edits", reporter(True, "edit"))
    say(f"{page.parent.absolute()} holds the session; open {page.absolute()} in a browser")


def _demo(chosen: argparse.Namespace, folder: Path, method: Incremental) -> Path:
    """Pearl earrings: precomputed into the folder, then edited."""
    session = edits() if chosen.session is None else read_session(chosen.session)
    env = environment_of(chosen.env or _LIGHT, chosen)
    folder.mkdir(parents=True, exist_ok=True)
    step_of = steps(True, "edit", 2)
    scene, path, tell = jewels(chosen.size or _SIZE), folder / "jewels.curves", step_of("curves")
    transport = precompute_curves(scene, path, env=env, materials=MATERIALS, fresnel=FRESNEL, progress=tell)
    tell.clear()
    for part in transport.parts.values():
        say(part)
    return play(BrdfEditor(transport, method), session, folder, "Editing pearl earrings", step_of("session"))
