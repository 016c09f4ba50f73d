"""Twelve scenes against Mitsuba 3's path integrator, under exactly the same light.

A scene a turn. The light is piecewise constant, 6 x 32 x 32 texels: ours as a cubemap, Mitsuba's as six far squares
that shine by those texels. Rays from the eye through the very points of our rows carry the samples, so that pixels are
the same points on both sides; textures, colours and normals are Mitsuba's own reading of the scene.

Three statistics of every channel, at a significance of 1e-3 each after Sidak's correction over scenes and channels: the
worst row, the worst 8 x 8 tile, the whole picture. Mitsuba's noise and what 16 rays know of an edge texel are their
deviation. Two kinds of scene are known to be off, and are asked for what is beyond it:

- thin things, as leaves and rims: what is thinner than a texel and lies between the middles of its neighbours is not
  found, so that a few rows in a thousand take a lamp for open or closed (`THIN`);
- bounces go by way of nodes, whose spacing biases tiles and the picture (`ALLOWED`); their rows are not asked.

The smallest gain that the picture's statistic would notice is shown beside.
"""

from __future__ import annotations

import importlib
import os
import shutil
import subprocess
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import deltalux as dl
import numpy as np
import oracles
from deltalux import _core
from numpy.typing import NDArray
from scipy.stats import norm

from .tally import Clock, Tally

WHAT = "scenes against Mitsuba, by the worst row, tile and picture"
SHARE = 0.5

SIZE, WIDTH = 32, 24
SAMPLES, AT_ONCE = 16_000_000, 1 << 19
ALPHA = 1e-3
FAR = 3e4
"""How far the light is, in sizes of the scene."""
MOST_LEFT_OUT = 0.05
"""Share of the rows."""
THIN = 0.005
"""Share of the rows near thin things that may be off."""
ALLOWED = {"tile": 0.02, "picture": 0.004}
"""How far bounces by way of nodes may be off, relative to a tile and to the picture."""

Floats = NDArray[np.float64]


def on_the_floor(*parts, camera: tuple, **more) -> dl.Scene:
    """Parts above a floor, which is the last material."""
    floor = oracles.quad((-3, 0, -3), (6, 0, 0), (0, 0, 6), more.pop("cells", 1))
    mesh = oracles.merged(*parts, floor)
    counts = [len(triangles) for _, triangles in (*parts, floor)]
    material = np.repeat(np.arange(len(counts)), counts)
    eye = dl.Camera(*camera, vertical_fov=38, width=WIDTH, height=WIDTH)
    materials = [dl.Material(albedo) for albedo in more.pop("albedo")]
    return dl.Scene.from_arrays(*mesh, materials=materials, material=material, camera=eye, **more)


def boxes() -> dl.Scene:
    tall = oracles.box((0, 0, 0), (1, 2, 1.5)), oracles.box((-1.5, 0, 0.5), (-1.0, 1.5, 0.75))
    colours = [(0.8, 0.2, 0.1), (0.1, 0.3, 0.9), (0.5, 0.5, 0.5)]
    return on_the_floor(*tall, camera=((-3.2, 4.6, 5.5), (0, 0.6, 0)), albedo=colours)


def ball(rings: int) -> tuple[Floats, NDArray[np.int64]]:
    """A ball of radius 1 on the floor; poles are rings without width."""
    theta, phi = np.linspace(0, np.pi, rings + 1), 2 * np.pi * np.arange(2 * rings + 1) / (2 * rings)
    theta, phi = np.meshgrid(theta, phi, indexing="ij")
    points = np.stack([np.sin(theta) * np.cos(phi), np.cos(theta) + 1, np.sin(theta) * np.sin(phi)], -1)
    at = np.arange(theta.size).reshape(theta.shape)
    a, b, c, d = at[:-1, :-1], at[1:, :-1], at[:-1, 1:], at[1:, 1:]
    halves = np.stack([a, c, d], -1)[1:], np.stack([a, d, b], -1)[:-1]
    return points.reshape(-1, 3), np.concatenate([half.reshape(-1, 3) for half in halves])


