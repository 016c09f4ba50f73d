"""Against independent programs: Mitsuba 3's rays and path tracer, and Embree's rays.

1. Every ray: transports of one ray a texel hold exactly what another ray tracer says of the same rays.
2. Every receiver: B against a Monte Carlo estimate over Mitsuba's rays, judged by three statistics (worst receiver,
   worst 8 x 8 tile, whole picture) at a significance of 1e-3 after Sidak's correction over all cases.
3. The renderer: Mitsuba's own path integrator, materials and environment map against B times the albedo.

Both sides are fed the same piecewise constant light, haar:32, in which a texel's edge is 3 degrees long.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path

import deltalux as dl
import numpy as np
import oracles
import pytest
from deltalux import _core
from tools import missing, needed

mi = needed("mitsuba")
dr = needed("drjit")
DATA = Path(__file__).parents[2] / "../shared/data/mesh"

SIZE = 32
ENVIRONMENTS = ("constant", "hall", "texel")


def box_on_a_plane(width):
    floor = oracles.quad((-4, 0, -4), (9, 0, 0), (0, 0, 10))
    mesh = oracles.merged(floor, oracles.box((0, 0, 0), (1, 2, 3)), oracles.box((-2, 0, 1), (-1.5, 3, 1.25)))
    camera = dl.Camera((-5, 7.3, 9.1), (0.1, 0.6, 1.2), vertical_fov=38, width=width, height=width)
    return dl.Scene.from_arrays(*mesh, (0.6, 0.4, 0.2), camera, name="box on a plane")


def loaded(name):
    def load(width):
        scene = dl.Scene.load(DATA / name)
        return scene.with_camera(scene.camera.resized(width, width))

    return load


def builtin(name):
    def build(width):
        scene = dl.Scene.builtin(name)
        return scene.with_camera(scene.camera.resized(width, width))

    return build


# How to make each scene, and the width of its picture.
SCENES = {
    "box": (box_on_a_plane, 24),
    "cornell": (builtin("cornell"), 24),
    "still-life": (builtin("still-life"), 12),
    "plant": (builtin("plant"), 10),
    "scorpion_low.obj": (loaded("scorpion_low.obj"), 12),
}
CASES = len(SCENES) * len(ENVIRONMENTS)


@pytest.fixture(scope="module", autouse=True)
def variant():
    """Mitsuba's vectorised variant, which needs a compiler: libLLVM of the system, or of Rust (`.ci/run` says how)."""
    try:
        mi.set_variant("llvm_ad_rgb")
        dr.eval(mi.Float(1) + 1)
    except Exception as error:
        missing(f"no vectorised Mitsuba: {error}")


@cache
def scene_of(name):
    build, width = SCENES[name]
    if name.endswith(".obj") and not (DATA / name).exists():
        pytest.skip("optional data")
    return build(width)


def mitsuba_scene(scene, **more):
    """The same triangles, a mesh for each material."""
    shapes = {}
    for number, albedo in enumerate(scene.albedo):
        triangles = scene.triangles[scene.material == number]
        bsdf = mi.load_dict({"type": "diffuse", "reflectance": {"type": "rgb", "value": albedo.tolist()}})
        properties = mi.Properties()
        properties["bsdf"] = mi.load_dict({"type": "twosided", "bsdf": bsdf})
        mesh = mi.Mesh(f"m{number}", len(scene.vertices), len(triangles), props=properties)
        parameters = mi.traverse(mesh)
        arrays = {"vertex_positions": scene.vertices.astype(np.float32), "faces": triangles.astype(np.uint32)}
        for key, array in arrays.items():
            parameters[key] = type(parameters[key])(array.ravel())
        parameters.update()
        shapes[f"m{number}"] = mesh
    return mi.load_dict({"type": "scene", **shapes, **more})


def mitsuba_open(scene):
    """open(origins, directions) -> bool: whether nothing is met."""
    inside = mitsuba_scene(scene)

    def is_open(origin, direction):
        ray = mi.Ray3f(mi.Point3f(*origin.T.astype(np.float32)), mi.Vector3f(*direction.T.astype(np.float32)))
        return ~np.array(inside.ray_test(ray))

    return is_open


