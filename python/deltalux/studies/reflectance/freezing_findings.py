"""What a studio costs and shows: bytes and times of live and frozen transport, and errors of lamps that sweep."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...brdf.family import Family
from ...edit.studio import Memory, Studio, StudioFrame
from ...light.lamps import Spot
from ...precomputation.studio import precompute_studio
from ...progress import Progress
from ...update.methods import Incremental, Method, Nonlinear, PerBand
from .carriers import Way, ways

if TYPE_CHECKING:
    from ...scene.scene import Scene
    from ...transport.studio import StudioTransport

__all__ = ["LOOKS", "METHODS", "SWEEPS", "Findings", "Object", "found_of"]

METHODS: dict[str, type[Method]] = {"NWA": Nonlinear, "BI": Incremental, "PBI": PerBand}
SWEEPS = {"a tenth of the path": 0.1, "three tenths": 0.3, "all of it": 1.0}
LOOKS = (3.0, 100.0, 300.0)
GATHER, TOLERANCE, FRAMES, TERMS, REPEATS = 4096, 0.01, 24, (100, 300), 5
_PREFERRED = ("floor", "tall box", "short box", "table", "vase", "ball", "hare", "dragon", "stool")
"""Materials that are edited where a scene has them."""
_FAMILIES = (("blinn-phong", (3.0, 300.0)), ("ward", (0.1, 1.0)), ("cook-torrance", (0.1, 1.0)))


class Object(NamedTuple):
    """One material while it is edited."""

    name: str
    model: str
    memory: Memory
    freeze: float
    """Seconds, as all that follow."""
    edit: float
    move_live: float
    frozen_error: float
    """L1 between its frozen picture and its live one."""


@dataclass(frozen=True)
class Findings:
    """Of one scene."""

    samples: int
    rows: int
    seconds: float
    tolerance: float
    terms: tuple[int, ...]
    objects: list[Object]
    move: float
    """Seconds of a move with all frozen."""
    pictures: list[tuple[str, NDArray[np.float32]]]
    errors: dict[tuple[str, int, str], float]
    times: dict[tuple[str, int], float]
    ways: list[Way]
    """That diffuse light is carried in."""

    def table(self) -> list[dict[str, str]]:
        """All errors, as a file holds them."""
        return [
            {"method": name, "terms": str(terms), "sweep": sweep, "error": f"{error:.5g}"}
            for (name, terms, sweep), error in self.errors.items()
        ]


def found_of(scene: Scene, path: Path, progress: Progress) -> Findings:
    """Makes the studio of a scene and measures it."""
    steps = 3 + len(SWEEPS)
    progress(0, steps)
    scene = replace(scene, names=tuple(name or f"material {k}" for k, name in enumerate(_names(scene))))
    objects = sorted(scene.names, key=lambda name: name not in _PREFERRED)[: len(_FAMILIES)]
    families = {name: Family(model, ends, error=0.005) for name, (model, ends) in zip(objects, _FAMILIES, strict=False)}
    made = precompute_studio(
        scene, path, families=families, gather=GATHER, bounces=2, nodes=0, tolerance=TOLERANCE, progress=False
    )
    progress(1, steps)
    stage = _Stage(scene, made)
    measured = [stage.edited(name) for name in families]
    pictures = stage.pictures(objects[0])
    progress(2, steps)
    errors: dict[tuple[str, int, str], float] = {}
    times: dict[tuple[str, int], float] = {}
    for number, (sweep, share) in enumerate(SWEEPS.items()):
        stage.sweep(sweep, share, errors, times)
        progress(3 + number, steps)
    carried = ways(scene, path.parent)
    progress(steps, steps)
    return Findings(
        samples=len(made.albedo),
        rows=len(made.pixels),
        seconds=made.seconds,
        tolerance=TOLERANCE,
        terms=TERMS,
        objects=measured,
        move=stage.moved(),
        pictures=pictures,
        errors=errors,
        times=times,
        ways=carried,
    )


def _names(scene: Scene) -> tuple[str, ...]:
    """Of all materials, empty where one has none."""
    return scene.names or ("",) * len(scene.albedo)


class _Stage:
    """A studio's transport and the lamps that shine on it."""

    def __init__(self, scene: Scene, made: StudioTransport) -> None:
        self.scene, self.made = scene, made
        self.low, self.extent = scene.vertices.min(axis=0), np.ptp(scene.vertices, axis=0)

    def at(self, *share: float) -> NDArray[np.float64]:
        """A place inside of the scene's box."""
        return np.asarray(self.low + self.extent * np.array(share))

    def lamp(self, way: float) -> Spot:
        """A spot on its way from left to right, aimed at the floor below the middle."""
        power = 4.0 * float(self.extent.max()) ** 2
        aim = self.at(0.3 + 0.4 * way, 0.0, 0.55)
        return Spot(self.at(0.1 + 0.8 * way, 0.85, 0.6), aim, power, angle=40)

    def studio(self, method: Method | None = None) -> Studio:
        """With all frozen, under the lamp in the middle."""
        studio = Studio(self.made, method)
        studio.set_lights([self.lamp(0.5)])
        return studio

    def edited(self, name: str) -> Object:
        """One material live: what it takes."""
        studio, part = self.studio(), self.made.parts[name]
        studio.edit(name)
        low, high = part.family.range
        middle = float(np.sqrt(low * high))
        studio.set(name, gamma=middle)
        live, memory = studio.step(), studio.memory
        known = part.family._core.segment
        segment = [gamma for gamma in np.geomspace(low, high, 64) if known(gamma) == known(middle)]
        edits = []
        for gamma in segment[:REPEATS] + segment[-REPEATS:]:
            studio.set(name, gamma=float(gamma))
            edits.append(studio.step().seconds)
        moves = [self._move(studio, 0.5 + 0.02 * k).seconds for k in range(1, REPEATS + 1)]
        studio.set(name, gamma=middle)
        studio.set_lights([self.lamp(0.5)])
        studio.light_mode()
        frozen = studio.step()
        off = np.abs(frozen.values - live.values).sum() / np.abs(live.values).sum()
        model = part.family.model
        return Object(
            name, model, memory, studio.freeze_seconds, float(np.median(edits)), float(np.median(moves)), float(off)
        )

    def _move(self, studio: Studio, way: float) -> StudioFrame:
        studio.set_lights([self.lamp(way)])
        return studio.step()

    def moved(self) -> float:
        """Seconds of a move with all frozen."""
        studio = self.studio()
        studio.step()
        return float(np.median([self._move(studio, 0.5 + 0.02 * k).seconds for k in range(1, 2 * REPEATS)]))

    def pictures(self, name: str) -> list[tuple[str, NDArray[np.float32]]]:
        """A material at several gammas, then the lamp elsewhere with all frozen."""
        studio = self.studio()
        studio.edit(name)
        low, high = self.made.parts[name].family.range
        found = []
        for gamma in LOOKS:
            studio.set(name, gamma=min(max(gamma, low), high))
            found.append((f"{name}: gamma {gamma:g}", studio.step().image))
        studio.light_mode()
        for way in (0.1, 0.9):
            found.append(("the lamp moved", self._move(studio, way).image))
        return found

    def sweep(
        self,
        name: str,
        share: float,
        errors: dict[tuple[str, int, str], float],
        times: dict[tuple[str, int], float],
    ) -> None:
        """A lamp's way in so many frames: what each method is off by, relative to the indirect light."""
        ways = [0.5 + share * (k / (FRAMES - 1) - 0.5) for k in range(FRAMES)]
        plain = self.studio()
        exact = [self._move(plain, way) for way in ways]
        direct = [self._direct(plain, way) for way in ways]
        whole = [float(np.abs(frame.values - own).sum()) for frame, own in zip(exact, direct, strict=True)]
        for method, make in METHODS.items():
            for terms in TERMS:
                studio = self.studio(make(terms=terms))
                self._move(studio, ways[0])
                frames = [self._move(studio, way) for way in ways]
                off = [
                    float(np.abs(a.values - b.values).sum()) / all_
                    for a, b, all_ in zip(frames, exact, whole, strict=True)
                ]
                errors[method, terms, name] = float(np.mean(off[1:]))
                times[method, terms] = float(np.median([frame.seconds for frame in frames[1:]]))

    def _direct(self, studio: Studio, way: float) -> NDArray[np.float32]:
        """What the lamp itself sends."""
        studio.set_lights([self.lamp(way)])
        return studio.direct()