def smooth(rings: int = 6, cells: int = 1) -> dl.Scene:
    """Few facets, whose normals are those of the ball."""
    points, triangles = ball(rings)
    floor = oracles.quad((-3, 0, -3), (6, 0, 0), (0, 0, 6), cells)[0]
    normals = np.concatenate([points - [0, 1, 0], np.tile([0.0, 1.0, 0.0], (len(floor), 1))])
    return on_the_floor(
        (points, triangles), camera=((1.5, 3.0, 5.0), (0, 0.7, 0)), albedo=[(0.7, 0.6, 0.2), (0.4, 0.4, 0.5)],
        normals=normals, cells=cells,
    )  # fmt: skip


def textured() -> dl.Scene:
    """A floor with a picture, whose colours and contrasts are strong, under boxes."""
    scene, rng = boxes(), np.random.default_rng(5)
    picture = rng.random((16, 16, 3)) ** 2
    uv = scene.vertices[:, [0, 2]] / 6 + 0.5
    return replace(scene, uv=uv.astype(np.float32), textures=(None, None, picture.astype(np.float32)))


def coloured() -> dl.Scene:
    """Colours at vertices."""
    scene, rng = boxes(), np.random.default_rng(6)
    return replace(scene, colours=rng.random((len(scene.vertices), 3)).astype(np.float32))


def builtin(name: str) -> Callable[[], dl.Scene]:
    def build() -> dl.Scene:
        scene = dl.Scene.builtin(name)
        return scene.with_camera(scene.camera.resized(WIDTH, WIDTH))

    return build


def room() -> dl.Scene:
    """An open box with a picture on its back wall, and another in it."""
    walls, within = oracles.box((-1, 0, -1), (1, 2, 1), without="z+"), oracles.box((-0.2, 0, -0.5), (0.5, 0.9, 0.2))
    vertices, triangles = oracles.merged(walls, within)
    material = np.where(np.arange(len(triangles)) < len(walls[1]), 0, 1)
    picture = np.random.default_rng(7).random((8, 8, 3))
    eye = dl.Camera((0.3, 1.1, 4.5), (0, 1, 0), vertical_fov=30, width=WIDTH, height=WIDTH)
    materials = [dl.Material(0.9), dl.Material((0.8, 0.4, 0.1))]
    scene = dl.Scene.from_arrays(vertices, triangles, materials=materials, material=material, camera=eye)
    uv = vertices[:, :2] / 2 + [0.5, 0.0]
    return replace(scene, uv=uv.astype(np.float32), textures=(picture.astype(np.float32), None))


def light_of(name: str) -> Floats:
    """Radiance (6, 32, 32, 3)."""
    if name == "constant":
        return np.broadcast_to((1.0, 0.7, 0.4), (6, SIZE, SIZE, 3)).astype(np.float64)
    if name == "texel":
        # Of the +Y face, in front of the scene and to its right.
        light = np.zeros((6, SIZE, SIZE, 3))
        light[2, 21, 20] = 1e4, 2e4, 3e4
        return light
    # Turned out of its symmetries.
    return dl.Environment.builtin(name).rotated(37.0, (1, 2, 0.5)).cubemap(SIZE).astype(np.float64)


@dataclass(frozen=True)
class Case:
    """A scene, its light, and how it is made."""

    build: Callable[[], dl.Scene]
    light: str
    bounces: int = 0
    receivers: str = "pixels"
    thin: bool = False


CASES = {
    "boxes": Case(boxes, "constant"),
    "boxes, one bright texel": Case(boxes, "texel"),
    "textured": Case(textured, "hall"),
    "colours at vertices": Case(coloured, "sky"),
    "smooth normals": Case(smooth, "hall"),
    "rows at vertices": Case(lambda: smooth(6, 12), "hall", receivers="vertices"),
    "cornell": Case(builtin("cornell"), "hall"),
    "still-life": Case(builtin("still-life"), "studio", thin=True),
    "plant": Case(builtin("plant"), "hall", thin=True),
    "street": Case(builtin("street"), "sky", thin=True),
    "cornell, two bounces": Case(builtin("cornell"), "hall", bounces=2),
    "textured room, two bounces": Case(room, "hall", bounces=2),
}


