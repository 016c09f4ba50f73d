"""Transport of scenes whose light can be worked out on paper: furnaces, sweeps, symmetries, leaks.

B(x) = 1/pi Int L(w) V(x, w) cos(w) dw, without the albedo. `centres` takes one ray a texel: the midpoint rule.
"""

from __future__ import annotations

import deltalux as dl
import numpy as np
import oracles
import pytest
from deltalux import _core

FLOOR = oracles.quad((-10, 0, -10), (20, 0, 0), (0, 0, 20))
# 16-bit values are within 2^-16 of the largest of 16 neighbours; a light of norm 1 meets a handful of them.
STORED = 2.0**-13


def scene_of(mesh, *, position=(0, 3, 0), target=(0, 0, 0), up=(0, 0, -1), fov=20.0, size=4):
    camera = dl.Camera(position, target, up, vertical_fov=fov, width=size, height=size)
    return dl.Scene.from_arrays(*mesh, (0.5, 0.25, 0.125), camera)


def product(transport, cubemap):
    """B under a piecewise constant light (6, n, n, 3)."""
    return transport.multiply(transport.coefficients(dl.Environment.from_cubemap(np.asarray(cubemap, np.float32))))


def ones(size):
    return np.ones((6, size, size, 3), np.float32)


def random_light(size, seed=3):
    """Positive, lively in all texels and colours."""
    return np.random.default_rng(seed).lognormal(0, 1.5, (6, size, size, 3)).astype(np.float32)


def sweep(transport):
    """B of every row under each one-texel light in turn, (rows, 6 n n).

    A light of 1 in texel p has coefficients W sqrt(dw_p) e_p, so that B_p = sqrt(dw_p) (W^T t)_p; `haar_inverse`
    gives (W^T t)_p / sqrt(dw_p).
    """
    size = transport.columns.size
    rows = transport.to_scipy().toarray().astype(np.float64)
    radiance = [_core.haar_inverse(size, np.repeat(row[:, None], 3, axis=1))[..., 0] for row in rows]
    return (np.array(radiance) * oracles.solid_angles(size)).reshape(len(rows), -1)


# A horizontal receiver that nothing shadows: B = 1/pi Int_hemisphere cos dw = 1 under L = 1. The midpoint rule over
# texels is off by at most 0.33 / n^2.
@pytest.mark.parametrize("size", [8, 16, 32, 64])
def test_white_furnace(make, size):
    B = product(make(scene_of(FLOOR), size), ones(size))
    assert np.abs(B - 1).max() <= 0.35 / size**2
    assert np.abs(B - 1).max() >= 0.25 / size**2, "the midpoint rule has this error: a smaller one is another rule"


# In a pit of depth 1 what is left of the hemisphere is the opening, a rectangle parallel to the receiver: its form
# factor is known in closed form (oracles).
@pytest.mark.parametrize("size", [16, 32])
def test_white_furnace_of_a_pit(make, size):
    pit = oracles.box((-1, -1, -0.5), (1, 0, 0.5), without="y+")
    transport = make(scene_of(pit, position=(0, 1, 0), fov=40.0, size=12), size, "lossless")
    core = transport._core
    floor = core.receivers.normal[:, 1] > 0.9
    expected = oracles.rectangle_form_factor(
        core.receivers.position[floor][:, [0, 2]].astype(float), (-1, -0.5), (1, 0.5), 1.0
    )
    error = product(transport, ones(size))[floor, 0] - expected
    assert floor.sum() > 50 and expected.std() > 0.02
    # 16 rays in each texel that the rim crosses, some 6 n / 2 of them: independent errors of 1/8 of a texel at most.
    noise = np.sqrt(3 * size) / 8 * 4 * np.pi / (6 * size**2) / np.pi
    assert np.abs(error).max() <= 4 * noise
    assert abs(error.mean()) <= noise


# At the foot of a wall that has no end a quarter sphere is left, half of the cosine hemisphere: B = 1/2.
def test_foot_of_a_wall_sees_half(make):
    wall = oracles.quad((-1e4, 0, 0), (2e4, 0, 0), (0, 1e4, 0))
    floor = oracles.quad((-1e4, 0, 0), (2e4, 0, 0), (0, 0, 1e4))
    # 0.001 / 1e4 of the scene's size: near enough to the wall that its top is at the zenith.
    scene = scene_of(oracles.merged(wall, floor), position=(0, 5, 5), target=(0, 0, 5), fov=2.0)
    B = product(make(scene, 16), ones(16))
    # The part above the wall's top, 90 - atan(1e4 / 5) degrees, is a 1e-6 of the hemisphere.
    assert np.abs(B - 0.5).max() <= 0.35 / 16**2


