"""Studios: products of stored matrices against dense rows, lamps, freezing, bounds, and what is refused."""

from __future__ import annotations

import json
import shutil
import warnings
from dataclasses import replace

import deltalux as dl
import numpy as np
import pytest
from deltalux._core import GatherSamples, LitPoints
from deltalux.precomputation import room
from deltalux.scene.builtin.shapes import join, quad, sphere
from PIL import Image

GATHER, NODES, SIZE, GAMMA = 256, 200, 20, 40.0
LAMP = dl.PointLight((0.3, 1.7, 0.2), 4.0)
SPOT = dl.Spot((-0.4, 1.8, 0.3), (0.2, 0.0, 0.0), (6.0, 5.0, 4.0), angle=40)
PANEL = dl.AreaLight((-0.2, 1.95, -0.2), (0.4, 0, 0), (0, 0, 0.4), 8.0)


def box():
    scene = dl.Scene.builtin("studio-box")
    return scene.with_camera(scene.camera.resized(SIZE, SIZE))


def families():
    return {
        "floor": dl.Family("blinn-phong", (3, 300), live=5, segments=2),
        "tall box": dl.Family("cook-torrance", (0.1, 1), live=4, segments=1, f0=0.3),
    }


@pytest.fixture(scope="module")
def transport(tmp_path_factory):
    path = tmp_path_factory.mktemp("studio") / "box.studio"
    return dl.precompute_studio(
        box(), path, families=families(), gather=GATHER, bounces=3, nodes=0, quality="lossless", progress=False
    )


@pytest.fixture(scope="module")
def truncated(tmp_path_factory):
    """The same, truncated."""
    path = tmp_path_factory.mktemp("studio") / "box.studio"
    return dl.precompute_studio(
        box(), path, families=families(), gather=GATHER, bounces=3, nodes=0, tolerance=0.03, progress=False
    )


@pytest.fixture(scope="module")
def coarse(tmp_path_factory):
    """The same over nodes."""
    path = tmp_path_factory.mktemp("studio") / "box.studio"
    return dl.precompute_studio(
        box(), path, families=families(), gather=GATHER, bounces=3, nodes=NODES, tolerance=0.03, progress=False
    )


@pytest.fixture(scope="module")
def checked_floor():
    """A picture of many colours for the floor, and one of as many shares."""
    rng = np.random.default_rng(7)
    return rng.uniform(0.1, 0.6, (8, 8, 3)).astype(np.float32), rng.uniform(0.0, 0.4, (4, 4)).astype(np.float32)


@pytest.fixture(scope="module")
def dense():
    """What is stored, made again as plain matrices over the samples: D, M_s, and T at a gamma of the floor."""
    scene = box()
    core, camera = scene.traced(), scene.camera.rays()
    rows = core.receivers(camera, edges=True)
    glossy = np.isin(scene.material, [scene.numbered(name) for name in families()])
    samples = GatherSamples.place(core, camera, glossy, GATHER)
    eye = tuple(map(float, scene.camera.position))
    numbers = list(range(len(rows)))
    floor = np.flatnonzero(scene.material[rows.triangle] == scene.numbered("floor"))
    family = families()["floor"]
    return {
        "samples": samples,
        # By as many points of each cell, however narrow a lobe is.
        "gathers": lambda numbers, through: samples.rows(
            rows, numbers.tolist(), eye, through, sub_area="cell", points=16
        ).astype(np.float64),
        "D": samples.rows(rows, numbers, eye, None)[:, 0].astype(np.float64),
        "T": np.einsum(
            "k,nkg->ng",
            family.coefficients(GAMMA),
            samples.rows(rows, floor.tolist(), eye, (family._core, GAMMA)).astype(np.float64),
        ),
        "floor": floor,
    }


def lit(transport, *lamps, gamma=None, method=None, **look):
    studio = dl.Studio(transport, method)
    studio.set_lights(list(lamps))
    if gamma is not None:
        studio.edit("floor")
        studio.set("floor", gamma=gamma, **look)
    return studio