@cache
def mitsuba() -> Any:
    """Its vectorised variant. Its loops need a newer LLVM than many systems have; Rust's own will do."""
    if "DRJIT_LIBLLVM_PATH" not in os.environ and shutil.which("rustc"):
        said = subprocess.run(["rustc", "--print", "sysroot"], capture_output=True, text=True, check=True).stdout
        for library in sorted(Path(said.strip(), "lib").glob("libLLVM*.so*")):
            os.environ["DRJIT_LIBLLVM_PATH"] = str(library)
    mi = importlib.import_module("mitsuba")
    mi.set_variant("llvm_ad_rgb")
    return mi


def colour(scene: dl.Scene, number: int) -> dict[str, Any]:
    """A material's reflectance."""
    mi, albedo = mitsuba(), scene.albedo[number]
    if scene.textures and scene.textures[number] is not None:
        picture = np.asarray(scene.textures[number], np.float32) * albedo
        return {"type": "bitmap", "bitmap": mi.Bitmap(picture.astype(np.float32)), "raw": True}
    if scene.colours is not None:
        return {"type": "mesh_attribute", "name": "vertex_color"}
    return {"type": "rgb", "value": albedo.tolist()}


def surfaces(scene: dl.Scene) -> dict[str, Any]:
    """The same triangles, a mesh for each material."""
    mi, shapes = mitsuba(), {}
    for number in range(len(scene.albedo)):
        triangles = scene.triangles[scene.material == number]
        diffuse = {"type": "diffuse", "reflectance": colour(scene, number)}
        properties = mi.Properties()
        properties["bsdf"] = mi.load_dict({"type": "twosided", "bsdf": diffuse})
        with_normals, with_uv = scene.normals is not None, scene.uv is not None
        mesh = mi.Mesh(f"m{number}", len(scene.vertices), len(triangles), properties, with_normals, with_uv)
        arrays = {"vertex_positions": scene.vertices, "faces": triangles.astype(np.uint32)}
        if with_normals:
            arrays["vertex_normals"] = scene.normals
        if with_uv:
            # Mitsuba's first row is at v = 0.
            arrays["vertex_texcoords"] = scene.uv * [1, -1] + [0, 1]
        if scene.colours is not None:
            mesh.add_attribute("vertex_color", 3, (scene.colours * scene.albedo[number]).astype(np.float32).ravel())
        parameters = mi.traverse(mesh)
        for key, array in arrays.items():
            kind = np.uint32 if key == "faces" else np.float32
            parameters[key] = type(parameters[key])(np.asarray(array).astype(kind).ravel())
        parameters.update()
        shapes[f"m{number}"] = mesh
    return shapes


def shining(light: Floats, middle: Floats, distance: float) -> dict[str, Any]:
    """Six squares around a scene."""
    mi, squares, area = mitsuba(), {}, oracles.solid_angles(SIZE)
    for number, face in enumerate(oracles._FACES):
        if not light[number].any():
            continue
        centre = np.array(face(0, 0), float)
        right, down = np.array(face(1, 0), float) - centre, np.array(face(0, 1), float) - centre
        place = np.eye(4)
        place[:3] = np.stack([distance * right, distance * down, np.cross(right, down), middle + distance * centre], 1)
        bitmap, flux = mi.Bitmap(light[number].astype(np.float32)), float((light[number].sum(-1) * area).sum())
        radiance = {"type": "bitmap", "bitmap": bitmap, "raw": True, "filter_type": "nearest"}
        squares[f"light{number}"] = {
            "type": "rectangle", "to_world": mi.ScalarTransform4f(place),
            "emitter": {"type": "area", "radiance": radiance, "sampling_weight": flux},
        }  # fmt: skip
    return squares


