"""Gather samples and their cells; rows through lobes and families against brute force; what a point sees."""

from __future__ import annotations

import deltalux as dl
import numpy as np
import oracles
import pytest
from deltalux._core import GatherSamples, gather_lobe_hits, points_seen_from

COUNT = 1024


class Room:
    """A scene with its rows and gather samples."""

    def __init__(self, scene, count=COUNT):
        self.scene, self.core, self.camera = scene, scene.traced(), scene.camera.rays()
        self.rows = self.core.receivers(self.camera, edges=False)
        self.floor = np.isin(np.arange(len(scene.triangles)), (0, 1))
        self.samples = GatherSamples.place(self.core, self.camera, self.floor, count)
        self.eye = tuple(map(float, scene.camera.position))
        self.on_floor = np.flatnonzero(self.floor[self.rows.triangle])

    def taken(self, numbers, through, **options):
        return self.samples.rows(self.rows, [int(n) for n in numbers], self.eye, through, **options)


def closed_box():
    """A cube seen from inside: light from every direction comes from a surface."""
    corners = np.array([(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)], float)
    faces = [(0, 4, 5), (0, 5, 1), (2, 3, 7), (2, 7, 6), (0, 1, 3), (0, 3, 2)]
    faces += [(4, 6, 7), (4, 7, 5), (0, 2, 6), (0, 6, 4), (1, 5, 7), (1, 7, 3)]
    camera = dl.Camera((0.5, 0.9, 0.9), (0.5, 0.1, 0.1), vertical_fov=90, width=12, height=12)
    return dl.Scene.from_arrays(corners, np.array(faces), (0.5, 0.5, 0.5), camera)


@pytest.fixture(scope="module")
def box():
    return Room(closed_box())


@pytest.fixture(scope="module")
def cornell_room():
    scene = dl.Scene.builtin("cornell")
    return Room(scene.with_camera(scene.camera.resized(32, 32)), 2048)


def test_cells_are_a_partition(box):
    """Six squares of area 1, each point of them in one cell: nothing is counted twice at edges or from outside."""
    samples = box.samples
    assert len(samples) <= COUNT and samples.area.sum() == pytest.approx(6, rel=1e-9)
    places, normals, triangles = samples.cell_points()
    starts = samples.cell_starts
    assert starts[0] == 0 and starts[-1] == len(places) == len(normals) == len(triangles)
    assert (np.diff(starts.astype(int)) > 0).all() and len(places) == pytest.approx(64 * COUNT, rel=0.01)
    own = np.repeat(np.arange(len(samples)), np.diff(starts.astype(int)))
    # A cell lies on its sample's wall and faces as it does, into the box.
    np.testing.assert_allclose((normals * samples.normal[own]).sum(axis=1), 1, atol=1e-5)
    assert np.abs(((places - samples.position[own]) * samples.normal[own]).sum(axis=1)).max() < 1e-5
    assert (((0.5, 0.5, 0.5) - places) * normals).sum(axis=1).min() > 0
    # Brute force: of the samples of its wall, a point's own is the nearest.
    for k in range(0, len(places), 997):
        same = (samples.normal @ normals[k]) > 0.9
        apart = np.linalg.norm(samples.position - places[k], axis=1)
        assert apart[own[k]] <= apart[same].min() + 1e-6


def test_samples_follow_paths_from_the_eye(box, cornell_room):
    # One in seven leaves the floor into its lobe.
    for room in (box, cornell_room):
        assert np.mean(room.samples.glossy) == pytest.approx(1 / 7, abs=0.03)
    again = GatherSamples.place(box.core, box.camera, box.floor, COUNT)
    for name in ("position", "normal", "area", "glossy", "cell_starts"):
        np.testing.assert_array_equal(getattr(again, name), getattr(box.samples, name))
    nothing = GatherSamples.place(box.core, box.camera, np.zeros_like(box.floor), COUNT)
    assert not nothing.glossy.any()


