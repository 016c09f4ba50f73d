"""Lamps: lights that stand in the scene and move at run time, with shadows."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._core import Lamp as CoreLamp
from ..checks import Vector, amount, as_vector, real_array
from ..sphere import face_points
from .environment import Environment

__all__ = ["AreaLight", "Lamp", "PointLight", "Spot", "far_lamps"]

_SIDE = 4
"""Places along each side of an area light; they are traced in `_SIDE` parts, of which each covers all of it."""
_FACE = 32
"""Texels along a face of the cubemap that an environment's directions are drawn from."""


def _vector(name: str, value: ArrayLike, least: float = -np.inf) -> Vector:
    """Three finite numbers; one stands for all."""
    array = real_array(name, value, np.float64)
    if array.shape not in ((), (3,)) or not np.isfinite(array).all() or (array < least).any():
        what = "finite numbers" if least == -np.inf else f"finite numbers >= {least:g}"
        raise ValueError(f"expected {name} to be three {what}, got {value!r}")
    return as_vector(np.broadcast_to(array, 3))


def _place(name: str, value: ArrayLike) -> Vector:
    if np.shape(value) != (3,):
        raise ValueError(f"expected {name} to be a point (x, y, z), got {value!r}")
    return _vector(name, value)


def _unit(name: str, vector: NDArray[np.float64]) -> NDArray[np.float64]:
    length = np.linalg.norm(vector)
    if length == 0:
        raise ValueError(f"expected {name} to have a direction, but both its ends are at one place")
    return np.asarray(vector / length, np.float64)


class Lamp:
    """What shines from somewhere: `PointLight`, `Spot` or `AreaLight`."""

    @cached_property
    def _parts(self) -> tuple[CoreLamp, ...]:
        """What is traced by itself; the light is the mean of so many as have been."""
        raise NotImplementedError


@dataclass(frozen=True)
class PointLight(Lamp):
    """A point that shines everywhere alike.

    Attributes
    ----------
    position
        In the scene's space.
    intensity
        Radiant intensity, W / sr with the scene's unit for a metre: red, green and blue, or one number.

    Raises
    ------
    ValueError
        If a number is not finite, or an intensity is negative.
    """

    position: ArrayLike
    intensity: ArrayLike = 1.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "position", _place("position", self.position))
        object.__setattr__(self, "intensity", _vector("intensity", self.intensity, 0.0))

    @cached_property
    def _parts(self) -> tuple[CoreLamp, ...]:
        return (CoreLamp(np.array([self.position]), np.array([self.intensity])),)


@dataclass(frozen=True)
class Spot(Lamp):
    """A point that shines into a cone.

    Attributes
    ----------
    position, target
        Where it stands, and what it points at.
    intensity
        Radiant intensity along its axis, as of `PointLight`.
    angle
        Degrees from the axis at which nothing is left, above 0 and at most 90.
    blend
        The share of the angle over which it falls, from 0 (a sharp cone) to 1; by the cosine, smoothly.

    Raises
    ------
    ValueError
        If a number is out of its range, or position and target are one.
    """

    position: ArrayLike
    target: ArrayLike
    intensity: ArrayLike = 1.0
    angle: float = 30.0
    blend: float = 0.15

    def __post_init__(self) -> None:
        for name in ("position", "target"):
            object.__setattr__(self, name, _place(name, getattr(self, name)))
        object.__setattr__(self, "intensity", _vector("intensity", self.intensity, 0.0))
        if not 0 < amount("angle", self.angle) <= 90:
            raise ValueError(f"expected angle in degrees above 0 and at most 90, got {self.angle!r}")
        if amount("blend", self.blend) > 1:
            raise ValueError(f"expected blend from 0 to 1, got {self.blend!r}")
        _unit("a spot", self._axis)

    @property
    def _axis(self) -> NDArray[np.float64]:
        return np.subtract(self.target, self.position)

    @cached_property
    def _parts(self) -> tuple[CoreLamp, ...]:
        inner, outer = np.cos(np.radians([self.angle * (1 - self.blend), self.angle]))
        axis = as_vector(_unit("a spot", self._axis))
        place, colour = np.array([self.position]), np.array([self.intensity])
        return (CoreLamp(place, colour, beam="cone", axis=axis, cosines=(float(inner), float(outer))),)


