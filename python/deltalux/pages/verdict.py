"""A verdict on a claim of the papers."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

MARKS = {"holds": "holds", "does not hold": "fails", "a tie": "open", "not tested": "open"}
"""How what is said of a claim is shown."""

# What differs by less is the same: runs of the same program differ by more in time, and pictures look alike.
_TIE = 0.005


@dataclass(frozen=True)
class Verdict:
    """A claim, whether it holds here, the figures that say so, and in plain words why or why not.

    Attributes
    ----------
    holds
        None where this run says nothing of it.
    tie
        Whether what is compared is the same, to half a percent.
    """

    claim: str
    holds: bool | None
    figures: str
    why: str = ""
    tie: bool = False

    @property
    def word(self) -> str:
        """What there is to say of the claim: a key of `MARKS`."""
        if self.holds is None:
            return "not tested"
        return "a tie" if self.tie else "holds" if self.holds else "does not hold"


def tied(a: float, b: float) -> bool:
    """Whether two figures are the same, to half a percent of the larger."""
    return abs(a - b) <= _TIE * max(abs(a), abs(b))


def summed(verdicts: Iterable[Verdict]) -> str:
    """How many claims hold, in a sentence."""
    words = [verdict.word for verdict in verdicts]
    several = {"holds": "hold", "does not hold": "do not", "a tie": "tied", "not tested": "not tested"}
    counts = [f"{words.count(word)} {several[word]}" for word in MARKS if word in words]
    return f"Of {len(words)} claims: {', '.join(counts)}."