def test_what_is_stored_is_what_samples_say(transport, dense):
    """D L and sum_k c_k T_k L over the tree, against rows over the samples; M_s sums to at most 1."""
    light = np.random.default_rng(1).random((len(dense["samples"]), 3))
    V = transport.tree.forward(light)
    np.testing.assert_allclose(transport.between.diffuse.multiply(V), dense["D"] @ light, rtol=2e-4, atol=2e-6)
    part = transport.parts["floor"]
    np.testing.assert_array_equal(part.rows, dense["floor"])
    mix = np.tile(part.family.coefficients(GAMMA), (len(part.rows), 1))
    segment = part.segments[int(np.searchsorted(part.family.borders[1:], GAMMA))]
    wanted = dense["T"] @ light
    np.testing.assert_array_equal(segment.multiply(V, mix=mix), segment.multiply(V, mix=mix[0]))
    np.testing.assert_allclose(segment.multiply(V, mix=mix), wanted, rtol=1e-3, atol=2e-4 * wanted.max())
    sums = transport.between.bounces.multiply(transport.tree.forward(np.ones((len(light), 3))))
    assert sums.min() >= 0 and sums.max() <= 1 + 1e-4


def test_facets_reflect_more_at_grazing_angles(dense):
    """Schlick's factor in rows of a family: those of the model that has it."""
    family = dl.Family("ashikhmin-shirley", (10, 100), live=5, segments=1, f0=0.05)
    some = dense["floor"][::9]
    found = np.einsum("k,nkg->ng", family.coefficients(GAMMA), dense["gathers"](some, (family._core, GAMMA)))
    wanted = dense["gathers"](some, dl.brdf.AshikhminShirley(GAMMA, f0=0.05).core())[:, 0]
    mirrors = dense["gathers"](some, dl.brdf.AshikhminShirley(GAMMA, f0=1.0).core())[:, 0]
    assert np.abs(found - wanted).sum() < 0.01 * wanted.sum()
    assert wanted.sum() > 0.055 * mirrors.sum()
    with pytest.raises(ValueError, match="no facets"):
        dl.Family("lafortune", (10, 100), live=5, segments=1, f0=0.5)


def test_a_picture_is_direct_light_and_its_bounces(transport, dense):
    """By the formula, from dense rows: what the lamp sends, two passes between samples, D and T."""
    studio = lit(transport, SPOT, gamma=GAMMA, k_s=(0.3, 0.2, 0.1))
    frame = studio.step()
    (part,) = SPOT._parts
    cells = LitPoints.of_cells(transport.scene, dense["samples"], 4)
    sights = cells.sights(part)
    arrived = cells.irradiance(part, sights).reshape(-1, 4, 3).mean(axis=1)
    np.testing.assert_allclose(cells.irradiance(part, sights, together=4), arrived, rtol=1e-12)
    albedo = transport.albedo.astype(np.float64)
    passing = light = albedo * arrived
    for _ in range(2):
        passing = albedo * transport.between.bounces.multiply(transport.tree.forward(passing))
        light = light + passing
    view, rows = transport.view, transport.parts["floor"].rows
    sights = view.sights(part)
    receivers = transport.pixels
    wanted = receivers.albedo * (view.irradiance(part, sights) + dense["D"] @ light)
    # The floor is level: the lobe's frame is the world's, with y up.
    up = [0, 2, 1]
    way = np.asarray(SPOT.position) - receivers.position[rows]
    lobe = dl.brdf.BlinnPhong(GAMMA).evaluate(way[:, up], transport.eyes_of(transport.parts["floor"])[:, up])
    shine = np.pi * lobe[:, None] * view.irradiance(part, sights)[rows]
    assert shine.max() > 0.005 * wanted.max()
    wanted[rows] += np.array([0.3, 0.2, 0.1]) * (shine + dense["T"] @ light)
    others = np.setdiff1d(
        np.arange(len(wanted)), np.flatnonzero(receivers.material == transport.parts["tall box"].number)
    )
    np.testing.assert_allclose(frame.values[others], wanted[others], rtol=2e-3, atol=2e-4 * wanted.max())
    assert frame.converged and frame.image.shape == (SIZE, SIZE, 3) and np.isfinite(frame.image).all()
    assert frame.bound < 0.01 * wanted.max() and 0 < frame.residual < 0.02