# The light is one texel p of radiance 1: B_p = max(0, n . d_p) dw_p / pi. Solid angle, orientation and handedness show.
@pytest.mark.parametrize("tilt", [(0, 0), (3, -1), (-4, -6)], ids=str)
def test_one_texel_sweep_over_all_texels(make, tilt):
    size = 64
    # A plane y = a x + b z through the origin has the normal (-a, 1, -b).
    a, b = np.divide(tilt, 7)
    tilted = oracles.quad((-10, -10 * (a + b), -10), (20, 20 * a, 0), (0, 20 * b, 20))
    normal = np.array([-a, 1, -b]) / np.sqrt(1 + a * a + b * b)
    transport = make(scene_of(tilted, size=2, position=2 * normal), size)
    found = sweep(transport)
    area = np.tile(oracles.solid_angles(size).ravel(), 6)
    cosine = oracles.directions(size).reshape(-1, 3) @ normal
    expected = np.where(cosine > 1e-6, cosine * area / np.pi, 0)
    assert np.abs(found - expected).max() <= STORED * expected.max()

    # A texel in the middle of a face is 5.03 times one in the corner, at 64 x 64.
    if tilt == (0, 0):
        top = (found[0] / np.where(cosine > 0, cosine, 1)).reshape(6, size, size)[2]
        assert top[32, 32] / top[0, 0] == pytest.approx(5.03, abs=0.01)


# The same through the front door: every texel a light of its own, projected and multiplied.
def test_one_texel_lights_one_by_one(make):
    size = 8
    transport = make(scene_of(FLOOR, size=2), size)
    lights = np.eye(6 * size**2, dtype=np.float32).reshape(-1, 3, 6, size, size).transpose(0, 2, 3, 4, 1)
    V = np.array([transport.coefficients(dl.Environment.from_cubemap(light)) for light in lights])
    found = transport.multiply(V).transpose(1, 0, 2).reshape(4, -1)
    cosine = oracles.directions(size).reshape(-1, 3)[:, 1]
    expected = np.maximum(cosine, 0) * np.tile(oracles.solid_angles(size).ravel(), 6) / np.pi
    np.testing.assert_allclose(found, np.tile(expected, (4, 1)), atol=STORED * expected.max())


CORNERS = [(5.0, 6.0, 7.0), (-5.0, -6.0, -7.0)]


def seen_sides(make, size, corner):
    """(transport, {normal: rows}) of a box of 1 x 2 x 3 seen from a corner: three of its sides."""
    mesh = oracles.box((-0.5, -1, -1.5), (0.5, 1, 1.5))
    transport = make(scene_of(mesh, position=corner, up=(0, 1, 0), fov=25.0, size=16), size)
    normals = np.round(transport.receivers.normal).astype(int)
    sides = {tuple(normal): (normals == normal).all(axis=1) for normal in np.unique(normals, axis=0)}
    assert len(sides) == 3
    return transport, sides


