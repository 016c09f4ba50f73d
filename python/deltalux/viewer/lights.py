"""The light as it is set by hand: environments, lamps and paint, each a group with gain, tint, mute and solo."""

from __future__ import annotations

import math
import re
import threading
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from ..checks import Vector
from ..light.discs import FACE, dabbed
from ..light.environment import Environment
from .messages import checked_keys, number, vector

__all__ = ["Dab", "Group", "Lights"]

Dab = tuple[float, float, float, Vector]
"""Azimuth, elevation and radius in degrees, and the colour of the paint."""

_MOST_GROUPS, _MOST_DABS = 16, 20_000
_STOPS, _FARTHEST, _BRIGHTEST = 20.0, 36_000.0, 1e6
_SHARED = ("id", "kind", "gain", "tint", "mute", "solo")
_OWN = {"environment": ("source", "turn"), "lamp": ("azimuth", "elevation", "radius"), "paint": ("cleared",)}


@dataclass(frozen=True)
class Group:
    """One light among others."""

    id: str
    kind: str
    gain: float = 0.0
    """Stops."""
    tint: Vector = (1.0, 1.0, 1.0)
    mute: bool = False
    solo: bool = False
    source: str = ""
    turn: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 1.0)
    """Of an environment, a unit quaternion x, y, z, w."""
    azimuth: float = 0.0
    elevation: float = 0.0
    radius: float = 0.0
    cleared: int = 0
    """So many of the first dabs of paint are not shown: wiped away, and there again when that is undone."""

    @staticmethod
    def of(value: Any, sources: Sequence[str]) -> Group:
        """A group as a message has it."""
        kind = value.get("kind") if isinstance(value, dict) else None
        if not isinstance(kind, str) or kind not in _OWN:
            raise ValueError(f"expected groups of light of {', '.join(_OWN)}, got {str(value)[:60]}")
        found = checked_keys("a group", value, (*_SHARED, *_OWN[kind]))
        group = Group(
            id=_id(found.get("id")),
            kind=kind,
            gain=number("a gain in stops", found.get("gain", 0.0), -_STOPS, _STOPS),
            tint=vector("a tint", found.get("tint", [1.0, 1.0, 1.0]), 0.0, 1.0),
            mute=found.get("mute") is True,
            solo=found.get("solo") is True,
        )
        if kind == "environment":
            return replace(group, source=one_of(found.get("source"), sources), turn=_unit(found.get("turn")))
        if kind == "lamp":
            return replace(
                group,
                azimuth=number("an azimuth", found.get("azimuth"), -_FARTHEST, _FARTHEST),
                elevation=number("an elevation", found.get("elevation"), -90.0, 90.0),
                radius=number("a radius in degrees", found.get("radius"), 0.1, 90.0),
            )
        return replace(group, cleared=int(number("how many dabs are cleared", found.get("cleared", 0), 0, _MOST_DABS)))

    def to_json(self) -> dict[str, Any]:
        """As `of` takes it."""
        return {name: getattr(self, name) for name in (*_SHARED, *_OWN[self.kind])}

    @property
    def angle(self) -> tuple[float, Vector]:
        """How far an environment is turned, in degrees, and about which axis."""
        x, y, z, w = self.turn
        length = math.sqrt(x * x + y * y + z * z)
        if length < 1e-12:
            return 0.0, (0.0, 1.0, 0.0)
        degrees = math.degrees(2.0 * math.atan2(length, w))
        return degrees, (x / length, y / length, z / length)

    @property
    def factors(self) -> Vector:
        """What the light is multiplied by in each colour."""
        gain = 2.0**self.gain
        return (gain * self.tint[0], gain * self.tint[1], gain * self.tint[2])


