"""Update methods: which columns of V to bring up to date in a frame, and how many.

``Full``, ``Linear``, ``Nonlinear`` (NWA), ``Incremental`` (BI), ``PerBand`` (PBI) and ``HarmonicOrder`` (PBI for
spherical harmonics) are plain settings; `Approximation` and `Relighter` act on them. (Overbeck 2006, chapters 2, 4, 6
and 8.)
"""

from __future__ import annotations

from dataclasses import dataclass, field

from ..checks import amount, count, one_of

__all__ = ["Full", "HarmonicOrder", "Incremental", "Linear", "Method", "Nonlinear", "PerBand"]

WEIGHTS = ("area", "none", "root-area", "transport", "cost")
TESTS = ("simple", "dealer", "exhaustive", "fixed")
NORMS = ("l1", "l2")
CHANNELS = ("joint", "separate")


@dataclass(frozen=True)
class Full:
    """Every column that differs, in every frame: the exact product."""


@dataclass(frozen=True)
class _Budgeted:
    """What all methods but `Full` share: a budget, of which exactly one form is given, a weight and channels."""

    terms: int | None = None
    milliseconds: float | None = field(default=None, kw_only=True)
    error: float | None = field(default=None, kw_only=True)
    weight: str = field(default="area", kw_only=True)
    channels: str = field(default="joint", kw_only=True)

    def __post_init__(self) -> None:
        budgets = {"terms": self.terms, "milliseconds": self.milliseconds, "error": self.error}
        given = [name for name, value in budgets.items() if value is not None]
        if len(given) != 1:
            found = " and ".join(given) or "none"
            raise ValueError(f"expected one budget (terms=, milliseconds= or error=), got {found}")
        (name,) = given
        check = count if name == "terms" else amount
        object.__setattr__(self, name, check(name, budgets[name]))
        one_of("weight", self.weight, WEIGHTS)
        one_of("channels", self.channels, CHANNELS)


@dataclass(frozen=True)
class Nonlinear(_Budgeted):
    """NWA, non-linear wavelet approximation: the largest terms of the light, from black, in every frame.

    Exactly one of the three budgets is given.

    Parameters
    ----------
    terms
        Columns a frame (with ``channels="separate"``: pairs of a column and a colour).
    milliseconds
        Time a frame: terms are sent until the measured cost of their columns has used it up. Needs a `Relighter`.
    error
        Terms are sent until the bound on the error of every receiver is at most this much radiance.
    weight
        What a change is worth: ``"area"`` times it (the area of the column's support in texels, the papers' choice),
        ``"root-area"``, ``"none"``, ``"transport"`` (the norm of the column of M), or ``"cost"`` (that norm over
        the root of the bytes of M that must be read: squared error removed per byte, by which a knapsack is filled).
    channels
        ``"joint"``: one list of columns for the three colours. ``"separate"``: each colour has its own.

    Raises
    ------
    ValueError
        If a setting is out of its range.
    """


@dataclass(frozen=True)
class Linear(_Budgeted):
    """Linear approximation: the first columns of the light and no others, from black, in every frame.

    ``Linear(terms=25)`` on spherical harmonics of any order is lighting of order 5: its columns stand degree by degree.
    Budget and ``channels`` are those of `Nonlinear`; ``weight`` changes nothing.
    """


@dataclass(frozen=True)
class Incremental(_Budgeted):
    """BI, basic incremental updates: the largest changes of the light.

    Budget, ``weight`` and ``channels`` are those of `Nonlinear`.
    """


@dataclass(frozen=True)
class PerBand(_Budgeted):
    """PBI, per-band incremental updates: each band is either changed or started anew (Fig. 6.1).

    ``test`` decides: ``"simple"`` (is the light nearer to our copy than to zero?), ``"dealer"`` (together with the
    allocation, term by term), ``"exhaustive"`` (all combinations) or ``"fixed"`` (the ``fixed`` coarsest bands are
    incremental, the others always reset: NWA in those, which never converges). ``norm`` is the error they measure,
    over columns and colours, in the weights of the choice: ``"l1"`` or ``"l2"``.

    Budget, ``weight`` and ``channels`` are those of `Nonlinear`.
    """

    test: str = "simple"
    norm: str = "l1"
    fixed: int | None = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        super().__post_init__()
        one_of("test", self.test, TESTS)
        one_of("norm", self.norm, NORMS)
        if (self.test == "fixed") != (self.fixed is not None):
            raise ValueError(
                'test="fixed", and no other, takes fixed=, the number of coarse bands that are always incremental; '
                f"got test={self.test!r} and fixed={self.fixed!r}"
            )
        if self.fixed is not None:
            object.__setattr__(self, "fixed", count("fixed", self.fixed))
        if self.error is not None and self.test in ("dealer", "exhaustive"):
            raise ValueError(
                f"test={self.test!r} minimises error within a budget: expected terms= or milliseconds=, got error="
            )


@dataclass(frozen=True)
class HarmonicOrder(_Budgeted):
    """PBI for spherical harmonics: low bands first, each to a tolerance, a tenth of it in each later pass.

    ``tolerance`` is relative to the norm of the light. A band that gets no term keeps its values (Fig. 8.1, in the
    reading that does not zero it). Budget, ``weight`` and ``channels`` are those of `Nonlinear`.
    """

    terms: int | None = 25
    tolerance: float = 5e-4
    weight: str = field(default="none", kw_only=True)

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "tolerance", amount("tolerance", self.tolerance))


Method = Full | Linear | Nonlinear | Incremental | PerBand | HarmonicOrder
