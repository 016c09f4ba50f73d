"""What a transport can be made into by rooms that stand above it: those say so here, and `Transport` asks for them.

A file opens without a reader of meshes and without a pass, and still has the methods that need them.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .transport import Transport

    Maker = Callable[..., Transport]

__all__ = ["made", "maker"]

_MAKERS: dict[str, Maker] = {}


def maker(name: str) -> Callable[[Maker], Maker]:
    """Declares the function that does what the method `name` of a transport asks."""

    def declare(function: Maker) -> Maker:
        _MAKERS[name] = function
        return function

    return declare


def made(name: str) -> Maker:
    """The function that was declared under a name; importing `deltalux` declares all."""
    return _MAKERS[name]
