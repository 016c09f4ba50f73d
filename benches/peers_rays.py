"""Occlusion rays per CPU-second, side by side with Embree on the same rays: `python benches/peers_rays.py`.

The rays are those of the precomputation: from what a camera sees (512 x 512 first hits) to the texels of a 6 x 64 x 64
cubemap above the horizon; a sample of bundles of 64 receivers and of blocks of 8 x 8 texels stands for all. Ours are
traced through `_core.Tracer`, Embree's through the arrays of the `embreex` package, on one thread each, in turns; a
figure is the best of its turns in CPU time. Both get the same triangles and the same lifted origins, in f32, in one
order.

Scenes: the built-in plant, and any file given by --mesh. Without one, the 69k bunny, and a million triangles made of it
by splitting, where ../shared/data/mesh holds it.
"""

from __future__ import annotations

import argparse
import dataclasses
import platform
import time
from collections.abc import Callable
from pathlib import Path

import deltalux as dl
import numpy as np
from deltalux import _core
from numpy.typing import NDArray

BUNNY = Path(__file__).parents[1] / "../shared/data/mesh/stanford-bunny_69k.obj"
BUNDLE = BLOCK = 64
LIFT = 4e-6
"""As in rust/scene/rays/tracer.rs: how far origins are lifted, in the normalised scene."""


@dataclasses.dataclass
class Rays:
    """Rays of one scene, in a space where its largest extent is between 1 and 2."""

    name: str
    vertices: NDArray[np.float64]
    triangles: NDArray[np.uint32]
    origins: NDArray[np.float64]
    normals: NDArray[np.float64]
    batches: list[tuple[slice, NDArray[np.float64]]]
    """Rows of `origins` that are one bundle, and the directions that it looks in."""

    def above(self, rows: slice, directions: NDArray[np.float64]) -> NDArray[np.bool_]:
        # Added up as the tracer does, and without BLAS: its threads spin on, and would be counted as ours.
        d, n = directions.astype(np.float32), self.normals[rows].astype(np.float32)
        return np.asarray(sum(d[:, None, k] * n[None, :, k] for k in range(3)) > 0)