def test_nodes_pass_light_on(coarse):
    """By the formula, from dense matrices: radiosity between nodes, and a pass behind it what samples send on."""
    nodes, count = coarse.between, len(coarse.between)

    def dense(sparse, columns, unit):
        starts, numbers, weights = sparse.arrays()
        rows = np.zeros((len(starts) - 1, columns))
        np.add.at(rows, (np.repeat(np.arange(len(rows)), np.diff(starts)), numbers), unit * weights.astype(np.float64))
        return rows

    F = dense(nodes.factors, count, 1 / nodes.factors.rays)
    view, own = (dense(taking, 2 * count, 2.0**taking.exponent) for taking in (nodes.view, nodes.samples))
    assert F.sum(axis=1).max() <= 1 and view.sum(axis=1).max() <= 1 + 1e-12
    (part,) = SPOT._parts
    studio = lit(coarse, SPOT)
    studio.set("floor", k_s=0)
    studio.set("tall box", k_s=0)
    passed = [coarse.nodes.irradiance(part, coarse.nodes.sights(part), together=4)]
    for _ in range(3):
        passed.append(F @ (nodes.albedo * passed[-1]))
    rows = [np.concatenate([sum(passed[1 : n + 1]), nodes.albedo * sum(passed[:n])]) for n in (3, 2)]
    direct = coarse.view.irradiance(part, coarse.view.sights(part))
    np.testing.assert_allclose(
        studio.step().values, coarse.pixels.albedo * (direct + view @ rows[0]), rtol=1e-5, atol=1e-7
    )
    arrived = coarse.cells.irradiance(part, coarse.cells.sights(part), together=4)
    sources = studio._lighting.traced()
    np.testing.assert_allclose(
        studio._light_of_samples(sources).light,
        coarse.tree.forward(coarse.albedo * (arrived + own @ rows[1])),
        rtol=1e-9,
        atol=1e-12,
    )


def test_nodes_and_samples_say_the_same(transport, coarse):
    """To what so few of both leave: the light of all surfaces together, and that of parts of the picture."""
    one, other = lit(transport, SPOT, gamma=GAMMA).step().image, lit(coarse, SPOT, gamma=GAMMA).step().image
    tiles = [image.reshape(5, 4, 5, 4, 3).mean(axis=(1, 3)) for image in (one, other)]
    assert abs(one.sum() / other.sum() - 1) < 0.15
    assert np.abs(tiles[0] - tiles[1]).sum() < 0.2 * tiles[0].sum()


@pytest.mark.parametrize("method", [None, dl.Incremental(terms=20)])
def test_edits_and_moves_leave_no_trace(coarse, truncated, method):
    """Edit, light move, edit back and light back: the first picture, bit for bit; and under another method too."""
    for made in (coarse, truncated):
        studio = lit(made, LAMP, gamma=30.0, method=method)
        first = studio.step().values
        for gamma, lamp in [(100.0, LAMP), (100.0, SPOT), (4.0, SPOT), (30.0, LAMP)]:
            studio.set("floor", gamma=gamma)
            studio.set_lights([lamp])
            frame = studio.step()
        for _ in range(200):
            if frame.converged:
                break
            frame = studio.step()
        assert frame.converged
        np.testing.assert_array_equal(frame.values, first)


def test_frozen_is_live_to_its_bound_and_starts_from_live(coarse):
    studio = lit(coarse, SPOT, gamma=GAMMA)
    live = studio.step()
    memory = studio.memory
    assert memory.live == coarse.parts["floor"].segments[1].nbytes and memory.total == sum(memory)
    studio.light_mode()
    frozen = studio.step()
    assert np.abs(frozen.values - live.values).max() <= frozen.bound + live.bound
    assert studio.memory.live == 0 and studio.memory.frozen < memory.live
    assert (studio.memory.diffuse, studio.memory.bounces) == coarse.between.sizes
    bits = studio._frozen["floor"][1]._core
    studio.edit("floor")
    studio.set("floor", gamma=100)
    studio.light_mode()
    studio.step()
    studio.edit("floor")
    studio.set("floor", gamma=GAMMA)
    studio.light_mode()
    studio.step()
    again = studio._frozen["floor"][1]._core
    assert again is not bits
    np.testing.assert_array_equal(again.row(3), bits.row(3))
    assert studio.freeze_seconds > 0


@pytest.mark.parametrize("method", [None, dl.Incremental(terms=6), dl.PerBand(terms=6), dl.Nonlinear(terms=6)])
def test_no_value_is_further_off_than_the_bound(transport, truncated, method):
    """A lamp that sweeps, with few terms: against untruncated matrices and all of the light."""
    exact, studio = lit(transport, LAMP), lit(truncated, LAMP, method=method)
    for place in np.linspace(-0.6, 0.6, 5):
        lamp = dl.PointLight((place, 1.6, 0.3), 4.0)
        exact.set_lights([lamp])
        studio.set_lights([lamp])
        wanted, frame = exact.step(), studio.step()
        assert np.abs(frame.values - wanted.values).max() <= frame.bound + wanted.bound
        assert frame.bound < 10 * wanted.values.max()


