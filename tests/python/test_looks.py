"""What surfaces look like beyond triangles and colours: shading normals, holes, tangents, precision near the eye."""

from __future__ import annotations

from dataclasses import replace

import deltalux as dl
import numpy as np
import oracles
import pytest
from deltalux.images.oiio import library
from deltalux.io import auto_exposure
from deltalux.relight.backdrop import Backdrop
from deltalux.surface.cutout import Cutout
from deltalux.surface.shading import corner_tangents, frame_turns, tangents_at
from deltalux.surface.surface import Surface
from deltalux.transport.gloss import Gloss
from PIL import Image

WHITE = dl.Environment.from_latlong(np.ones((8, 16, 3), np.float32))
CAMERA = dl.Camera((0, 1, 6), (0, 1, 0), width=16, height=16)


def lit(scene, tmp_path, env=WHITE, columns="haar:8", quality="preview", **asked):
    path = tmp_path / "t.transport"
    transport = dl.precompute(scene, path, columns=columns, quality=quality, progress=False, **asked)
    return transport, transport.multiply(transport.coefficients(env))[:, 0]


def ball(levels=1, **more):
    """The unit sphere of 20 x 4^levels triangles, with the normals that it stands for."""
    import trimesh

    made = trimesh.creation.icosphere(levels, 1.0)
    points, faces = np.asarray(made.vertices), np.asarray(made.faces)
    camera = dl.Camera((0, 0, 4), (0, 0, 0), vertical_fov=28, width=32, height=32)
    return dl.Scene.from_arrays(points, faces, (1, 1, 1), camera, normals=points, **more)


# --- Shading normals


def test_a_terminator_follows_the_normals(tmp_path):
    """A coarse ball under one texel of light: the cosine to the shading normal wherever both horizons see it, and 0
    elsewhere; no black in between."""
    light = np.zeros((6, 8, 8, 3), np.float32)
    light[0, 3, 3] = 1.0
    texel = oracles.directions(8).reshape(-1, 3)[3 * 8 + 3]
    transport, B = lit(ball(), tmp_path, dl.Environment.from_cubemap(light), tolerance=0)
    normal = transport.receivers.normal.astype(float)
    scene, rows = ball(), ball().traced().receivers(ball().camera.rays(), edges=False)
    flat = rows.normal.astype(float)
    np.testing.assert_allclose(np.linalg.norm(normal, axis=1), 1, atol=1e-6)
    solid = oracles.solid_angles(8)[3, 3]
    expected = np.maximum(normal @ texel, 0) * (flat @ texel > 0) * solid / np.pi
    near = np.abs(flat @ texel) > 1e-6
    np.testing.assert_allclose(B[near], expected[near], atol=0.01 * expected.max())
    assert B[(normal @ texel > 0.1) & (flat @ texel > 0) & near].min() > 0
    # Rows of the sphere, not of its facets.
    places = scene.vertices[scene.triangles[rows.triangle]]
    b1, b2 = rows.barycentric.astype(float).T[:, :, None]
    middle = (1 - b1 - b2) * places[:, 0] + b1 * places[:, 1] + b2 * places[:, 2]
    inner = np.linalg.norm(middle[:, :2], axis=1) < 0.8
    np.testing.assert_allclose(normal[inner], (middle / np.linalg.norm(middle, axis=1)[:, None])[inner], atol=1e-3)


def test_flat_is_as_without_normals(tmp_path):
    scene = ball()
    bare = replace(scene, normals=None)
    a, b = lit(scene, tmp_path, normals="flat")[1], lit(bare, tmp_path)[1]
    assert (a == b).all() and (a != lit(scene, tmp_path)[1]).any()


def relief(vector):
    return np.tile(np.float32(vector), (2, 2, 1))


def square(**fields):
    """A square in x and y, seen from +z, with u along x and v along y; mirrored in the other half."""
    points = np.array([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)], float)
    camera = dl.Camera((0, 0, 4), (0, 0, 0), vertical_fov=20, width=4, height=4)
    scene = dl.Scene.from_arrays(points, [(0, 1, 2), (0, 2, 3)], (1, 1, 1), camera)
    uv = np.float32([(0, 0), (1, 0), (1, 1), (0, 1)])
    return replace(scene, uv=uv, **fields)