def texel_blocks(size: int = 64, side: int = 8) -> NDArray[np.float64]:
    """Unit directions of texel centres, (blocks, side * side, 3)."""
    at = (2 * np.arange(size) + 1) / size - 1
    t, s = (
        a.reshape(size // side, side, size // side, side).swapaxes(1, 2) for a in np.meshgrid(at, at, indexing="ij")
    )
    one = np.ones_like(s)
    faces = [(one, -t, -s), (-one, -t, s), (s, one, t), (s, -one, -t), (s, -t, one), (-s, -t, -one)]
    points = np.concatenate([np.stack(face, -1).reshape(-1, side * side, 3) for face in faces])
    return np.asarray(points / np.linalg.norm(points, axis=-1, keepdims=True))


def rays_of(scene: dl.Scene, bundles: int, blocks: int) -> Rays:
    """A sample of the rays of a scene: every so many bundles, each with every so many blocks of texels."""
    receivers = scene.traced().receivers(scene.camera.resized(512, 512).rays(), edges=False)
    corners = scene.vertices[scene.triangles.ravel()]
    low, high = corners.min(0), corners.max(0)
    scale = 2.0 ** -np.floor(np.log2((high - low).max()))
    centre = (low + high) / 2

    # Positions come as f32 of the user's space: place them again by their weights.
    weights = receivers.barycentric.astype(np.float64)
    weights = np.column_stack([1 - weights.sum(1), weights])
    origins = np.einsum("rk,rkx->rx", weights, scene.vertices[scene.triangles[receivers.triangle]])
    table = receivers.table(np.zeros((len(receivers), 3), np.float32), np.zeros(len(receivers), np.uint16))
    origins, normals = (origins - centre) * scale, table.normal.astype(np.float64)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)

    texels = texel_blocks()
    starts = range(0, len(origins) - BUNDLE + 1, max(1, len(origins) // (BUNDLE * bundles)) * BUNDLE)
    step = max(1, len(texels) // blocks)
    batches = [(slice(s, s + BUNDLE), texels[k % step :: step].reshape(-1, 3)) for k, s in enumerate(starts)]
    return Rays(scene.name, (scene.vertices - centre) * scale, scene.triangles, origins, normals, batches)


def ours(rays: Rays) -> Callable[[], tuple[float, NDArray[np.bool_]]]:
    tracer = _core.Tracer(rays.vertices, rays.triangles)

    def run() -> tuple[float, NDArray[np.bool_]]:
        start = time.process_time()
        seen = [tracer.visibility(rays.origins[rows], rays.normals[rows], way) for rows, way in rays.batches]
        seconds = time.process_time() - start
        above = (rays.above(rows, way) for rows, way in rays.batches)
        return seconds, np.concatenate([visible[mask] for visible, mask in zip(seen, above, strict=True)])

    return run


def embree(rays: Rays) -> Callable[[], tuple[float, NDArray[np.bool_]]]:
    from embreex import rtcore_scene
    from embreex.mesh_construction import TriangleMesh

    scene = rtcore_scene.EmbreeScene()
    TriangleMesh(scene, rays.vertices[rays.triangles].astype(np.float32))
    lifted = (rays.origins + LIFT * rays.normals).astype(np.float32)
    starts, ways = [], []
    for rows, directions in rays.batches:
        above = rays.above(rows, directions)
        starts.append(np.broadcast_to(lifted[rows], (len(directions), BUNDLE, 3))[above])
        ways.append(np.broadcast_to(directions.astype(np.float32)[:, None], (len(directions), BUNDLE, 3))[above])
    origins, directions = np.concatenate(starts), np.concatenate(ways)

    def run() -> tuple[float, NDArray[np.bool_]]:
        start = time.process_time()
        hit = scene.run(origins, directions, query="OCCLUDED")
        return time.process_time() - start, np.asarray(hit) < 0

    return run


def million(bunny: dl.Scene) -> dl.Scene:
    """The same surface, every triangle split into sixteen."""
    vertices, triangles = bunny.vertices, bunny.triangles.astype(np.int64)
    for _ in range(2):
        edges = np.sort(triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
        edges, inverse = np.unique(edges, axis=0, return_inverse=True)
        a, b, c = triangles.T
        ab, bc, ca = (len(vertices) + inverse.reshape(-1, 3)).T
        vertices = np.concatenate([vertices, vertices[edges].mean(1)])
        triangles = np.concatenate([np.stack(t, 1) for t in [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]])
    split = dl.Scene.from_arrays(vertices, triangles, albedo=(0.5, 0.5, 0.5), camera=bunny.camera)
    return dataclasses.replace(split, name="million")


def scenes(meshes: list[Path]) -> list[dl.Scene]:
    found = [dl.Scene.builtin("plant"), *(dl.Scene.load(path) for path in meshes)]
    if not meshes and BUNNY.exists():
        bunny = dl.Scene.load(BUNNY)
        found += [bunny, million(bunny)]
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--mesh", type=Path, nargs="+", default=[], help="scene files to measure beside the plant")
    parser.add_argument("--bundles", type=int, default=100, help="bundles of 64 receivers (default 100)")
    parser.add_argument("--blocks", type=int, default=48, help="blocks of 8 x 8 texels for each, of 384 (default 48)")
    parser.add_argument("--turns", type=int, default=3, help="turns of each program (default 3)")
    arguments = parser.parse_args()

    _core.set_threads(1)
    print(f"{platform.processor() or platform.machine()}, {'debug' if _core.DEBUG_BUILD else 'release'} build")
    print(f"{'scene':24}{'triangles':>10}{'rays':>12}{'ours':>8}{'Embree':>8}{'ratio':>7}{'blocked':>9}{'differ':>9}")
    for scene in scenes(arguments.mesh):
        rays = rays_of(scene, arguments.bundles, arguments.blocks)
        programs = [ours(rays), embree(rays)]
        turns = [[program() for program in programs] for _ in range(arguments.turns)]
        mine, theirs = turns[0][0][1], turns[0][1][1]
        speed = [len(mine) / min(turn[k][0] for turn in turns) / 1e6 for k in range(2)]
        print(
            f"{scene.name:24}{len(scene.triangles):10}{len(mine):12}{speed[0]:8.1f}{speed[1]:8.1f}"
            f"{speed[0] / speed[1]:7.2f}{1 - mine.mean():9.3f}{(mine != theirs).mean():9.1e}",
            flush=True,
        )
    print("ours, Embree: millions of rays per CPU-second, f32; differ: share of rays on which the two disagree")


if __name__ == "__main__":
    main()
