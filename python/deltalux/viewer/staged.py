"""A studio: lamps that are moved and materials that are edited, under global illumination."""

from __future__ import annotations

import threading
from collections.abc import Mapping, Sequence, Set
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..checks import Vector, as_vector, one_of
from ..edit.studio import Studio, StudioFrame
from ..io import auto_exposure
from ..light.lamps import AreaLight, Lamp, PointLight, Spot
from ..transport.studio import StudioTransport
from ..update.methods import Method
from .messages import checked_keys, number, vector
from .relit import camera_words
from .subject import Layer, Shot, Subject

__all__ = ["Staged"]

_KINDS = ("point", "spot", "area")
_KEYS = ("id", "kind", "position", "target", "angle", "size", "intensity")
_MOST_LAMPS, _FAR, _BRIGHT = 16, 1e9, 1e9
_LOOK = ("gamma", "k_s", "k_d", "colour")
_START = {"k_s": [0.3, 0.3, 0.3], "k_d": [1.0, 1.0, 1.0], "colour": None}


@dataclass(frozen=True)
class _Lamp:
    """A lamp as a page sets it."""

    id: str
    kind: str
    position: Vector
    target: Vector
    angle: float
    size: float
    intensity: Vector

    @staticmethod
    def of(value: Any) -> _Lamp:
        found = checked_keys("a lamp", value, _KEYS)
        one_of("the kind of a lamp", found.get("kind"), _KINDS)
        name = found.get("id")
        if not isinstance(name, str) or not 0 < len(name) <= 24:
            raise ValueError("expected the id of a lamp, of at most 24 letters")
        position = vector("a position", found.get("position"), -_FAR, _FAR)
        target = vector("a target", found.get("target", [0.0, 0.0, 0.0]), -_FAR, _FAR)
        if found["kind"] != "point" and position == target:
            raise ValueError("expected a lamp to stand elsewhere than what it shines at")
        return _Lamp(
            name,
            found["kind"],
            position,
            target,
            number("an angle", found.get("angle", 30.0), 0.1, 90.0),
            number("a size", found.get("size", 0.1), 1e-9, _FAR),
            vector("an intensity", found.get("intensity", [1.0, 1.0, 1.0]), 0.0, _BRIGHT),
        )

    def to_json(self) -> dict[str, Any]:
        return {key: getattr(self, key) for key in _KEYS}

    @property
    def lamp(self) -> Lamp:
        """As the studio takes it; an area light is a square of this edge, which gives this intensity straight ahead."""
        if self.kind == "point":
            return PointLight(self.position, self.intensity)
        if self.kind == "spot":
            return Spot(self.position, self.target, self.intensity, self.angle)
        axis = np.subtract(self.target, self.position) / np.linalg.norm(np.subtract(self.target, self.position))
        helper = np.eye(3)[int(np.argmin(np.abs(axis)))]
        u = np.cross(axis, helper)
        u *= self.size / np.linalg.norm(u)
        # u x v is along the axis.
        v = np.cross(axis, u)
        corner = np.asarray(self.position) - (u + v) / 2
        return AreaLight(
            as_vector(corner), as_vector(u), as_vector(v), as_vector(np.array(self.intensity) / self.size**2)
        )

    def in_python(self) -> str:
        """As a program makes it."""
        lamp = self.lamp
        if isinstance(lamp, AreaLight):
            return f"dl.AreaLight({lamp.corner!r}, {lamp.u!r}, {lamp.v!r}, {lamp.radiance!r})"
        if isinstance(lamp, Spot):
            return f"dl.Spot({self.position!r}, {self.target!r}, {self.intensity!r}, {self.angle!r})"
        return f"dl.PointLight({self.position!r}, {self.intensity!r})"


