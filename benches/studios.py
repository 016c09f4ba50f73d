"""Studios against brute force: `python benches/studios.py [--size 64] [--samples 256] [-o FOLDER]`.

Three built-in rooms under a lamp, one material with a Lafortune lobe edited through three gammas that no function of
its family was fitted to. Two references are traced with Embree through trimesh, pixel by pixel, and share no code with
the core: what a studio stands for (lobes for the eye alone, light that is diffuse from the second bounce on, as many
bounces), and every path there is, lobes after lobes. Off is the sum of what pixels are off by over the picture's own;
tiles are of 8 x 8 pixels, where the noise of a reference, told beside it from its two halves, is a fraction of what it
is in pixels. -o leaves the studio, both references and ten times the differences as a picture for each gamma (Nguyen
2010, Fig. 4).
"""

from __future__ import annotations

import argparse
import tempfile
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import deltalux as dl
import numpy as np
import trimesh
from deltalux.io import auto_exposure, save_image, to_display
from numpy.typing import NDArray
from trimesh.ray.ray_pyembree import RayMeshIntersector

SCENES = {"studio-room": "floor", "studio-figures": "floor", "studio-still-life": "table"}
GAMMAS = (17.0, 60.0, 220.0)
POWER, SHINE, BOUNCES, TILE = 5.0, 0.3, 2, 8
LONGEST = 8
"""Bounces of a path of the whole reference: what comes after them is below a thousandth."""
LIFT = 1e-5

Vectors = NDArray[np.float64]


class Hits(NamedTuple):
    """Where rays met a surface, for those that did."""

    rays: NDArray[np.intp]
    points: Vectors
    normals: Vectors
    ways: Vectors
    """To where the rays came from."""
    material: NDArray[np.intp]


@dataclass
class Room:
    """A scene, its lamp, and the material whose lobe is edited."""

    scene: dl.Scene
    shiny: int
    lamp: Vectors

    def __post_init__(self) -> None:
        mesh = trimesh.Trimesh(self.scene.vertices, self.scene.triangles, process=False)
        self._tracer = RayMeshIntersector(mesh, scale_to_box=False)
        p0, p1, p2 = self.scene.vertices[self.scene.triangles].astype(np.float64).transpose(1, 0, 2)
        across = np.cross(p1 - p0, p2 - p0)
        self._corners, self._normals = p0, across / np.linalg.norm(across, axis=1, keepdims=True)
        self.albedo = self.scene.albedo.astype(np.float64)

    def _first(self, origins: Vectors, ways: Vectors) -> tuple[NDArray[np.intp], NDArray[np.intp], Vectors]:
        """The rays that meet a triangle, which, and how far away."""
        found = np.asarray(self._tracer.intersects_first(origins, ways))
        rays = np.flatnonzero(found >= 0)
        triangles = found[rays]
        normals = self._normals[triangles]
        along = ((self._corners[triangles] - origins[rays]) * normals).sum(axis=1)
        return rays, triangles, along / (ways[rays] * normals).sum(axis=1)

    def hits(self, origins: Vectors, ways: Vectors) -> Hits:
        """What rays meet first."""
        rays, triangles, distance = self._first(origins, ways)
        normals = self._normals[triangles]
        normals = np.where((normals * ways[rays]).sum(axis=1, keepdims=True) < 0, normals, -normals)
        points = origins[rays] + distance[:, None] * ways[rays] + LIFT * normals
        return Hits(rays, points, normals, -ways[rays], self.scene.material[triangles].astype(np.intp))

    def lit(self, hits: Hits) -> tuple[Vectors, Vectors]:
        """Unit vectors to the lamp, and what arrives of it on a surface across them; 0 where it is hidden."""
        way = self.lamp - hits.points
        distance = np.linalg.norm(way, axis=1)
        way /= distance[:, None]
        arrives = np.where((way * hits.normals).sum(axis=1) > 0, POWER / distance**2, 0.0)
        rays, _, until = self._first(hits.points, way)
        arrives[rays[until < distance[rays] - 10 * LIFT]] = 0.0
        return way, arrives


def around(rng: np.random.Generator, axes: Vectors, power: float) -> Vectors:
    """Directions about axes with a density of cosine to a power."""
    u, v = rng.random((2, len(axes)))
    cosine = u ** (1 / (power + 1))
    helper = np.where(np.abs(axes[:, :1]) > 0.9, [[0.0, 1.0, 0.0]], [[1.0, 0.0, 0.0]])
    side = np.cross(axes, helper)
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    turned = np.cos(2 * np.pi * v)[:, None] * side + np.sin(2 * np.pi * v)[:, None] * np.cross(axes, side)
    return np.sqrt(1 - cosine**2)[:, None] * turned + cosine[:, None] * axes


