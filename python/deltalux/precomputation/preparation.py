"""What comes before a plan: the scene ready for rays, and the receivers that its camera shows."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from numbers import Real
from typing import TypedDict

import numpy as np

from .._core import DirectPass, Looked
from .._core import Scene as CoreScene
from ..columns import Columns, Haar, parse
from ..scene.scene import Scene
from .between import Between, Interreflection
from .lights import lights
from .quality import QUALITIES, Quality
from .room import check_request

__all__ = ["BUNDLE", "COLUMNS", "QUANTUM", "Prepared", "Survey", "surveyed_bundles"]

COLUMNS = "haar:64+texels"
"""The basis where none is asked for."""
QUANTUM = -24
"""Every value of M is an integer times 2^-24: below what an image can show, coarse enough for exact sums. (Groups with
rows too long for that have units of their own.)"""
BUNDLE = 64
"""Rows that a pass makes together."""

# Bundles that are looked at first, to choose the threshold for the stated error: one in twenty, but at least and at
# most so many.
_SURVEY = (8, 64)


def surveyed_bundles(rows: int) -> int:
    """How many bundles of so many rows are looked at to choose the threshold."""
    return min(max(rows // (20 * BUNDLE), _SURVEY[0]), _SURVEY[1])


@dataclass(frozen=True)
class Survey:
    """What a survey has found, and the worst error under each light: with peaks in texels, if any, and without."""

    looked: Looked
    errors: dict[str, float]
    without: dict[str, float]


class _View(TypedDict):
    """A camera as the core takes it."""

    position: tuple[float, float, float]
    right: tuple[float, float, float]
    up: tuple[float, float, float]
    forward: tuple[float, float, float]
    half_height: float
    width: int
    height: int


class Prepared:
    """A scene and a request, checked; the receivers are found, and nothing is written."""

    clock: Callable[[], float] = staticmethod(time.perf_counter)

    def __init__(
        self,
        scene: Scene,
        columns: Columns | str,
        quality: str,
        tolerance: float | None,
        asked: Between | None = None,
    ) -> None:
        self.scene = scene
        self.columns = parse(columns) if isinstance(columns, str) else columns
        self.quality, self.settings = quality, _settings(quality, tolerance)
        check_request(scene)
        camera = scene.camera
        right, up, forward = camera.basis()
        self.core = CoreScene(scene.vertices, scene.triangles, scene.material)
        self.view = _View(
            position=_three(camera.position),
            right=_three(right),
            up=_three(up),
            forward=_three(forward),
            half_height=float(np.tan(np.radians(camera.vertical_fov) / 2)),
            width=camera.width,
            height=camera.height,
        )
        self.rows = self.core.receivers(**self.view, edges=self.settings.edges)
        self.count = len(self.rows)
        if self.count == 0:
            raise ValueError(f"the camera sees nothing of {scene.name}: no pixel shows a surface")
        self.between = None if asked is None else Interreflection(self, asked)
        # Drawn here, once: no clock that times a survey is to time this.
        self.lights = lights(self.columns)
        self.direct = DirectPass(self.core, self.rows, columns=str(self.columns), edge_side=self.settings.edge_side)

    @property
    def bundles(self) -> int:
        """Bundles of all rows."""
        return -(-self.count // BUNDLE)

    @property
    def stored(self) -> int:
        """Columns that have entries: of texels rows keep bits."""
        return self.columns.wavelets if isinstance(self.columns, Haar) else self.columns.columns

    def survey(self, bundles: int, progress: Callable[[int], None] | None = None) -> Survey:
        """Looks at some bundles: by which threshold the tolerance is kept, and what follows from it."""
        found = self.direct.survey(
            bundles,
            tolerance=self.settings.tolerance,
            quantum=QUANTUM,
            width=self.settings.width,
            lights=[(light.decides, light.truncated, light.whole) for light in self.lights],
            progress=progress,
        )
        errors: dict[str, float] = {}
        without: dict[str, float] = {}
        for light, error in zip(self.lights, found.errors, strict=True):
            of = without if light.peaks == 0 else errors
            of[light.name] = max(error, of.get(light.name, 0.0))
        return Survey(found, errors, without)


def _three(vector: Sequence[float] | np.ndarray) -> tuple[float, float, float]:
    x, y, z = (float(component) for component in vector)
    return x, y, z


def _settings(quality: str, tolerance: float | None) -> Quality:
    if not isinstance(quality, str) or quality not in QUALITIES:
        raise ValueError(f"expected a quality of {', '.join(QUALITIES)}, got {quality!r}")
    chosen = QUALITIES[quality]
    if tolerance is None:
        return chosen
    if not isinstance(tolerance, Real) or not 0 <= tolerance < 1:
        raise ValueError(f"expected a tolerance from 0 to 1 (0.01 is 1 % image error), got {tolerance!r}")
    return replace(chosen, tolerance=float(tolerance))
