"""Update methods: which columns of V to bring up to date in a frame, and how many.

``Full``, ``Linear``, ``Nonlinear`` (NWA), ``Incremental`` (BI), ``PerBand`` (PBI) and ``HarmonicOrder`` (PBI for
spherical harmonics) are plain settings, written here once and read by the core; `Approximation` and `Relighter` act on
them. (Overbeck 2006, chapters 2, 4, 6 and 8.) A `Method` of one's own chooses in Python.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields

from .._core import Method as CoreMethod
from ..checks import amount, count, one_of
from ..mistakes import suggests_keywords
from .choice import Choice, State

__all__ = ["Full", "HarmonicOrder", "Incremental", "Linear", "Method", "Nonlinear", "PerBand"]

WEIGHTS = ("area", "none", "root-area", "transport", "cost")
TESTS = ("simple", "dealer", "exhaustive", "fixed")
NORMS = ("l1", "l2")
CHANNELS = ("joint", "separate")


@dataclass(frozen=True, repr=False)
class Method:
    """How the columns of a frame are chosen. Subclass it and write `choose` for a method of your own.

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
        If a setting is out of its range, or not exactly one budget is given. (A method of one's own may have none: all
        that it chooses is sent.)

    Examples
    --------
    >>> class Loudest(Method):
    ...     def choose(self, state):
    ...         return Choice(columns=(-state.worth()).argsort())
    >>> Loudest(terms=30)
    Loudest(terms=30)
    """

    terms: int | None = None
    milliseconds: float | None = field(default=None, kw_only=True)
    error: float | None = field(default=None, kw_only=True)
    weight: str = field(default="area", kw_only=True)
    channels: str = field(default="joint", kw_only=True)

    def __post_init__(self) -> None:
        budgets = {"terms": self.terms, "milliseconds": self.milliseconds, "error": self.error}
        given = [name for name, value in budgets.items() if value is not None]
        if len(given) > 1 or (not given and not self.is_own):
            found = " and ".join(given) or "none"
            raise ValueError(f"expected one budget (terms=, milliseconds= or error=), got {found}")
        for name in given:
            check = count if name == "terms" else amount
            object.__setattr__(self, name, check(name, budgets[name]))
        if not self.is_own and type(self).core is Method.core:
            raise ValueError(f"expected a method with choose(state), but {type(self).__name__} has none")
        one_of("weight", self.weight, WEIGHTS)
        one_of("channels", self.channels, CHANNELS)

    def __repr__(self) -> str:
        """The settings that are not the default."""
        own = [item for item in fields(self) if getattr(self, item.name) != item.default]
        return f"{type(self).__name__}({', '.join(f'{item.name}={getattr(self, item.name)!r}' for item in own)})"

    @property
    def is_own(self) -> bool:
        """Whether `choose` is somebody's own; the methods of this module are chosen by the core."""
        return type(self).choose is not Method.choose

    def choose(self, state: State) -> Choice:
        """What to send in one frame: to be written by a method of one's own.

        It is asked in every frame, but for the first where `Relighter` is told what that starts from. Whatever it says,
        a frame is exact and its bound holds: only what is sent, and so how near the frame is, depends on it.

        Parameters
        ----------
        state
            Where the light is, and what has been applied of it.

        Returns
        -------
        Choice
            Bands to reset, and columns in the order of their worth.

        Raises
        ------
        NotImplementedError
            If the method is one of the package's, which the core asks.
        """
        raise NotImplementedError(f"{type(self).__name__} has no choose(state)")

    def core(self) -> CoreMethod:
        """The rule of the core that chooses; for a method of one's own, one that is never asked.

        Returns
        -------
        _core.Method
        """
        return CoreMethod.incremental()


@dataclass(frozen=True, repr=False, init=False)
class Full(Method):
    """Every column that differs, in every frame: the exact product. It has no budget and nothing to set."""

    def __init__(self) -> None:
        # More than there can be.
        super().__init__(terms=2**40)

    def __repr__(self) -> str:
        return "Full()"

    def core(self) -> CoreMethod:
        return CoreMethod.full()


@suggests_keywords
@dataclass(frozen=True, repr=False)
class Nonlinear(Method):
    """NWA, non-linear wavelet approximation: the largest terms of the light, from black, in every frame.

    Parameters
    ----------
    terms, milliseconds, error, weight, channels
        As for `Method`.

    Raises
    ------
    ValueError
        As `Method`.
    """

    def core(self) -> CoreMethod:
        return CoreMethod.nonlinear()


@suggests_keywords
@dataclass(frozen=True, repr=False)
class Linear(Method):
    """Linear approximation: the first columns of the light and no others, from black, in every frame.

    ``Linear(terms=25)`` on spherical harmonics of any order is lighting of order 5: its columns stand degree by degree.

    Parameters
    ----------
    terms, milliseconds, error, weight, channels
        As for `Method`; ``weight`` changes nothing.

    Raises
    ------
    ValueError
        As `Method`.
    """

    def core(self) -> CoreMethod:
        return CoreMethod.linear()


@suggests_keywords
@dataclass(frozen=True, repr=False)
class Incremental(Method):
    """BI, basic incremental updates: the largest changes of the light.

    Parameters
    ----------
    terms, milliseconds, error, weight, channels
        As for `Method`.

    Raises
    ------
    ValueError
        As `Method`.
    """

    def core(self) -> CoreMethod:
        return CoreMethod.incremental()


@suggests_keywords
@dataclass(frozen=True, repr=False)
class PerBand(Method):
    """PBI, per-band incremental updates: each band is either changed or started anew (Fig. 6.1).

    Parameters
    ----------
    test
        ``"simple"`` (is the light nearer to our copy than to zero?), ``"dealer"`` (together with the allocation, term
        by term), ``"exhaustive"`` (all combinations) or ``"fixed"`` (the ``fixed`` coarsest bands are incremental,
        the others always reset: NWA in those, which never converges).
    norm
        The error that the tests measure, over columns and colours, in the weights of the choice: "l1" or "l2".
    fixed
        How many of the coarsest bands are always incremental, with ``test="fixed"`` and no other.
    terms, milliseconds, error, weight, channels
        As for `Method`.

    Raises
    ------
    ValueError
        As `Method`, or if settings do not go together.
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

    def core(self) -> CoreMethod:
        return CoreMethod.per_band(test=self.test, norm=self.norm, fixed=self.fixed)


@suggests_keywords
@dataclass(frozen=True, repr=False)
class HarmonicOrder(Method):
    """PBI for spherical harmonics: low bands first, each to a tolerance, a tenth of it in each later pass.

    A band that gets no term keeps its values (Fig. 8.1, in the reading that does not zero it).

    Parameters
    ----------
    tolerance
        Relative to the norm of the light.
    terms, milliseconds, error, weight, channels
        As for `Method`.

    Raises
    ------
    ValueError
        As `Method`.
    """

    terms: int | None = 25
    tolerance: float = 5e-4
    weight: str = field(default="none", kw_only=True)

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "tolerance", amount("tolerance", self.tolerance))

    def core(self) -> CoreMethod:
        return CoreMethod.harmonic_order(tolerance=self.tolerance)
