"""Light between surfaces where pieces are small: `python benches/outdoors.py [--scene plant] [--paths 800]`.

The built-in plant and street, and a chess still life where its file is at hand, under the hall and under one texel's
sun. The truth is traced with Embree, from the receivers' own places, and shares no code with the core. Off is the root
mean square of what the indirect radiance of a pixel is off by, over the mean of all radiance, both of the object alone;
the truth's own noise is taken out by two halves, as the mean of (e - t1)(e - t2). Nodes are placed as for 512 lines.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import deltalux as dl
import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene
from numpy.typing import NDArray
from studios import around

CHESS = Path(__file__).parents[1] / "../shared/data/mesh/chess_still_life.glb"
GROUND = {"plant": {"ground"}, "street": set(), "chess": set()}
"""Materials that are not the object's."""
SIZE = 32
"""Of the light, which both sides take as even within a texel."""
SUN = (2, 21, 20)
AT_ONCE = 1 << 18
"""Paths."""

Vectors = NDArray[np.float64]


def scene_of(name: str, width: int) -> dl.Scene:
    scene = dl.Scene.load(CHESS) if name == "chess" else dl.Scene.builtin(name)
    return scene.with_camera(scene.camera.resized(width, width))


class Light(NamedTuple):
    """A light of texels, and how they are drawn: by their power, and evenly within one."""

    cubemap: NDArray[np.float32]

    def draw(self, rng: np.random.Generator, count: int) -> tuple[Vectors, Vectors]:
        """Unit vectors, and radiance over the density of their solid angle."""
        edge = 2 * np.arange(SIZE + 1) / SIZE - 1
        s, t = np.meshgrid(edge, edge)
        corner = np.arctan(s * t / np.sqrt(1 + s * s + t * t))
        angles = corner[1:, 1:] - corner[1:, :-1] - corner[:-1, 1:] + corner[:-1, :-1]
        power = (self.cubemap.mean(axis=-1) * angles).ravel()
        sums = np.cumsum(power)
        texel = np.searchsorted(sums[:-1] / sums[-1], rng.random(count), side="right")
        face, at = np.divmod(texel, SIZE * SIZE)
        x = 2 * (at % SIZE + rng.random(count)) / SIZE - 1
        y = 2 * (at // SIZE + rng.random(count)) / SIZE - 1
        one = np.ones(count)
        faces = [(one, -y, -x), (-one, -y, x), (x, one, y), (x, -one, -y), (x, -y, one), (-x, -y, -one)]
        ways = np.array(faces)[face, :, np.arange(count)]
        length = np.linalg.norm(ways, axis=1)
        measure = (2 / SIZE) ** 2 / length**3
        radiance = self.cubemap.reshape(-1, 3)[texel]
        return ways / length[:, None], radiance * (measure * sums[-1] / power[texel])[:, None]


class Paths:
    """Paths from points of surfaces, that are lit by several lights."""

    def __init__(self, scene: dl.Scene, lights: list[Light], seed: int) -> None:
        self._scene, self._lights, self._rng = scene, lights, np.random.default_rng(seed)
        corners = scene.vertices[scene.triangles].astype(np.float32)
        self._tracer = EmbreeScene()
        TriangleMesh(self._tracer, corners)
        p0, p1, p2 = corners.astype(np.float64).transpose(1, 0, 2)
        across = np.cross(p1 - p0, p2 - p0)
        self._normals = across / np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-300)
        self._lift = 2e-6 * float(np.ptp(scene.vertices, axis=0).max())

    def _meet(self, origins: Vectors, ways: Vectors) -> tuple[NDArray[np.intp], Vectors, Vectors, Vectors]:
        """Which rays meet something; points and normals there, and what of light is reflected."""
        found = self._tracer.run(origins.astype(np.float32), ways.astype(np.float32), query="INTERSECT", output=True)
        rays = np.flatnonzero(found["primID"] >= 0)
        triangle = found["primID"][rays].astype(np.int64)
        normals = self._normals[triangle]
        normals = np.where((normals * ways[rays]).sum(axis=1, keepdims=True) < 0, normals, -normals)
        points = origins[rays] + found["tfar"][rays, None].astype(np.float64) * ways[rays] + self._lift * normals
        inside = np.stack([found["u"][rays], found["v"][rays]], axis=-1).astype(np.float32)
        return rays, points, normals, np.asarray(self._scene.reflectance_at(triangle.astype(np.uint32), inside), float)

    def lifted(self, points: Vectors, normals: Vectors) -> tuple[Vectors, NDArray[np.intp]]:
        """Points as far above their surface as hits are, and the triangles that they lie on."""
        above = points + 20 * self._lift * normals
        query = (above.astype(np.float32), -normals.astype(np.float32))
        found = self._tracer.run(*query, query="INTERSECT", output=True)
        down = np.where(found["primID"] >= 0, found["tfar"], 20 * self._lift).astype(np.float64)
        return above + (self._lift - down)[:, None] * normals, np.maximum(found["primID"], 0).astype(np.intp)

    def _lit(self, light: Light, points: Vectors, normals: Vectors) -> Vectors:
        """Light that arrives directly, over pi."""
        ways, radiance = light.draw(self._rng, len(points))
        cosine = (ways * normals).sum(axis=1)
        arrives = radiance * np.maximum(cosine, 0)[:, None] / np.pi
        asked = np.flatnonzero(cosine > 0)
        query = (points[asked].astype(np.float32), ways[asked].astype(np.float32))
        arrives[asked[self._tracer.run(*query, query="OCCLUDED") >= 0]] = 0
        return arrives

    def indirect(self, origins: Vectors, normals: Vectors, paths: int, bounces: int) -> Vectors:
        """What arrives of each light by so many bounces, over pi: (lights, points, 3)."""
        sums = np.zeros((len(self._lights), len(origins), 3))
        for start in range(0, len(origins) * paths, AT_ONCE):
            point = np.arange(start, min(start + AT_ONCE, len(origins) * paths)) // paths
            at, facing, through = origins[point], normals[point], np.ones((len(point), 3))
            for _ in range(bounces):
                rays, at, facing, rho = self._meet(at, around(self._rng, facing, 1.0))
                point, through = point[rays], through[rays] * rho
                for k, light in enumerate(self._lights):
                    np.add.at(sums[k], point, through * self._lit(light, at, facing))
        return sums / paths


