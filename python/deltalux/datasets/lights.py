"""Lights as lines of text, and the rule that draws them.

A light is a sum of layers: environments, each turned and times a gain, and discs, which are lamps. A line of JSON holds
one. `LightRule` draws the light of a number from the seed, that number and the environments, and from nothing else:
more lights, other workers and another order change none of them.
"""

from __future__ import annotations

import hashlib
import json
import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from ..checks import Vector, amount, as_vector, count, one_of, real_array
from ..light.environment import Environment
from ..light.skies import BUILTIN
from ..mistakes import described, near
from ..plain import MOST_TEXT, read_plain
from ..rotation import rotation_matrix

__all__ = ["ROTATIONS", "Layer", "LightRecipe", "LightRule", "Source", "read_recipes", "sources_of"]

ROTATIONS = ("none", "upright", "any")
"""How environments are turned: not at all, about the vertical, or any way."""

_UPRIGHT: Vector = (0.0, 1.0, 0.0)
_RADII = (0.5, 10.0)
"""Of lamps, in degrees."""
_SHARES = (0.25, 2.0)
"""What a lamp gives a surface that faces it, over what a sky of radiance 1 gives it."""
_WARM, _COLD = (1.3, 1.0, 0.7), (0.85, 1.0, 1.15)


@dataclass(frozen=True)
class Layer:
    """One part of a light.

    Attributes
    ----------
    environment
        A built-in light or a file; None: a disc.
    degrees, axis
        How it is turned, as for `Environment.rotated`.
    gain
        What it is multiplied by, in red, green and blue.
    disc
        Azimuth, elevation and radius in degrees, as for `Environment.disc`.

    Raises
    ------
    ValueError
        If it is both or neither, or a number is not finite.
    """

    environment: str | None = None
    degrees: float = 0.0
    axis: Vector = _UPRIGHT
    gain: Vector = (1.0, 1.0, 1.0)
    disc: Vector | None = None

    def __post_init__(self) -> None:
        if (self.environment is None) == (self.disc is None):
            raise ValueError(
                "expected a layer of an environment or of a disc, got " + ("both" if self.disc else "none")
            )
        if self.environment is not None and not isinstance(self.environment, str):
            raise ValueError(f"expected the name or the path of an environment, got {described(self.environment)}")
        for name in ("axis", "gain") if self.disc is None else ("axis", "gain", "disc"):
            object.__setattr__(self, name, _three(name, getattr(self, name)))
        rotation_matrix(self.degrees, self.axis)

    @property
    def matrix(self) -> list[list[float]]:
        """Of its rotation: what stood at d stands at R d."""
        turned: list[list[float]] = rotation_matrix(self.degrees, self.axis).tolist()
        return turned

    def _light(self, sources: Mapping[str, Source]) -> Environment:
        """The layer as light."""
        if self.disc is not None:
            return Environment.disc(*self.disc).rotated(self.degrees, self.axis).tinted(self.gain)
        return sources[str(self.environment)].opened().rotated(self.degrees, self.axis).tinted(self.gain)


def _three(name: str, values: Any) -> Vector:
    array = real_array(name, values, np.float64)
    if array.shape != (3,) or not np.isfinite(array).all():
        raise ValueError(f"expected {name} to be three finite numbers, got {values!r}")
    return as_vector(array)


