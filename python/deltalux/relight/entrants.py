"""The table of entrants: what the report and the studies compare, each named once.

An entrant's name is made of its family and its budget, and it stands as its own key: `str` of it is its name.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from ..update.methods import Full, Incremental, Method, Nonlinear, PerBand

__all__ = [
    "BI_30",
    "EXACT",
    "NWA_100",
    "NWA_30",
    "NWA_300",
    "NWA_500",
    "NWA_60",
    "PBI_100",
    "PBI_30",
    "Entrant",
    "bi",
    "nwa",
    "own",
    "pbi",
]


@dataclass(frozen=True)
class Entrant:
    """A method that takes part in a comparison: its name, its family in the plots, its settings and how it starts."""

    name: str
    family: str
    method: Method
    initial: str | None = "full"

    @property
    def budget(self) -> int | None:
        """Terms a frame; None: no limit."""
        return None if isinstance(self.method, Full) else self.method.terms

    def __str__(self) -> str:
        return self.name


def nwa(terms: int, kind: str = "", **settings: Any) -> Entrant:
    """NWA of so many terms. It keeps nothing from frame to frame: it starts as it goes on."""
    return Entrant(_name("NWA", terms, kind), "NWA", Nonlinear(terms, **settings), initial=None)


def bi(terms: int, kind: str = "", **settings: Any) -> Entrant:
    """BI of so many terms; like all that follow it starts from the exact product."""
    return Entrant(_name("BI", terms, kind), "BI", Incremental(terms, **settings))


def pbi(terms: int, kind: str = "", *, family: str = "PBI", **settings: Any) -> Entrant:
    """PBI of so many terms."""
    return Entrant(_name("PBI", terms, kind), family, PerBand(terms, **settings))


def _name(family: str, terms: int, kind: str) -> str:
    return f"{family}-{terms} {kind}".rstrip()


EXACT = Entrant("exact", "exact", Full())
"""The reference of every comparison."""
NWA_30, NWA_60, NWA_100, NWA_300, NWA_500 = (nwa(terms) for terms in (30, 60, 100, 300, 500))
BI_30 = bi(30)
PBI_30, PBI_100 = pbi(30), pbi(100)


def own(methods: Sequence[Method]) -> tuple[Entrant, ...]:
    """Methods of one's own, each under the name of its class and a name of its own."""
    entrants: dict[str, Entrant] = {}
    for method in methods:
        if not isinstance(method, Method):
            raise ValueError(f"expected update methods such as PerBand(terms=30), got {method!r}")
        budget = "" if method.terms is None else f"-{method.terms}"
        name = f"{type(method).__name__}{budget}"
        alike = sum(known.partition(" (")[0] == name for known in entrants)
        name = f"{name} ({alike + 1})" if alike else name
        entrants[name] = Entrant(name, "own", method)
    return tuple(entrants.values())