def test_pictures_of_normals_bend_along_the_coordinates(tmp_path):
    bent = np.array([0.3, 0.4, np.sqrt(0.75)])
    transport, _ = lit(square(reliefs=(relief(bent),)), tmp_path)
    np.testing.assert_allclose(transport.receivers.normal, np.tile(bent, (len(transport.receivers), 1)), atol=1e-6)
    # Mirrored coordinates: u runs the other way, and v does not.
    mirrored = square(reliefs=(relief(bent),))
    mirrored = replace(mirrored, uv=mirrored.uv * np.float32([-1, 1]))
    transport, _ = lit(mirrored, tmp_path)
    np.testing.assert_allclose(transport.receivers.normal[0], bent * (-1, 1, 1), atol=1e-6)
    # From behind all of it is turned.
    behind = square(reliefs=(relief(bent),)).with_camera(dl.Camera((0, 0, -4), (0, 0, 0), width=4, height=4))
    np.testing.assert_allclose(lit(behind, tmp_path)[0].receivers.normal[0], -bent, atol=1e-6)


def test_tangents_by_hand():
    scene = square()
    np.testing.assert_allclose(corner_tangents(scene), np.tile([1.0, 0, 0, 1], (2, 3, 1)), atol=1e-12)
    # Two triangles about an edge: the mean by angle, in the plane of the normal.
    bent = replace(scene, vertices=scene.vertices * (1, 1, 0) + np.array([(0, 0, 0), (0, 0, 1), (0, 0, 0), (0, 0, 0)]))
    own = corner_tangents(bent)
    np.testing.assert_allclose(np.linalg.norm(own[:, :, :3], axis=2), 1, atol=1e-12)
    np.testing.assert_allclose(own[0, 0], own[1, 0], atol=1e-12)
    given = replace(scene, tangents=np.tile(np.float32([0, 1, 0, -1]), (4, 1)))
    tangent, sign = tangents_at(given, np.array([0]), np.array([[0.2, 0.2]]))
    assert tangent.tolist() == [[0, 1, 0]] and sign.tolist() == [-1]


def test_brushed_metal_lies_along_the_tangent(tmp_path):
    """Turning the tangents by a right angle is the same as exchanging the two roughnesses."""
    metal = [dl.Material(0, 1, dl.brdf.GGX(a, b)) for a, b in ((0.6, 0.2), (0.2, 0.6))]
    scene = square()
    along, across = (np.tile(np.float32(way), (4, 1)) for way in ((1, 0, 0), (0, 1, 0)))

    def light_of(tangents, material):
        own = {"camera": scene.camera, "tangents": tangents, "materials": [material]}
        made = dl.Scene.from_arrays(scene.vertices, scene.triangles, **own)
        return lit(made, tmp_path, dl.Environment.builtin("studio"), tolerance=0)[1]

    a, b, c = light_of(along, metal[0]), light_of(across, metal[1]), light_of(across, metal[0])
    np.testing.assert_allclose(a, b, rtol=1e-3, atol=1e-4 * a.max())
    assert np.abs(a - c).max() > 0.05 * a.max()


def test_factors_at_vertices_are_turned_too():
    """What the eye makes of a factor, where its tangent is turned by a right angle, is what it makes of the factor
    turned back."""
    eyes = np.random.default_rng(5).random((1, 4, 8)).astype(np.float32)
    one, place = np.zeros(1, np.intp), np.float32([[0, 0, 0]])
    camera = dl.Camera((1, 2, 3), (0, 0, 0))

    def seen(tables, turn):
        own = {0: np.ascontiguousarray(tables)}
        return Gloss(one, one, one, own, place, np.float32([[0, 0, 1]]), 1, np.float32([turn])).mix(camera)

    # A quarter of a turn is two of eight columns.
    np.testing.assert_allclose(seen(eyes, (0, 1)), seen(np.roll(eyes, 2, axis=2), (1, 0)), rtol=1e-6)
    assert not np.allclose(seen(eyes, (0, 1)), seen(eyes, (1, 0)), rtol=1e-3)