class Canvas:
    """A map that is painted on: only new dabs are drawn."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._dabs: tuple[Dab, ...] = ()
        self._map = np.zeros((6, FACE, FACE, 3), np.float32)
        self._env = Environment.from_cubemap(self._map)

    def environment(self, dabs: tuple[Dab, ...]) -> Environment:
        """What these dabs leave on black, as `Environment.painted`."""
        with self._lock:
            if dabs != self._dabs:
                known = len(self._dabs)
                if dabs[:known] != self._dabs:
                    known, self._map = 0, np.zeros_like(self._map)
                for azimuth, elevation, radius, colour in dabs[known:]:
                    self._map = dabbed(self._map, [(azimuth, elevation)], radius, np.asarray(colour, np.float32))
                self._dabs, self._env = dabs, Environment.from_cubemap(self._map)
            return self._env


@dataclass(frozen=True)
class Lights:
    """All groups of a view.

    Attributes
    ----------
    sources
        Environments that groups may name.
    groups
        In the order of the panel.
    blend
        The environment that the first one fades to, and how far it has.
    dabs
        What brushes left, by group.
    """

    sources: Mapping[str, Environment] = field(repr=False)
    groups: tuple[Group, ...]
    blend: tuple[str | None, float] = (None, 0.0)
    dabs: Mapping[str, tuple[Dab, ...]] = field(default_factory=dict, repr=False)
    paths: Mapping[str, str] = field(default_factory=dict, repr=False)
    """Where the files of sources lie, which programs and commands name."""
    canvases: dict[str, Canvas] = field(default_factory=dict, repr=False, compare=False)
    """What is painted so far, shared by all that come of one another."""

    def changed(self, value: Any) -> Lights:
        """The lights that a message asks for; paint stays where its group does."""
        found = checked_keys("light", value, ("groups", "blend"))
        groups = self.groups
        if "groups" in found:
            given = found["groups"]
            if not isinstance(given, list) or len(given) > _MOST_GROUPS:
                raise ValueError(f"expected a list of at most {_MOST_GROUPS} groups of light")
            groups = tuple(Group.of(own, tuple(self.sources)) for own in given)
            if len({own.id for own in groups}) < len(groups):
                raise ValueError("expected groups of light with ids of their own")
        blend = self.blend
        if "blend" in found:
            words = checked_keys("a blend", found["blend"], ("source", "t"))
            source = words.get("source")
            blend = (
                None if source is None else one_of(source, tuple(self.sources)),
                number("a blend", words.get("t", 0.0), 0.0, 1.0),
            )
        painted = {own.id for own in groups if own.kind == "paint"}
        return replace(self, groups=groups, blend=blend, dabs={k: own for k, own in self.dabs.items() if k in painted})

    def painted(self, value: Any) -> Lights:
        """With further dabs of a brush."""
        found = checked_keys("paint", value, ("id", "points", "radius", "colour"))
        name, points = self._paint(found.get("id")), found.get("points")
        radius = number("a radius of paint", found.get("radius"), 0.1, 90.0)
        colour = vector("a colour of paint", found.get("colour"), 0.0, _BRIGHTEST)
        before = self.dabs.get(name, ())
        if not isinstance(points, list) or len(points) + len(before) > _MOST_DABS:
            raise ValueError(f"expected a list of dabs, of which a group has at most {_MOST_DABS}")
        dabs = []
        for point in points:
            if not isinstance(point, list) or len(point) != 2:
                raise ValueError("expected dabs as pairs of an azimuth and an elevation")
            azimuth = number("an azimuth", point[0], -_FARTHEST, _FARTHEST)
            dabs.append((azimuth, number("an elevation", point[1], -90.0, 90.0), radius, colour))
        return replace(self, dabs={**self.dabs, name: (*before, *dabs)})

    def unpainted(self, value: Any) -> Lights:
        """Without the paint that a group has by now."""
        name = self._paint(value)
        cleared = len(self.dabs.get(name, ()))
        return replace(
            self, groups=tuple(replace(own, cleared=cleared) if own.id == name else own for own in self.groups)
        )

    def shown(self, group: Group) -> tuple[Dab, ...]:
        """What of a group's paint has not been cleared."""
        return self.dabs.get(group.id, ())[group.cleared :]

    def _paint(self, value: Any) -> str:
        name = _id(value)
        if not any(own.id == name and own.kind == "paint" for own in self.groups):
            raise ValueError(f"expected a group of paint, got {name!r}")
        return name

    @property
    def heard(self) -> tuple[Group, ...]:
        """The groups that give light: those that are alone, or all that are not muted."""
        alone = tuple(own for own in self.groups if own.solo)
        return alone or tuple(own for own in self.groups if not own.mute)

    def of_group(self, group: Group) -> Environment:
        """The light of one group by itself, before gain and tint."""
        if group.kind == "environment":
            env = self.sources[group.source]
            other, t = self.blend
            if other is not None and t > 0.0 and group.id == self._first:
                env = env.mixed(self.sources[other], t)
            degrees, axis = group.angle
            return env.rotated(degrees, axis) if degrees else env
        if group.kind == "lamp":
            return Environment.disc(group.azimuth, group.elevation, group.radius)
        return self.canvases.setdefault(group.id, Canvas()).environment(self.shown(group))

    @property
    def _first(self) -> str:
        return next((own.id for own in self.groups if own.kind == "environment"), "")

    @cached_property
    def environment(self) -> Environment:
        """The sum of all groups that are heard."""
        total: Environment | None = None
        for group in self.heard:
            if group.kind != "paint" or self.shown(group):
                own = self.of_group(group).tinted(group.factors)
                total = own if total is None else total + own
        # No light is a light as well, and a follower has to follow it.
        return _dark() if total is None else total

    def to_json(self) -> dict[str, Any]:
        """As `changed` takes it."""
        return {
            "groups": [own.to_json() for own in self.groups],
            "blend": {"source": self.blend[0], "t": self.blend[1]},
        }


def one_of(value: Any, names: Sequence[str]) -> str:
    """A name among others."""
    if not isinstance(value, str) or value not in names:
        raise ValueError(f"expected one of {', '.join(names)}, got {str(value)[:40]!r}")
    return value


def _id(value: Any) -> str:
    if not isinstance(value, str) or not re.fullmatch(r"[A-Za-z0-9-]{1,24}", value):
        raise ValueError("expected the id of a group, of at most 24 letters, digits or -")
    return value


def _unit(value: Any) -> tuple[float, float, float, float]:
    if value is None:
        return (0.0, 0.0, 0.0, 1.0)
    if not isinstance(value, list) or len(value) != 4:
        raise ValueError("expected a turn as four numbers")
    x, y, z, w = (number("a turn", own, -2.0, 2.0) for own in value)
    length = math.sqrt(x * x + y * y + z * z + w * w)
    if length < 1e-6:
        raise ValueError("expected a turn of a length above 0")
    return (x / length, y / length, z / length, w / length)


def _dark() -> Environment:
    return Environment.builtin("hall").scaled(0.0)