def test_lamps_add_up_and_those_that_stand_are_not_traced_again(coarse):
    both = lit(coarse, LAMP, SPOT)
    one, other = lit(coarse, LAMP).step(), lit(coarse, SPOT).step()
    frame = both.step()
    np.testing.assert_allclose(frame.values, one.values + other.values, rtol=1e-3, atol=1e-4)
    stood = both._lighting._lit[LAMP][0]
    both.set_lights([LAMP, dl.Spot((0.1, 1.8, 0.3), (0.2, 0.0, 0.0), 6.0, angle=40)])
    both.step()
    assert both._lighting._lit[LAMP][0] is stood
    dark = lit(coarse, dl.PointLight((0, 1, 0), 0.0)).step()
    assert not dark.values.any() and not lit(coarse).step().values.any()


def test_area_lights_are_done_in_four_frames(coarse):
    studio = lit(coarse, PANEL)
    frames = [studio.step() for _ in range(4)]
    assert [frame.converged for frame in frames] == [False, False, False, True]
    assert np.abs(frames[0].values - frames[3].values).mean() < 0.2 * frames[3].values.mean()
    # A small one sends straight down what a point of its radiance times its area does.
    far = dl.AreaLight((-0.05, 1.95, -0.05), (0.1, 0, 0), (0, 0, 0.1), 800.0)
    studio.set_lights([far])
    for _ in range(4):
        studio.step()
    below = np.abs(coarse.pixels.position - (0.0, 0.0, 0.0))
    below = np.flatnonzero((below[:, 0] < 0.1) & (below[:, 1] < 0.1))
    (lamp,) = dl.PointLight((0.0, 1.95, 0.0), 8.0)._parts
    straight = coarse.view.irradiance(lamp, coarse.view.sights(lamp))[below]
    assert straight.any()
    spread = np.add.reduce([own.view for own in studio._lighting._lit[far]])[below]
    # A cosine more, at the lamp.
    assert (spread <= straight * 1.001).all() and spread.sum() > 0.7 * straight.sum()


def test_an_environment_is_its_directions(coarse):
    env = dl.Environment.builtin("hall")
    studio = dl.Studio(coarse)
    studio.set_lights([], env=env)
    frame = studio.step()
    assert frame.converged and frame.values.mean() > 0
    studio.set_lights([])
    assert not studio.step().values.any()


def test_colours_and_weights_change_what_bounces(coarse):
    studio = lit(coarse, LAMP, gamma=30.0)
    before = studio.step().values
    studio.set("floor", colour=(0.9, 0.05, 0.05), k_d=1.0, k_s=0.05)
    after = studio.step().values
    walls = np.setdiff1d(np.arange(len(before)), coarse.parts["floor"].rows)
    # Red bleeds onto what is not the floor.
    assert after[walls, 0].sum() / before[walls, 0].sum() > after[walls, 2].sum() / before[walls, 2].sum()
    with pytest.warns(UserWarning, match="k_d \\+ k_s is above 1"):
        studio.set("floor", k_s=0.9)


def test_gamma_crosses_a_border_without_a_jump(coarse):
    border = coarse.parts["floor"].family.borders[1]
    studio = lit(coarse, LAMP, gamma=border)
    below = studio.step()
    studio.set("floor", gamma=border * (1 + 1e-9))
    above = studio.step()
    assert np.abs(above.values - below.values).max() <= above.bound + below.bound
    assert np.abs(above.values - below.values).mean() < 0.02 * below.values.mean()


