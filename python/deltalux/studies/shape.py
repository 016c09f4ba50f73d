"""The shape that all studies have."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from ..columns import Haar
from ..progress import Progress
from .case import Case
from .sheet import Sheet

__all__ = ["Study"]


@dataclass(frozen=True)
class Study:
    """A title, what is looked at and why, the files that each chapter may write, and the work."""

    title: str
    intro: str
    run: Callable[[Case, Sheet, Progress], None]
    light_files: tuple[str, ...] = ()
    scene_files: tuple[str, ...] = ()
    own_files: tuple[str, ...] = ()
    """Of a study that has a subject of its own."""
    needs_scene: bool = False
    needs_texels: bool = False
    """Whether transports need texel columns, and rows that are kept untruncated."""
    refuses_texels: bool = False
    """Whether transports must have no texel columns."""
    takes_methods: bool = False
    """Whether methods of one's own can take part."""
    traces: str | None = None
    """The built-in scene that it traces, in several ways, where it is given no other; None: it looks at transports."""
    subject: str | None = None
    """What it looks at where that is neither light nor a scene: its only chapter."""
    columns: Haar = Haar(64)
    """What light is measured in where nothing else is said."""

    def files(self, case: Case) -> tuple[str, ...]:
        """Names of the files of one chapter, without the chapter's own."""
        looks_at_one = case.transport is not None or case.scene is not None
        return self.own_files + self.light_files + (self.scene_files if looks_at_one else ())
