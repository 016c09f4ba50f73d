"""What one material is at the moment: its curve, its reflectance, and the V that both make."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..brdf import Model
from ..brdf.curves import ANGLES, COSINES, curve_of, reflectance_of
from ..checks import real_array
from ..transport.curves import CurvePart

__all__ = ["Lobe", "NeedsPrecompute", "checked_curve", "sampled_curve", "sampled_reflectance"]

_REFLECTANCE = ("n", "k", "f0")
_MOST_POINTS = 1_000_000
# A drawn reflectance further off its basis than this is not shown as if it were it.
_TOLERATED = 0.01


class NeedsPrecompute(ValueError):
    """An edit that T' does not hold, with the seconds that another would take."""


@dataclass(frozen=True, eq=False)
class Lobe:
    """The state of one material.

    Attributes
    ----------
    part
        T', and what the material was when it was made.
    model
        The parameters that `set` has reached; None of a measured material.
    curve
        (256, 3) at the nodes.
    indices
        What each colour's reflectance is given by: (n, k, f0), three times.
    colour
        What all is multiplied by.
    weights
        (factors, 3): the reflectance in its basis.
    residual
        How far it is off there, at most, up to 85 degrees.
    """

    part: CurvePart
    model: Model | None
    curve: NDArray[np.float64]
    indices: tuple[tuple[float | None, ...], ...]
    colour: NDArray[np.float64]
    weights: NDArray[np.float64]
    residual: float

    @classmethod
    def of(cls, part: CurvePart) -> Lobe:
        """A material as T' was made for it."""
        own = tuple(getattr(part.model, name, None) for name in _REFLECTANCE)
        weights, residual = _weights(part, (own,) * 3)
        return cls(part, part.model, part.curve, (own,) * 3, np.array(part.specular), weights, residual)

    def V(self) -> NDArray[np.float64]:
        """The curve and the reflectance in the columns of T': (columns, 3)."""
        columns = self.part.columns
        return columns.product(self.colour * self.weights, columns.forward(self.curve))

    def albedo(self) -> float:
        """What it reflects of an even sky to the normal, the most of three colours."""
        found = self.colour * np.einsum("rjk,rk,jk->k", self.part.albedo, self.weights, self.curve)
        return float(found.max())

    def with_parameters(self, changes: dict[str, Any]) -> Lobe:
        """The same with other parameters of its model, indices of each colour, or a colour."""
        lobe, changes = self, dict(changes)
        if "colour" in changes:
            colour = np.broadcast_to(_colours("colour", changes.pop("colour")), 3)
            lobe = replace(lobe, colour=colour)
        if changes and lobe.model is None:
            raise ValueError(
                f"expected a curve or a colour for the measured {self.part.name!r}, got {', '.join(changes)}"
            )
        known = [parameter.name for parameter in fields(lobe.model)] if lobe.model else []  # type: ignore[arg-type]
        unknown = [name for name in changes if name not in known]
        if unknown:
            raise ValueError(f"expected parameters of {', '.join([*known, 'colour'])}, got {', '.join(unknown)}")
        reflecting = {name: changes.pop(name) for name in _REFLECTANCE if name in changes}
        if reflecting:
            lobe = lobe._reflecting(reflecting)
        return lobe._shaped(changes) if changes else lobe

    def _reflecting(self, changes: dict[str, Any]) -> Lobe:
        """Other indices, one for all colours or one each."""
        if self.part.kind in ("fixed", "none"):
            raise NeedsPrecompute(f"the reflectance of {self.part.name!r} was made {self.part.kind}: it is not edited")
        each = {name: np.broadcast_to(_colours(name, value), 3) for name, value in changes.items()}
        indices = tuple(
            tuple(float(each[name][k]) if name in each else old for name, old in zip(_REFLECTANCE, own, strict=True))
            for k, own in enumerate(self.indices)
        )
        for own in indices:
            # The model knows its ranges.
            names = [name for name in _REFLECTANCE if hasattr(self.model, name)]
            replace(self.model, **{n: v for n, v in zip(_REFLECTANCE, own, strict=True) if n in names})  # type: ignore[type-var]
        weights, residual = _weights(self.part, indices)
        if residual > _TOLERATED:
            raise NeedsPrecompute(
                f"a reflectance of {', '.join(f'{k}={v!r}' for k, v in changes.items())} is {100 * residual:.1f} % off "
                f"what {self.part.name!r} was made for ({self.part.kind})"
            )
        return replace(self, indices=indices, weights=weights, residual=residual)

    def _shaped(self, changes: dict[str, Any]) -> Lobe:
        """Another width, and so another curve."""
        assert self.model is not None
        model = replace(self.model, **changes)  # type: ignore[type-var]
        if _fixed(model) != _fixed(self.part.model):
            raise NeedsPrecompute(
                f"{self.part.name!r} was made for {self.part.model!r}, whose ratio of widths and direction stay; got "
                f"{model!r}"
            )
        return replace(self, model=model, curve=np.repeat(curve_of(model)[:, None], 3, axis=1))

    def over(self, part: CurvePart) -> Lobe:
        """The same over another T', whose functions hold those of this one."""
        shown = self.weights.T @ self.part.reflectances.functions
        return replace(self, part=part, weights=np.stack([part.reflectances.weights(own)[0] for own in shown], axis=1))

    def reflectance_drawn(self, theta: ArrayLike, values: ArrayLike) -> Lobe:
        """A reflectance by hand, over the difference angle; it is applied as what its basis has of it."""
        found = [self.part.reflectances.weights(own) for own in sampled_reflectance(theta, values)]
        residual = max(off for _, off in found)
        if residual > _TOLERATED:
            raise NeedsPrecompute(
                f"the curve is {100 * residual:.1f} % off what {self.part.name!r} was made for ({self.part.kind}); up "
                f"to {100 * _TOLERATED:.0f} % are applied"
            )
        return replace(self, weights=np.stack([own for own, _ in found], axis=1), residual=residual)