def test_runs_resume_and_files_are_opened(coarse, tmp_path):
    path = tmp_path / "again.studio"
    asked = {"families": families(), "gather": GATHER, "bounces": 3, "nodes": NODES, "tolerance": 0.03}

    class Stop(Exception):
        pass

    def stop(done, total):
        if done > 0.9 * total:
            raise Stop

    with pytest.raises(Stop):
        dl.precompute_studio(box(), path, progress=stop, **asked)
    finished = (path / "nodes.npz").stat().st_mtime_ns
    assert not (path / "studio.json").exists()
    made = dl.precompute_studio(box(), path, progress=False, **asked)
    assert (path / "nodes.npz").stat().st_mtime_ns == finished
    opened = dl.StudioTransport.open(path)
    for own in (made, opened):
        np.testing.assert_array_equal(lit(own, SPOT).step().values, lit(coarse, SPOT).step().values)
    with pytest.raises(dl.FileError, match="expected a transport of a studio, got none"):
        dl.StudioTransport.open(tmp_path)
    with pytest.raises(dl.FileError, match="this is a transport; dl.Transport"):
        dl.StudioTransport.open(next(path.glob("part-*")))
    with pytest.raises(dl.FileError, match="expected a transport of curves, but this is a transport of a studio"):
        dl.CurveTransport.open(path)
    about = json.loads((path / "studio.json").read_text())
    for change in ({"version": 9}, {"passes": -1}, {"parts": [{}]}):
        (path / "studio.json").write_text(json.dumps(about | change))
        with pytest.raises(dl.FileError):
            dl.StudioTransport.open(path)
    (path / "studio.json").write_text(json.dumps(about))
    with np.load(path / "nodes.npz") as stored:
        arrays = dict(stored)
    for change in (
        {"view_nodes": arrays["view_nodes"] + 2 * NODES},
        {"factors_starts": arrays["factors_starts"][::-1]},
        {"node_origin": arrays["node_origin"][:-4]},
        {"exponents": np.array([0, -12, -12])},
    ):
        np.savez(path / "nodes.npz", **(arrays | change))
        with pytest.raises(dl.FileError):
            dl.StudioTransport.open(path)
    shutil.rmtree(path)


def test_bad_requests(coarse, tmp_path):
    scene, path, floor = box(), tmp_path / "a", families()["floor"]
    glossy = scene.with_material("floor", dl.Material(albedo=0.5, specular=0.3, model=dl.brdf.Phong(exponent=20)))
    for given, options, what in [
        (scene, {"families": {"sea": floor}}, "sea"),
        (scene, {"families": {"floor": 3}}, "dl.Family"),
        (scene, {"families": {"floor": dl.Family.even("blinn-phong", (3, 300))}}, "family of segments"),
        (glossy, {"families": {}}, "family for every glossy"),
        (scene, {"families": {}, "gather": 10}, "64 to"),
        (scene, {"families": {}, "bounces": 0}, "1 to 16 bounces"),
        (scene, {"families": {}, "nodes": "all"}, "the most there may be"),
        (scene, {"families": {}, "quality": "best"}, "quality"),
        (scene, {"families": {}, "tolerance": 2.0}, "tolerance"),
    ]:
        with pytest.raises(ValueError, match=what):
            dl.precompute_studio(given, path, progress=False, **options)
    assert not path.exists()
    path.write_text("mine")
    with pytest.raises(FileExistsError):
        dl.precompute_studio(scene, path, families={}, progress=False)
    studio = dl.Studio(coarse)
    for call, what in [
        (lambda: studio.set("floor", gamma=10), "call edit"),
        (lambda: studio.set("sea", k_d=1), "floor, tall box"),
        (lambda: studio.edit("sea"), "floor, tall box"),
        (lambda: studio.set("floor", k_d=-1), "0 or more"),
        (lambda: studio.set("floor", k_s=np.nan), "finite"),
        (lambda: studio.set_lights([3]), "lamps such as"),
        (lambda: studio.set_lights([], env=3), "dl.Environment"),
        (lambda: dl.Studio(3), "precompute_studio"),
        (lambda: dl.Studio(coarse, "bi"), "update method"),
        (lambda: dl.PointLight((0, 0), 1), "a point"),
        (lambda: dl.PointLight((0, 0, np.inf), 1), "finite"),
        (lambda: dl.PointLight((0, 0, 0), -1), ">= 0"),
        (lambda: dl.Spot((0, 0, 0), (0, 0, 0)), "one place"),
        (lambda: dl.Spot((0, 0, 0), (0, 1, 0), angle=120), "angle"),
        (lambda: dl.Spot((0, 0, 0), (0, 1, 0), blend=2), "blend"),
        (lambda: dl.AreaLight((0, 0, 0), (1, 0, 0), (2, 0, 0)), "u x v"),
    ]:
        with pytest.raises(ValueError, match=what):
            call()
    studio.edit("floor")
    for gamma in (2.9, 301, np.nan):
        with pytest.raises(ValueError, match="gamma of floor from 3 to 300"):
            studio.set("floor", gamma=gamma)
    assert studio.looks["floor"].gamma == 3


