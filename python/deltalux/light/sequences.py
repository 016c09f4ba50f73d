"""Moving light: sequences of environments, one a frame, made when asked for and the same every time.

`rotation`, `interpolation`, `area_light`, `sunrise` and `painting`; `make` finds them by name. The first three ease in
and out: at frame k of n the way behind is `ease` (k / (n - 1)), and `hold` frames of rest follow.

>>> from deltalux import Environment, sequences
>>> frames = list(sequences.rotation(Environment.builtin("hall"), degrees=13.5, frames=100, hold=25))
>>> len(frames)
125
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..checks import count
from . import skies
from .discs import FACE, Place, dabbed, disc
from .environment import Environment
from .motion import Motion, ease

__all__ = ["SEQUENCES", "area_light", "ease", "interpolation", "make", "painting", "rotation", "sunrise"]

_SCRIBBLE: tuple[tuple[Place, ...], ...] = (
    ((-50, 35), (-20, 50), (-25, 38), (0, 48), (-8, 33), (15, 42)),
    ((40, 20), (45, 60), (55, 25), (60, 60)),
    ((-120, 15), (-100, 18), (-80, 14), (-60, 17)),
)
"""A zigzag, an up and down, and a line: what a hand paints in a few seconds."""


def rotation(
    env: Environment, degrees: float, frames: int, axis: str | ArrayLike = "y", hold: int = 0
) -> Iterator[Environment]:
    """The light turns about an axis by `degrees` in all, by the right-hand rule, always from the original.

    Parameters
    ----------
    env
        The light.
    degrees
        Of the last frame; the first is 0.
    frames
        Frames of movement.
    axis
        "x", "y", "z" or a 3-vector.
    hold
        Frames of rest that follow.

    Returns
    -------
    iterator of Environment
        One a frame, made when it is asked for.

    Raises
    ------
    ValueError
        If a setting is out of its range.
    """
    return (env.rotated(angle, axis) for angle in Motion(degrees, frames, hold, axis).angles)


def interpolation(a: Environment, b: Environment, frames: int, hold: int = 0) -> Iterator[Environment]:
    """One light fades into another: (1 - t) a + t b.

    Parameters
    ----------
    a, b
        The light of the first frame, and of the last.
    frames
        Frames of movement.
    hold
        Frames of rest that follow.

    Returns
    -------
    iterator of Environment
        One a frame, made when it is asked for.

    Raises
    ------
    ValueError
        If a setting is out of its range.
    """
    a.mixed(b, 0.5)
    return (a.mixed(b, way) for way in _eased(frames, hold))


def area_light(
    env: Environment,
    frames: int,
    *,
    start: tuple[float, float, float] = (-60.0, 30.0, 4.0),
    end: tuple[float, float, float] = (60.0, 50.0, 16.0),
    radiance: tuple[float, float, float] = (20.0, 18.0, 15.0),
    hold: int = 0,
) -> Iterator[Environment]:
    """A round area light moves and changes its size over a still environment.

    Parameters
    ----------
    env
        What does not move.
    frames, hold
        Frames of movement, and of rest that follow.
    start, end
        Azimuth (from -Z towards +X), elevation and radius, in degrees.
    radiance
        Of the light, linear RGB.

    Returns
    -------
    iterator of Environment
        One a frame, made when it is asked for.

    Raises
    ------
    ValueError
        If a number is not finite or out of its range.
    """
    ends = np.array([start, end], np.float64)
    if ends.shape != (2, 3) or not np.all(np.isfinite(ends)) or np.any(ends[:, 2] <= 0):
        raise ValueError(f"expected start and end as azimuth, elevation and a radius above 0, got {start} and {end}")
    colour = _colour(radiance)

    def frame(way: float) -> Environment:
        azimuth, elevation, radius = ends[0] + way * (ends[1] - ends[0])
        return _with(env, disc((azimuth, elevation), radius)[..., None] * colour)

    return (frame(way) for way in _eased(frames, hold))


def sunrise(frames: int, *, noon: float = 55.0) -> Iterator[Environment]:
    """A day under a clear sky: from dawn the sun climbs at +X, stands `noon` degrees high at -Z, and sets at -X.

    The sun moves evenly; with it the sky changes its colour (Preetham, Shirley and Smits 1999), and the sun its own by
    the air that its light goes through. The first and the last frame lie 6 degrees of its circle below the horizon.

    Parameters
    ----------
    frames
        Frames of the whole day.
    noon
        The sun's greatest height, in degrees above the horizon, up to 90.

    Returns
    -------
    iterator of Environment
        One a frame, made when it is asked for.

    Raises
    ------
    ValueError
        If a number is out of its range.
    """
    if not 0 < noon <= 90:
        raise ValueError(f"expected the sun's height at noon in degrees above 0 and up to 90, got {noon}")
    hours = np.radians(np.linspace(-6.0, 186.0, _frames(frames)))

    def frame(hour: float) -> Environment:
        x, y, z = np.cos(hour) * np.array([1.0, 0.0, 0.0]) + np.sin(hour) * skies.toward(0.0, np.radians(noon))
        picture = skies.sky(azimuth=float(np.arctan2(x, -z)), elevation=float(np.arcsin(y)), height=192)
        return Environment.from_latlong(picture, rows="centre")

    return (frame(hour) for hour in hours)


def painting(
    env: Environment,
    frames: int,
    *,
    strokes: Sequence[Sequence[Place]] = _SCRIBBLE,
    radius: float = 5.0,
    radiance: tuple[float, float, float] = (8.0, 6.5, 4.0),
    hold: int = 0,
) -> Iterator[Environment]:
    """Light is painted by hand: a brush moves at an even pace along strokes and leaves a trail; nothing else changes.

    Parameters
    ----------
    env
        The canvas.
    frames, hold
        Frames of painting, and of rest that follow.
    strokes
        Each a list of two or more places: azimuth (from -Z towards +X) and elevation in degrees.
    radius
        Of the round brush, in degrees.
    radiance
        Of the paint, linear RGB, added to the canvas.

    Returns
    -------
    iterator of Environment
        One a frame, made when it is asked for.

    Raises
    ------
    ValueError
        If a number is not finite or out of its range, or a stroke is shorter than two places.
    """
    lines = [np.array(stroke, np.float64) for stroke in strokes]
    if not lines or any(line.ndim != 2 or line.shape[1] != 2 or len(line) < 2 for line in lines):
        raise ValueError(f"expected strokes of two or more places (azimuth, elevation), got {strokes!r}")
    if not (0 < radius < 90 and all(np.all(np.isfinite(line)) for line in lines)):
        raise ValueError(f"expected finite strokes and a radius between 0 and 90 degrees, got {radius}")
    return _painted(env, _dabs(lines, radius / 3), _frames(frames), radius, _colour(radiance), _rest(hold))


def _painted(
    env: Environment, dabs: NDArray[np.float64], frames: int, radius: float, colour: NDArray[np.float32], hold: int
) -> Iterator[Environment]:
    paint = np.zeros((6, FACE, FACE, 3), np.float32)
    painted = env
    for k in range(frames):
        now = dabs[k * len(dabs) // frames : (k + 1) * len(dabs) // frames]
        paint = dabbed(paint, ((dab[0], dab[1]) for dab in now), radius, colour)
        painted = _with(env, paint)
        yield painted
    for _ in range(hold):
        yield painted


def _dabs(lines: list[NDArray[np.float64]], step: float) -> NDArray[np.float64]:
    """Places where the brush touches, no more than `step` degrees apart along each stroke: (n, 2)."""
    places = []
    for line in lines:
        for a, b in zip(line[:-1], line[1:], strict=True):
            count = int(np.ceil(np.abs(b - a).max() / step))
            places += [a + (b - a) * k / count for k in range(count)]
        places.append(line[-1])
    return np.array(places)


def _with(env: Environment, cubemap: NDArray[np.float32]) -> Environment:
    """The sum of both: halving and doubling are exact."""
    return env.mixed(Environment.from_cubemap(cubemap), 0.5).scaled(2.0)


def _eased(frames: int, hold: int) -> list[float]:
    last = max(_frames(frames) - 1, 1)
    ways = [ease(k / last) for k in range(frames)]
    return ways + [ways[-1]] * _rest(hold)


def _frames(frames: int) -> int:
    if count("frames", frames) == 0:
        raise ValueError("expected at least 1 frame, got 0")
    return operator.index(frames)


def _rest(hold: int) -> int:
    return count("hold", hold)


def _colour(radiance: ArrayLike) -> NDArray[np.float32]:
    colour = np.asarray(radiance, np.float32)
    if colour.shape != (3,) or not np.all(np.isfinite(colour)):
        raise ValueError(f"expected three finite numbers of radiance, got {radiance!r}")
    return colour


def _rotation(env: Environment, frames: int, degrees: float = 90.0, **options: Any) -> Iterator[Environment]:
    return rotation(env, degrees, frames, **options)


def _interpolation(
    env: Environment, frames: int, other: Environment | None = None, **options: Any
) -> Iterator[Environment]:
    return interpolation(env, Environment.builtin("hall") if other is None else other, frames, **options)


def _sunrise(env: Environment, frames: int, **options: Any) -> Iterator[Environment]:
    return sunrise(frames, **options)


SEQUENCES: dict[str, Callable[..., Iterator[Environment]]] = {
    "rotation": _rotation,
    "interpolation": _interpolation,
    "area-light": area_light,
    "sunrise": _sunrise,
    "painting": painting,
}
"""By name: functions of an environment, a number of frames, and options."""


def make(name: str, env: Environment, frames: int, **options: Any) -> Iterator[Environment]:
    """A sequence by its name.

    Parameters
    ----------
    name
        "rotation" (options: degrees = 90, axis, hold), "interpolation" (other, by default the built-in hall; hold),
        "area-light" (start, end, radiance, hold), "sunrise" (noon; the environment is not used) or "painting"
        (strokes, radius, radiance, hold).
    env
        The light that moves, or what stays behind the light that does.
    frames
        Frames of movement.
    **options
        Of the sequence, as above.

    Returns
    -------
    iterator of Environment
        One a frame, made when it is asked for.

    Raises
    ------
    ValueError
        If there is no such sequence, or an option is out of its range.
    """
    if name not in SEQUENCES:
        raise ValueError(f"expected a sequence of {', '.join(SEQUENCES)}, got {name!r}")
    return SEQUENCES[name](env, frames, **options)