def embree_open(scene):
    rtcore_scene = needed("embreex.rtcore_scene")
    mesh_construction = needed("embreex.mesh_construction")
    inside = rtcore_scene.EmbreeScene()
    mesh_construction.TriangleMesh(inside, scene.vertices[scene.triangles].astype(np.float32))

    def is_open(origin, direction):
        return inside.run(origin.astype(np.float32), direction.astype(np.float32), query="OCCLUDED") < 0

    return is_open


def light_of(name):
    """(6, 32, 32), positive: one channel of a piecewise constant light."""
    if name == "constant":
        return np.ones((6, SIZE, SIZE))
    if name == "hall":
        # Turned out of its symmetries.
        return dl.Environment.builtin("hall").rotated(37.0, (1, 2, 0.5)).cubemap(SIZE).mean(axis=-1).astype(np.float64)
    # One texel of the +Y face, in front of the scene and to its right.
    light = np.zeros((6, SIZE, SIZE))
    light[2, 21, 20] = 1e5
    return light


def response(transport, light):
    """B of every receiver for one channel."""
    env = dl.Environment.from_cubemap(np.repeat(light[..., None], 3, axis=-1).astype(np.float32))
    return transport.multiply(transport.coefficients(env))[:, 0].astype(np.float64)


def entries(transport):
    """V cos dw / pi of every receiver and texel, (rows, 6 n n), from the rows of M."""
    size = transport.columns.size
    rows = transport.to_scipy().toarray().astype(np.float64)
    radiance = [_core.haar_inverse(size, np.repeat(row[:, None], 3, axis=1))[..., 0] for row in rows]
    return (np.array(radiance) * oracles.solid_angles(size)).reshape(len(rows), -1)


# 1. ------------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("oracle", [mitsuba_open, embree_open], ids=["mitsuba", "embree"])
@pytest.mark.parametrize("name", SCENES)
def test_every_ray(make, name, oracle):
    scene, size = scene_of(name), 8
    transport = make(scene, size)
    receivers = transport.receivers
    directions = oracles.directions(size).reshape(-1, 3)
    cosine = receivers.normal.astype(np.float64) @ directions.T
    # Grazing rays graze the receiver's own neighbours too: what is an ulp above the horizon is nobody's truth.
    asked = cosine > 1e-3
    row, texel = np.nonzero(asked)
    # Positions are ray origins: lifted off their surface already.
    theirs = oracle(scene)(receivers.position[row], directions[texel])

    full = (cosine * np.tile(oracles.solid_angles(size).ravel(), 6) / np.pi)[asked]
    share = entries(transport)[asked] / full
    ours = share > 0.5
    decided = full > 1e-4
    assert np.minimum(np.abs(share), np.abs(share - 1))[decided].max() < 0.02, "open or not, nothing between"
    wrong = (ours != theirs).mean()
    # Rays through edges and thin leaves may fall on either side, by the lift and by float32.
    assert wrong <= 2e-3, f"{wrong:.2e} of {len(row)} rays"
    assert 0.02 < theirs.mean() < 0.99


# 2. ------------------------------------------------------------------------------------------------------------------


