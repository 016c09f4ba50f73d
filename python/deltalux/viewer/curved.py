"""Materials whose curves move, under a light that stands still."""

from __future__ import annotations

import threading
from collections.abc import Mapping, Set
from dataclasses import fields
from typing import Any

import numpy as np

from ..brdf.curves import ANGLES
from ..edit.editor import BrdfEditor, EditedFrame
from ..io import auto_exposure
from ..transport.curves import CurvePart, CurveTransport
from ..update.methods import Method
from .messages import checked_keys, number, vector
from .relit import camera_words
from .subject import Layer, Shot, Subject

__all__ = ["Curved"]

# Ranges of sliders; a width is one of a factor.
_RANGES: dict[str, tuple[float, float, bool]] = {
    "sigma": (0.01, 0.6, True),
    "alpha": (0.01, 0.6, True),
    "exponent": (1.0, 10_000.0, True),
    "n": (1.0, 3.0, False),
    "k": (0.0, 8.0, False),
    "f0": (0.0, 1.0, False),
}
_INDICES = ("n", "k", "f0")
_SAMPLES, _MOST_POINTS, _BRIGHTEST = 64, 512, 1e9


class Curved(Subject):
    """A transport of curves.

    Parameters
    ----------
    transport
        To be seen.
    method
        How edits are followed, as for `BrdfEditor`.
    name
        Of the transport: where it lies.
    """

    kind = "curves"

    def __init__(self, transport: CurveTransport, method: Method | str, name: str) -> None:
        self.name, self.transport = name, transport
        self.editor = BrdfEditor(transport, method)
        self._lock = threading.Lock()
        self._materials = {own: _parameters(part) for own, part in transport.parts.items()}
        self._curves: dict[str, Any] = dict.fromkeys(transport.parts)

    def about(self) -> dict[str, Any]:
        camera = self.transport.camera
        parts = self.transport.parts
        return {
            "kind": self.kind,
            "width": camera.width,
            "height": camera.height,
            "camera": camera_words(camera),
            "facts": [[own, f"{part.transport.shape[0]:,} rows, Fresnel {part.kind}"] for own, part in parts.items()]
            + [["size", f"{self.transport.nbytes / 1e6:.1f} MB"]],
            "columns": None,
            "methods": [],
            "weights": [],
            "materials": [
                {
                    "name": own,
                    "kind": "curve",
                    "colour": list(part.specular),
                    "parameters": [
                        {"name": key, "low": _RANGES[key][0], "high": _RANGES[key][1], "log": _RANGES[key][2]}
                        for key in _parameters(part)
                        if key != "colour"
                    ],
                }
                for own, part in parts.items()
            ],
        }

    def state(self) -> dict[str, Any]:
        return {"materials": self._materials, "curves": self._curves}

    def take(self, patch: Mapping[str, Any]) -> dict[str, Any]:
        checked_keys("the state", dict(patch), ("materials", "curves"))
        with self._lock:
            before = dict(self.editor._lobes), dict(self.editor._targets)
            materials, curves = {k: dict(v) for k, v in self._materials.items()}, dict(self._curves)
            try:
                with self._remarking():
                    for name, own in checked_keys("materials", patch.get("materials", {}), tuple(materials)).items():
                        self._set(name, own, materials, curves)
                    for name, curve in checked_keys("curves", patch.get("curves", {}), tuple(curves)).items():
                        self._draw(name, curve, materials, curves)
            except ValueError:
                self.editor._lobes, self.editor._targets = before
                raise
            self._materials, self._curves = materials, curves
            return {key: self.state()[key] for key in patch} | {"curves": self._curves}

    def _set(self, name: str, value: Any, materials: dict[str, Any], curves: dict[str, Any]) -> None:
        """The parameters of a material that differ from what they are."""
        known = materials[name]
        found = checked_keys(name, value, tuple(known))
        changes: dict[str, Any] = {}
        for key, own in found.items():
            asked = vector(key, own, 0.0, 1e3) if key == "colour" else number(key, own, *_RANGES[key][:2])
            if asked != (tuple(known[key]) if key == "colour" else known[key]):
                changes[key] = asked
                known[key] = list(asked) if isinstance(asked, tuple) else asked
        if changes:
            self.editor.set(name, **changes)
            if set(changes) - {"colour", *_INDICES}:
                # A width takes the place of what was drawn.
                curves[name] = None

    def _draw(self, name: str, curve: Any, materials: dict[str, Any], curves: dict[str, Any]) -> None:
        if curve is None:
            if curves[name] is not None:
                widths = {k: v for k, v in materials[name].items() if k not in ("colour", *_INDICES)}
                if widths:
                    self.editor.set(name, **widths)
                else:
                    part = self.transport.parts[name]
                    self.editor.set_curve(name, _angles(), _at(part.curve))
                curves[name] = None
            return
        found = checked_keys("a curve", curve, ("theta", "values"))
        theta, values = found.get("theta"), found.get("values")
        if not isinstance(theta, list) or not isinstance(values, list) or not len(theta) == len(values) <= _MOST_POINTS:
            raise ValueError(f"expected a curve as at most {_MOST_POINTS} angles, and as many values")
        angles = [number("an angle in radians", own, 0.0, 1.5708) for own in theta]
        heights = [_height(own) for own in values]
        self.editor.set_curve(name, angles, heights)
        curves[name] = {"theta": angles, "values": heights}

    def step(self, layers: Set[str], rests: bool) -> Shot:
        with self._lock:
            frame = self.editor.step()
        picture = frame.image
        bounds = [own.bound for own in frame._frames.values()]
        stats = {
            "seconds": frame.seconds,
            "columns": frame.columns,
            "converged": frame.converged,
            "late": False,
            "pending": max(own.pending for own in bounds),
            "truncation": max(own.truncation for own in bounds),
            "residual": frame.residual,
        }
        return Shot(
            {"a": picture}, {"a": stats, "b": None, "auto": auto_exposure(picture[::2, ::2])}, frame.converged, frame
        )

    def curve(self, name: Any) -> dict[str, Any]:
        """The curve of a material as it is asked for."""
        if not isinstance(name, str) or name not in self._materials:
            raise ValueError(f"expected a material of {', '.join(self._materials)}, got {str(name)[:40]!r}")
        with self._lock:
            return {"name": name, "theta": _angles().tolist(), "values": _at(self.editor.curve(name)[1]).tolist()}

    def picture(self, shot: Shot) -> Layer:
        frame: EditedFrame = shot.of
        return frame.image

    def python(self, view: Mapping[str, Any]) -> str:
        lines = ["import deltalux as dl", "", f"editor = dl.BrdfEditor(dl.CurveTransport.open({self.name!r}))"]
        for name, own in self._materials.items():
            words = ", ".join(f"{key}={value!r}" for key, value in own.items())
            lines.append(f"editor.set({name!r}, {words})")
            curve = self._curves[name]
            if curve is not None:
                lines.append(f"editor.set_curve({name!r}, {curve['theta']!r}, {curve['values']!r})")
        lines.append(
            f"dl.write('view.png', editor.step().image, exposure={view['exposure']:.3f}, tone={view['tone']!r})"
        )
        return "\n".join([*lines, ""])


def _parameters(part: CurvePart) -> dict[str, Any]:
    """What of a material is set by sliders, as it was made."""
    known: dict[str, Any] = {}
    for own in fields(part.model) if part.model is not None else ():  # type: ignore[arg-type]
        value = getattr(part.model, own.name)
        edited = own.name not in _INDICES or part.kind not in ("fixed", "none")
        if own.name in _RANGES and isinstance(value, float) and edited:
            known[own.name] = value
    return {**known, "colour": list(part.specular)}


def _height(value: Any) -> list[float]:
    """A value of a curve: in red, green and blue; one number stands for all."""
    each = value if isinstance(value, list) else [value] * 3
    return list(vector("a value of a curve", each, 0.0, _BRIGHTEST))


def _angles() -> Any:
    """Where the page has a curve's values: denser towards the normal, where highlights are."""
    return np.pi / 2 * np.linspace(0.0, 1.0, _SAMPLES) ** 2


def _at(curve: Any) -> Any:
    """A curve (256, 3) there."""
    return np.stack([np.interp(_angles(), ANGLES, curve[:, k]) for k in range(3)], axis=1)
