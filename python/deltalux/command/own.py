"""Methods of one's own on the command line: ``mine.py:Mine`` is the class Mine in the file mine.py."""

from __future__ import annotations

import argparse
import importlib.util
from pathlib import Path

from ..update.methods import Method

__all__ = ["OWN", "add_own", "own_of", "read_own"]

OWN = "FILE.py:CLASS"


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
    spec = importlib.util.spec_from_file_location(path.stem, path)
    if spec is None or spec.loader is None:
        raise argparse.ArgumentTypeError(f"expected a Python module, got {path}")
    module = importlib.util.module_from_spec(spec)
    try:
        spec.loader.exec_module(module)
    except Exception as error:
        raise argparse.ArgumentTypeError(f"{path} cannot be run: {type(error).__name__}: {error}") from None
    found = getattr(module, name, None)
    if not (isinstance(found, type) and issubclass(found, Method)) or found.choose is Method.choose:
        raise argparse.ArgumentTypeError(f"expected {name} in {path} to be a deltalux.Method with choose(state)")
    return found


def add_own(command: argparse.ArgumentParser) -> None:
    """The argument of commands that compare methods."""
    command.add_argument(
        "--method", type=read_own, action="append", default=[], metavar=OWN, help="a method of your own, of 30 terms"
    )


def own_of(chosen: argparse.Namespace) -> list[Method]:
    """The methods asked for, with the budget of the papers."""
    return [kind(terms=30) for kind in chosen.method]
