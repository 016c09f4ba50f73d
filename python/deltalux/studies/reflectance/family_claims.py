"""What is said of families: the paper's claims, and ours."""

from __future__ import annotations

from collections.abc import Sequence

from ...pages.verdict import Verdict
from .family_findings import Found

__all__ = ["claims"]

_CLAIMED = 1e-5
_WITHIN = 0.004
_SEEN = 0.02
"""A highlight whose peak or energy is off by so much is seen to be."""
_JUMP = 1e-6


def claims(found: Sequence[Found]) -> list[Verdict]:
    """A verdict each, in the paper's order."""
    return [_accuracy(found), _enough(found), _ours(found), _borders(found), _printed(found)]


def _accuracy(found: Sequence[Found]) -> Verdict:
    phong = next(one for one in found if one.model == "blinn-phong")
    rms, least = phong.papers.errors.rms, min(off.rms for off in phong.along[0])
    holds = rms <= _CLAIMED
    return Verdict(
        "Six basis vectors keep the RMS error of Blinn and Phong's model within 1e-5 for gamma from 3 to 300 (7.1).",
        holds,
        f"RMS {rms:.1e} at worst and {least:.1e} at best, the mean square {rms**2:.1e}",
        "" if holds else "It is the mean square of the easiest of the six models that is about 1e-5, not its root.",
    )


def _enough(found: Sequence[Found]) -> Verdict:
    worst = max(found, key=lambda one: _off(one.papers.errors))
    off = _off(worst.papers.errors)
    return Verdict(
        "In most cases six basis vectors capture the important features of a model (7.2).",
        off <= _SEEN,
        f"peak off by {_percents([one.papers.errors.peak for one in found])}; "
        f"energy by {_percents([one.papers.errors.energy for one in found])}",
        ""
        if off <= _SEEN
        else f"{worst.model} is off by {100 * off:.2g} % where its lobe is wide: parameters spread evenly see the "
        "narrow end of a range of exponents, or the wide end of one of roughness, and differences are not weighed by "
        "what they are differences of.",
    )


def _ours(found: Sequence[Found]) -> Verdict:
    worst = max(_off(one.ours.errors) for one in found)
    gains = [_off(one.papers.errors) / _off(one.ours.errors) for one in found]
    return Verdict(
        "Six live functions of three segments are within 0.4 % of the peak and of the energy (our own aim).",
        worst <= _WITHIN,
        f"{100 * worst:.2g} % at worst; {', '.join(f'{gain:.3g}' for gain in gains)} times less than the paper's seven",
        "The price: eighteen matrices are stored for seven, of which six are in memory."
        if worst <= _WITHIN
        else "A wide lobe has more shapes than six functions hold.",
    )


def _borders(found: Sequence[Found]) -> Verdict:
    jump = max(one.jump for one in found)
    return Verdict(
        "A parameter that crosses a border between segments makes no jump (our own aim).",
        jump <= _JUMP,
        f"{jump:.1e} of the peak",
        "Both sides hold the border's own lobe exactly." if jump <= _JUMP else "Rounding of the functions is seen.",
    )


def _printed(found: Sequence[Found]) -> Verdict:
    printed = max(found, key=lambda one: one.albedos[0])
    holds = printed.albedos[0] <= 1.001
    return Verdict(
        "The six models reflect no more light than there is (tables 3 and 4).",
        holds,
        "; ".join(f"{one.model} {one.albedos[0]:.2f}" for one in found)
        + f"; in use {max(one.albedos[1] for one in found):.2f} at most",
        ""
        if holds
        else "Of light along the normal. Blinn and Phong's constant is that of a lobe about the mirror direction, and "
        "Cook and Torrance's 1 / pi is in the place of 1 / 4 pi: the forms in use have neither.",
    )


def _off(errors: tuple[float, float, float]) -> float:
    return max(errors[:2])


def _percents(values: Sequence[float]) -> str:
    return ", ".join(f"{100 * value:.2g}" for value in values) + " %"
