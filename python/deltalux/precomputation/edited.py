"""A material that is edited: what its rows are made of, and the curves that it is expected to take."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from .._core import CURVE, Quotient
from ..brdf import GGX, Beckmann, Measured, Model
from ..brdf.curves import (
    COSINES,
    KINDS,
    Reflectances,
    curve_of,
    physical,
    reflectance_of_model,
    reflectances,
    separated,
)
from ..checks import Vector
from ..columns import Daubechies4

__all__ = ["Edited", "edited"]

# Curves that truncation is measured under: roughnesses from the narrowest that a texel of the map allows.
_MEASURED = np.geomspace(0.01, 1.0, 17)
# Of the albedo's integral.
_RINGS = 4096
_WHITE = (1.0, 1.0, 1.0)


@dataclass(frozen=True, eq=False)
class Edited:
    """What a pass and a file need of one material; the attributes are those of a `CurvePart`."""

    name: str
    quotient: Quotient
    model: Model | None
    curve: NDArray[np.float64]
    specular: Vector
    kind: str
    reflectances: Reflectances
    unexplained: float | None
    digest: str
    drawn: NDArray[np.float64]
    """Reflectances that were drawn, (m, 512) at `COSINES`."""

    @property
    def columns(self) -> Daubechies4:
        """The basis that V is measured in."""
        return Daubechies4(len(self.reflectances.functions))

    def weights(self) -> NDArray[np.float64]:
        """The roots of the prior of V, (columns,): that of curves times that of reflectances."""
        of_factor = np.sqrt((self._expected() ** 2).mean(axis=0))
        # What was drawn is to be seen.
        of_factor[KINDS[self.kind] :] = of_factor.max()
        # What no expected curve has may still be drawn.
        return np.maximum(self.columns.product(of_factor[:, None], _prior()[:, None])[:, 0], 1e-12)

    def _expected(self) -> NDArray[np.float64]:
        """What factors are weighted by, of many reflectances: (m, factors)."""
        if self.kind in ("dielectric", "metal"):
            return np.array([self.reflectances.weights(own)[0] for own in physical(self.kind)])
        return np.ones((1, len(self.reflectances.functions)))

    def measured(self) -> list[NDArray[np.float64]]:
        """V of highlights, (columns, 3) each, that truncation is measured under."""
        # Under the reflectance as it is: that of a dielectric is what is left of larger functions.
        given = np.ones_like(COSINES) if self.model is None else reflectance_of_model(self.model)
        weights = [self.reflectances.weights(own)[0] for own in (given, *self.drawn)]
        curves = Daubechies4().forward(_highlights(_MEASURED))
        made = [self.columns.product(own[:, None], curve[:, None]) for own in weights for curve in curves.T]
        return [np.repeat(own, 3, axis=1) for own in made]

    def albedo(self) -> NDArray[np.float64]:
        """What each node of a curve reflects of an even sky to the normal: (factors, 256, 3)."""
        theta = (np.arange(_RINGS) + 0.5) / _RINGS * np.pi / 2
        wi = np.stack([np.sin(theta), np.zeros(_RINGS), np.cos(theta)], axis=1)
        u, cos_d, quotients = self.quotient.shares(wi, np.tile([0.0, 0.0, 1.0], (_RINGS, 1)))
        sent = (np.pi**2 / _RINGS * np.sin(theta))[:, None] * quotients
        place = u * (CURVE - 1)
        node = np.minimum(place.astype(int), CURVE - 2)
        rest = (place - node)[:, None]
        found = np.zeros((len(self.reflectances.functions), CURVE, 3))
        for out, function in zip(found, self.reflectances.functions, strict=True):
            own = np.interp(cos_d, COSINES, function)[:, None] * sent
            np.add.at(out, node, (1.0 - rest) * own)
            np.add.at(out, node + 1, rest * own)
        return found


def edited(
    name: str, model: Model | Measured, specular: Vector, kind: str, drawn: NDArray[np.float64] | None = None
) -> Edited:
    """A material by its name, with what its lobe is multiplied by, what of its reflectance is edited, and reflectances
    that were drawn."""
    drawn = np.zeros((0, len(COSINES))) if drawn is None else drawn
    more = drawn.tobytes().hex() if len(drawn) else ""
    if isinstance(model, Measured):
        curve, unexplained = separated(model)
        quotient = Quotient.of_measured(model.core(), curve)
        own = reflectances("none").beside(drawn)
        return Edited(name, quotient, None, curve, _WHITE, kind, own, unexplained, model.digest + more, drawn)
    curve = np.repeat(curve_of(model)[:, None], 3, axis=1)
    own = Reflectances(reflectance_of_model(model)[None]) if kind == "fixed" else reflectances(kind)
    quotient, digest = Quotient.of_model(model.core()), repr(model) + more
    return Edited(name, quotient, model, curve, specular, kind, own.beside(drawn), None, digest, drawn)


def _highlights(roughnesses: Iterable[float]) -> NDArray[np.float64]:
    """Curves with a peak of 1, one a column."""
    curves = [curve_of(make(float(alpha))) for make in (Beckmann, GGX) for alpha in roughnesses]
    return np.stack([curve / curve[0] for curve in curves], axis=1)


@cache
def _prior() -> NDArray[np.float64]:
    """The root mean square of each coefficient over highlights of all roughnesses: (256,)."""
    coefficients = Daubechies4().forward(_highlights(np.geomspace(0.01, 1.0, 25)))
    squares: NDArray[np.float64] = (coefficients**2).mean(axis=1)
    return np.sqrt(squares)