def ball(segments, normals):
    """A ball of few or many triangles before a wall."""
    (round_, faces), (level, two), (up, _) = (
        sphere((0, 0.6, 0), 0.6, segments),
        quad((-2, 0, -2), (0, 0, 4), (4, 0, 0)),
        quad((-2, 0, -2), (4, 0, 0), (0, 3, 0)),
    )
    vertices, triangles = join((round_, faces), (level, two), (up, two))
    outwards = np.concatenate([round_ - (0, 0.6, 0), np.tile((0, 1, 0), (4, 1)), np.tile((0, 0, 1), (4, 1))])
    return dl.Scene.from_arrays(
        vertices,
        triangles,
        camera=dl.Camera((0, 1.2, 4.2), (0, 0.6, 0), vertical_fov=26, width=24, height=24),
        materials={"ball": dl.Material((0.5, 0.3, 0.2)), "else": dl.Material((0.5, 0.6, 0.6))},
        material=np.repeat([0, 1], [len(faces), 4]),
        normals=outwards if normals else None,
    )


def test_a_curved_mesh_is_as_round_as_its_normals(tmp_path):
    """What a ball of 24 segments reflects of other surfaces, through D and T, is what one of 96 does."""
    found = {}
    for segments, normals in ((96, True), (24, True), (24, False)):
        made = dl.precompute_studio(
            ball(segments, normals),
            tmp_path / f"{segments} {normals}",
            families={"ball": dl.Family("blinn-phong", (3, 300), live=5, segments=2)},
            gather=1024,
            nodes=0,
            tolerance=0.005,
            progress=False,
        )
        studio = dl.Studio(made)
        studio.set_lights([dl.PointLight((1.0, 2.2, 1.2), 5.0)])
        studio.edit("ball")
        studio.set("ball", gamma=200, k_s=0.3)
        pixels = made.pixels
        whole = np.zeros(24 * 24, bool)
        whole[pixels.pixel[(pixels.material == 0) & (pixels.weight > 0.999)]] = True
        of_surfaces = pixels.shown(studio.step().values - studio.direct()).reshape(-1, 3)
        found[segments, normals] = np.where(whole[:, None], of_surfaces, 0)
    inside = np.all([own.any(axis=1) for own in found.values()], axis=0)
    fine, smooth, flat = (own[inside] for own in found.values())
    assert inside.sum() > 60 and abs(smooth.sum() / fine.sum() - 1) < 0.03
    assert np.abs(smooth - fine).sum() < 0.06 * fine.sum() < np.abs(flat - fine).sum()


def test_what_does_not_fit_is_refused_before_any_ray(tmp_path, monkeypatch):
    """Rows over samples are dense while they are made: the number of samples decides."""
    monkeypatch.setattr(room, "_available_memory", lambda: 400e6)
    with pytest.raises(ValueError, match="fewer pixels, gather samples or threads"):
        dl.precompute_studio(box(), tmp_path / "a", families=families(), gather=262144, progress=False)
    assert not (tmp_path / "a").exists()


def test_a_family_of_what_no_pixel_shows_is_refused(tmp_path):
    scene = box()
    away = scene.with_camera(replace(scene.camera, target=(0.0, 4.0, 0.0), vertical_fov=20.0))
    with pytest.raises(ValueError, match="no pixel shows floor"):
        dl.precompute_studio(away, tmp_path / "a", families=families(), progress=False)
    assert not (tmp_path / "a").exists()


def test_lamps_where_they_should_not_be(coarse, dense):
    """Without power: black to the bit. Inside a box, on a surface, at a gather sample: finite."""
    studio = dl.Studio(coarse)
    studio.set_lights([dl.PointLight((0.0, 1.0, 0.0), 0.0), dl.Spot((0, 1, 0), (0, 0, 0), 0.0)])
    frame = studio.step()
    assert not frame.values.any() and not frame.image.any()
    inside, sample = (-0.33, 0.5, -0.30), tuple(map(float, dense["samples"].position[7]))
    for place in (inside, (0.2, 0.0, 0.1), sample):
        studio.set_lights([dl.PointLight(place, 1.0)])
        frame = studio.step()
        assert np.isfinite(frame.values).all() and np.isfinite(frame.bound)
        # Truncated wavelets go below 0 a little.
        assert (frame.values >= -frame.bound).all()
    # Closed in by its box, a lamp shines on nothing that is seen. (Cells of samples beside the box reach under it, and
    # these are few: what is gathered of them is not 0.)
    studio.set_lights([dl.PointLight(inside, 1.0)])
    assert not studio.direct().any()