def test_neighbours_in_the_list_are_near_each_other(box):
    """The order is that of a balanced tree: the parts of a level are smaller than the whole."""
    whole = box.samples.position.std(axis=0).max()
    parts = [part.std(axis=0).max() for part in np.array_split(box.samples.position[: 1 << 9], 32)]
    assert np.mean(parts) < whole / 3


def test_rows_of_cosines_are_closed(box):
    """In a closed box all that a surface receives comes from samples: rows of D sum to 1."""
    numbers = range(0, len(box.rows), 5)
    for sub_area in ("centre", "disc", "cell", "angle"):
        rows = box.taken(numbers, None, sub_area=sub_area)
        assert rows.shape == (len(numbers), 1, len(box.samples)) and (rows >= 0).all()
        np.testing.assert_allclose(rows.sum(axis=2), 1, rtol=1e-5)


def test_rows_of_an_open_scene_say_how_open_it_is(cornell_room):
    numbers = cornell_room.on_floor[::40]
    rows = cornell_room.taken(numbers, None)
    hits = gather_lobe_hits(
        cornell_room.core, cornell_room.rows, [int(n) for n in numbers], cornell_room.eye, dl.brdf.Lambert().core(), 32
    )
    closed = hits[3].reshape(len(numbers), -1).sum(axis=1)
    # By 256 rays against 1,024: each is off by less than 0.03.
    np.testing.assert_allclose(rows.sum(axis=(1, 2)), closed, atol=0.05)


@pytest.mark.parametrize(("model", "lobe"), [("blinn-phong", dl.brdf.BlinnPhong(40)), ("lafortune", dl.brdf.Phong(40))])
def test_a_familys_functions_make_the_lobe(cornell_room, model, lobe):
    """sum_k c_k T_k = T, to what the family is off by."""
    family, numbers = dl.Family(model, (3, 300), live=6, segments=3), cornell_room.on_floor[::60]
    plain = cornell_room.taken(numbers, lobe.core(), sub_area="cell")[:, 0]
    functions = cornell_room.taken(numbers, (family._core, 40.0), sub_area="cell")
    assert functions.shape[1] == family.live
    mixed = np.einsum("k,nkg->ng", family.coefficients(40.0), functions.astype(np.float64))
    assert np.abs(mixed - plain).max() <= 1e-3 * plain.max()
    assert np.abs(mixed.sum(axis=1) - plain.sum(axis=1)).max() <= 2e-3 * plain.sum(axis=1).max()


@pytest.mark.parametrize(
    ("model", "lobe", "gamma"),
    [
        ("ward", dl.brdf.Ward(0.3), 0.3),
        ("ward-duer", dl.brdf.WardDuer(0.3), 0.3),
        ("cook-torrance", dl.brdf.CookTorrance(0.3), 0.3),
        ("ashikhmin-shirley", dl.brdf.AshikhminShirley(40), 40.0),
    ],
)
def test_fixed_factors_are_the_models_own(cornell_room, model, lobe, gamma):
    ends = (3, 300) if gamma > 10 else (0.1, 2)
    family, numbers = dl.Family(model, ends, live=7, segments=3), cornell_room.on_floor[::60]
    plain = cornell_room.taken(numbers, lobe.core(), sub_area="centre")[:, 0]
    functions = cornell_room.taken(numbers, (family._core, gamma), sub_area="centre").astype(np.float64)
    mixed = np.einsum("k,nkg->ng", family.coefficients(gamma), functions)
    assert np.abs(mixed - plain).max() <= 5e-3 * plain.max()


def test_light_is_the_rows_times_the_samples(cornell_room):
    light = np.random.default_rng(0).random((len(cornell_room.samples), 3))
    numbers = [int(n) for n in cornell_room.on_floor[:70]]
    lobe = dl.brdf.BlinnPhong(30).core()
    rows = cornell_room.taken(numbers, lobe)[:, 0].astype(np.float64)
    found = cornell_room.samples.light(cornell_room.rows, numbers, cornell_room.eye, lobe, light)
    np.testing.assert_allclose(found, rows @ light, rtol=1e-12)
    dl.set_threads(1)
    try:
        alone = cornell_room.samples.light(cornell_room.rows, numbers, cornell_room.eye, lobe, light)
    finally:
        dl.set_threads(0)
    np.testing.assert_array_equal(found, alone)