@dataclass
class Reference:
    """Paths from the eye: as a studio has them, or all there are."""

    room: Room
    gamma: float
    every_lobe: bool
    rng: np.random.Generator

    def picture(self, samples: int) -> Vectors:
        """So many paths a pixel, each through a place of its own."""
        camera = self.room.scene.camera
        right, up, forward = camera.basis()
        half = np.tan(np.radians(camera.vertical_fov) / 2)
        row, column = np.divmod(np.arange(camera.height * camera.width), camera.width)
        total = np.zeros((len(row), 3))
        for _ in range(samples):
            x, y = self.rng.random((2, len(row)))
            across = (2 * (column + x) - camera.width) / camera.height * half
            above = (1 - 2 * (row + y) / camera.height) * half
            ways = forward + across[:, None] * right + above[:, None] * up
            ways /= np.linalg.norm(ways, axis=1, keepdims=True)
            origins = np.broadcast_to(np.asarray(camera.position, np.float64), ways.shape)
            total += self.radiance(origins, ways, 0, True)
        return (total / samples).reshape(camera.height, camera.width, 3)

    def radiance(self, origins: Vectors, ways: Vectors, depth: int, shiny: bool) -> Vectors:
        """What comes along rays that have left `depth` surfaces."""
        room, total = self.room, np.zeros((len(ways), 3))
        hits = room.hits(origins, ways)
        if not len(hits.rays):
            return total
        rho = room.albedo[hits.material]
        to_lamp, arrives = room.lit(hits)
        cosine = (to_lamp * hits.normals).sum(axis=1)
        here = rho / np.pi * (arrives * np.maximum(cosine, 0))[:, None]
        lobes = np.flatnonzero((hits.material == room.shiny) & shiny)
        some = Hits(*(own[lobes] for own in hits))
        mirrored = 2 * (some.ways * some.normals).sum(axis=1)[:, None] * some.normals - some.ways
        peak = np.maximum((to_lamp[lobes] * mirrored).sum(axis=1), 0) ** self.gamma
        direct = (self.gamma + 2) / (2 * np.pi) * peak * arrives[lobes] * np.maximum(cosine[lobes], 0)
        here[lobes] += SHINE * direct[:, None]
        if depth < (LONGEST if self.every_lobe else BOUNCES):
            here += rho * self.radiance(hits.points, around(self.rng, hits.normals, 1.0), depth + 1, self.every_lobe)
        if len(lobes) and depth < LONGEST:
            out = around(self.rng, mirrored, self.gamma)
            above = np.maximum((out * some.normals).sum(axis=1), 0)
            weight = (self.gamma + 2) / (self.gamma + 1) * above
            here[lobes] += SHINE * weight[:, None] * self.radiance(some.points, out, depth + 1, self.every_lobe)
        total[hits.rays] = here
        return total


def tiles(picture: Vectors) -> Vectors:
    """Means over tiles."""
    height, width = (side // TILE for side in picture.shape[:2])
    return picture.reshape(height, TILE, width, TILE, 3).mean(axis=(1, 3))


def off(picture: Vectors, truth: Vectors) -> float:
    """What pixels are off by, over the picture's own."""
    return float(np.abs(picture - truth).sum() / truth.sum())


def halves(reference: Reference, samples: int) -> tuple[Vectors, float, float]:
    """A reference, and the noise of its pixels and of its tiles."""
    first, second = (reference.picture(samples // 2) for _ in range(2))
    mean = (first + second) / 2
    return mean, off(first, second) / 2, off(tiles(first), tiles(second)) / 2


def compared(name: str, size: int, samples: int, gather: int, folder: Path) -> Iterator[str]:
    """A line for each gamma and reference."""
    scene = dl.Scene.builtin(name)
    scene = scene.with_camera(scene.camera.resized(size, size))
    low, high = scene.vertices.min(axis=0), scene.vertices.max(axis=0)
    place = low + (high - low) * (0.55, 0.85, 0.6)
    family = dl.Family("lafortune", (3, 300), error=0.005)
    with tempfile.TemporaryDirectory() as made:
        transport = dl.precompute_studio(
            scene, Path(made) / "a.studio", families={SCENES[name]: family}, gather=gather, bounces=BOUNCES
        )
        studio = dl.Studio(transport)
        studio.set_lights([dl.PointLight(tuple(place), POWER)])
        studio.edit(SCENES[name])
        room = Room(scene, scene.numbered(SCENES[name]), np.asarray(place, np.float64))
        for gamma in GAMMAS:
            studio.set(SCENES[name], gamma=gamma, k_s=SHINE)
            found = studio.step().image.astype(np.float64)
            shown = [found]
            for what, every in (("as a studio has it", False), ("every path", True)):
                rng = np.random.default_rng(int(gamma))
                truth, noise, noise_of_tiles = halves(Reference(room, gamma, every, rng), samples)
                shown += [truth, 10 * np.abs(found - truth)]
                yield (
                    f"{name:18} {gamma:5.0f}  {what:18} {100 * (found.sum() / truth.sum() - 1):+6.2f} "
                    f"{100 * off(found, truth):6.2f} {100 * noise:6.2f} "
                    f"{100 * off(tiles(found), tiles(truth)):6.2f} {100 * noise_of_tiles:6.2f}"
                )
            row = np.concatenate(shown, axis=1).astype(np.float32)
            save_image(folder / f"{name}-{gamma:g}.png", to_display(row, auto_exposure(shown[1].astype(np.float32))))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--size", type=int, default=64, help=f"of the picture, in whole tiles of {TILE}")
    parser.add_argument("--samples", type=int, default=256, help="paths a pixel of each reference")
    parser.add_argument("--gather", type=int, default=4096)
    parser.add_argument("--scene", action="append", choices=[*SCENES], help="default: all")
    parser.add_argument("-o", "--output", type=Path, default=Path("bench-studios"))
    chosen = parser.parse_args()
    chosen.output.mkdir(parents=True, exist_ok=True)
    # k_d is 1 here and k_s beside it: some of these materials reflect more than they receive.
    warnings.filterwarnings("ignore", message=".*may reflect more light.*")
    print(f"{'':18} gamma  {'reference':18}  total    off  noise  tiles  noise   (%)")
    for name in chosen.scene or SCENES:
        for line in compared(name, chosen.size, chosen.samples, chosen.gather, chosen.output):
            print(line, flush=True)


if __name__ == "__main__":
    main()