def compared(name: str, width: int, paths: int, bounces: int, folder: Path) -> Iterator[str]:
    """A line for each light."""
    scene = scene_of(name, width)
    sun = np.zeros((6, SIZE, SIZE, 3), np.float32)
    sun[SUN] = 1e3
    lights = {"hall": dl.Environment.builtin("hall").cubemap(SIZE).astype(np.float32), "sun": sun}
    started = time.process_time()
    transport = dl.precompute(
        scene, folder / name, columns=f"haar:{SIZE}", bounces=bounces, normals="flat", tolerance=0.003, progress=False
    )
    seconds, receivers = time.process_time() - started, transport.receivers
    tracer = Paths(scene, [Light(light) for light in lights.values()], 1)
    points, normals = receivers.position.astype(np.float64), receivers.normal.astype(np.float64)
    points, triangle = tracer.lifted(points, normals)
    halves = [tracer.indirect(points, normals, paths // 2, bounces) for _ in range(2)]
    own = ~np.isin(np.array(scene.names)[scene.material[triangle]], list(GROUND[name]))
    object_ = (
        transport.image(np.repeat(own[:, None], 3, axis=1) / np.maximum(transport.albedo, 1e-6)).min(axis=-1) > 0.5
    )
    gathering = 100 * transport.solve.gathering
    yield (
        f"{name}: {transport.nodes:,} nodes, {gathering:.0f} % of {len(points):,} receivers gather, {seconds:.0f} CPU-s"
    )
    for k, (what, light) in enumerate(lights.items()):
        V = transport.coefficients(dl.Environment.from_cubemap(light))
        all_, direct = (
            transport.image(own.multiply(V))[object_].astype(np.float64) for own in (transport, transport.direct)
        )
        found, (a, b) = all_ - direct, (transport.image(half[k])[object_].astype(np.float64) for half in halves)
        share = (a.mean() + b.mean()) / 2
        mean = direct.mean() + share
        off, whole = ((found - a) * (found - b)).mean(), (a * b).mean()
        yield (
            f"{name:7} {what:5} off {100 * np.sqrt(max(off, 0)) / mean:5.2f} %, left out it were "
            f"{100 * np.sqrt(whole) / mean:4.1f} %; indirect light {100 * share / mean:4.1f} % of all, "
            f"in the mean {100 * (found.mean() / share - 1):+4.1f} % off"
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scene", action="append", choices=[*GROUND], help="default: all that are at hand")
    parser.add_argument("--width", type=int, default=64, help="of the picture")
    parser.add_argument("--bounces", type=int, default=2)
    parser.add_argument("--paths", type=int, default=800, help="of a receiver, in the truth")
    chosen = parser.parse_args()
    names = chosen.scene or [name for name in GROUND if name != "chess" or CHESS.exists()]
    with tempfile.TemporaryDirectory() as folder:
        for name in names:
            for line in compared(name, chosen.width, chosen.paths, chosen.bounces, Path(folder)):
                print(line, flush=True)


if __name__ == "__main__":
    main()
