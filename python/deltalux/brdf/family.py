"""Families: a model over the range of its parameter, as few functions that span all of it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._core import FAMILIES
from .._core import Family as CoreFamily
from ..checks import amount, count, one_of

__all__ = ["Errors", "Family"]


class Errors(NamedTuple):
    """How far the functions of a family are from what they stand for."""

    peak: float
    """The largest difference, relative to the largest value."""
    energy: float
    """The integral of the difference's size times sin delta cos delta, relative to that of the values."""
    rms: float
    """The root of the mean square over delta, 1 / sr: the measure of Nguyen 2010."""


class Family:
    """A model whose one parameter gamma is edited: f = f_E(gamma, delta) f_F, and f_E in a basis of few functions.

    The transport of every function is precomputed; gamma is then K coefficients. The range is cut into segments of
    equal logarithm, of which only one is live at a time. Each has functions of its own, in which both of its ends are
    exact, so that nothing jumps where gamma crosses a border. (Nguyen 2010, section 4, cut and weighed so that six
    functions do what seven of theirs do not: `Family.even` is theirs.)

    ===================  ========  ================================================  ===========================
    model                gamma     f_E                                               f_F
    ===================  ========  ================================================  ===========================
    "blinn-phong"        1-10000   (g + 2) (g + 4) / (8 pi (2^(-g / 2) + g)) cos^g   1
    "ward"               0.005-10  exp(-tan^2 / g^2) / (4 pi g^2)                    1 / sqrt(n.wi n.wo)
    "ward-duer"          0.005-10  the same                                          1 / (n.wi n.wo)
    "lafortune"          1-10000   (g + 2) / 2 pi cos^g                              1
    "cook-torrance"      0.005-10  exp(-tan^2 / g^2) / (pi g^2 cos^4)                G F / (4 n.wi n.wo)
    "ashikhmin-shirley"  1-10000   (g + 1) / 8 pi cos^g                              F / (h.wo max(n.wi, n.wo))
    ===================  ========  ================================================  ===========================

    cos and tan are of delta, the angle between the normal and the half vector h; Lafortune's delta has the cosine
    max(0, Cx wix wox + Cy wiy woy + Cz wiz woz) / max abs(C). Constants are those of `deltalux.brdf`. F is
    Schlick's, of `f0`, and belongs to f_F of every model but Lafortune's.

    Parameters
    ----------
    model
        A name of the table.
    range : (2,) real
        The least and the largest gamma, within those of the table.
    error
        Of parameters that the functions were not made of, the worst in both the `peak` and the `energy` measure. The
        fewest live functions that reach it are taken, and of those the fewest segments, at most three.
    live, segments
        The number of both, in the place of `error`.
    f0
        What facets reflect at normal incidence, from 0 to 1; more at others (Schlick). It is part of f_F and is not
        edited. 1: all light, at every angle.

    Raises
    ------
    ValueError
        If the model is none, the range is none or outside the model's, no family reaches the error, only one of
        `live` and `segments` is given, or f0 is outside its range or of Lafortune's model.
    """

    def __init__(
        self,
        model: str,
        range: tuple[float, float],
        error: float = 0.005,
        *,
        live: int | None = None,
        segments: int | None = None,
        f0: float = 1.0,
    ) -> None:
        ends, facets = _checked(model, range), amount("f0", f0)
        if live is None and segments is None:
            core = CoreFamily.within(model, ends, amount("error", error), facets)
        elif live is None or segments is None:
            raise ValueError(f"expected live and segments, or none of them, got {live!r} and {segments!r}")
        else:
            core = CoreFamily.segmented(model, ends, count("live", live), count("segments", segments), facets)
        self._take(model, core, facets)

    @classmethod
    def even(cls, model: str, range: tuple[float, float], live: int = 7, *, printed: bool = False) -> Family:
        """The basis of the paper: one for the whole range, of 100 parameters and 400 angles spread evenly.

        (Nguyen 2010, eq. 10 to 15; it does not say how many of both.)

        Parameters
        ----------
        model, range
            As of the class.
        live
            Functions, of which the first is the mean: the paper's k and one more.
        printed
            f_E as the paper prints it (table 4): Blinn and Phong's with (g + 2) / 2 pi, under which it reflects up to
            four times the light, and Cook and Torrance's without cos^4 delta, which stands in f_F there.

        Returns
        -------
        Family
            Of one segment. Its errors are at the paper's own angles.

        Raises
        ------
        ValueError
            If the model is none, the range is none or outside the model's, or there are too few or too many functions.
        """
        family = cls.__new__(cls)
        family._take(model, CoreFamily.even(model, _checked(model, range), count("live", live), printed), 1.0)
        return family

    def _take(self, model: str, core: CoreFamily, f0: float) -> None:
        self._model, self._core, self._f0 = model, core, f0
        self._errors = Errors(*core.errors())

    def __repr__(self) -> str:
        low, high = self.range
        peak, energy, _ = self.errors
        return (
            f"<Family {self.model!r} of gamma {low:g} to {high:g}: {self.live} live functions, {self.segments} "
            f"segments, off by {peak:.2%} of the peak, {energy:.2%} of the energy>"
        )

    @property
    def model(self) -> str:
        """The name of the model."""
        return self._model

    @property
    def f0(self) -> float:
        """What facets reflect at normal incidence."""
        return self._f0

    @property
    def range(self) -> tuple[float, float]:
        """The least and the largest gamma."""
        return self.borders[0], self.borders[-1]

    @property
    def live(self) -> int:
        """Functions of a segment: so many matrices are live at a time."""
        return self._core.live

    @property
    def segments(self) -> int:
        """Parts of the range, each with functions of its own."""
        return len(self.borders) - 1

    @property
    def borders(self) -> tuple[float, ...]:
        """Where segments begin and end, the range's own ends included: `segments` + 1 values of gamma."""
        return tuple(self._core.borders)

    @property
    def errors(self) -> Errors:
        """The worst of all parameters halfway between those that the functions were made of."""
        return self._errors

    def errors_at(self, gamma: ArrayLike) -> list[Errors]:
        """The errors of some parameters.

        Parameters
        ----------
        gamma : (n,) real
            Within the range.

        Returns
        -------
        list of Errors
            One for each.

        Raises
        ------
        ValueError
            If one is outside the range.
        """
        return [Errors(*found) for found in self._core.errors_at(np.atleast_1d(np.asarray(gamma, float)).tolist())]

    def coefficients(self, gamma: float) -> NDArray[np.float64]:
        """c(gamma), in the functions of its segment.

        Parameters
        ----------
        gamma
            Within the range.

        Returns
        -------
        (live,) float64
            ``basis(gamma, delta) @ coefficients(gamma)`` is ``evaluate(gamma, delta)``.

        Raises
        ------
        ValueError
            If gamma is outside the range.
        """
        return self._core.coefficients(float(gamma))

    def basis(self, gamma: float, delta: ArrayLike) -> NDArray[np.float64]:
        """The functions of a parameter's segment.

        Parameters
        ----------
        gamma
            Within the range.
        delta : (n,) real
            Radians, from 0 to pi / 2.

        Returns
        -------
        (n, live) float64
            Their values, linear between a thousand angles.

        Raises
        ------
        ValueError
            If gamma or an angle is outside its range.
        """
        return self._core.basis(float(gamma), _angles(delta))

    def evaluate(self, gamma: float, delta: ArrayLike) -> NDArray[np.float64]:
        """f_E as the functions give it.

        Parameters
        ----------
        gamma
            Within the range.
        delta : (n,) real
            Radians, from 0 to pi / 2.

        Returns
        -------
        (n,) float64
            1 / sr times what f_F lacks of it. May be a little below 0.

        Raises
        ------
        ValueError
            If gamma or an angle is outside its range.
        """
        return self._core.evaluate(float(gamma), _angles(delta))

    def exact(self, gamma: float, delta: ArrayLike) -> NDArray[np.float64]:
        """f_E itself.

        Parameters
        ----------
        gamma
            Within the range.
        delta : (n,) real
            Radians, from 0 to pi / 2.

        Returns
        -------
        (n,) float64
            What `evaluate` stands for.

        Raises
        ------
        ValueError
            If gamma or an angle is outside its range.
        """
        return self._core.exact(float(gamma), _angles(delta))


def _checked(model: str, range: tuple[float, float]) -> tuple[float, float]:
    """The ends of a range, which the core compares with the model's own."""
    one_of("model", model, tuple(FAMILIES))
    try:
        low, high = (float(end) for end in range)
    except (TypeError, ValueError):
        raise ValueError(f"expected range to be two numbers, got {range!r}") from None
    return low, high


def _angles(delta: ArrayLike) -> NDArray[np.float64]:
    angles = np.asarray(delta, np.float64)
    if angles.ndim != 1:
        raise ValueError(f"expected delta of shape (n,), got {angles.shape}")
    return angles
