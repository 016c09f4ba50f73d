"""What is measured of a model over its parameter's range: the paper's basis beside segments, and what it reflects."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...brdf.family import Errors, Family

__all__ = ["OURS", "PAPERS", "RANGES", "Found", "albedo", "find", "printed_albedo"]

RANGES = {
    "blinn-phong": (3.0, 300.0),
    "ward": (0.05, 2.0),
    "ward-duer": (0.05, 2.0),
    "lafortune": (3.0, 300.0),
    "cook-torrance": (0.1, 2.0),
    "ashikhmin-shirley": (3.0, 300.0),
}
"""Of the paper's table 5; of Ward and Dür's, which is not in it, that of Ward's."""
_COUNTS = range(2, 12)
PAPERS, OURS, _SEGMENTS = 7, 6, 3
"""Live functions: k = 6 and the mean; and of as many segments."""
_ALONG = 181


class Found(NamedTuple):
    """What was measured of one model."""

    model: str
    even: dict[int, Family]
    """The paper's basis, by its number of functions."""
    cut: dict[int, Family]
    """Segments, likewise."""
    gamma: NDArray[np.float64]
    """Parameters over the range, evenly by their logarithms."""
    along: tuple[list[Errors], list[Errors]]
    """The errors there, of the paper's seven functions and of our six."""
    jump: float
    """The largest jump at a border between segments, relative to the largest value."""
    albedos: tuple[float, float]
    """Of light along the normal, what is reflected at most over the range: by the printed form, by the one in use."""

    @property
    def papers(self) -> Family:
        """The mean and six functions, as in the paper."""
        return self.even[PAPERS]

    @property
    def ours(self) -> Family:
        """Six functions of three segments."""
        return self.cut[OURS]


def find(model: str) -> Found:
    """One model over its range."""
    ends = RANGES[model]
    even = {live: Family.even(model, ends, live) for live in _COUNTS}
    cut = {live: Family(model, ends, live=live, segments=_SEGMENTS) for live in _COUNTS}
    gamma = np.geomspace(*ends, _ALONG).clip(*ends)
    printed = [printed_albedo(model, Family.even(model, ends, 2, printed=True), g) for g in gamma]
    mine = [albedo(model, cut[OURS], g) for g in gamma]
    along = even[PAPERS].errors_at(gamma), cut[OURS].errors_at(gamma)
    return Found(model, even, cut, gamma, along, _jump(cut[OURS]), (max(printed), max(mine)))


def _jump(family: Family) -> float:
    """Between the functions of the segments on both sides of a border."""
    delta = np.linspace(0, np.pi / 2, 2001)
    jumps = [0.0]
    for border in family.borders[1:-1]:
        below, above = family.evaluate(border, delta), family.evaluate(np.nextafter(border, np.inf), delta)
        jumps.append(float(np.abs(above - below).max() / below.max()))
    return max(jumps)


def albedo(model: str, family: Family, gamma: float) -> float:
    """What is reflected of light along the normal, without Fresnel's factor: the integral of f_E f_F cos theta."""
    return _reflected(model, lambda delta: family.exact(gamma, delta), 4.0)


def printed_albedo(model: str, family: Family, gamma: float) -> float:
    """The same of the printed form, whose f_F of Cook and Torrance's has cos^4 delta below the line and no 4 there."""

    def lobe(delta: NDArray[np.float64]) -> NDArray[np.float64]:
        values = family.exact(gamma, delta)
        return values / np.cos(delta) ** 4 if model == "cook-torrance" else values

    return _reflected(model, lobe, 1.0)


def _reflected(model: str, lobe: Callable[[NDArray[np.float64]], NDArray[np.float64]], quarter: float) -> float:
    """The integral over the hemisphere."""
    theta, measure = _angles()
    cosine = np.cos(theta)
    delta = theta if model == "lafortune" else theta / 2
    factor = {
        "blinn-phong": 1.0,
        "lafortune": 1.0,
        "ward": cosine**-0.5,
        "ward-duer": 1 / cosine,
        "cook-torrance": np.minimum(1, 2 * cosine) / (quarter * cosine),
        "ashikhmin-shirley": 1 / np.cos(delta),
    }[model]
    return float((lobe(delta) * factor * cosine * 2 * np.pi * np.sin(theta) * measure).sum())


@cache
def _angles() -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Gauss's points over the angles to the normal, with their weights: half within a quarter of the way down."""
    points, weights = np.polynomial.legendre.leggauss(400)
    t = 0.5 * (points + 1)
    return np.pi / 2 * t * t, 0.5 * weights * np.pi * t