def means(draw: Callable[[int], Any], rows: int, each: int) -> tuple[Floats, Floats]:
    """The mean of what is drawn, `each` times a row and call, and its standard error, (rows, 3)."""
    runs = -(-SAMPLES // (rows * each))
    sums = np.zeros((2, rows, 3))
    for run in range(runs):
        values = np.array(draw(run), np.float64).T.reshape(rows, each, 3)
        sums += values.sum(1), (values**2).sum(1)
    mean, square = sums / (runs * each)
    return mean, np.sqrt(np.maximum(square - mean**2, 0) / (runs * each))


def along(whole: Any, origin: Floats, way: Floats, depth: int, seed: int) -> tuple[Floats, Floats]:
    """The light along rays from the eye, by the path integrator."""
    mi = mitsuba()
    integrator = mi.load_dict({"type": "path", "max_depth": depth, "rr_depth": 100})
    sampler, each = mi.load_dict({"type": "independent"}), max(AT_ONCE // len(origin), 1)
    rays = [np.repeat(array, each, axis=0).astype(np.float32).T for array in (origin, way)]
    ray = mi.RayDifferential3f(mi.Point3f(*rays[0]), mi.Vector3f(*rays[1]))

    def draw(run: int) -> Any:
        sampler.seed(1_000_003 * seed + 7919 * run, len(origin) * each)
        return integrator.sample(whole, sampler, ray)[0]

    return means(draw, len(origin), each)


def arriving(whole: Any, position: Floats, normal: Floats, seed: int) -> tuple[Floats, Floats]:
    """The direct light at points off all surfaces, L cos / pi, by samples of the emitters."""
    mi, dr, each = mitsuba(), importlib.import_module("drjit"), max(AT_ONCE // len(position), 1)
    sampler, count = mi.load_dict({"type": "independent"}), len(position) * each
    place, up = (np.repeat(array, each, axis=0).astype(np.float32).T for array in (position, normal))
    at, upwards = dr.zeros(mi.Interaction3f, count), mi.Vector3f(*up)
    at.p = mi.Point3f(*place)

    def draw(run: int) -> Any:
        sampler.seed(1_000_003 * seed + 7919 * run, count)
        sample, weight = whole.sample_emitter_direction(at, sampler.next_2d(), False)
        cosine = dr.dot(upwards, sample.d)
        ray = mi.Ray3f(at.p, sample.d, 0.999 * sample.dist, 0.0, [])
        return dr.select((cosine > 0) & ~whole.ray_test(ray), weight * cosine / np.pi, 0)

    return means(draw, len(position), each)


def beside_an_edge(share: Floats) -> NDArray[np.bool_]:
    """Of each texel whether it and its neighbours in its face are open to another part."""
    padded = np.pad(share.reshape(6, SIZE, SIZE), ((0, 0), (1, 1), (1, 1)), mode="edge")
    around = [padded[:, i : i + SIZE, k : k + SIZE] for i in range(3) for k in range(3)]
    return (np.max(around, axis=0) - np.min(around, axis=0) > 0.1).ravel()


def of_itself(transport: dl.Transport, light: Floats) -> tuple[Floats, Floats]:
    """What B is off by the columns' own rule, and its deviation, (rows, 3).

    The middle of an open texel speaks for its mean cosine, which is a known difference; 16 rays tell how much of an
    edge texel is open, with a variance of v (1 - v) / 16 or so.
    """
    area, radiance = np.tile(oracles.solid_angles(SIZE).ravel(), 6), light.reshape(-1, 3)
    middles, points = oracles.directions(SIZE).reshape(-1, 3), oracles.points(SIZE, 4)
    points = points.reshape(6, SIZE, 4, SIZE, 4, 3).swapaxes(2, 3).reshape(-1, 16, 3)
    lengths = np.linalg.norm(points, axis=-1)
    # Within a texel the solid angle of a part goes with the third power of how near it is.
    parts = points / lengths[..., None] * (lengths**-3 / (lengths**-3).sum(1, keepdims=True))[..., None]
    heading = points / lengths[..., None]
    off, variance = np.zeros((transport.shape[0], 3)), np.zeros((transport.shape[0], 3))
    lit = radiance.any(1)
    for row, normal in enumerate(transport.receivers.normal.astype(np.float64)):
        stored = transport._core.row(row)[:, 0].astype(np.float64)
        own = _core.haar_inverse(SIZE, np.repeat(stored[:, None], 3, axis=1))[..., 0].ravel()
        middle = np.maximum(middles @ normal, 0) / np.pi
        mean = np.where(heading @ normal > 0, parts @ normal, 0).sum(1) / np.pi
        by_middle = (middle > 0) & (np.abs(own - middle) <= 1e-4 * np.maximum(middle, 0.01))
        off[row] = (np.where(by_middle, middle - mean, 0) * area)[lit] @ radiance[lit]
        share = np.clip(own / np.maximum(mean, 1e-12), 0, 1)
        # Also where all 16 rays agree beside an edge, as if half a ray had not.
        seen = (16 * share + 0.5) / 17
        unsure = np.where(beside_an_edge(share) | (share * (1 - share) > 0.02), seen * (1 - seen) / 17 * mean**2, 0)
        # Texels whose middle lies below the horizon are left out, be they open or not.
        unsure += np.where(middle > 0, 0, mean**2 / 4)
        variance[row] = (unsure * area**2)[lit] @ radiance[lit] ** 2
    return off, np.sqrt(variance)


def met(whole: Any, scene: dl.Scene, transport: dl.Transport, origin: Floats, way: Floats, seed: int):
    """Which rows are the same points to both, and our albedos there.

    Left out are rays that meet something else in 32-bit floats, normals that are turned towards the eye behind a
    silhouette, and rows nearer to another surface than a few of the steps by which Mitsuba's rays leave theirs.
    Textures are taken at the point: a transport's own albedo is the mean over what its pixel covers.
    """
    mi, receivers = mitsuba(), transport.receivers
    size = float(np.linalg.norm(np.ptp(scene.vertices, axis=0)))
    ray = mi.Ray3f(*(kind(*array.astype(np.float32).T) for kind, array in ((mi.Point3f, origin), (mi.Vector3f, way))))
    corner = whole.ray_intersect_preliminary(ray)
    hit = corner.compute_surface_interaction(ray)
    same = np.linalg.norm(np.array(hit.p).T - receivers.position, axis=1) < 1e-4 * size
    same &= np.abs(np.einsum("rx,rx->r", np.array(hit.sh_frame.n).T, receivers.normal)) > 0.9999
    ways = np.random.default_rng(seed).normal(size=(64, 3))
    step = 9e-5 * (1 + np.abs(receivers.position).max(1))
    above = receivers.position + step[:, None] * receivers.normal
    for direction in ways / np.linalg.norm(ways, axis=1, keepdims=True):
        # Downwards as far as the row's own surface, upwards further.
        reach = np.where(receivers.normal @ direction > 0, 5.0, 0.9) * step
        place, heading = (array.astype(np.float32).T for array in (above, np.broadcast_to(direction, above.shape)))
        ray = mi.Ray3f(mi.Point3f(*place), mi.Vector3f(*heading), mi.Float(reach.astype(np.float32)), 0.0, [])
        same &= ~np.array(whole.ray_test(ray))
    # A mesh of Mitsuba's holds the triangles of a material, in their order.
    order = np.argsort(scene.material, kind="stable")
    first = np.searchsorted(scene.material[order], receivers.material)
    triangle = order[np.where(same, first + np.array(corner.prim_index), 0)]
    return same, scene.albedo_at(triangle, np.array(corner.prim_uv).T)


def rays_to(transport: dl.Transport, scene: dl.Scene) -> tuple[Floats, Floats]:
    """From the eye through each pixel's point."""
    at, eye = transport.receivers.position.astype(np.float64), np.array(scene.camera.position, float)
    way = at - eye
    return np.broadcast_to(eye, at.shape), way / np.linalg.norm(way, axis=1, keepdims=True)


def tiles_of(transport: dl.Transport) -> NDArray[np.int64]:
    """The 8 x 8 tile of pixels that each row is in; of vertices 64 neighbours."""
    if transport.receivers.kind == "vertices":
        return np.arange(transport.shape[0]) // 64
    row, column = np.divmod(transport.receivers.pixel.astype(int), WIDTH)
    return row // 8 * WIDTH + column // 8


def largest_z(count: int) -> float:
    """The |z| that the largest of so many normal numbers exceeds with probability ALPHA, after Sidak."""
    alpha = 1 - (1 - ALPHA) ** (1 / (3 * len(CASES)))
    return float(norm.isf((1 - (1 - alpha) ** (1 / count)) / 2))


@dataclass(frozen=True)
class Verdict:
    """One channel: each statistic by the largest that it may be, what gain would be seen, and what was."""

    scores: dict[str, float]
    sees: float
    off: float


def compare(found: Floats, expected: Floats, error: Floats, tile: NDArray[np.int64], case: Case) -> Verdict:
    """The three statistics, and a fourth: what has no error on either side must agree outright."""
    kept = error > 0
    apart = np.abs((found - expected)[~kept]).max(initial=0) / (1e-3 * expected.max())
    difference, variance, level = (found - expected)[kept], error[kept] ** 2, expected[kept]
    _, of_tile = np.unique(tile[kept], return_inverse=True)
    sums = [np.bincount(of_tile, numbers) for numbers in (difference, variance, level)]
    allowed = ALLOWED if case.bounces else {"tile": 0.0, "picture": 0.0}
    rows = np.abs(difference) / np.sqrt(variance) / largest_z(len(difference))
    beyond = np.maximum(np.abs(sums[0]) - allowed["tile"] * sums[2], 0)
    whole = max(abs(difference.sum()) - allowed["picture"] * level.sum(), 0)
    scores = {
        "row": 0.0 if case.bounces else float((rows > 1).mean() / THIN if case.thin else rows.max()),
        "tile": float((beyond / np.sqrt(sums[1])).max()) / largest_z(len(sums[0])),
        "picture": float(whole / np.sqrt(variance.sum())) / largest_z(1),
        "row without noise": float(apart),
    }
    sees = largest_z(1) * np.sqrt(variance.sum()) / level.sum() + allowed["picture"]
    return Verdict(scores, float(sees), float(difference.sum() / level.sum()))


def run(clock: Clock, seed: int, folder: Path) -> Tally:
    tally, mi = Tally(), mitsuba()
    name = list(CASES)[seed % len(CASES)]
    case = CASES[name]
    scene, light = case.build(), light_of(case.light)
    transport = dl.precompute(
        scene, folder / "a.transport", columns=f"haar:{SIZE}", quality="lossless", bounces=case.bounces,
        receivers=case.receivers, progress=False,
    )  # fmt: skip
    V = transport.coefficients(dl.Environment.from_cubemap(light.astype(np.float32)))
    found = transport.multiply(V).astype(np.float64)
    low, high = scene.vertices.min(0), scene.vertices.max(0)
    far = FAR * float(np.linalg.norm(high - low))
    whole = mi.load_dict({"type": "scene", **surfaces(scene), **shining(light, (low + high) / 2, far)})
    if case.bounces == 0:
        off, deviation = of_itself(transport, light)
        found -= off
    else:
        deviation = np.zeros_like(found)
    if case.receivers == "vertices":
        at, normal = (array.astype(np.float64) for array in (transport.receivers.position, transport.receivers.normal))
        same, albedo = np.ones(len(found), bool), np.ones((len(found), 3))
        # Off the facets around a vertex, by as much as they are flatter than the ball.
        expected, error = arriving(whole, at + 1e-4 * normal, normal, seed)
    else:
        origin, way = rays_to(transport, scene)
        same, albedo = met(whole, scene, transport, origin, way, seed)
        expected, error = along(whole, origin, way, case.bounces + 2, seed)
    found, deviation = found * albedo, np.hypot(error, deviation * albedo)
    lost, figures = [], []
    for channel in range(3):
        parts = (array[same, channel] for array in (found, expected, deviation))
        verdict = compare(*parts, tiles_of(transport)[same], case)
        lost += [f"{key} {score:.2f}" for key, score in verdict.scores.items() if score > 1]
        figures.append(f"{verdict.off:+.3%} (sees {verdict.sees:.2%})")
        for key, score in verdict.scores.items():
            tally.see(f"{key}, of what is allowed", score)
        tally.see("least gain that would be seen, %", 100 * verdict.sees)
    missed = int((~same).sum())
    if missed > MOST_LEFT_OUT * len(same):
        lost.append(f"{missed} of {len(same)} rows cannot be compared")
    line = f"{name}: {len(same)} rows, {missed} left out; red, green, blue {', '.join(figures)}"
    print(line, {key: round(most, 2) for key, most in tally.most.items()}, flush=True)
    tally.count(1, bool(lost), f"{line}: {', '.join(lost)}")
    return tally
