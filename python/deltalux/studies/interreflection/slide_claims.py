"""What the slides claim of transfer (Sloan, Lehtinen and Kautz 2005), held against one scene and light."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...pages.verdict import Verdict
from ...relight.errors import relative_errors

__all__ = ["BOUNCES", "TERMS", "Transfers", "claims"]

BOUNCES = 6
TERMS = (25, 100)
"""Of the light, in both bases; squares, as an order n of harmonics has n^2 terms."""
_SLACK = 0.01
"""A receiver is not darker or brighter where it differs by less than this share of the mean: truncation does."""
_NEARLY_ALL = 0.99
_RIGHT = 0.05
"""A picture within this relative error is taken for right."""


@dataclass(frozen=True)
class Transfers:
    """Responses (rows, 3) of one scene to one light, before the receivers' own albedo, and what their M takes."""

    unshadowed: NDArray[np.float32]
    shadowed: NDArray[np.float32]
    bounced: NDArray[np.float32]
    one: NDArray[np.float32]
    """As `bounced`, but all surfaces between which light bounces are grey, so that one channel does."""
    albedo: NDArray[np.float32]
    channels: tuple[int, int, int]
    """Of shadowed, bounced and one."""
    nbytes: tuple[int, int, int]
    few: dict[str, float]
    """The error of the shadowed picture with few terms of the light."""
    sum_error: float
    """Of a picture that is summed of images of single basis functions."""

    @property
    def one_error(self) -> tuple[float, float]:
        """What a single channel is off by: of all light, and of what has bounced."""
        exact, direct = self.bounced * self.albedo, self.shadowed * self.albedo
        found = self.one * self.albedo
        return relative_errors(found, exact)[1], relative_errors(found - direct, exact - direct)[1]


def claims(found: Transfers) -> list[Verdict]:
    """In the order of the slides."""
    return [_order(found), _channels(found), _sum(found), _terms(found)]


def _order(found: Transfers) -> Verdict:
    slack = _SLACK * float(found.unshadowed.mean())
    darker = float((found.shadowed <= found.unshadowed + slack).mean())
    brighter = float((found.bounced >= found.shadowed - slack).mean())
    means = [float((B * found.albedo).mean()) for B in (found.unshadowed, found.shadowed, found.bounced)]
    holds = min(darker, brighter) >= _NEARLY_ALL
    return Verdict(
        "Shadows only take light away, and light between surfaces only adds to it.",
        holds,
        f"in {100 * darker:.1f} % and {100 * brighter:.1f} % of receivers; mean radiance "
        f"{', '.join(f'{mean:.3g}' for mean in means)}",
        "Visibility is 0 or 1, and every bounce is a sum of light that is not negative."
        if holds
        else "What truncation leaves out of M weighs more here than the shadows or the bounces themselves.",
    )


def _channels(found: Transfers) -> Verdict:
    shadows, bounces, _ = found.channels
    all_light, bounced = found.one_error
    holds = shadows == 1 and bounces == 3
    return Verdict(
        "For shadows one transfer vector serves all colours; light between surfaces bleeds and takes three.",
        holds,
        f"channels: {shadows} with shadows, {bounces} with bounces; one channel in their place is off by "
        f"{100 * all_light:.2g} % of the picture and {100 * bounced:.2g} % of what has bounced",
        "Only the last albedo on a path of light can stand outside the sum; that of the surfaces before it cannot."
        if holds
        else "All surfaces of this scene are grey: then one vector is right, and no more is stored.",
    )


def _sum(found: Transfers) -> Verdict:
    return Verdict(
        "A picture is the sum of the images of single basis functions, each times its coefficient of the light.",
        found.sum_error <= 1e-5,
        f"the sum of the wavelets' images above is off by {100 * found.sum_error:.2g} %",
        "Light is linear, also where it is negative; what is left is the rounding of pictures in single precision.",
    )


def _terms(found: Transfers) -> Verdict:
    few, many = TERMS
    wavelets = found.few[f"Haar, {many} terms"]
    holds = wavelets <= _RIGHT
    return Verdict(
        f"{many} wavelets, chosen by the light, seem sufficient.",
        holds,
        "; ".join(f"{name}: {100 * error:.3g} %" for name, error in found.few.items()),
        f"Within {100 * _RIGHT:g} % of the picture with all of them."
        if holds
        else f"Not within {100 * _RIGHT:g} %: much of this light is in more places than so many wavelets reach.",
    )