def test_turns_are_angles_in_the_frame_of_the_core():
    normal = np.random.default_rng(1).normal(size=(20, 3))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    sign = np.where(normal[:, 2] < 0, -1.0, 1.0)
    a = -1 / (sign + normal[:, 2])
    first = np.stack(
        [1 + sign * normal[:, 0] ** 2 * a, sign * normal[:, 0] * normal[:, 1] * a, -sign * normal[:, 0]], -1
    )
    np.testing.assert_allclose(frame_turns(normal, first), np.tile([1.0, 0.0], (20, 1)), atol=1e-6)
    np.testing.assert_allclose(frame_turns(normal, np.cross(normal, first)), np.tile([0.0, 1.0], (20, 1)), atol=1e-6)
    assert frame_turns(normal[:1], np.zeros((1, 3))).tolist() == [[1, 0]]


# --- Holes


def under_a_card(cutout):
    """The middle of a floor, looked at from under a large card close above it."""
    floor, card = (
        oracles.quad((-1, 0, -1), (2, 0, 0), (0, 0, 2)),
        oracles.quad((-40, 0.05, -40), (80, 0, 0), (0, 0, 80)),
    )
    camera = dl.Camera((0, 0.025, 0.9), (0, 0, 0), vertical_fov=1, width=16, height=16)
    one = dl.Material((1, 1, 1))
    scene = dl.Scene.from_arrays(
        *oracles.merged(floor, card), camera=camera, materials=[one, one], material=[0, 0, 1, 1]
    )
    uv = np.float32([(0, 0), (1, 0), (1, 1), (0, 1)] * 2)
    return replace(scene, uv=uv, cutouts=(None, cutout))


@pytest.mark.parametrize(("alpha", "expected"), [(0.0, 1.0), (0.49, 1.0), (0.5, 0.0), (1.0, 0.0)])
def test_what_is_cut_out_casts_no_shadow(tmp_path, alpha, expected):
    cutout = Cutout(1.0, 0.5, np.full((2, 2), alpha, np.float32))
    assert lit(under_a_card(cutout), tmp_path)[1].mean() == pytest.approx(expected, abs=0.01)


@pytest.mark.parametrize("quality", ["preview", "publication"])
@pytest.mark.parametrize("opacity", [0.1, 0.5, 0.9])
def test_thin_surfaces_let_a_share_through(tmp_path, quality, opacity):
    """In the mean over all rows the share is right, whether edges are looked at closely or not."""
    transport, B = lit(under_a_card(Cutout(opacity)), tmp_path, quality=quality)
    rows = len(B)
    # 384 directions a row: a standard error of a few thousandths.
    assert rows > 200 and B.mean() == pytest.approx(1 - opacity, abs=0.02)


def test_a_camera_sees_through_holes(tmp_path):
    """A checker of holes, half of it there, before nothing: half of the picture is background."""
    checker = np.float32([[1, 0], [0, 1]])
    for cutout in (Cutout(1.0, 0.5, checker), Cutout(0.5)):
        scene = square(cutouts=(cutout,)).with_camera(
            dl.Camera((0, 0, 4), (0, 0, 0), vertical_fov=20, width=16, height=16)
        )
        background = lit(scene, tmp_path, quality="publication")[0].receivers.background
        assert background.mean() == pytest.approx(0.5, abs=0.03)


def test_vertices_say_how_much_is_there(tmp_path):
    scene = square(cutouts=(Cutout(1.0, 0.5),), opacity=np.float32([1, 0, 0, 1]))
    background = lit(scene, tmp_path)[0].receivers.background
    assert (background[:, :2] == 0).all() and (background[:, 2:] == 1).all()


def test_a_transport_keeps_looks(tmp_path):
    scene = square(
        reliefs=(relief((0, 0, 1)),),
        cutouts=(Cutout(0.5, None, np.float32([[1, 0]])),),
        colours=np.ones((4, 3), np.float32) / 2,
        opacity=np.ones(4, np.float32),
    )
    own = Surface.restored(scene.arrays())
    assert own.digest() == scene.digest() != replace(scene, opacity=None).digest()
    assert own.cutouts[0].opacity == 0.5 and own.cutouts[0].cutoff is None
    transport, _ = lit(scene, tmp_path)
    assert transport.surface.colours.tolist() == scene.colours.tolist()


