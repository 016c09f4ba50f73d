"""Materials: what share of its light a surface reflects, diffusely and in a lobe."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from .. import brdf
from ..brdf import Measured, Model
from ..checks import Vector, real_array
from ..mistakes import suggests_keywords

__all__ = ["BRIGHTEST", "Lobe", "Material", "decoded", "encoded"]

Lobe: TypeAlias = Model | Measured
"""What a glossy material reflects by."""

_KINDS: tuple[type[Model], ...] = (
    brdf.Lambert,
    brdf.Phong,
    brdf.BlinnPhong,
    brdf.Ward,
    brdf.WardDuer,
    brdf.Lafortune,
    brdf.CookTorrance,
    brdf.Beckmann,
    brdf.GGX,
    brdf.AshikhminShirley,
)
"""By their numbers in files: new ones at the end."""
_NUMBERS = 8
"""Parameters of a model in a file; those left over, and those that are None, are -1."""
_NOTHING = -1.0


@suggests_keywords
@dataclass(frozen=True)
class Material:
    """A diffuse surface, with a glossy lobe over it or a measured one instead; it may give off light.

    What is reflected is ``albedo / pi + specular * model``. Both are colours, and stay outside M: rows of a glossy
    material are grey, a diffuse one and one of the lobe. What is given off does not move with the light: it is added to
    pictures as a term of its own (`Transport.emitted`).

    Parameters
    ----------
    albedo
        Linear diffuse reflectance in [0, 1], a number or three; without effect under a `Measured` model, which holds
        all that the surface reflects.
    specular
        What the lobe is multiplied by, in [0, 1], a number or three; by default 1 with a model and 0 without.
    model
        Of `deltalux.brdf`; None: diffuse. Anisotropic lobes have their x along the tangent of the mesh, or where it has
        none along the one that Duff et al. (2017) give to the normal.
    emission
        Linear radiance that it gives off to both sides, in the unit of the environment: a number or three, at least 0.

    Raises
    ------
    ValueError
        If a colour is out of range, or a specular colour has no model.
    """

    albedo: float | Sequence[float] = (0.5, 0.5, 0.5)
    specular: float | Sequence[float] | None = None
    model: Lobe | None = None
    emission: float | Sequence[float] = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        if self.model is not None and not isinstance(self.model, (Model, Measured)):
            raise ValueError(f"expected a model of dl.brdf such as dl.brdf.GGX(alpha=0.2), got {self.model!r}")
        object.__setattr__(self, "albedo", _colour("albedo", self.albedo))
        given = self.specular is not None
        specular = _colour("specular", self.specular if given else float(self.model is not None))
        if self.model is None and any(specular):
            raise ValueError(f"expected a model for the specular colour {specular}, got none")
        object.__setattr__(self, "specular", specular)
        object.__setattr__(self, "emission", _colour("emission", self.emission, BRIGHTEST))


def is_anisotropic(model: Lobe | None) -> bool:
    """Whether a lobe is not the same when it is turned about the normal."""
    if isinstance(model, brdf.AshikhminShirley):
        return model.exponent_v not in (None, model.exponent)
    if isinstance(model, brdf.Lafortune):
        return model.coefficients[0] != model.coefficients[1]
    if isinstance(model, (brdf.Ward, brdf.WardDuer, brdf.Beckmann, brdf.GGX)):
        return model.alpha_v not in (None, model.alpha)
    return isinstance(model, Measured)


BRIGHTEST = 1e12
"""Radiance that a surface may give off: far above suns, and its sums are finite."""


def _colour(name: str, value: Any, most: float = 1.0) -> Vector:
    array = real_array(name, value, np.float64)
    if array.shape not in ((), (3,)) or not ((array >= 0) & (array <= most)).all():
        raise ValueError(f"expected {name} to be a number or three in [0, {most:g}], got {value!r}")
    r, g, b = (float(x) for x in np.broadcast_to(array, 3))
    return r, g, b


def mean_albedo(model: Lobe) -> npt.NDArray[np.float64]:
    """What a lobe reflects in the mean over the directions of an even sky: (3,), as it reflects to a cosine of 2/3."""
    return np.broadcast_to(model.albedo((np.sqrt(5.0) / 3.0, 0.0, 2.0 / 3.0)), 3)


def encoded(models: Sequence[Model | None]) -> dict[str, np.ndarray]:
    """Models as arrays for a file: their kinds, counted from 1, 0 for none, and their parameters."""
    kinds = [0 if model is None else 1 + _KINDS.index(type(model)) for model in models]
    numbers = np.full((len(models), _NUMBERS), _NOTHING)
    for row, model in zip(numbers, models, strict=True):
        own = [] if model is None else [getattr(model, parameter.name) for parameter in fields(model)]  # type: ignore[arg-type]
        flat = [x for value in own for x in (value if isinstance(value, tuple) else (value,))]
        row[: len(flat)] = [_NOTHING if x is None else x for x in flat]
    return {"models": np.array(kinds, np.uint32), "parameters": numbers}


def decoded(kinds: np.ndarray, numbers: np.ndarray) -> tuple[Model | None, ...]:
    """Models from the arrays of a file, whoever wrote it; ValueError where they are none."""
    if kinds.max(initial=0) > len(_KINDS) or numbers.shape != (len(kinds), _NUMBERS):
        raise ValueError(f"expected models from 0 to {len(_KINDS)}, of {_NUMBERS} parameters each")
    return tuple(_decoded(int(kind), row.tolist()) for kind, row in zip(kinds, numbers, strict=True))


def _decoded(kind: int, numbers: list[float]) -> Model | None:
    if kind == 0:
        return None
    make, values = _KINDS[kind - 1], iter(numbers)
    own: dict[str, Any] = {}
    for parameter in fields(make):  # type: ignore[arg-type]
        several = isinstance(parameter.default, tuple)
        taken = [next(values) for _ in range(len(parameter.default) if several else 1)]  # type: ignore[arg-type]
        own[parameter.name] = tuple(taken) if several else None if taken[0] == _NOTHING else taken[0]
    return make(**own)
