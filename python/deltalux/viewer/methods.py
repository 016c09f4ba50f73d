"""Update methods as a page chooses them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from ..checks import one_of
from ..update.methods import WEIGHTS, Full, HarmonicOrder, Incremental, Linear, Method, Nonlinear, PerBand
from .messages import checked_keys, number

__all__ = ["Chosen", "Methods"]

_BUDGETS = ("terms", "milliseconds", "error")
_MOST = {"terms": 1e6, "milliseconds": 1e4, "error": 1e9}
_BUILTIN: dict[str, tuple[str, type[Method]]] = {
    "pbi": ("PBI", PerBand),
    "bi": ("BI", Incremental),
    "nwa": ("NWA", Nonlinear),
    "full": ("Full", Full),
}
_HARMONIC: dict[str, tuple[str, type[Method]]] = {
    "harmonic-order": ("Harmonic order", HarmonicOrder),
    "linear": ("Linear", Linear),
}


@dataclass(frozen=True)
class Chosen:
    """A method as it is set on the page."""

    name: str
    budget: str | None
    amount: float | None
    weight: str | None
    method: Method

    def to_json(self) -> dict[str, Any]:
        """As `Methods.of` takes it."""
        words = {"name": self.name, "budget": self.budget, "amount": self.amount, "weight": self.weight}
        return {key: value for key, value in words.items() if value is not None}


class Methods:
    """The methods that a page offers.

    Parameters
    ----------
    harmonic
        Whether columns are harmonics, for which there are methods of their own.
    own
        Methods of one's own by name, as classes that take a budget.
    """

    def __init__(self, harmonic: bool, own: Mapping[str, type[Method]]) -> None:
        self._known = {**_BUILTIN, **(_HARMONIC if harmonic else {}), **{name: (name, of) for name, of in own.items()}}

    def listed(self) -> list[dict[str, Any]]:
        """For the page: names, titles and budgets."""
        return [
            {"name": name, "title": title, "budgets": [] if of is Full else list(_BUDGETS)}
            for name, (title, of) in self._known.items()
        ]

    def of(self, value: Any) -> Chosen:
        """The method that a message asks for."""
        found = checked_keys("a method", value, ("name", "budget", "amount", "weight"))
        name = found.get("name")
        if not isinstance(name, str) or name not in self._known:
            raise ValueError(f"expected a method of {', '.join(self._known)}, got {str(name)[:40]!r}")
        of = self._known[name][1]
        if of is Full:
            return Chosen(name, None, None, None, Full())
        budget, weight = found.get("budget", "terms"), found.get("weight")
        one_of("a budget", budget, _BUDGETS)
        amount = number(f"a budget in {budget}", found.get("amount", 30), 0.0, _MOST[budget])
        if budget == "terms":
            amount = max(1, round(amount))
        options: dict[str, Any] = {"terms": None, budget: amount}
        if weight is not None:
            one_of("a weight", weight, WEIGHTS)
            options["weight"] = weight
        return Chosen(name, budget, amount, weight, of(**options))

    def naming(self, method: Method) -> Chosen:
        """A method that a program gave; one that is not known by then is known as itself."""
        name = next((own for own, (_, of) in self._known.items() if type(method) is of), "")
        if not name:
            name = type(method).__name__
            self._known[name] = (name, type(method))
        if isinstance(method, Full):
            return Chosen(name, None, None, None, method)
        budget = next((own for own in _BUDGETS if getattr(method, own) is not None), None)
        amount = None if budget is None else float(getattr(method, budget))
        return Chosen(name, budget, amount, method.weight, method)
