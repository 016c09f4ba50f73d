"""The table of entrants: what the report and the studies compare."""

from __future__ import annotations

from dataclasses import dataclass

from ..update.methods import Method


@dataclass(frozen=True)
class Entrant:
    """One line of the table of methods: its name, its family in the plots, its settings and how it starts."""

    name: str
    family: str
    method: Method
    initial: str | None = "full"

    @property
    def budget(self) -> int | None:
        """Terms a frame; None: no limit."""
        return getattr(self.method, "terms", None)