def estimate(is_open, origin, normal, light, samples, seed):
    """B and its standard error at each receiver, by directions that follow the light.

    A texel is drawn with the probability of its power, a point on it uniformly: with the solid angle
    dw = (2 / n)^2 (s^2 + t^2 + 1)^(-3/2) of that point, f = L cos V / pi dw / P.
    """
    rng = np.random.default_rng(seed)
    rows, size = len(origin), light.shape[1]
    power = (light * oracles.solid_angles(size)).ravel()
    probability = power / power.sum()
    # Points of a face are middle + s right + t down.
    middle = np.array([face(0, 0) for face in oracles._FACES], float)
    right = np.array([face(1, 0) for face in oracles._FACES], float) - middle
    down = np.array([face(0, 1) for face in oracles._FACES], float) - middle
    values = np.zeros((2, rows))
    for _ in range(8):
        count = samples // 8
        texel = np.searchsorted(np.cumsum(probability)[:-1], rng.random((rows, count)), side="right")
        face, at = np.divmod(texel, size * size)
        s = 2 * (at % size + rng.random(texel.shape)) / size - 1
        t = 2 * (at // size + rng.random(texel.shape)) / size - 1
        point = middle[face] + s[..., None] * right[face] + t[..., None] * down[face]
        length = np.sqrt(1 + s * s + t * t)
        cosine = np.einsum("rck,rk->rc", point, normal) / length
        row, draw = np.nonzero(cosine > 0)
        seen = np.zeros(texel.shape)
        seen[row, draw] = is_open(origin[row], point[row, draw] / length[row, draw, None])
        value = light.ravel()[texel] * cosine * seen / np.pi * (2 / size) ** 2 / length**3 / probability[texel]
        values += value.sum(axis=1), (value**2).sum(axis=1)
    mean, square = values / (8 * count)
    return mean, np.sqrt(np.maximum(square - mean**2, 0) / (8 * count))


def own_deviation(transport, light, expected):
    """How uncertain B is by itself: 16 rays tell how much of an edge texel is open, v (1 - v) / 16 at the most."""
    directions = oracles.directions(SIZE).reshape(-1, 3)
    cosine = np.maximum(transport.receivers.normal.astype(np.float64) @ directions.T, 0)
    full = cosine * np.tile(oracles.solid_angles(SIZE).ravel(), 6) / np.pi * light.ravel()
    lit = np.flatnonzero(light.ravel())
    if len(lit) > 1:
        share = np.clip(entries(transport)[:, lit] * light.ravel()[lit] / np.maximum(full[:, lit], 1e-30), 0, 1)
        return np.sqrt((share * (1 - share) / 16 * full[:, lit] ** 2).sum(axis=1))

    # Of a single texel the estimate tells how much is open. Its centre's cosine stands for it, which shows where the
    # receiver's horizon cuts through it.
    face, (row, column) = lit[0] // SIZE**2, np.divmod(lit[0] % SIZE**2, SIZE)
    inside = (slice(16 * row, 16 * row + 16), slice(16 * column, 16 * column + 16))
    point = oracles.points(SIZE, 16)[face][inside].reshape(-1, 3)
    length = np.linalg.norm(point, axis=1, keepdims=True)
    measure = length[:, 0] ** -3.0
    mean = np.maximum(transport.receivers.normal.astype(np.float64) @ (point / length).T, 0) @ measure / measure.sum()
    true = mean * oracles.solid_angles(SIZE)[row, column] / np.pi * light.ravel()[lit[0]]
    share = np.clip(expected / np.maximum(true, 1e-30), 0, 1)
    return np.hypot(np.sqrt(share * (1 - share) / 16) * true, true - full[:, lit[0]])


def largest_z(count):
    """The |z| that the largest of `count` normal numbers exceeds with probability 1e-3 / (3 CASES), by Sidak."""
    from scipy.stats import norm

    alpha = 1 - (1 - 1e-3) ** (1 / (3 * CASES))
    return norm.isf((1 - (1 - alpha) ** (1 / count)) / 2)


def check(found, expected, error, tile, report):
    """Worst receiver, worst tile, whole picture; says the smallest gain error that would be seen."""
    kept = error > 0
    difference, deviation = (found - expected)[kept], error[kept]
    tiles = [difference[tile[kept] == number].sum() for number in np.unique(tile[kept])]
    tile_deviation = [np.sqrt((deviation[tile[kept] == number] ** 2).sum()) for number in np.unique(tile[kept])]
    worst = np.abs(difference / deviation).max()
    worst_tile = np.abs(np.divide(tiles, tile_deviation)).max()
    whole = difference.sum() / np.sqrt((deviation**2).sum())
    gain = largest_z(1) * np.sqrt((deviation**2).sum()) / expected.sum()
    line = f"{report}: worst {worst:.2f}, tile {worst_tile:.2f}, picture {whole:+.2f}; would see {100 * gain:.2f} %"
    print(line)
    assert worst <= largest_z(kept.sum()), line
    assert worst_tile <= largest_z(len(tiles)), line
    assert abs(whole) <= largest_z(1), line
    # What has no error on either side must agree outright: receivers that no sample reaches.
    assert np.abs((found - expected)[~kept]).max(initial=0) <= 1e-3 * expected.max()
    return gain


@pytest.fixture(scope="module")
def measured(make):
    """(transport, rays, origins) of a scene at haar:32, lossless; made once."""

    @cache
    def measure(name):
        scene = scene_of(name)
        transport = make(scene, SIZE, "lossless")
        return transport, mitsuba_open(scene), transport.receivers.position.astype(float)

    return measure


def tiles_of(transport):
    """The 8 x 8 tile of pixels that each receiver is in."""
    width = transport.camera.width
    row, column = np.divmod(transport.receivers.pixel.astype(int), width)
    return row // 8 * width + column // 8


@pytest.mark.parametrize("environment", ENVIRONMENTS)
@pytest.mark.parametrize("name", SCENES)
def test_every_receiver(measured, name, environment):
    transport, is_open, origin = measured(name)
    light = light_of(environment)
    samples = 3_000_000 // len(origin)
    normal = transport.receivers.normal.astype(np.float64)
    expected, error = estimate(is_open, origin, normal, light, samples, seed=11)
    found = response(transport, light)
    own = own_deviation(transport, light, expected)
    gain = check(found, expected, np.hypot(error, own), tiles_of(transport), f"{name}, {environment}")
    assert gain < 0.04, "a test that sees only larger errors says little"


# 3. ------------------------------------------------------------------------------------------------------------------


def latlong(light, height=1024):
    """A fine raster of a piecewise constant light, with the same flux in every texel that is lit alone."""
    v, u = np.meshgrid((np.arange(height) + 0.5) / height, (np.arange(2 * height) + 0.5) / (2 * height), indexing="ij")
    theta, phi = np.pi * v, 2 * np.pi * u
    # Mitsuba's convention: u = atan2(x, -z) / 2 pi, v = acos(y) / pi.
    direction = np.stack([np.sin(theta) * np.sin(phi), np.cos(theta), -np.sin(theta) * np.cos(phi)], axis=-1)
    image = oracles.look_up(light, direction)
    flux = (image * np.sin(theta)).sum() * (np.pi / height) ** 2
    return image * ((light * oracles.solid_angles(SIZE)).sum() / flux)


@pytest.fixture
def scalar():
    """The path tracer runs in the scalar variant: its loops need more of LLVM than every machine has."""
    mi.set_variant("scalar_rgb")
    yield
    mi.set_variant("llvm_ad_rgb")


@pytest.mark.parametrize("environment", ENVIRONMENTS)
@pytest.mark.parametrize("name", ["box", "scorpion_low.obj"])
def test_the_renderer(measured, scalar, name, environment):
    transport = measured(name)[0]
    receivers, scene, light = transport.receivers, scene_of(name), light_of(environment)
    image = np.repeat(latlong(light)[..., None], 3, axis=-1).astype(np.float32)
    whole = mitsuba_scene(scene, sky={"type": "envmap", "bitmap": mi.Bitmap(image)})
    integrator, sampler = mi.load_dict({"type": "path", "max_depth": 2}), mi.load_dict({"type": "independent"})
    sampler.seed(5, 1)

    # Camera rays to the receivers, many to each; light arrives at the first thing that they meet.
    eye, passes = np.array(scene.camera.position), 60_000 // transport.shape[0]
    values = np.zeros((transport.shape[0], passes, 3))
    for row, position in enumerate(receivers.position):
        ray = mi.RayDifferential3f(mi.Point3f(*eye), mi.Vector3f(*((position - eye) / np.linalg.norm(position - eye))))
        for draw in range(passes):
            values[row, draw] = integrator.sample(whole, sampler, ray)[0]
    expected, error = values.mean(axis=1), values.std(axis=1) / np.sqrt(passes)

    found = response(transport, light)[:, None] * transport.albedo
    own = own_deviation(transport, light, expected[:, 0] / transport.albedo[:, 0])[:, None] * transport.albedo
    for channel in range(3):
        check(
            found[:, channel], expected[:, channel], np.hypot(error, own)[:, channel], tiles_of(transport),
            f"{name}, {environment}, channel {channel}",
        )  # fmt: skip


# 4. ------------------------------------------------------------------------------------------------------------------

SUN = Path(__file__).parents[2] / "../shared/data/env/kloppenheim_05_1k.hdr"


def bunny_on_a_floor():
    if not (DATA / "bunny_6k.obj").exists() or not SUN.exists():
        pytest.skip("optional data")
    bunny = dl.Scene.load(DATA / "bunny_6k.obj")
    low, high = bunny.vertices.min(axis=0), bunny.vertices.max(axis=0)
    middle = (low + high) / 2
    standing = (bunny.vertices - [middle[0], low[1], middle[2]]) / (high - low).max()
    mesh = oracles.merged(oracles.quad((-1.5, 0, -1.5), (3, 0, 0), (0, 0, 3)), (standing, bunny.triangles))
    camera = dl.Camera((0.8, 1.5, 2.6), (0, 0.35, 0), vertical_fov=38, width=96, height=72)
    return dl.Scene.from_arrays(*mesh, (0.5, 0.5, 0.5), camera, name="bunny on a floor")


def rows_of_mitsuba(env, height=1024):
    """A light as Mitsuba reads a map: its first and last rows lie on the poles, its columns as ours."""
    theta = np.pi * np.arange(height) / (height - 1)
    phi = np.pi * (np.arange(2 * height) + 0.5) / height
    theta, phi = np.meshgrid(theta, phi, indexing="ij")
    return env.radiance(np.stack([np.sin(theta) * np.sin(phi), np.cos(theta), -np.sin(theta) * np.cos(phi)], axis=-1))


def test_a_real_sun(scalar, tmp_path):
    """An outdoor map with a sun: a transport of 2 MB against a path tracer, in the mean and in blocks of 8 x 8."""
    scene, env = bunny_on_a_floor(), dl.Environment.load(SUN).rotated(30)
    sky = {"type": "envmap", "bitmap": mi.Bitmap(rows_of_mitsuba(env).astype(np.float32))}
    camera = scene.camera
    view = mi.ScalarTransform4f().look_at(list(camera.position), list(camera.target), [0, 1, 0])
    film = {"type": "hdrfilm", "width": 96, "height": 72, "rfilter": {"type": "box"}, "pixel_format": "rgb"}
    sensor = mi.load_dict({"type": "perspective", "fov": 38, "fov_axis": "y", "to_world": view, "film": film})
    integrator = mi.load_dict({"type": "path", "max_depth": 2, "hide_emitters": True})
    truth = np.array(mi.render(mitsuba_scene(scene, sky=sky), sensor=sensor, integrator=integrator, spp=256))

    def blocks(picture):
        return picture.reshape(9, 8, 12, 8, 3).sum(axis=(1, 3))

    def against(columns):
        transport = dl.precompute(scene, tmp_path / "t.transport", columns=columns, progress=False)
        found = transport.image(transport.multiply(transport.coefficients(env)))
        whole = (transport.pixels.background == 0)[..., None]
        a, b = found * whole, truth * whole
        return transport, a.sum() / b.sum() - 1, np.linalg.norm(blocks(a) - blocks(b)) / np.linalg.norm(blocks(b))

    transport, mean, block = against("haar:64+texels")
    assert transport.nbytes < 3e6 and abs(mean) < 0.007 and block < 0.01, (transport, mean, block)
    # What it is for: without texels the same truncation is darker, and its blocks are off.
    _, mean, block = against("haar:64")
    assert abs(mean) > 0.01 and block > 0.02


# 5. ------------------------------------------------------------------------------------------------------------------


def test_light_between_surfaces(scalar, tmp_path):
    """The Cornell box under the hall: all light, and what has bounced, against the path tracer; in whole pixels."""
    scene, env = builtin("cornell")(64), dl.Environment.builtin("hall")
    sky = {"type": "envmap", "bitmap": mi.Bitmap(rows_of_mitsuba(env).astype(np.float32))}
    camera = scene.camera
    view = mi.ScalarTransform4f().look_at(list(camera.position), list(camera.target), [0, 1, 0])
    film = {"type": "hdrfilm", "width": 64, "height": 64, "rfilter": {"type": "box"}, "pixel_format": "rgb"}
    whole = mitsuba_scene(scene, sky=sky)

    def truth(depth, spp):
        sensor = mi.load_dict(
            {"type": "perspective", "fov": camera.vertical_fov, "fov_axis": "y", "to_world": view, "film": film}
        )
        integrator = {"type": "path", "max_depth": depth, "hide_emitters": True, "rr_depth": 100}
        # Seeds far apart: streams of neighbouring ones meet.
        return np.array(
            mi.render(whole, sensor=sensor, integrator=mi.load_dict(integrator), spp=spp, seed=7919 * depth)
        )

    ours = {}
    for bounces in (0, 1, 6):
        transport = dl.precompute(
            scene, tmp_path / "t.transport", columns="haar:32", tolerance=0.003, bounces=bounces, progress=False
        )
        ours[bounces] = transport.image(transport.multiply(transport.coefficients(env)))
    pixels = transport.pixels
    single = (np.bincount(pixels.pixel, minlength=64 * 64) == 1) & (pixels.background.ravel() == 0)
    mask = single.reshape(64, 64, 1)
    assert transport.nodes <= 3100

    def tiles(picture):
        count = np.maximum(mask.reshape(8, 8, 8, 8).sum(axis=(1, 3)), 1)
        return (picture * mask).reshape(8, 8, 8, 8, 3).sum(axis=(1, 3)) / count[..., None]

    for bounces in (1, 6):
        theirs = truth(bounces + 2, 512)
        total = (ours[bounces] * mask).sum() / (theirs * mask).sum() - 1
        # Direct light is ours on both sides: its own truth would bring more noise than there is to see.
        bounced = [((picture - ours[0]) * mask).sum() for picture in (ours[bounces], theirs)]
        indirect = bounced[0] / bounced[1] - 1
        filled = mask.reshape(8, 8, 8, 8).sum(axis=(1, 3)) > 32
        error = np.abs(tiles(ours[bounces]) - tiles(theirs))[filled].mean() / tiles(theirs)[filled].mean()
        line = f"{bounces} bounces: total {total:+.3%}, indirect {indirect:+.2%}, tiles {error:.2%}"
        print(line)
        assert abs(total) < 0.006 and abs(indirect) < 0.03 and error < 0.02, line


def ball(model, width=64):
    """A glossy ball on a diffuse plane, of facets."""
    n = 96
    theta, phi = np.meshgrid(np.linspace(0, np.pi, n // 2 + 1), 2 * np.pi * np.arange(n) / n, indexing="ij")
    points = [np.sin(theta) * np.cos(phi), np.cos(theta) + 1, np.sin(theta) * np.sin(phi)]
    number = np.arange(theta.size).reshape(theta.shape)
    a, b = number[:-1], number[1:]
    c, d = np.roll(a, -1, axis=1), np.roll(b, -1, axis=1)
    round_ = np.concatenate([np.stack([a, c, d], -1).reshape(-1, 3), np.stack([a, d, b], -1).reshape(-1, 3)])
    plane = np.array(oracles.quad((-6, 0, -6), (12, 0, 0), (0, 0, 12))[0], float)
    vertices, triangles = oracles.merged((np.stack(points, -1).reshape(-1, 3), round_), (plane, [[0, 1, 2], [0, 2, 3]]))
    camera = dl.Camera((0, 2.2, 5.5), (0, 0.8, 0), vertical_fov=35, width=width, height=width)
    materials = {"ball": dl.Material(0, None if model is None else 0.8, model), "plane": dl.Material(0.4)}
    of = np.where(np.arange(len(triangles)) < len(round_), 0, 1)
    return dl.Scene.from_arrays(vertices, triangles, camera=camera, materials=materials, material=of, name="ball")


def against_paths(scene, env, ours, pixels, bsdf, folder, samples=512):
    """What a ball's whole pixels show beside Mitsuba's direct light: total, and means over tiles of 8 x 8 pixels."""
    shapes, bsdfs = {}, (bsdf, {"type": "diffuse", "reflectance": {"type": "rgb", "value": 0.4}})
    finer = len(ours) // 64
    ours = ours.reshape(64, finer, 64, finer, 3).mean(axis=(1, 3))
    for number, bsdf in enumerate(bsdfs):
        used, corners = np.unique(scene.triangles[scene.material == number], return_inverse=True)
        mesh = mi.Mesh("m", len(used), len(corners.reshape(-1, 3)))
        parameters = mi.traverse(mesh)
        parameters["vertex_positions"] = scene.vertices[used].astype(np.float32).ravel()
        parameters["faces"] = corners.astype(np.uint32).ravel()
        parameters.update()
        mesh.write_ply(str(folder / f"{number}.ply"))
        two_sided = bsdf if number == 0 else {"type": "twosided", "bsdf": bsdf}
        shapes[f"m{number}"] = {
            "type": "ply", "filename": str(folder / f"{number}.ply"), "face_normals": True, "bsdf": two_sided
        }  # fmt: skip
    sky = {"type": "envmap", "bitmap": mi.Bitmap(rows_of_mitsuba(env).astype(np.float32))}
    whole = mi.load_dict({"type": "scene", "sky": sky, **shapes})
    view = mi.ScalarTransform4f().look_at(list(scene.camera.position), list(scene.camera.target), [0, 1, 0])
    film = {"type": "hdrfilm", "width": 64, "height": 64, "rfilter": {"type": "box"}, "pixel_format": "rgb"}
    sensor = mi.load_dict({"type": "perspective", "fov": 35, "fov_axis": "y", "to_world": view, "film": film})
    integrator = mi.load_dict({"type": "path", "max_depth": 2, "hide_emitters": True})
    theirs = np.array(mi.render(whole, sensor=sensor, integrator=integrator, spp=samples, seed=7919))
    shown = np.zeros((64 * finer) ** 2, bool)
    shown[pixels.pixel[pixels.material == 0]] = True
    shown[pixels.pixel[pixels.material == 1]] = False
    mask = (shown & (pixels.background.ravel() == 0)).reshape(64, finer, 64, finer).all(axis=(1, 3))[..., None]
    count = mask.reshape(8, 8, 8, 8).sum(axis=(1, 3))

    def tiles(picture):
        return ((picture * mask).reshape(8, 8, 8, 8, 3).sum(axis=(1, 3)) / np.maximum(count, 1)[..., None])[count > 32]

    total = (ours * mask).sum() / (theirs * mask).sum() - 1
    return total, np.abs(tiles(ours) - tiles(theirs)).mean() / tiles(theirs).mean()


@pytest.mark.parametrize(("alpha", "most"), [(0.05, 0.045), (0.1, 0.03), (0.2, 0.02), (0.5, 0.012)])
def test_a_glossy_ball(scalar, tmp_path, alpha, most):
    """A ball of GGX on a plane in the studio against the path tracer: its direct light, whole pixels of the ball.

    A pixel of ours is one point, and what a narrow lobe reflects changes from facet to facet: 4 x 4 of them make one.
    """
    scene, env = ball(dl.brdf.GGX(alpha), 256), dl.Environment.builtin("studio")
    transport = dl.precompute(scene, tmp_path / "t.transport", columns="haar:64", tolerance=0.003, progress=False)
    ours = transport.image(transport.multiply(transport.coefficients(env)))
    colour = {"type": "rgb", "value": [0.8] * 3}
    metal = {"type": "roughconductor", "distribution": "ggx", "alpha": alpha, "material": "none"}
    total, error = against_paths(
        scene, env, ours, transport.pixels, {**metal, "specular_reflectance": colour}, tmp_path
    )
    line = f"GGX {alpha}: total {total:+.3%}, tiles {error:.2%}"
    print(line)
    # With the noise of Mitsuba, which is 0.6 % of a tile for the widest lobe and 2.5 % for the narrowest.
    assert abs(total) < 0.012 and error < most, line


@pytest.mark.parametrize(("name", "most"), [("paper_white", 0.015), ("vch_golden_yellow", 0.03)])
def test_a_measured_material_before_its_curve_is_edited(scalar, tmp_path, name, most):
    """A transport of curves keeps all of a measured BRDF that its curve does not say: unedited, the ball is Mitsuba's
    `measured`."""
    path = DATA.parent / "brdf" / "rgl" / f"{name}_rgb.bsdf"
    if not path.exists():
        pytest.skip("optional data")
    scene, env = ball(None, 128).with_material(0, dl.Material(0.0)), dl.Environment.builtin("studio")
    made = dl.precompute_curves(
        scene, tmp_path / "c", env=env, materials={"ball": dl.brdf.Measured.load(path)}, progress=False
    )
    part = made.parts["ball"]
    assert f"{100 * part.unexplained:.1f} % of it unexplained" in str(part)
    pixels = dl.precompute(scene, tmp_path / "p", columns="haar:8", quality="preview", progress=False).pixels
    bsdf = {"type": "measured", "filename": str(path)}
    total, error = against_paths(scene, env, dl.BrdfEditor(made).step().image, pixels, bsdf, tmp_path, 1024)
    line = f"{name}: total {total:+.3%}, tiles {error:.2%}, unexplained {part.unexplained:.1%}"
    print(line)
    assert abs(total) < 0.01 and error < most, line
