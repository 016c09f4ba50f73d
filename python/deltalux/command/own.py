"""Methods of one's own on the command line: ``mine.py:Mine`` is the class Mine in the file mine.py."""

from __future__ import annotations

import argparse
import importlib.util
import sys
from pathlib import Path

from ..update.methods import Method

__all__ = ["OWN", "add_own", "read_own"]

OWN = "FILE.py:CLASS"
TERMS = 30


def read_own(text: str) -> type[Method]:
    """The class that ``mine.py:Mine`` names; its file is run like any Python module.

    Raises
    ------
    argparse.ArgumentTypeError
        If there is no such file, or it has no such method.
    """
    file, _, name = text.rpartition(":")
    path = Path(file)
    if not file or not name or path.suffix != ".py":
        raise argparse.ArgumentTypeError(f"expected a method of your own as {OWN}, got {text!r}")
    if not path.is_file():
        raise argparse.ArgumentTypeError(f"expected the file {path}, which does not exist")
    # Under a name that hides no other module; dataclasses look theirs up by it.
    spec = importlib.util.spec_from_file_location(f"_own_{path.stem}", path)
    if spec is None or spec.loader is None:
        raise argparse.ArgumentTypeError(f"expected a Python module, got {path}")
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    try:
        spec.loader.exec_module(module)
    except Exception as error:
        raise argparse.ArgumentTypeError(f"{path} cannot be run: {type(error).__name__}: {error}") from None
    found = getattr(module, name, None)
    if not (isinstance(found, type) and issubclass(found, Method)) or found.choose is Method.choose:
        raise argparse.ArgumentTypeError(f"expected {name} in {path} to be a deltalux.Method with choose(state)")
    try:
        found(terms=TERMS)
    except (TypeError, ValueError) as error:
        raise argparse.ArgumentTypeError(f"{name}(terms={TERMS}) of {path} cannot be made: {error}") from None
    return found


def add_own(command: argparse.ArgumentParser, where: str = "") -> None:
    """The argument of commands that compare methods."""
    command.add_argument(
        "--method",
        type=lambda text: read_own(text)(terms=TERMS),
        action="append",
        default=[],
        metavar=OWN,
        help=f"a method of your own, of {TERMS} terms{where}",
    )
