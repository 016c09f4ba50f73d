"""What a row has tried, and how long it may go on."""

from __future__ import annotations

import time
from dataclasses import dataclass, field

MOST_FAULTS = 20
"""Of a row, that are told one by one."""


@dataclass
class Tally:
    """What was tried, and what of it did not survive."""

    tried: int = 0
    lost: int = 0
    faults: list[str] = field(default_factory=list)
    """What happened to the first of those that were lost."""
    most: dict[str, float] = field(default_factory=dict)
    """Figures, of which the largest that was seen is shown."""
    sums: dict[str, float] = field(default_factory=dict)
    """Figures that are added up."""
    seconds: float = 0.0

    def count(self, tried: int, lost: int = 0, what: str = "") -> None:
        """So many more were tried; what happened to those that were lost."""
        self.tried += tried
        self.lost += lost
        if lost and len(self.faults) < MOST_FAULTS:
            self.faults.append(what)

    def see(self, name: str, figure: float) -> None:
        """A figure of which the largest counts."""
        self.most[name] = max(figure, self.most.get(name, figure))

    def add(self, name: str, figure: float) -> None:
        """A figure that is added up."""
        self.sums[name] = self.sums.get(name, 0.0) + figure

    def join(self, other: Tally) -> None:
        """What was tried before, and now."""
        self.tried += other.tried
        self.lost += other.lost
        self.faults = (self.faults + other.faults)[:MOST_FAULTS]
        for name, figure in other.most.items():
            self.see(name, figure)
        for name, figure in other.sums.items():
            self.add(name, figure)
        self.seconds += other.seconds


class Clock:
    """So many seconds, from now on."""

    def __init__(self, seconds: float) -> None:
        self._end = time.monotonic() + seconds

    def left(self) -> float:
        """Seconds until the end; 0 after it."""
        return max(self._end - time.monotonic(), 0.0)