@dataclass(frozen=True)
class AreaLight(Lamp):
    """A parallelogram that shines to one side, as 16 places spread over it.

    Attributes
    ----------
    corner, u, v
        A corner of it and the two edges from there; it shines along u x v.
    radiance
        W / sr / m^2 in the scene's unit: red, green and blue, or one number.

    Raises
    ------
    ValueError
        If a number is not finite, a radiance is negative, or the edges span nothing.
    """

    corner: ArrayLike
    u: ArrayLike
    v: ArrayLike
    radiance: ArrayLike = 1.0

    def __post_init__(self) -> None:
        for name in ("corner", "u", "v"):
            object.__setattr__(self, name, _place(name, getattr(self, name)))
        object.__setattr__(self, "radiance", _vector("radiance", self.radiance, 0.0))
        _unit("u x v", self._across)

    @property
    def _across(self) -> NDArray[np.float64]:
        return np.cross(np.asarray(self.u, np.float64), np.asarray(self.v, np.float64))

    @cached_property
    def _parts(self) -> tuple[CoreLamp, ...]:
        across = self._across
        # A place in each cell of the grid, moved inside it as a small Latin square is: no row or column of places.
        i, j = (axis.ravel() for axis in np.meshgrid(np.arange(_SIDE), np.arange(_SIDE), indexing="ij"))
        share = (np.stack([i + (j + 0.5) / _SIDE, j + (i + 0.5) / _SIDE], axis=1)) / _SIDE
        places = np.asarray(self.corner) + share[:, :1] * np.asarray(self.u) + share[:, 1:] * np.asarray(self.v)
        each = np.tile(np.asarray(self.radiance) * np.linalg.norm(across) / _SIDE**2, (_SIDE, 1))
        axis = as_vector(_unit("u x v", across))
        # Part k takes the cells of one broken diagonal: one of every row and column.
        return tuple(CoreLamp(places[(i + j) % _SIDE == k], each, beam="facing", axis=axis) for k in range(_SIDE))


def far_lamps(env: Environment, count: int) -> tuple[CoreLamp, ...]:
    """An environment as directions: a part of the sphere for each, all of about the same flux.

    Parameters
    ----------
    env
        The light.
    count
        How many directions, a power of two.

    Returns
    -------
    tuple of one core lamp
        Empty where the environment is black.
    """
    cube = np.asarray(env.cubemap(_FACE), np.float64).reshape(-1, 3)
    directions, solid = _texels()
    flux = cube * solid[:, None]
    parts = [np.flatnonzero(flux.sum(axis=1) > 0)]
    if not parts[0].size:
        return ()
    # Halved at the median of the flux along the widest axis, as Debevec's median cut (2005).
    while len(parts) < count:
        halves = []
        for part in parts:
            if len(part) == 1:
                halves.append(part)
                continue
            at, weight = directions[part], flux[part].sum(axis=1)
            order = part[np.argsort(at[:, np.argmax(np.ptp(at, axis=0))], kind="stable")]
            sums = np.cumsum(flux[order].sum(axis=1))
            cut = int(np.clip(np.searchsorted(sums, 0.5 * weight.sum()) + 1, 1, len(order) - 1))
            halves += [order[:cut], order[cut:]]
        if len(halves) == len(parts):
            break
        parts = halves
    weights = [flux[part].sum(axis=1) for part in parts]
    towards = np.stack(
        [(directions[part] * weight[:, None]).sum(axis=0) for part, weight in zip(parts, weights, strict=True)]
    )
    towards /= np.linalg.norm(towards, axis=1, keepdims=True)
    return (CoreLamp(towards, np.stack([flux[part].sum(axis=0) for part in parts]), far=True),)


def _texels() -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Directions and solid angles of the cubemap's texels."""
    points = face_points(_FACE).reshape(-1, 3)
    distance = np.linalg.norm(points, axis=1, keepdims=True)
    return points / distance, (2 / _FACE) ** 2 / distance[:, 0] ** 3
