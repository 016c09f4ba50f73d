"""`deltalux report`: all methods against the exact product."""

from __future__ import annotations

import argparse
from typing import Any

from ..report import check_report, report
from ..transport.transport import Transport
from .arguments import add_command, add_light, add_motion, environment_of, motion_of, say
from .own import add_own


def add(commands: Any) -> None:
    """The command and its arguments."""
    command = add_command(commands, "report", _report, "all methods against the exact product: error, run time, bytes")
    command.add_argument("transport", metavar="TRANSPORT")
    add_light(command, several=True)
    command.set_defaults(when_stopped="stopped; the same command begins anew")
    add_motion(command, rotate=45.0, hold=25)
    add_own(command)
    command.add_argument("-o", "--output", required=True, metavar="FOLDER")


def _report(chosen: argparse.Namespace) -> None:
    motion = motion_of(chosen)
    envs, transport = [environment_of(name, chosen) for name in chosen.env], Transport.open(chosen.transport)
    check_report(envs, chosen.output, motion)
    page = report(
        transport,
        envs,
        chosen.output,
        rotate=motion.rotate,
        frames=motion.frames,
        hold=motion.hold,
        axis=motion.axis,
        methods=chosen.method,
    )
    say(f"{page.parent.absolute()} holds the report; open {page.absolute()} in a browser")
