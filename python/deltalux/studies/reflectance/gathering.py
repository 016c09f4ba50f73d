"""A glossy floor under a lamp: what it takes from gather samples, and what many rays say of the same bounce."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..._core import Camera, GatherSamples, Receivers, gather_lobe_hits, points_seen_from
from ..._core import Scene as CoreScene
from ...brdf import BlinnPhong

if TYPE_CHECKING:
    from ...scene.scene import Scene

__all__ = ["LAMPS", "Stage", "Way", "off"]

Points = NDArray[np.float32]
Colours = NDArray[np.float64]
_FLAT = 0.99
"""Cosine to the vertical of what is a floor."""
_CONE = np.cos(np.radians(35))


class Way(NamedTuple):
    """How the surface of a sample is looked at."""

    name: str
    sub_area: str
    points: int
    mean: bool = False
    """Whether its light is the mean over its cell."""


@dataclass(frozen=True)
class Stage:
    """A scene whose floor shines; only the floor's pixels are looked at."""

    scene: Scene

    @cached_property
    def _traced(self) -> tuple[CoreScene, Camera, Receivers]:
        core, camera = self.scene.traced(), self.scene.camera.rays()
        return core, camera, core.receivers(camera, edges=False)

    @cached_property
    def floor(self) -> NDArray[np.bool_]:
        """Of each triangle, whether it is level and the lowest that is."""
        corners = self.scene.vertices[self.scene.triangles].astype(np.float64)
        up = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        level = np.abs(up[:, 1]) > _FLAT * np.linalg.norm(up, axis=1)
        heights = corners[:, :, 1].mean(axis=1)
        low, extent = corners[:, :, 1].min(), np.ptp(corners[:, :, 1])
        floor: NDArray[np.bool_] = level & (heights < low + 1e-3 * extent)
        if not floor.any():
            raise ValueError(f"the study looks at a floor that shines, but {self.scene.name} has none")
        return floor

    @cached_property
    def table(self) -> tuple[NDArray[np.uint32], NDArray[np.uint32]]:
        """The rows that show the floor, and their pixels."""
        rows = self._traced[2]
        count = len(rows)
        pixel = rows.table(np.zeros((count, 3), np.float32), np.zeros(count, np.uint16)).pixel
        own = np.flatnonzero(self.floor[rows.triangle])
        if not own.size:
            raise ValueError(f"the study looks at a floor that shines, but no pixel of {self.scene.name} shows it")
        return own.astype(np.uint32), pixel[own]

    @property
    def eye(self) -> tuple[float, float, float]:
        """Where the camera is."""
        x, y, z = (float(value) for value in self.scene.camera.position)
        return x, y, z

    def samples(self, count: int) -> GatherSamples:
        """By so many paths."""
        core, camera, _ = self._traced
        return GatherSamples.place(core, camera, self.floor, count)

    def seen(self, point: tuple[float, float, float], places: Points, normals: Points) -> NDArray[np.bool_]:
        """Which points of surfaces a point sees."""
        return points_seen_from(self._traced[0], point, places, normals)

    def light(self, lamp: str, places: Points, normals: Points, triangles: NDArray[np.uint32]) -> Colours:
        """What surfaces send on of a lamp's light: of a point that shines evenly, or of a sharp cone downwards."""
        low, high = self.scene.vertices.min(axis=0), self.scene.vertices.max(axis=0)
        x, y, z = (float(value) for value in low + (high - low) * (0.55, 0.85, 0.6))
        way = np.array((x, y, z)) - places
        distance = np.linalg.norm(way, axis=1)
        received = np.maximum((way * normals).sum(axis=1) / distance, 0) / distance**2
        received *= self.seen((x, y, z), places, normals)
        if lamp == "spot":
            received *= way[:, 1] > _CONE * distance
        sent: Colours = received[:, None] * self.scene.albedo[self.scene.material[triangles]].astype(np.float64) / np.pi
        return sent

    def gathered(
        self, samples: GatherSamples, numbers: NDArray[np.uint32], gamma: float, lamp: str, way: Way
    ) -> Colours:
        """What rows take from samples, in one way."""
        places, normals, triangles = samples.cell_points()
        starts = samples.cell_starts.astype(np.intp)
        if way.mean:
            each = self.light(lamp, places, normals, triangles)
            light = np.add.reduceat(each, starts[:-1]) / np.diff(starts)[:, None]
        else:
            light = self.light(lamp, samples.position, samples.normal, triangles[starts[:-1]])
        options = {"sub_area": way.sub_area, "points": way.points}
        lobe = BlinnPhong(gamma).core()
        return samples.light(self._traced[2], numbers.tolist(), self.eye, lobe, light, **options)  # type: ignore[arg-type]

    def reference(self, numbers: NDArray[np.uint32], gamma: float, lamp: str, side: int) -> Colours:
        """The same bounce by `side` x `side` rays of the lobe from every row, and the light where they end."""
        core, _, rows = self._traced
        lobe = BlinnPhong(gamma).core()
        places, normals, triangles, shares = gather_lobe_hits(core, rows, numbers.tolist(), self.eye, lobe, side)
        met = shares[:, None] * self.light(lamp, places, normals, triangles)
        taken: Colours = met.reshape(len(numbers), side * side, 3).sum(axis=1)
        return taken

    def picture(self, values: Colours) -> NDArray[np.float32]:
        """The floor's values where the camera shows them."""
        camera = self.scene.camera
        picture = np.zeros((camera.height * camera.width, 3), np.float32)
        picture[self.table[1]] = values
        return picture.reshape(camera.height, camera.width, 3)

    def projected(self, places: Points) -> NDArray[np.float64]:
        """Pixels of points, (n, 2), x to the right and y downwards."""
        camera = self.scene.camera
        right, up, forward = camera.basis()
        away = places - np.array(self.eye)
        scale = camera.height / (2 * np.tan(np.radians(camera.vertical_fov) / 2)) / (away @ forward)
        return np.stack([camera.width / 2 + scale * (away @ right), camera.height / 2 - scale * (away @ up)], axis=1)


LAMPS = ("point", "spot")


def off(found: NDArray[np.floating], wanted: NDArray[np.floating]) -> float:
    """Relative L1 error."""
    whole = float(np.abs(wanted).sum())
    return float(np.abs(found - wanted).sum()) / whole if whole > 0 else 0.0