@dataclass(frozen=True)
class LightRecipe:
    """A light that can be made again from a line of JSON.

    Attributes
    ----------
    layers
        Which add up.

    Raises
    ------
    ValueError
        If there are none.
    """

    layers: tuple[Layer, ...]

    def __post_init__(self) -> None:
        if not self.layers or not all(isinstance(layer, Layer) for layer in self.layers):
            raise ValueError(f"expected at least one layer, got {self.layers!r}")

    def to_json(self) -> str:
        """The light as a line, what is as usual left out.

        Returns
        -------
        str
        """
        usual = {name: own.default for name, own in Layer.__dataclass_fields__.items()}
        layers = [{k: v for k, v in asdict(layer).items() if v != usual[k]} for layer in self.layers]
        return json.dumps({"layers": layers}, sort_keys=True)

    @classmethod
    def from_json(cls, text: str) -> LightRecipe:
        """A light from its line.

        Parameters
        ----------
        text
            ``{"layers": [{"environment": "hall", "degrees": 30, "gain": [1, 1, 1]}, {"disc": [40, 20, 5]}]}``: the
            fields of `Layer`.

        Returns
        -------
        LightRecipe

        Raises
        ------
        ValueError
            If it is no such line.
        """
        try:
            layers = json.loads(text)["layers"]
            return cls(tuple(Layer(**layer) for layer in layers))
        except (KeyError, TypeError, RecursionError, json.JSONDecodeError) as error:
            raise ValueError(
                f"expected a light like {cls((Layer('hall'),)).to_json()}, got {text[:80]!r}: {error}"
            ) from None

    def light(self, sources: Mapping[str, Source] | None = None) -> Environment:
        """The light itself.

        Parameters
        ----------
        sources
            The environments by their names; None: they are looked up.

        Returns
        -------
        Environment

        Raises
        ------
        ValueError, OSError
            If an environment is not there, or not what it was.
        """
        known = sources_of([self]) if sources is None else sources
        return sum((layer._light(known) for layer in self.layers[1:]), self.layers[0]._light(known))


@dataclass(frozen=True)
class Source:
    """An environment that lights are made of: where it is, and what it was when it was looked up.

    Attributes
    ----------
    name
        A built-in light, or a path.
    sha256
        Of the file; None of a built-in light.
    """

    name: str
    sha256: str | None

    @classmethod
    def of(cls, name: str) -> Source:
        """The environment of a name or path, as it is now; ValueError or OSError where there is none."""
        if name in BUILTIN:
            return cls(name, None)
        if not Path(name).suffix and not os.path.exists(name):
            known = ", ".join(BUILTIN)
            raise ValueError(f"expected an environment of {known}, or a file, got {name!r}{near(name, BUILTIN)}")
        path = os.path.abspath(name)
        with open(path, "rb") as file:
            return cls(path, hashlib.file_digest(file, "sha256").hexdigest())

    def opened(self) -> Environment:
        """The light, read once a process."""
        return _opened(self)

    @property
    def level(self) -> float:
        """Its mean radiance over the sphere and the colours."""
        return float(self.opened().cubemap(1).mean(dtype=np.float64))


@lru_cache(maxsize=64)
def _opened(source: Source) -> Environment:
    if source.sha256 is None:
        return Environment.builtin(source.name)
    if Source.of(source.name) != source:
        raise ValueError(f"{source.name}: expected the file that the data set began with, found another one")
    return Environment.load(source.name)


def sources_of(recipes: Sequence[LightRecipe]) -> dict[str, Source]:
    """All environments that lights name, by those names."""
    names = {layer.environment for recipe in recipes for layer in recipe.layers if layer.environment is not None}
    return {name: Source.of(name) for name in sorted(names)}