class Staged(Subject):
    """A transport of a studio.

    Parameters
    ----------
    transport
        To be seen.
    method
        How light that moves is sent, as for `Studio`; None: all of it in every frame.
    name
        Of the transport: where it lies.
    """

    kind = "studio"

    def __init__(self, transport: StudioTransport, method: Method | None, name: str) -> None:
        self.name, self.transport = name, transport
        self.studio = Studio(transport, method)
        self._lock = threading.Lock()
        self._materials: dict[str, dict[str, Any]] = {
            own: {"gamma": part.family.range[0], **_START} for own, part in transport.parts.items()
        }
        self._editing: str | None = None
        self._lamps: tuple[_Lamp, ...] = (_first_lamp(transport),)
        self.studio.set_lights([own.lamp for own in self._lamps])

    def about(self) -> dict[str, Any]:
        transport, camera, memory = self.transport, self.transport.camera, self.transport.nbytes
        return {
            "kind": self.kind,
            "width": camera.width,
            "height": camera.height,
            "camera": camera_words(camera),
            "facts": [
                ["receivers", f"{len(transport.pixels):,} in {camera.width} x {camera.height} pixels"],
                ["gather samples", f"{len(transport.albedo):,}"],
                ["bounces", str(transport.passes + 1)],
                ["size", f"{memory / 1e6:.1f} MB"],
            ],
            "columns": None,
            "methods": [],
            "weights": [],
            "materials": [
                {
                    "name": own,
                    "kind": "family",
                    "model": str(part.family.model),
                    "parameters": [
                        {"name": "gamma", "low": part.family.range[0], "high": part.family.range[1], "log": True}
                    ],
                }
                for own, part in transport.parts.items()
            ],
        }

    def state(self) -> dict[str, Any]:
        return {
            "materials": self._materials,
            "editing": self._editing,
            "lamps": [own.to_json() for own in self._lamps],
        }

    def take(self, patch: Mapping[str, Any]) -> dict[str, Any]:
        checked_keys("the state", dict(patch), ("materials", "editing", "lamps"))
        with self._lock:
            editing = patch.get("editing", self._editing)
            if editing is not None:
                one_of("the material that is edited", editing, tuple(self._materials))
            lamps = self._lamps
            if "lamps" in patch:
                given: Sequence[Any] = patch["lamps"] if isinstance(patch["lamps"], list) else [None]
                if len(given) > _MOST_LAMPS:
                    raise ValueError(f"expected at most {_MOST_LAMPS} lamps, got {len(given)}")
                lamps = tuple(_Lamp.of(own) for own in given)
            changes = self._changes(patch.get("materials", {}), editing)
            if "lamps" in patch:
                self.studio.set_lights([own.lamp for own in lamps])
            if editing != self._editing:
                self.studio.light_mode() if editing is None else self.studio.edit(editing)
            for name, own in changes.items():
                with self._remarking():
                    self.studio.set(name, **own)
                self._materials[name] = {**self._materials[name], **{k: _words(v) for k, v in own.items()}}
            self._lamps, self._editing = lamps, editing
            return {key: self.state()[key] for key in patch}

    def _changes(self, value: Any, editing: str | None) -> dict[str, dict[str, Any]]:
        """What of the materials differs from what they are, checked."""
        changes: dict[str, dict[str, Any]] = {}
        for name, own in checked_keys("materials", value, tuple(self._materials)).items():
            known, asked = self._materials[name], checked_keys(name, own, _LOOK)
            found: dict[str, Any] = {}
            for key in asked:
                if asked[key] == known[key]:
                    continue
                if key == "gamma":
                    if name != editing:
                        raise ValueError(f"expected {name} to be edited when its gamma moves")
                    found[key] = number("gamma", asked[key], *self.transport.parts[name].family.range)
                elif asked[key] is not None:
                    found[key] = vector(key, asked[key], 0.0, 1.0)
            if found:
                changes[name] = found
        return changes

    def step(self, layers: Set[str], rests: bool) -> Shot:
        with self._lock:
            frame = self.studio.step()
        picture = frame.image
        stats = {
            "seconds": frame.seconds,
            "choosing": frame.traced,
            "multiplying": frame.solved + frame.sent,
            "columns": len(self.transport.weights),
            "converged": frame.converged,
            "late": False,
            "pending": None if frame.converged else frame.bound,
            "truncation": frame.bound if frame.converged else None,
        }
        words = {"a": stats, "b": None, "auto": auto_exposure(picture[::4, ::4])}
        return Shot({"a": picture}, words, frame.converged, frame)

    def picture(self, shot: Shot) -> Layer:
        frame: StudioFrame = shot.of
        return frame.image

    def python(self, view: Mapping[str, Any]) -> str:
        lines = ["import deltalux as dl", "", f"studio = dl.Studio(dl.StudioTransport.open({self.name!r}))"]
        lines.append(f"studio.set_lights([{', '.join(own.in_python() for own in self._lamps)}])")
        # The one that is edited comes last, so that it stays live.
        for name in sorted(self._materials, key=lambda own: own == self._editing):
            own = self._materials[name]
            words = ", ".join(f"{key}={own[key]!r}" for key in _LOOK if own[key] is not None)
            lines += [f"studio.edit({name!r})", f"studio.set({name!r}, {words})"]
        if self._editing is None:
            lines.append("studio.light_mode()")
        lines += [
            "frame = studio.step()",
            "while not frame.converged:",
            "    frame = studio.step()",
            f"dl.write('view.png', frame.image, exposure={view['exposure']:.3f}, tone={view['tone']!r})",
            "",
        ]
        return "\n".join(lines)


def _words(value: Any) -> Any:
    return list(value) if isinstance(value, tuple) else value


def _first_lamp(transport: StudioTransport) -> _Lamp:
    """A lamp to begin with: between the eye and what it sees, near the top."""
    places = transport.pixels.position.astype(np.float64)
    low, high = places.min(axis=0), places.max(axis=0)
    middle = (low + high) / 2
    place = 0.5 * middle + 0.5 * np.asarray(transport.camera.target)
    place[1] = low[1] + 0.8 * (high[1] - low[1])
    size = float(np.linalg.norm(high - low))
    bright = 0.5 * size**2
    target = (float(middle[0]), float(low[1]), float(middle[2]))
    return _Lamp("lamp-1", "point", as_vector(place), target, 40.0, 0.1 * size, (bright, bright, bright))