def test_every_draw_of_parameters_is_finite(coarse):
    rng = np.random.default_rng(5)
    studio = dl.Studio(coarse)
    studio.edit("floor")
    # Outside of the box and inside its walls too.
    low, high = np.full(3, -1.2), np.full(3, 2.2)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for _ in range(12):
            studio.set(
                "floor", gamma=float(np.exp(rng.uniform(np.log(3), np.log(300)))), k_s=rng.random(3), k_d=rng.random()
            )
            studio.set_lights([dl.PointLight(rng.uniform(low, high), rng.random(3) * 10)])
            frame = studio.step()
            assert np.isfinite(frame.values).all() and np.isfinite(frame.bound)


def test_a_session_moves_lamps_and_edits(coarse, tmp_path, capsys):
    from deltalux.command.cli import main

    spot = {"kind": "spot", "position": [-0.4, 1.8, 0.3], "target": [0.2, 0, 0], "intensity": [6, 5, 4], "angle": 40}
    steps = [
        {"title": "a spot", "lights": [spot]},
        {"lights": [spot | {"position": [0.4, 1.8, 0.3]}], "frames": 2},
        {"material": "floor", "set": {"gamma": 120, "k_s": 0.2}, "frames": 3},
        {"lights": [{"kind": "point", "position": [0.3, 1.7, 0.2], "intensity": 4}]},
    ]
    session, out = tmp_path / "session.json", tmp_path / "out"
    command = ["edit", str(coarse.path), "--session", str(session), "-o", str(out)]
    session.write_text(json.dumps(steps))
    assert main(command) == 0
    assert {"index.html", "frames.csv", "times.png", *(f"step-{k:02}.png" for k in range(4))} <= {
        path.name for path in out.iterdir()
    }
    lines = (out / "frames.csv").read_text().splitlines()
    assert [line.split(",")[0] for line in lines[1:]] == ["0", "1", "1", "2", "2", "2", "3"]
    # What it leads to is what is asked of a studio at once.
    studio = lit(coarse, LAMP, gamma=120.0, k_s=0.2)
    picture = dl.io.to_display(studio.step().image, dl.io.auto_exposure(lit(coarse, SPOT).step().image))
    np.testing.assert_array_equal(np.asarray(Image.open(out / "step-03.png")), picture)
    for wrong in (
        {"a": 1},
        [],
        [{"material": "floor", "set": {"gamma": 9}}],
        [{"lights": [{"kind": "sun"}]}],
        [{"lights": [spot], "frames": 0}],
        [{"lights": [spot], "set": {"gamma": 9}}],
        [{"lights": [spot | {"size": 3}]}],
        [{"lights": [spot]}, {"material": "sea", "set": {"gamma": 9}}],
        [{"lights": [spot]}, {"material": "floor", "set": {"gamma": 1e9}}],
    ):
        session.write_text(json.dumps(wrong))
        assert main(command) == 2
    assert main([*command[:2], "-o", str(out)]) == 2
    assert "expected --session" in capsys.readouterr().err


def test_lamps_move_and_families_are_edited(coarse):
    lamp = {"id": "a", "kind": "spot", "position": [0.2, 1.8, 0.3], "target": [0, 0, 0], "angle": 40.0}
    pages = pytest.importorskip("pages")
    with dl.view(coarse, browser=False, port=0) as view, pages.page(view) as own:
        assert pages.welcomed(own)["kind"] == "studio"
        own.send(state={"lamps": [{**lamp, "intensity": [3, 2, 1]}], "editing": "floor"})
        own.send(state={"materials": {"floor": {"gamma": 20.0, "k_s": [0.5, 0.5, 0.5]}}})
        shown = own.still()
        assert any("more light than it receives" in words.get("problem", "") for words in own.words)
        plain = dl.Studio(coarse)
        plain.set_lights([dl.Spot((0.2, 1.8, 0.3), (0, 0, 0), (3, 2, 1), 40.0)])
        plain.edit("floor")
        with pytest.warns(UserWarning, match="more light"):
            plain.set("floor", gamma=20.0, k_s=0.5)
        wanted = plain.step().image
        assert np.abs(shown - wanted).max() <= 1e-5 * wanted.max()
        own.send(state={"editing": None, "materials": {"floor": {"gamma": 30.0}}})
        assert "edited" in own.read(lambda header: "problem" in header)[0]["problem"]
        area = {**lamp, "kind": "area", "size": 0.3, "intensity": [1, 1, 1]}
        own.send(state={"lamps": [area, {**area, "id": "b", "position": area["target"]}]})
        own.read(lambda header: "problem" in header)
        own.send(state={"lamps": [area]})
        own.still()
        own.send(save={"kind": "python"})
        assert "dl.AreaLight(" in own.read(lambda header: "text" in header)[0]["text"]["text"]