@dataclass(frozen=True)
class LightRule:
    """How lights are drawn.

    Every light is an environment, turned and times a gain; some are two, of which one fades into the other; some have a
    lamp besides. Environments are brought to a mean radiance of 1 first, so that gains mean the same of all.

    Attributes
    ----------
    environments
        Names of built-in lights, or files; each as likely as the others.
    rotation
        ``"upright"``, by any angle about the vertical; ``"any"``, to anywhere; ``"none"``.
    stops
        Gains are from 2^-stops to 2^stops, evenly in stops.
    crossfades
        The share of lights that are two environments, from one to the other evenly.
    lamps
        The share of lights that have a lamp: a disc of 0.5 to 10 degrees above the horizon, warm or cold, which gives
        what faces it a quarter to twice of what an even sky of radiance 1 does.

    Raises
    ------
    ValueError
        If a word is unknown, or a number out of its range.
    """

    environments: tuple[str, ...] = tuple(BUILTIN)
    rotation: str = "upright"
    stops: float = 1.0
    crossfades: float = 0.5
    lamps: float = 0.5

    def __post_init__(self) -> None:
        names = (self.environments,) if isinstance(self.environments, str) else tuple(self.environments)
        if not names:
            raise ValueError("expected at least one environment to draw lights of, got none")
        object.__setattr__(self, "environments", names)
        one_of("rotation", self.rotation, ROTATIONS)
        for name, most in (("stops", 16.0), ("crossfades", 1.0), ("lamps", 1.0)):
            if amount(name, getattr(self, name)) > most:
                raise ValueError(f"expected {name} from 0 to {most:g}, got {getattr(self, name)!r}")

    def recipes(self, number: int, seed: int = 0) -> list[LightRecipe]:
        """The first so many lights.

        Parameters
        ----------
        number
            How many.
        seed
            Another one draws others.

        Returns
        -------
        list of LightRecipe

        Raises
        ------
        ValueError, OSError
            If a number is no whole one, or an environment is not there.
        """
        levels = [max(Source.of(name).level, 1e-30) for name in self.environments]
        return [self._drawn(count("seed", seed), k, levels) for k in range(count("number", number))]

    def _drawn(self, seed: int, k: int, levels: Sequence[float]) -> LightRecipe:
        # A number of its own for each property: who asks for no lamps gets the same environments.
        u = _uniform(seed, k, 18)
        gain = 2.0 ** (self.stops * (2.0 * u[4] - 1.0))
        first = self._environment(u[0], u[1:4], levels)
        layers = [_times(first, gain)]
        if u[5] < self.crossfades:
            second = self._environment(u[6], u[7:10], levels)
            layers = [_times(first, gain * (1.0 - u[10])), _times(second, gain * u[10])]
        if u[11] < self.lamps:
            layers.append(_lamp(u[12:17]))
        return LightRecipe(tuple(layers))

    def _environment(self, which: float, turn: Sequence[float], levels: Sequence[float]) -> Layer:
        place = int(which * len(self.environments))
        degrees, axis = {"none": (0.0, _UPRIGHT), "upright": (360.0 * turn[0], _UPRIGHT), "any": _any_way(turn)}[
            self.rotation
        ]
        return _times(Layer(self.environments[place], degrees, axis), 1.0 / levels[place])


def _times(layer: Layer, factor: float) -> Layer:
    return Layer(layer.environment, layer.degrees, layer.axis, as_vector(np.multiply(layer.gain, factor)), layer.disc)


def _any_way(u: Sequence[float]) -> tuple[float, Vector]:
    """A rotation, all alike (Shoemake, Graphics Gems III, 1992), as an angle and an axis."""
    s, t = math.sqrt(1.0 - u[0]), math.sqrt(u[0])
    a, b = 2.0 * math.pi * u[1], 2.0 * math.pi * u[2]
    w, axis = t * math.cos(b), (s * math.sin(a), s * math.cos(a), t * math.sin(b))
    return 2.0 * math.degrees(math.acos(min(max(w, -1.0), 1.0))), axis if any(axis) else _UPRIGHT


def _lamp(u: Sequence[float]) -> Layer:
    elevation = math.degrees(math.asin(u[1]))
    radius = _RADII[0] * (_RADII[1] / _RADII[0]) ** u[2]
    share = _SHARES[0] + (_SHARES[1] - _SHARES[0]) * u[3]
    angle = 2.0 * math.pi * (1.0 - math.cos(math.radians(radius)))
    colour = as_vector(((1.0 - u[4]) * np.array(_WARM) + u[4] * np.array(_COLD)) * share * math.pi / angle)
    return Layer(gain=colour, disc=(360.0 * u[0], elevation, radius))


def _uniform(seed: int, k: int, number: int) -> list[float]:
    """Numbers from 0 to 1 that belong to a seed and a light; raw bits, which numpy promises to keep."""
    bits = np.random.PCG64(np.random.SeedSequence([seed, k])).random_raw(number)
    return [float(x) for x in (np.asarray(bits, np.uint64) >> np.uint64(11)) * 2.0**-53]


def read_recipes(path: str | os.PathLike[str]) -> list[LightRecipe]:
    """Lights from a file of JSON Lines; ValueError names the line that is none, OSError where it cannot be read."""
    found = []
    for number, line in enumerate(read_plain(path, 16 * MOST_TEXT).decode("utf-8", "replace").splitlines(), 1):
        if line.strip():
            try:
                found.append(LightRecipe.from_json(line))
            except ValueError as error:
                raise ValueError(f"{os.fspath(path)}, line {number}: {error}") from None
    if not found:
        raise ValueError(f"{os.fspath(path)}: expected a light on every line, found none")
    return found
