"""A transport under a light that is moved by hand, of pixels or of vertices."""

from __future__ import annotations

import threading
import time
from collections.abc import Mapping, Set
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._core import haar_inverse, haar_without_texels
from ..camera import Camera
from ..checks import one_of
from ..columns.haar import Haar
from ..columns.harmonics import SphericalHarmonics
from ..io import auto_exposure
from ..light.environment import Environment
from ..relight.errors import relative_errors
from ..relight.relighter import Frame, Relighter
from ..sphere import latlong_directions
from ..transport.transport import Transport
from ..update.methods import WEIGHTS, Method
from .lights import Lights
from .messages import checked_keys, number, vector
from .methods import Chosen, Methods
from .subject import Exact, Layer, Shot, Subject
from .wavelets import squares
from .words import light_in_python, render_command

__all__ = ["Relit"]

BACKGROUNDS = ("env", "blur", "grey", "none")
_GREY, _BLUR = 0.18, 8
_SQUARES = 300
_STRIP = (64, 128)
_LEAST = 512
"""Pixels along the longer edge of a picture of vertices."""


@dataclass(frozen=True)
class _Asked:
    """What is set, as one frame sees it."""

    lights: Lights
    a: Chosen
    b: Chosen | None
    background: str
    camera: Camera | None
    at: float
    """When the light was last set."""


@dataclass(frozen=True)
class _Shown:
    """What a shot was made of."""

    asked: _Asked
    env: Environment
    a: Frame
    b: Frame | None
    values: NDArray[np.float64]
    """V as applied."""