@pytest.mark.parametrize("nodes", [0, NODES])
def test_a_picture_laid_over_a_material_is_the_texture_that_the_scene_might_have_had(tmp_path, nodes, checked_floor):
    scene, picture = box(), checked_floor[0]
    floor = scene.numbered("floor")
    textures = tuple(picture if number == floor else None for number in range(len(scene.albedo)))
    albedo = scene.albedo.copy()
    albedo[floor] = 1.0
    asked = {"families": families(), "gather": GATHER, "bounces": 2, "nodes": nodes, "quality": "lossless"}
    textured = replace(scene, textures=textures, albedo=albedo)
    plain, wanted = (
        dl.precompute_studio(own, tmp_path / name, progress=False, **asked)
        for name, own in (("plain", scene), ("textured", textured))
    )
    for of in ("view", "nodes" if nodes else "samples"):
        colours, material = wanted.surfaces(of)
        off = np.abs(plain.coordinates.colours(picture, of) - colours)[material == floor].max(axis=1)
        # A cell at a border holds places of another material, which a texture of the scene knows and a look does not.
        assert (off < 1e-6).mean() > (0.5 if of == "samples" else 0.999)
    pictures = (lit(plain, LAMP, gamma=GAMMA, colour=picture), lit(wanted, LAMP, gamma=GAMMA))
    found, expected = (studio.step().values for studio in pictures)
    assert np.abs(found - expected).mean() < 0.006 * expected.mean()


def test_pictures_are_swapped_and_swapped_back(coarse, checked_floor):
    colour, shine = checked_floor
    studio = lit(coarse, LAMP, gamma=GAMMA, k_s=0.3)
    first = studio.step().values
    studio.set("floor", colour=colour, k_s=shine, k_d=np.full((2, 2), 0.7))
    other = studio.step()
    assert np.abs(other.values - first).max() > 0.01 and other.converged
    # What is the same everywhere is a number.
    studio.set("floor", colour=np.full((3, 3, 3), 0.4), k_s=np.full((2, 5), 0.3), k_d=np.full((2, 2, 1), 0.7))
    laid = studio.step().values
    studio.set("floor", colour=0.4, k_s=0.3, k_d=0.7)
    np.testing.assert_allclose(studio.step().values, laid, rtol=1e-5, atol=1e-6)
    fresh = lit(coarse, LAMP, gamma=GAMMA, k_s=0.3, k_d=0.7, colour=0.4)
    assert np.array_equal(fresh.step().values, studio.step().values)


def test_a_picture_of_shine_is_where_the_lobe_is(coarse):
    studio = lit(coarse, LAMP, gamma=GAMMA, k_s=0.4)
    whole = studio.step().values
    studio.set("floor", k_s=0.0)
    without = studio.step().values
    studio.set("floor", k_s=[[0.4, 0.0]])
    part, shown = coarse.parts["floor"], studio.step().values - without
    shares = coarse.coordinates.colours(studio.looks["floor"].k_s.picture, "view")[part.rows]
    assert shares.min() < 0.15 and shares.max() > 0.3
    np.testing.assert_allclose(shown[part.rows], shares / 0.4 * (whole - without)[part.rows], rtol=1e-4, atol=1e-5)
    others = np.setdiff1d(np.arange(len(shown)), part.rows)
    assert not shown[others].any()


def test_pictures_ask_for_texture_coordinates_and_numbers_of_0_or_more(coarse, tmp_path):
    studio = dl.Studio(coarse)
    for wrong in (np.full((2, 2), -1.0), np.zeros((0, 2)), np.zeros((2, 2, 2)), np.full((2, 2), np.nan)):
        with pytest.raises(ValueError, match="one or three finite numbers of 0 or more, or a picture"):
            studio.set("floor", colour=wrong)
    with pytest.raises(OSError):
        studio.set("floor", colour=tmp_path / "none.png")
    Image.new("RGB", (4, 4), (188, 188, 188)).save(tmp_path / "grey.png")
    studio.set("floor", colour=tmp_path / "grey.png")
    assert studio.looks["floor"].colour.picture == pytest.approx(0.5, abs=0.005)
    bare = dl.Studio(replace(coarse, coordinates=None))
    with pytest.raises(ValueError, match="this studio's scene has no texture coordinates"):
        bare.set("floor", k_s=np.ones((2, 2)))