# --- Precision


def test_what_is_far_leaves_the_near_as_it_was(tmp_path):
    mesh = oracles.merged(oracles.quad((-2, 0, -2), (4, 0, 0), (0, 0, 4)), oracles.box((-0.5, 0, -0.5), (0.5, 1, 0.5)))
    camera = dl.Camera((2, 2.5, 3), (0, 0.3, 0), vertical_fov=40, width=16, height=16)
    near = lit(dl.Scene.from_arrays(*mesh, camera=camera), tmp_path)[1]
    for far in (1e3, 1e5, 1e7):
        stray = (np.array([(far, 0, 0), (far + 1, 0, 0), (far, 1, 0)]), np.array([(0, 1, 2)]))
        assert (lit(dl.Scene.from_arrays(*oracles.merged(mesh, stray), camera=camera), tmp_path)[1] == near).all()


# --- Behind the scene


def test_backgrounds(tmp_path):
    transport, _ = lit(dl.Scene.builtin("cornell").with_camera(CAMERA), tmp_path)
    B, bare = transport.multiply(transport.coefficients(WHITE)), transport.pixels.background[..., None]
    black = transport.image(B)
    assert (Backdrop(transport, "env").picture(B, WHITE) == transport.image(B, WHITE)).all()
    cut = Backdrop(transport).picture(B, WHITE)
    assert (cut[..., :3] == black).all() and (cut[..., 3:] == 1 - bare).all() and 0 < bare.mean() < 1
    # Of light that is no colour of ours, exposure is chosen.
    assert Backdrop(transport, "#ffffff").exposure(B, WHITE) == auto_exposure(black)
    # sRGB 188 is 0.503, and is shown as that after a stop.
    found = Backdrop(transport, "#ff00bc").picture(B, WHITE, 1.0) - black
    np.testing.assert_allclose(found, bare * np.array([0.5, 0, 0.2515]), atol=1e-4)
    with pytest.raises(ValueError, match="expected a background of env, none or #rrggbb, got 'red'"):
        Backdrop(transport, "red")


def on_a_ground():
    """A box on a plane, seen from above its edge; the horizon is in the picture."""
    box = dl.Scene.from_arrays(*oracles.box((-0.5, 0, -0.5), (0.5, 1, 0.5)), (0.6, 0.3, 0.2))
    camera = dl.Camera((2, 1.5, 4), (0, 0.7, 0), vertical_fov=40, width=16, height=16)
    return box.with_camera(camera).with_ground()


@pytest.mark.parametrize("columns", ["haar:8", "haar:8+texels", "sh:9"])
def test_a_catcher_shows_what_light_the_scene_keeps_from_its_ground(tmp_path, columns):
    """The ground is lit as a transport without the box says, and so is the share of that in the other's."""
    scene, sky = on_a_ground(), dl.Environment.builtin("sky")
    transport, _ = lit(scene, tmp_path, sky, columns, tolerance=0)
    V, pixels = transport.coefficients(sky), transport.pixels
    B, luminance = transport.multiply(V), np.array([0.2126, 0.7152, 0.0722])
    plane = replace(scene, triangles=scene.triangles[-2:], material=scene.material[-2:])
    alone = dl.precompute(plane, tmp_path / "plane.transport", columns=columns, tolerance=0, progress=False)
    open_light = np.median(alone.multiply(V), axis=0) @ luminance
    ground = pixels.material == 1
    kept = np.where(ground, 1 - (B @ luminance / open_light).clip(0, 1), 1)
    alpha = np.bincount(pixels.pixel, pixels.weight * kept, 256).reshape(16, 16)
    caught = Backdrop(transport, "none", catcher=True).picture(B, sky)
    np.testing.assert_allclose(caught[..., 3], alpha, atol=0.01)
    # In shadow, in the open, beyond the horizon, and on the box.
    assert kept[ground].max() > 0.5 and kept[ground].min() < 0.02 and alpha[0].max() == 0 and alpha.max() == 1
    # The ground has no colour, and what is behind is seen through its shadow.
    on_box = (pixels.weight * ~ground)[:, None] * B * pixels.albedo
    box = np.stack([np.bincount(pixels.pixel, own, 256) for own in on_box.T], -1).reshape(16, 16, 3)
    np.testing.assert_allclose(caught[..., :3], box, atol=1e-5)
    whole = Backdrop(transport, "env", catcher=True).picture(B, WHITE, V=V)
    np.testing.assert_allclose(whole, caught[..., :3] + 1 - caught[..., 3:], atol=1e-5)