def test_cells_are_nearer_to_many_rays_than_discs(cornell_room):
    """A narrow lobe and light that is smooth over the surfaces: the same bounce by 1,024 rays a row."""
    room, lobe = cornell_room, dl.brdf.BlinnPhong(300).core()
    numbers = [int(n) for n in room.on_floor[:: max(len(room.on_floor) // 60, 1)]]

    def glow(places):
        return np.repeat((1 + np.sin(3 * places).mean(axis=1))[:, None], 3, axis=1).astype(np.float64)

    places, _, _, shares = gather_lobe_hits(room.core, room.rows, numbers, room.eye, lobe, 32)
    wanted = (shares[:, None] * glow(places)).reshape(len(numbers), -1, 3).sum(axis=1)
    errors = {}
    for sub_area in ("centre", "disc", "cell"):
        light = glow(room.samples.position)
        found = room.samples.light(room.rows, numbers, room.eye, lobe, light, sub_area=sub_area, points=16)
        errors[sub_area] = np.abs(found - wanted).sum() / wanted.sum()
    assert errors["cell"] < 0.5 * errors["disc"] < errors["centre"]


def first_hits(scene, origin, ways):
    """Moeller and Trumbore's test of every ray against every triangle: the least parameter along each way."""
    a, b, c = (scene.vertices[scene.triangles[:, k]].astype(float) for k in range(3))
    p = np.cross(ways[:, None], (c - a)[None])
    determinant = (p * (b - a)).sum(axis=2)
    s = origin - a
    q = np.cross(s, b - a)
    with np.errstate(divide="ignore", invalid="ignore"):
        u, v = (p * s).sum(axis=2) / determinant, (ways[:, None] * q).sum(axis=2) / determinant
        t = (q * (c - a)).sum(axis=1) / determinant
    return np.where((u >= 0) & (v >= 0) & (u + v <= 1) & (t > 0), t, np.inf).min(axis=1)


def test_what_a_point_sees_is_what_single_rays_say(cornell_room):
    places, normals, _ = cornell_room.samples.cell_points()
    places, normals = places[::53], normals[::53]
    lamp = (0.1, 1.7, 0.2)
    seen = points_seen_from(cornell_room.core, lamp, places, normals)
    ways = places.astype(float) - lamp
    wanted = (first_hits(cornell_room.scene, np.array(lamp), ways) > 1 - 1e-4) & ((ways * normals).sum(axis=1) < 0)
    assert 0.2 < seen.mean() < 0.9
    # A ray through an edge may go either way.
    assert (seen != wanted).sum() <= 2


def test_bad_requests(box):
    for count in (0, 63, (1 << 20) + 1):
        with pytest.raises(ValueError, match="expected 64 to 1048576 gather samples"):
            GatherSamples.place(box.core, box.camera, box.floor, count)
    with pytest.raises(ValueError, match="expected 12 numbers, one a triangle"):
        GatherSamples.place(box.core, box.camera, box.floor[:5], COUNT)
    with pytest.raises(ValueError, match='expected centre, disc, cell or angle, got "cone"'):
        box.taken([0], None, sub_area="cone")
    for points in (0, 65):
        with pytest.raises(ValueError, match="expected 1 to 64 points"):
            box.taken([0], None, sub_area="cell", points=points)
    with pytest.raises(ValueError, match="expected numbers of rows below"):
        box.taken([len(box.rows)], None)
    with pytest.raises(ValueError, match="expected the light of"):
        box.samples.light(box.rows, [0], box.eye, None, np.ones((5, 3)))
    floor = oracles.quad((-1, 0, -1), (2, 0, 0), (0, 0, 2))
    camera = dl.Camera((0, 3, 0.1), (0, 0, 0), vertical_fov=40, width=8, height=8)
    alone = dl.Scene.from_arrays(*floor, (0.5, 0.5, 0.5), camera)
    with pytest.raises(ValueError, match="no path from the camera meets two"):
        GatherSamples.place(alone.traced(), camera.rays(), np.ones(2, bool), COUNT)
