"""Edits of a highlight as they are scripted: what the curve of a model is in every frame (Overbeck 2006, Fig. 4.1)."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ... import brdf
from ...brdf import Model
from ...brdf.curves import NODES, curve_of

__all__ = ["LOCAL", "MODELS", "SCRIPTS", "STILL", "Script", "energy"]

Make = Callable[[float], Model]
Curve = NDArray[np.float64]

MODELS: dict[str, Make] = {
    "Cook-Torrance": lambda sigma: brdf.CookTorrance(sigma=sigma, n=1.5),
    "GGX": lambda alpha: brdf.GGX(alpha=alpha, n=1.5),
    "Ashikhmin-Shirley": lambda sigma: brdf.AshikhminShirley(exponent=2 / sigma**2, n=1.5),
}
"""Of one roughness each; the last is as wide as a Gaussian of it."""
STILL = 12
"""Frames that nothing is edited in after each script."""
_HAZE, _HAZE_WIDTH = 0.02, 0.25
_BUMP, _BUMP_AT, _BUMP_WIDTH = 0.2, 0.5, 0.06


class Script(NamedTuple):
    """One edit: its words, how many frames it takes, and the curve of a model at a share of it."""

    title: str
    frames: int
    at: Callable[[Make, float], Curve]

    def curves(self, make: Make) -> Curve:
        """The curve in every frame, those that stand still included: (1 + frames + STILL, 256)."""
        shares = np.minimum(np.arange(1 + self.frames + STILL) / self.frames, 1.0)
        return np.stack([self.at(make, float(share)) for share in shares])


def energy(curves: Curve) -> Curve:
    """What curves (m, 256) hold over the hemisphere of half vectors, cos sin dtheta: (m,)."""
    # 1 - cos theta = u^4, so sin theta dtheta = 4 u^3 du.
    found: Curve = curves @ (4.0 * NODES**3 * (1.0 - NODES**4)) / len(NODES)
    return found


def _sharpened(start: float, end: float) -> Callable[[Make, float], Curve]:
    """A slider of roughness, drawn evenly."""
    return lambda make, share: curve_of(make(start + (end - start) * share))


def _hazy(make: Make, share: float) -> Curve:
    """A sharp highlight that gets a second, wide one."""
    sharp, wide = curve_of(make(0.05)), curve_of(make(_HAZE_WIDTH))
    hazy: Curve = sharp + share * _HAZE * sharp[0] / wide[0] * wide
    return hazy


def _bumped(make: Make, share: float) -> Curve:
    """A part of the curve that is drawn higher."""
    curve = curve_of(make(0.1))
    bump: Curve = share * _BUMP * curve[0] * np.exp(-(((NODES - _BUMP_AT) / _BUMP_WIDTH) ** 2))
    return curve + bump


SCRIPTS = (
    Script("roughness 0.3 to 0.05 in 60 frames", 60, _sharpened(0.3, 0.05)),
    Script("roughness 0.1 to 0.01 in 30 frames", 30, _sharpened(0.1, 0.01)),
    Script("roughness 0.3 to 0.02 in 5 frames", 5, _sharpened(0.3, 0.02)),
    Script("haze in one step", 1, _hazy),
    Script("a part of the curve, in 20 frames", 20, _bumped),
)
LOCAL = tuple(script.title for script in SCRIPTS[-2:])
"""Edits of a part of the curve."""
