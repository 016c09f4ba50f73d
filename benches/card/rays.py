"""Rays that must meet something, and rays that must not.

From inside a closed surface nothing is seen: a ray that gets out has leaked, through an edge or a vertex. From a convex
body all above the horizon is seen: a ray that meets anything has met the surface that it starts from.

Six closed and six convex bodies; four kinds of ray, at random, through centres of texels, at vertices and at edges of
the body itself, where leaks are; three offsets of the body from the origin, and three scales.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import trimesh
from deltalux import _core
from numpy.typing import NDArray

from .tally import Clock, Tally

WHAT = "rays out of closed and off convex bodies"
SHARE = 1.0

DATA = Path(__file__).parents[2] / "../shared/data/mesh"
OFFSETS, SCALES = (0.0, 1e2, 1e4), (1e-3, 1.0, 1e3)
RAYS = 1 << 18
"""Of one trial."""
ALONE = 4096
"""Rays from one point, where each point has its own directions."""

Floats = NDArray[np.float64]


def _bumpy() -> trimesh.Trimesh:
    ball = trimesh.creation.icosphere(5)
    x, y, z = ball.vertices.T
    ball.vertices *= (1 + 0.2 * np.sin(9 * x) * np.cos(7 * y) * np.sin(8 * z + 1))[:, None]
    return ball


def _hull(points: Floats) -> trimesh.Trimesh:
    return trimesh.Trimesh(points).convex_hull


@cache
def closed() -> list[trimesh.Trimesh]:
    """Six closed surfaces; measured ones where they are at hand."""
    creation = trimesh.creation
    made = [creation.box((1, 2, 3)), creation.box((1, 1, 1e-3)), creation.torus(1, 0.3), _bumpy()]
    spare = [creation.annulus(0.5, 1, 0.2), creation.box((1, 0.01, 0.01))]
    for name, stand_in in zip(("armadillo_29k.obj", "scorpion_low.obj"), spare, strict=True):
        path = DATA / name
        made.append(trimesh.load(path, force="mesh") if path.exists() else stand_in)
    assert all(mesh.is_watertight and mesh.is_winding_consistent for mesh in made)
    return made


@cache
def convex() -> list[trimesh.Trimesh]:
    """Six convex bodies."""
    rng = np.random.default_rng(0)
    sphere = rng.normal(size=(3000, 3))
    sphere /= np.linalg.norm(sphere, axis=1, keepdims=True)
    creation = trimesh.creation
    return [
        creation.box((1, 2, 3)), creation.box((1, 1, 1e-3)), creation.cylinder(1, 2, sections=300),
        _hull(rng.normal(size=(60, 3))), _hull(sphere), _hull(sphere * (1, 0.3, 0.1)),
    ]  # fmt: skip


def unit(vectors: Floats) -> Floats:
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def starts(mesh: trimesh.Trimesh, count: int, rng: np.random.Generator) -> tuple[Floats, Floats]:
    """Points on the surface away from edges, and the normals there; none on triangles thinner than the lift."""
    inner = 2 * mesh.area_faces / np.linalg.norm(mesh.triangles - np.roll(mesh.triangles, 1, 1), axis=2).sum(1)
    weight = mesh.area_faces * (inner > 1e-4 * mesh.extents.max())
    triangle = rng.choice(len(weight), count, p=weight / weight.sum())
    part = 0.1 + 0.7 * rng.dirichlet((1, 1, 1), count)
    return np.einsum("rk,rkx->rx", part, mesh.triangles[triangle]), mesh.face_normals[triangle]


def texels(size: int = 64) -> Floats:
    """Directions of the texels of a cubemap."""
    from oracles import directions

    return directions(size).reshape(-1, 3)


def aims(mesh: trimesh.Trimesh, kind: str, rng: np.random.Generator) -> Floats:
    """Places on vertices, or on edges."""
    if kind == "vertices":
        return mesh.vertices[rng.integers(len(mesh.vertices), size=ALONE)]
    ends = mesh.vertices[mesh.edges_unique[rng.integers(len(mesh.edges_unique), size=ALONE)]]
    along = rng.choice([0.5, 0.25, *rng.random(6)], size=(ALONE, 1))
    return ends[:, 0] + along * (ends[:, 1] - ends[:, 0])


def bundles(mesh: trimesh.Trimesh, kind: str, sign: float, rng: np.random.Generator):
    """Starts, normals and directions, of so many rays in all; `sign`: outwards, or inwards."""
    if kind in ("random", "texels"):
        at, normal = starts(mesh, 512, rng)
        way = unit(rng.normal(size=(RAYS // 512, 3))) if kind == "random" else rng.permutation(texels())[: RAYS // 512]
        yield at, sign * normal, way
        return
    for at, normal in zip(*starts(mesh, RAYS // ALONE, rng), strict=True):
        way = aims(mesh, kind, rng) - at
        yield at[None], sign * normal[None], unit(way[np.linalg.norm(way, axis=1) > 0])


def trial(mesh: trimesh.Trimesh, inwards: bool, kind: str, rng: np.random.Generator) -> tuple[int, int]:
    """Rays of one kind, and how many of them went wrong."""
    tracer = _core.Tracer(mesh.vertices.astype(np.float64), mesh.faces.astype(np.uint32))
    rays = wrong = 0
    for at, normal, way in bundles(mesh, kind, -1.0 if inwards else 1.0, rng):
        seen = tracer.visibility(at, normal, way)
        # Added up as the tracer does: a ray along the horizon is on the same side of it.
        d, n = way.astype(np.float32), normal.astype(np.float32)
        above = sum(d[:, None, k] * n[None, :, k] for k in range(3)) > 0
        rays += int(above.sum())
        wrong += int((seen if inwards else above & ~seen).sum())
    return rays, wrong


def run(clock: Clock, seed: int, folder: Path) -> Tally:
    tally, rng, number = Tally(), np.random.default_rng(seed), 0
    cases = [(inwards, body, kind, offset) for inwards in (True, False) for body in range(6) for kind in KINDS
             for offset in OFFSETS]  # fmt: skip
    while clock.left():
        inwards, body, kind, offset = cases[(number + 7 * seed) % len(cases)]
        number += 1
        mesh = (closed() if inwards else convex())[body].copy()
        scale, kept = rng.choice(SCALES), "closed" if inwards else "convex"
        mesh.apply_scale(scale)
        mesh.apply_translation(offset * mesh.extents.max() * unit(rng.normal(size=3)))
        rays, wrong = trial(mesh, inwards, kind, rng)
        what = f"{wrong} of {rays} rays, {kept} body {body}, {kind}, offset {offset:g}, scale {scale:g}"
        tally.count(rays, wrong, what)
        tally.add("out of closed bodies" if inwards else "off convex bodies", rays)
    return tally


KINDS = ("random", "texels", "vertices", "edges")
