"""What carries diffuse light between surfaces: nodes, or gather samples as published; error, bytes and time of both."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..._core import Receivers, gather_lobe_hits
from ...brdf import Lambert
from ...edit.studio import Studio
from ...light.lamps import Lamp, PointLight, Spot
from ...precomputation.studio import precompute_studio
from .gathering import LAMPS, Stage, off

if TYPE_CHECKING:
    from ...scene.scene import Scene

__all__ = ["Way", "ways"]

ASKED: tuple[tuple[str, int, int | str], ...] = (
    ("nodes", 64, "auto"),
    ("D, 1,024 samples", 1024, 0),
    ("D, 4,096 samples", 4096, 0),
)
"""Names, gather samples and nodes."""
ROWS, SIDE, REPEATS = 400, 32, 9


class Way(NamedTuple):
    """One of them."""

    name: str
    nbytes: int
    seconds: float
    """That it took to make."""
    step: float
    """Seconds of a move, but for tracing."""
    errors: dict[str, float]
    """L1 of light that has bounced once, by the lamp."""
    totals: dict[str, float]
    """How much of that light there is too much."""


def ways(scene: Scene, folder: Path) -> list[Way]:
    """Makes a studio of each, and holds it against rays of some rows to what the lamps light."""
    stage = Stage(scene)
    core, camera = scene.traced(), scene.camera.rays()
    rows = core.receivers(camera, edges=True)
    some = np.linspace(0, len(rows) - 1, min(ROWS, len(rows))).astype(np.uint32)
    wanted = {lamp: _reference(stage, rows, some, lamp) for lamp in LAMPS}
    found = []
    for number, (name, gather, nodes) in enumerate(ASKED):
        path = folder / f"{number}.studio"
        made = precompute_studio(scene, path, families={}, gather=gather, nodes=nodes, bounces=1, progress=False)
        studio, errors, totals = Studio(made), {}, {}
        albedo = made.pixels.albedo[some]
        for lamp, exact in wanted.items():
            studio.set_lights([_lamp(stage, lamp)])
            values = (studio.step().values - studio.direct())[some]
            errors[lamp] = off(values, albedo * exact)
            totals[lamp] = float(values.sum() / max(float((albedo * exact).sum()), 1e-300)) - 1
        steps = []
        for k in range(REPEATS):
            studio.set_lights([_lamp(stage, LAMPS[0], 0.01 * (k + 1))])
            frame = studio.step()
            steps.append(frame.solved + frame.sent)
        found.append(Way(name, made.nbytes, made.seconds, float(np.median(steps)), errors, totals))
    return found


def _lamp(stage: Stage, name: str, moved: float = 0.0) -> Lamp:
    """What `Stage.light` has."""
    low, high = stage.scene.vertices.min(axis=0), stage.scene.vertices.max(axis=0)
    at = low + (high - low) * (0.55 + moved, 0.85, 0.6)
    return PointLight(at) if name == "point" else Spot(at, at - (0, 1, 0), angle=35, blend=0)


def _reference(stage: Stage, rows: Receivers, some: NDArray[np.uint32], lamp: str) -> NDArray[np.float64]:
    """What rows receive over pi, by `SIDE` x `SIDE` rays each."""
    hits = gather_lobe_hits(stage.scene.traced(), rows, some.tolist(), stage.eye, Lambert().core(), SIDE)
    places, normals, triangles, shares = hits
    met = shares[:, None] * stage.light(lamp, places, normals, triangles)
    taken: NDArray[np.float64] = met.reshape(len(some), SIDE * SIDE, 3).sum(axis=1)
    return taken
