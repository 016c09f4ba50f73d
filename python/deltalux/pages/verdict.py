"""A verdict on a claim of the papers."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Verdict:
    """A claim, whether it holds here, the figures that say so, and in plain words why or why not."""

    claim: str
    holds: bool
    figures: str
    why: str = ""