class Relit(Subject):
    """A transport of pixels or vertices.

    Parameters
    ----------
    transport
        To be seen.
    lights
        To begin with.
    method
        To begin with.
    own
        Methods of one's own, by name.
    name
        Of the transport: where it lies.
    """

    def __init__(
        self,
        transport: Transport,
        lights: Lights,
        method: Method,
        own: Mapping[str, type[Method]],
        name: str,
    ) -> None:
        self.transport, self.name = transport, name
        self.kind = transport.receivers.kind
        if self.kind not in ("pixels", "vertices"):
            raise ValueError(f"expected a transport of pixels or vertices to look at, but its rows are {self.kind}")
        self.methods = Methods(isinstance(transport.columns, SphericalHarmonics), own)
        camera = _large(transport.camera) if self.kind == "vertices" else None
        self._lock = threading.Lock()
        self._asked = _Asked(lights, self.methods.naming(method), None, "env", camera, time.monotonic())
        self._relighters: dict[str, tuple[Method, Relighter]] = {}
        self._rested = 0.0

    # What is set.

    def about(self) -> dict[str, Any]:
        transport, camera = self.transport, self.transport.camera
        rows, columns = transport.shape
        haar = transport.columns if isinstance(transport.columns, Haar) else None
        facts = [
            ["receivers", f"{rows:,} {self.kind}"],
            ["columns", f"{columns:,} ({transport.columns})"],
            ["size", f"{transport.nbytes / 1e6:.1f} MB"],
            ["channels", str(transport.channels)],
        ]
        return {
            "kind": self.kind,
            "width": camera.width,
            "height": camera.height,
            "camera": camera_words(camera),
            "facts": facts,
            "columns": {
                "count": columns,
                "size": None if haar is None else haar.size,
                "bands": list(transport.columns.band_names),
                "label": transport.columns.band_label,
            },
            "methods": self.methods.listed(),
            "weights": list(WEIGHTS),
            "backgrounds": list(BACKGROUNDS),
            "materials": [],
        }

    def state(self) -> dict[str, Any]:
        return self._words(self._asked, ("light", "method", "background", "camera"))

    def _words(self, asked: _Asked, keys: Set[str] | tuple[str, ...]) -> dict[str, Any]:
        words: dict[str, Any] = {
            "light": asked.lights.to_json(),
            "method": {"a": asked.a.to_json(), "b": None if asked.b is None else asked.b.to_json()},
            "background": asked.background,
        }
        if asked.camera is not None:
            words["camera"] = camera_words(asked.camera)
        return {key: value for key, value in words.items() if key in keys}

    def take(self, patch: Mapping[str, Any]) -> dict[str, Any]:
        checked_keys("the state", dict(patch), ("light", "method", "background", "camera"))
        with self._lock:
            asked = self._asked
            if "light" in patch:
                asked = replace(asked, lights=asked.lights.changed(patch["light"]), at=time.monotonic())
            if "method" in patch:
                found = checked_keys("methods", patch["method"], ("a", "b"))
                b = found.get("b")
                asked = replace(asked, a=self.methods.of(found.get("a")), b=None if b is None else self.methods.of(b))
            if "background" in patch:
                one_of("a background", patch["background"], BACKGROUNDS)
                asked = replace(asked, background=patch["background"])
            if "camera" in patch and asked.camera is not None:
                asked = replace(asked, camera=camera_of(asked.camera, patch["camera"]))
            self._asked = asked
            return self._words(asked, set(patch))

    def paint(self, change: str, value: Any) -> None:
        """Further dabs, or none any more."""
        with self._lock:
            lights = self._asked.lights
            lights = lights.painted(value) if change == "paint" else lights.unpainted(value)
            self._asked = replace(self._asked, lights=lights, at=time.monotonic())

    @property
    def lights(self) -> Lights:
        """As they are set."""
        return self._asked.lights

    @lights.setter
    def lights(self, lights: Lights) -> None:
        with self._lock:
            self._asked = replace(self._asked, lights=lights, at=time.monotonic())

    def finer(self, transport: Transport, name: str) -> Relit:
        """Another transport of the same scene, under all that is set."""
        asked = self._asked
        other = Relit(transport, asked.lights, asked.a.method, {}, name)
        other.methods = self.methods
        other._asked = replace(asked, camera=other._asked.camera and asked.camera)
        return other

    @property
    def method(self) -> Method:
        """The one that is seen first."""
        return self._asked.a.method

    @method.setter
    def method(self, method: Method) -> None:
        with self._lock:
            self._asked = replace(self._asked, a=self.methods.naming(method))

    # Frames.

    def step(self, layers: Set[str], rests: bool) -> Shot:
        asked = self._asked
        began = time.perf_counter()
        env = asked.lights.environment
        # Once for each light: suns and lamps in texel columns follow by and by.
        whole = rests and self._rested != asked.at
        if whole:
            self._rested = asked.at
        a, relighter = self._frame("a", asked.a, env, whole)
        b = None if asked.b is None else self._frame("b", asked.b, env, whole)[0]
        shown = _Shown(asked, env, a, b, relighter.values)
        found = {"a": self._layer(a.values, shown)}
        if b is not None and "b" in layers:
            found["b"] = self._layer(b.values, shown)
        if "bound" in layers:
            found["bound"] = self._resolved(relighter.bounds(a))
        stats = {
            "a": self._stats(asked.a, a, time.perf_counter() - began),
            "b": None if asked.b is None or b is None else self._stats(asked.b, b, b.seconds),
            "auto": auto_exposure(found["a"][::4, ::4] if self.kind == "pixels" else found["a"][::16, None]),
        }
        return Shot(found, stats, a.converged and (b is None or b.converged), shown)

    def _frame(self, slot: str, chosen: Chosen, env: Environment, whole: bool) -> tuple[Frame, Relighter]:
        known = self._relighters.get(slot)
        # A new follower begins with the whole product.
        if known is None or known[0] != chosen.method or whole:
            known = self._relighters[slot] = (chosen.method, Relighter(self.transport, chosen.method))
        return known[1].step(env), known[1]

    def _stats(self, chosen: Chosen, frame: Frame, seconds: float) -> dict[str, Any]:
        bound, relative = frame.bound, frame.bound.relative
        columns = self.transport.columns
        budget = chosen.method.milliseconds
        return {
            "seconds": frame.seconds,
            "choosing": frame.choosing,
            "multiplying": frame.multiplying,
            "whole": seconds,
            "columns": len(frame.columns),
            "resets": list(frame.resets),
            "converged": frame.converged,
            "late": budget is not None and 1e3 * frame.seconds > budget,
            "pending": bound.pending,
            "truncation": bound.truncation,
            "relative_pending": relative.pending,
            "relative_truncation": relative.truncation,
            "estimate": bound.estimate,
            "sent": squares(columns, frame.columns, _SQUARES) if isinstance(columns, Haar) else [],
        }

    def _layer(self, values: NDArray[np.float32], shown: _Shown) -> Layer:
        if self.kind == "vertices":
            return self.transport.colours(values)
        return self.transport.image(values, self._behind(shown))

    def _resolved(self, values: NDArray[np.float32]) -> Layer:
        """A bound as the pixels show it: on black."""
        if self.kind == "vertices":
            return self.transport.albedo[: len(self.transport._views.shown)] * values[self.transport._views.shown]
        return self.transport.pixels.resolve(values)

    def _behind(self, shown: _Shown) -> Environment | None:
        word = shown.asked.background
        if word == "blur":
            return Environment.from_cubemap(shown.env.cubemap(_BLUR))
        if word == "grey":
            return _even()
        return shown.env if word == "env" else None

    # What goes on beside frames.

    def exact(self, shot: Shot) -> Exact | None:
        shown: _Shown = shot.of
        values = self.transport.multiply(self.transport.coefficients(shown.env))
        albedo = self.transport.albedo
        errors = [
            None if frame is None else relative_errors(albedo * frame.values, albedo * values)[1]
            for frame in (shown.a, shown.b)
        ]
        return Exact(self._layer(values, shown), errors[0] or 0.0, errors[1], shown.asked.at, shot.number)

    def maps(self, shot: Shot) -> dict[str, Layer]:
        columns, shown = self.transport.columns, shot.of
        if not isinstance(columns, Haar):
            return {}
        applied = shown.values
        if columns.texels:
            applied = haar_without_texels(columns.size, applied)
        return {
            "asked": shown.env.cubemap(columns.size),
            "applied": haar_inverse(columns.size, applied).astype(np.float32),
        }

    def strip(self) -> Layer | None:
        return self._asked.lights.environment.radiance(latlong_directions(*_STRIP))

    def mesh(self) -> Mapping[str, NDArray[Any]] | None:
        if self.kind != "vertices":
            return None
        views, receivers = self.transport._views, self.transport.receivers
        rows = len(views.shown)
        return {
            "position": receivers.position[:rows],
            "normal": receivers.normal[views.shown],
            "triangles": views.triangles,
        }

    def still(self, shot: Shot) -> tuple[Layer, dict[str, Any]] | None:
        camera = shot.of.asked.camera
        if camera is None:
            return None
        return self._seen(shot), camera_words(camera)

    def look(self, x: int, y: int) -> tuple[Layer, int]:
        columns, camera = self.transport.columns, self._asked.camera
        if not isinstance(columns, Haar):
            return super().look(x, y)
        if camera is not None:
            camera = camera.resized(self.transport.camera.width, self.transport.camera.height)
        shares = self.transport.shares(camera)
        height, width = shares.image_shape
        if not (0 <= x < width and 0 <= y < height):
            raise ValueError(f"expected a pixel below {width} and {height}, got {x} and {y}")
        rows = int((shares.samples.pixel == y * width + x).sum())
        if rows == 0:
            raise ValueError("this pixel shows no surface")
        asked = np.zeros((height, width, 3))
        asked[y, x] = 1
        # Texel columns see what wavelets do, and are not needed for it.
        found = self.transport._core.adjoint(shares.back(asked)[None], None, False)[0, : columns.wavelets]
        return haar_inverse(columns.size, np.ascontiguousarray(found)).astype(np.float32), rows

    def _seen(self, shot: Shot) -> Layer:
        shown: _Shown = shot.of
        if shown.asked.camera is None:
            return self.transport.image(shown.a.values, self._behind(shown))
        return self.transport.render(shown.asked.camera, shown.a.values, self._behind(shown))

    def picture(self, shot: Shot) -> Layer:
        return self._seen(shot)

    def python(self, view: Mapping[str, Any]) -> str:
        asked = self._asked
        camera = asked.camera
        behind = {"env": "light", "none": "None"}.get(asked.background, "None")
        seen = f"transport.image(frame.values, {behind})"
        if camera is not None:
            seen = f"transport.render(dl.{camera!r}, frame.values, {behind})"
        return "\n".join(
            [
                "import deltalux as dl",
                "",
                f"transport = dl.Transport({self.name!r})",
                *light_in_python(asked.lights),
                f"frame = dl.Relighter(transport, dl.{asked.a.method!r}).step(light)",
                f"dl.write('view.png', {seen}, exposure={view['exposure']:.3f}, tone={view['tone']!r})",
                "",
            ]
        )

    def command(self, view: Mapping[str, Any]) -> str:
        asked = self._asked
        return render_command(self.name, asked.lights, asked.background, asked.camera, view)


def _large(camera: Camera) -> Camera:
    """Cameras of scenes may be small; a mesh is drawn at so many times their size that it fills a page."""
    times = max(1, -(-_LEAST // max(camera.width, camera.height)))
    return camera.resized(times * camera.width, times * camera.height)


def camera_words(camera: Camera) -> dict[str, Any]:
    """A camera as the page has it."""
    return {
        "position": list(camera.position),
        "target": list(camera.target),
        "up": list(camera.up),
        "fov": camera.vertical_fov,
    }


def camera_of(before: Camera, value: Any) -> Camera:
    """The camera that a message asks for."""
    found = checked_keys("a camera", value, ("position", "target", "up", "fov"))
    return replace(
        before,
        position=vector("a position", found.get("position"), -1e9, 1e9),
        target=vector("a target", found.get("target"), -1e9, 1e9),
        vertical_fov=number("a field of view", found.get("fov", before.vertical_fov), 1.0, 170.0),
    )


def _even() -> Environment:
    return Environment.from_latlong(np.full((2, 4, 3), _GREY, np.float32))
