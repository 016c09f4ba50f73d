"""What is seen, as a program or a command that makes it again."""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from typing import Any

from ..camera import Camera
from ..light.skies import BUILTIN
from .lights import Dab, Group, Lights

__all__ = ["light_in_python", "render_command"]


def light_in_python(lights: Lights) -> list[str]:
    """Lines that end with `light`, the sum of all groups that are heard."""
    lines: list[str] = []
    names: list[str] = []
    for group in lights.heard:
        dabs = lights.shown(group)
        if group.kind == "paint" and not dabs:
            continue
        name = f"light_{len(names) + 1}"
        names.append(name)
        lines.append(f"{name} = {_made(group, lights, dabs)}{_factors(group)}")
    return [*lines, f"light = {' + '.join(names)}" if names else "light = dl.Environment.builtin('hall') * 0.0"]


def _made(group: Group, lights: Lights, dabs: tuple[Dab, ...]) -> str:
    if group.kind == "lamp":
        return f"dl.Environment.disc({group.azimuth:.6g}, {group.elevation:.6g}, {group.radius:.6g})"
    if group.kind == "paint":
        return f"dl.Environment.painted({list(dabs)!r})"
    text = _source(group.source, lights)
    other, t = lights.blend
    first = next(own.id for own in lights.groups if own.kind == "environment")
    if other is not None and t > 0.0 and group.id == first:
        text += f".mixed({_source(other, lights)}, {t!r})"
    degrees, axis = group.angle
    if degrees:
        text += f".rotated({degrees!r}, {axis!r})"
    return text


def _source(name: str, lights: Lights) -> str:
    if name in BUILTIN:
        return f"dl.Environment.builtin({name!r})"
    return f"dl.Environment.load({lights.paths.get(name, name)!r})"


def _factors(group: Group) -> str:
    factors = group.factors
    if factors == (1.0, 1.0, 1.0):
        return ""
    return f" * {factors[0]!r}" if len(set(factors)) == 1 else f" * {factors!r}"


def render_command(
    transport: str, lights: Lights, background: str, camera: Camera | None, view: Mapping[str, Any]
) -> str:
    """The command that renders what is seen; ValueError where the light is more than one turns on a command line."""
    heard = lights.heard
    alone = heard[0] if len(heard) == 1 else None
    if alone is None or alone.kind != "environment" or alone.factors != (1.0, 1.0, 1.0) or lights.blend[1]:
        raise ValueError(
            "a command takes one environment as it is, which may be turned; this light has more: copy it as Python"
        )
    degrees, axis = alone.angle
    if abs(axis[1]) < 1.0 - 1e-9:
        raise ValueError("a command turns light about y alone; copy it as Python")
    words = ["deltalux", "render", transport, "--env", lights.paths.get(alone.source, alone.source)]
    if degrees:
        words += [f"--rotate={degrees * axis[1]:.6g}"]
    if background in ("env", "none"):
        words += ["--background", background]
    if camera is not None:
        place = ",".join(f"{own:.6g}" for own in camera.position)
        target = ",".join(f"{own:.6g}" for own in camera.target)
        words += [f"--camera={place}:{target}:{camera.vertical_fov:.6g}"]
    words += [f"--exposure={view['exposure']:.3f}", "--tone", view["tone"], "-o", "view.png"]
    return " ".join(shlex.quote(word) for word in words)