# Six colours, one a face of the cubemap. A side sees the one it looks at under F = 4 (1 / sqrt 2) atan(1 / sqrt 2) / pi
# = 0.5541 (a square of half side 1 at distance 1, four corners), four others under (1 - F) / 4, the last not at all.
@pytest.mark.parametrize("corner", CORNERS)
def test_six_colours_on_a_box(make, corner):
    size = 32
    colours = np.array([(9, 1, 1), (1, 8, 2), (2, 1, 7), (6, 5, 1), (1, 6, 5), (4, 1, 5)], np.float32)
    transport, sides = seen_sides(make, size, corner)
    B = product(transport, np.broadcast_to(colours[:, None, None], (6, size, size, 3)))
    facing = 4 / np.sqrt(2) * np.arctan(1 / np.sqrt(2)) / np.pi
    for normal, rows in sides.items():
        axis = int(np.argmax(np.abs(normal)))
        face = 2 * axis + (normal[axis] < 0)
        beside = [f for f in range(6) if f // 2 != axis]
        expected = facing * colours[face] + (1 - facing) / 4 * colours[beside].sum(axis=0)
        # The midpoint rule again: no face errs by more than the hemisphere.
        tolerance = colours.max() * 0.35 / size**2 + STORED
        np.testing.assert_allclose(B[rows], np.tile(expected, (rows.sum(), 1)), rtol=0, atol=tolerance)


# No two texels alike: a face that is mirrored, turned or transposed is seen in all its rows.
@pytest.mark.parametrize("corner", CORNERS)
def test_texels_are_the_right_way_round(make, corner):
    transport, sides = seen_sides(make, 8, corner)
    light = random_light(8)
    B = product(transport, light)
    for normal, rows in sides.items():
        expected = oracles.irradiance(light, np.array(normal, float))
        np.testing.assert_allclose(B[rows], np.tile(expected, (rows.sum(), 1)), rtol=4 * STORED)


UNTURNED = np.eye(3)


def corner_scene(turn=UNTURNED, scale=1.0, shift=(0.0, 0.0, 0.0), *, extra=(), size=12):
    """A box of 1 x 2 x 3 on a floor beside a post: moved as a whole, camera included."""
    floor = oracles.quad((-4, 0, -4), (9, 0, 0), (0, 0, 10))
    mesh = oracles.merged(floor, oracles.box((0, 0, 0), (1, 2, 3)), oracles.box((-2, 0, 1), (-1.5, 3, 1.25)), *extra)
    move = lambda at: (np.asarray(at, float) @ turn.T) * scale + shift  # noqa: E731
    camera = dl.Camera(
        tuple(move((-5, 7.3, 9.1))), tuple(move((0.1, 0.6, 1.2))), tuple(turn @ (0, 1, 0)),
        vertical_fov=38.0, width=size, height=size,
    )  # fmt: skip
    return dl.Scene.from_arrays(move(mesh[0]), mesh[1], camera=camera)


def assert_same_rows(transport, reference, light, reference_light, *, share):
    """The same receivers, and the same B but for a few rays; `share` is how many rows may differ at all."""
    # Rows follow a curve in space, which turns with the scene: they are compared pixel by pixel.
    order, reference_order = np.argsort(transport.receivers.pixel), np.argsort(reference.receivers.pixel)
    np.testing.assert_array_equal(transport.receivers.pixel[order], reference.receivers.pixel[reference_order])
    B, expected = product(transport, light)[order], product(reference, reference_light)[reference_order]
    # One ray more or less is a texel: B may move by its light.
    texel = light.max() * oracles.solid_angles(light.shape[1]).max() / np.pi
    assert np.abs(B - expected).max() <= 3 * texel
    differ = (np.abs(B - expected) > STORED * expected.max()).any(axis=1)
    assert differ.mean() <= share


@pytest.fixture(scope="module")
def corner_transport(make):
    return make(corner_scene())


# Scene, camera and light turned together: nothing changes but the names of axes.
def test_24_rotations_of_the_cube(make, corner_transport):
    light = random_light(8)
    turns = oracles.rotations()
    assert len(turns) == 24
    for turn in turns:
        transport = make(corner_scene(turn))
        assert_same_rows(transport, corner_transport, oracles.rotated(light, turn), light, share=0.02)
    # The light alone, turned: the picture changes, or the comparison above is worth nothing.
    with pytest.raises(AssertionError):
        assert_same_rows(corner_transport, corner_transport, oracles.rotated(light, turns[5]), light, share=0.02)


@pytest.mark.parametrize("exponent", [-40, -17, 20])
def test_units_that_are_powers_of_two_change_no_bit(make, corner_transport, exponent):
    transport = make(corner_scene(scale=2.0**exponent))
    np.testing.assert_array_equal(transport.to_scipy().toarray(), corner_transport.to_scipy().toarray())


@pytest.mark.parametrize("scale", [1e-5, 0.3, 1e6])
def test_units_change_nothing(make, corner_transport, scale):
    light = random_light(8)
    assert_same_rows(make(corner_scene(scale=scale)), corner_transport, light, light, share=0.02)


@pytest.mark.parametrize("shift", [(1e4, -1e4, 1e4), (0, 1e6, 0), (-1e6, 1e6, 1e6)], ids=str)
def test_far_from_the_origin(make, corner_transport, shift):
    light = random_light(8)
    assert_same_rows(make(corner_scene(shift=shift)), corner_transport, light, light, share=0.02)


def test_duplicates_and_slivers_change_no_bit(make, corner_transport):
    scene = corner_scene()
    a, b = scene.vertices[scene.triangles[0, :2]]
    # Every triangle again, one turned over, and two without area: a point, and three corners on a line.
    vertices = np.concatenate([scene.vertices, [a, (a + b) / 2, b]])
    last = len(scene.vertices)
    more = [scene.triangles, scene.triangles[:, [1, 0, 2]], [[last, last, last]], [[last, last + 1, last + 2]]]
    messy = dl.Scene.from_arrays(vertices, np.concatenate([scene.triangles, *more]), camera=scene.camera)
    assert messy.counts == {"degenerate triangles": 2, "duplicate triangles": 2 * len(scene.triangles)}
    transport = make(messy)
    np.testing.assert_array_equal(transport.to_scipy().toarray(), corner_transport.to_scipy().toarray())
    assert any("duplicate" in note for note in transport.plan.notes)


def test_winding_changes_nothing(make, corner_transport):
    scene = corner_scene()
    light = random_light(8)
    flipped = dl.Scene.from_arrays(scene.vertices, scene.triangles[:, [0, 2, 1]], camera=scene.camera)
    assert_same_rows(make(flipped), corner_transport, light, light, share=0.02)


@pytest.mark.parametrize("quality", ["centres", "lossless"])
def test_an_occluder_never_raises_light(make, quality):
    # Inside the scene's box, so that the tracer's units stay.
    shade = oracles.quad((-3, 2.9, -3), (3, 0, 0), (0, 0, 2))
    free, shaded = (make(corner_scene(extra=extra), 8, quality) for extra in ((), (shade,)))
    # The receivers that both pictures show: the shade hides some, and is one itself.
    lists = [[tuple(at) for at in transport.receivers.position.tolist()] for transport in (free, shaded)]
    both = sorted(set(lists[0]) & set(lists[1]))
    assert len(both) > 80
    here, there = ([places.index(at) for at in both] for places in lists)
    light = random_light(8)
    gain = (product(shaded, light)[there] - product(free, light)[here]) / light.max()
    # Rays into edge texels weigh their cosines a little differently from their centres.
    assert gain.max() <= (STORED if quality == "centres" else 0.35 / 8**2)
    assert gain.min() < -0.005, "the occluder must shade something"


# From inside a closed room no direction is open: every row of M is zero, to the last bit. The receivers lie on vertices
# of the grid and the directions are texel centres: rays run along edges and into vertices, where others leak.
@pytest.mark.parametrize("size", [8, 16])
@pytest.mark.parametrize("cells", [1, 32])
@pytest.mark.parametrize("quality", ["centres", "lossless"])
def test_a_closed_room_is_black(make, size, cells, quality):
    room = oracles.box((-1, -1, -1), (1, 1, 1), cells)
    scene = scene_of(room, position=(0, 0, 0), target=(0, 0, -1), up=(0, 1, 0), fov=90.0, size=16)
    transport = make(scene, size, quality)
    assert transport.shape[0] == 256
    if cells == 32 and quality == "centres":
        grid = 16 * transport.receivers.position
        assert np.abs(grid - np.round(grid)).max() < 1e-3, "receivers lie on vertices, but for their lift"
    assert transport._core.entries == 0
    assert (product(transport, ones(size) * 1e6) == 0).all()


# The same where two walls meet: with tan(fov / 2) = W / (W - 1) the outermost pixel centres look right into the seams.
@pytest.mark.parametrize("size", [9, 16])
@pytest.mark.parametrize("cells", [1, 4])
def test_seams_of_a_closed_room_are_black(make, size, cells):
    fov = 2 * np.degrees(np.arctan(size / (size - 1)))
    room = oracles.box((-1, -1, -1), (1, 1, 1), cells)
    scene = scene_of(room, position=(0, 0, 0), target=(0, 0, -1), up=(0, 1, 0), fov=fov, size=size)
    transport = make(scene, 8)
    on_seams = (np.abs(transport.receivers.position) > 0.9999).sum(axis=1) > 1
    assert on_seams.sum() == 4 * (size - 1)
    assert (product(transport, ones(8)) == 0).all()


def test_a_room_with_a_pinhole_is_not_black(make):
    room = oracles.box((-1, -1, -1), (1, 1, 1), 16)
    pinned = (room[0], np.delete(room[1], -1, axis=0))
    scene = scene_of(pinned, position=(0, 0, 0), target=(0, 0, -1), up=(0, 1, 0), fov=90.0, size=16)
    assert make(scene, 16)._core.entries > 0


def test_light_is_linear_to_the_last_bit(cornell):
    V = cornell.coefficients(dl.Environment.from_cubemap(random_light(8)))
    B = cornell.multiply(V)
    assert (cornell.multiply(-V) + B == 0).all()
    for exponent in (-40, 40):
        np.testing.assert_array_equal(cornell.multiply(V * 2.0**exponent), B * np.float32(2.0**exponent))
    assert (cornell.multiply(0 * V) == 0).all()