def test_vertices_catch_shadows_and_other_cameras_do(tmp_path):
    scene = on_a_ground()
    vertices = dl.precompute(
        scene, tmp_path / "v.transport", columns="haar:8", receivers="vertices", tolerance=0, progress=False
    )
    B = vertices.multiply(vertices.coefficients(WHITE))
    alpha = Backdrop(vertices, "none", scene.camera, catcher=True).picture(B, WHITE)[..., 3]
    # The plane's own four vertices are far from the box, whose shadow falls between them.
    assert alpha[0].max() == 0 and alpha[-1].max() < 0.02 and alpha.max() == pytest.approx(1)
    other = lit(scene, tmp_path)[0].for_camera(scene.camera.resized(8, 8), tmp_path / "o.transport", progress=False)
    assert other.plan.ground == 1
    Backdrop(other, catcher=True)


def test_shadows_are_caught_by_a_level_ground_alone(tmp_path):
    transport, _ = lit(dl.Scene.builtin("cornell").with_camera(CAMERA), tmp_path)
    with pytest.raises(ValueError, match="expected a transport of a scene on a ground to catch shadows"):
        Backdrop(transport, catcher=True)
    slope = dl.Scene.from_arrays(
        *oracles.quad((-1, 0, -1), (2, 1, 0), (0, 0, 2)), camera=CAMERA, materials={"ground": dl.Material()}
    )
    transport, _ = lit(slope, tmp_path)
    with pytest.raises(ValueError, match="expected a level ground"):
        Backdrop(transport, catcher=True).picture(transport.multiply(transport.coefficients(WHITE)), WHITE)


def test_alpha_is_associated_in_exr_and_straight_in_png(tmp_path):
    picture = np.zeros((2, 2, 4), np.float32)
    picture[0, 0], picture[0, 1] = (0.25, 0.125, 0, 0.5), (0, 0, 0, 0.25)
    dl.write(tmp_path / "a.exr", picture)
    dl.write(tmp_path / "a.png", picture)
    oiio = library()
    exr, png = (oiio.ImageBuf(str(tmp_path / name)) for name in ("a.exr", "a.png"))
    assert exr.spec().alpha_channel == png.spec().alpha_channel == 3
    np.testing.assert_array_equal(exr.get_pixels(oiio.FLOAT), picture)
    with Image.open(tmp_path / "a.png") as shown:
        # sRGB of 0.5 is 188, of 0.25 is 137; alpha has no curve.
        assert np.array(shown).tolist() == [[[188, 137, 0, 128], [0, 0, 0, 64]], [[0, 0, 0, 0], [0, 0, 0, 0]]]
    with pytest.raises(ValueError, match=r"expected .exr or .png for a picture with alpha"):
        dl.write(tmp_path / "a.hdr", picture)


@pytest.mark.parametrize(
    "asked, why",
    [({"receivers": "vertices"}, "vertices face as the mesh does"), ({"normals": "flat"}, "not asked for")],
)
def test_pictures_of_normals_that_are_left_out_are_said(asked, why):
    """Between vertices, where pictures of normals have their detail, vertices have no rows to show it."""
    square = dl.Scene.from_arrays(*oracles.quad((-1, 0, -1), (2, 0, 0), (0, 0, 2)), camera=CAMERA)
    bumpy = replace(square, reliefs=(np.full((2, 2, 3), (0, 0, 1), np.float32),), uv=np.zeros((4, 2), np.float32))
    left_out = dl.plan(bumpy, columns="haar:4", quality="preview", **asked).left_out
    assert [str(found) for found in left_out if found.what == "pictures of normals"] == [f"pictures of normals: {why}"]
