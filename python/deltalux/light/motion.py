"""How the light moves: a rotation with ease in and out, and then a hold."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..checks import count
from ..rotation import rotation_matrix
from .environment import Environment

__all__ = ["Motion", "ease"]


def ease(t: float) -> float:
    """The profile of every rotation: t^2 (3 - 2t); at rest at both ends, 1.5 times the mean speed between.

    The papers show their profile only as a plot (Overbeck 2006, Fig. 6.4, bottom); this is ours.

    Parameters
    ----------
    t
        Time, from 0 to 1.

    Returns
    -------
    float
        The way behind, from 0 to 1.
    """
    return t * t * (3.0 - 2.0 * t)


@dataclass(frozen=True)
class Motion:
    """A rotation with ease in and out, then light that stands still.

    Parameters
    ----------
    rotate
        Degrees in all, by the right-hand rule.
    frames
        Frames of rotation, 1 or more.
    hold
        Frames of rest that follow, 0 or more.
    axis
        ``"x"``, ``"y"``, ``"z"`` or a 3-vector of any length.

    Raises
    ------
    ValueError
        If a number is out of range.
    """

    rotate: float = 45.0
    frames: int = 100
    hold: int = 25
    axis: str | ArrayLike = "y"

    def __post_init__(self) -> None:
        rotation_matrix(self.rotate, self.axis)
        for name, least in (("frames", 1), ("hold", 0)):
            if count(name, getattr(self, name)) < least:
                raise ValueError(f"expected {name} to be at least {least}, got {getattr(self, name)}")

    @property
    def angles(self) -> list[float]:
        """Degrees in every frame: 0 in the first, `rotate` in the last of the rotation and in all that follow."""
        last = max(self.frames - 1, 1)
        turning = [self.rotate * ease(k / last) for k in range(self.frames)]
        return turning + [turning[-1]] * self.hold

    @property
    def stop(self) -> int:
        """The last frame of the rotation."""
        return self.frames - 1

    @property
    def moments(self) -> list[tuple[int, str]]:
        """The four frames that the pictures show: turning slowly, at the highest speed, stopped, and held."""
        last = len(self.angles) - 1
        slow, fast = round(0.15 * self.stop), round(0.5 * self.stop)
        named = [(slow, "turning slowly"), (fast, "turning fastest"), (self.stop, "stopped"), (last, "held still")]
        return [(frame, f"frame {frame}\n{what}") for frame, what in named]

    def light(self, env: Environment, frame: int) -> Environment:
        """The environment as it stands in a frame.

        Parameters
        ----------
        env
            The light at 0 degrees.
        frame
            Counted from 0.

        Returns
        -------
        Environment
            The light turned by ``angles[frame]``.

        Raises
        ------
        IndexError
            If there is no such frame.
        """
        return env.rotated(self.angles[frame], self.axis)

    @property
    def degrees_a_frame(self) -> float:
        """The highest speed."""
        return float(np.abs(np.diff(self.angles)).max(initial=0.0))

    def __str__(self) -> str:
        speed = f"at most {self.degrees_a_frame:.2f} degrees a frame" if math.isfinite(self.rotate) else ""
        return f"{self.rotate:g} degrees in {self.frames} frames ({speed}), then {self.hold} frames still"