def _weights(part: CurvePart, indices: tuple[tuple[float | None, ...], ...]) -> tuple[NDArray[np.float64], float]:
    """Each colour's reflectance in the part's functions, and the largest that one is off."""
    if len(part.reflectances.functions) == 1:
        return np.ones((1, 3)), 0.0
    found = [part.reflectances.weights(reflectance_of(*own)) for own in indices]
    return np.stack([weights for weights, _ in found], axis=1), max(residual for _, residual in found)


def _fixed(model: Model | None) -> tuple[Any, ...]:
    """What of a model stands in the quotient: its kind, the ratio of its widths, and the direction that it is about."""
    ratios = []
    for along, across in (("alpha", "alpha_v"), ("exponent", "exponent_v")):
        one, other = getattr(model, along, None), getattr(model, across, None)
        ratios.append(1.0 if other is None or one == other else float(f"{other / one:.9g}") if one else other)
    return type(model), *ratios, getattr(model, "coefficients", None)


def _colours(name: str, value: Any) -> NDArray[np.float64]:
    array = real_array(name, value, np.float64)
    if array.shape not in ((), (3,)) or not (np.isfinite(array) & (array >= 0)).all():
        raise ValueError(f"expected {name} as a finite number of 0 or more, or three, got {value!r}")
    return array


def checked_curve(theta: ArrayLike, values: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The points of a drawn curve, (m,) and (m, 3).

    Parameters
    ----------
    theta
        (m,): radians, ascending, from 0 to pi / 2.
    values
        (m,) or (m, 3): finite, 0 or more.

    Returns
    -------
    theta, values
        As float64.

    Raises
    ------
    ValueError
        If they are anything else.
    """
    angles, drawn = real_array("theta", theta, np.float64), real_array("values", values, np.float64)
    if angles.ndim != 1 or not 2 <= len(angles) <= _MOST_POINTS:
        raise ValueError(f"expected theta as a list of 2 to {_MOST_POINTS:,} angles, got shape {angles.shape}")
    if drawn.shape not in (angles.shape, (len(angles), 3)):
        raise ValueError(f"expected a value, or three, for each of {len(angles)} angles, got shape {drawn.shape}")
    if not np.isfinite(angles).all() or not (np.diff(angles) > 0).all():
        raise ValueError("expected finite angles that ascend")
    if angles[0] < 0 or angles[-1] > np.pi / 2 + 1e-6:
        raise ValueError(f"expected radians from 0 to pi / 2, got {angles[0]:g} to {angles[-1]:g} (degrees?)")
    if not (np.isfinite(drawn) & (drawn >= 0)).all():
        raise ValueError("expected finite values of 0 or more")
    return angles, np.broadcast_to(drawn[:, None], (len(angles), 3)) if drawn.ndim == 1 else drawn


def sampled_reflectance(theta: ArrayLike, values: ArrayLike) -> NDArray[np.float64]:
    """A drawn reflectance at `COSINES`, (3, 512): linear between its points, level beyond them."""
    angles, drawn = checked_curve(theta, values)
    return np.stack([np.interp(np.arccos(COSINES), angles, drawn[:, k]) for k in range(3)])


def sampled_curve(theta: ArrayLike, values: ArrayLike) -> NDArray[np.float64]:
    """A drawn curve at the nodes, (256, 3): linear between its points, level beyond them."""
    angles, drawn = checked_curve(theta, values)
    return np.stack([np.interp(ANGLES, angles, drawn[:, k]) for k in range(3)], axis=1)
