"""Glossy surfaces as one camera sees them: lobes against quadrature and brute force, and what scenes do with them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import deltalux as dl
import numpy as np
import pytest
from deltalux import _core, brdf
from deltalux.precomputation.between import between, linked
from deltalux.precomputation.factoring import MOST, factored
from deltalux.precomputation.preparation import Prepared, Request
from deltalux.transport.gloss import Gloss

MODELS = {
    "Lambert": brdf.Lambert(),
    "Phong 20": brdf.Phong(20),
    "Phong 1e5": brdf.Phong(1e5),
    "BlinnPhong 100": brdf.BlinnPhong(100),
    "Ward 0.2": brdf.Ward(0.2),
    "Ward 0.05, 0.4": brdf.Ward(0.05, 0.4),
    "Lafortune 30": brdf.Lafortune(30),
    "CookTorrance 0.2": brdf.CookTorrance(0.2, n=1.5),
    "Beckmann 0.3": brdf.Beckmann(0.3, n=0.2, k=3.0),
    "GGX 0.05": brdf.GGX(0.05),
    "GGX 0.5": brdf.GGX(0.5),
    "GGX 0.002": brdf.GGX(0.002),
    "AshikhminShirley 50": brdf.AshikhminShirley(50, 500, f0=0.3),
}
RGL = Path(__file__).parents[3] / "shared" / "data" / "brdf" / "rgl" / "paper_white_rgb.bsdf"


def tile(material: dl.Material, pixels: int = 12, tilt: float = 0.6) -> dl.Scene:
    """A square in the plane y = 0 that fills the picture, seen obliquely: each pixel by another direction."""
    vertices = np.array([[-9, 0, -9], [9, 0, -9], [9, 0, 9], [-9, 0, 9]], float)
    camera = dl.Camera((0, 2, 2 * tilt), (0, 0, 0), vertical_fov=50, width=pixels, height=pixels)
    return dl.Scene.from_arrays(vertices, [[0, 2, 1], [0, 3, 2]], camera=camera, materials=[material], name="tile")


def made(path: Path, scene: dl.Scene, **options) -> dl.Transport:
    options = {"columns": "haar:8", "quality": "lossless", "progress": False, **options}
    return dl.precompute(scene, path, **options)


def eyes(transport: dl.Transport) -> np.ndarray:
    """Unit vectors to the camera, in the local frame of a surface that faces +y: z is its normal."""
    way = np.array(transport.camera.position) - transport.receivers.position
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    return local(way)


def local(directions: np.ndarray) -> np.ndarray:
    """The frame of Duff et al. for the normal +y: tangent (1, 0, 0) x ..., as the formula gives it."""
    n = np.array([0.0, 1.0, 0.0])
    a = -1 / (1 + n[2])
    b = n[0] * n[1] * a
    frame = np.array([[1 + n[0] ** 2 * a, b, -n[0]], [b, 1 + n[1] ** 2 * a, -n[1]], n])
    return directions @ frame.T


@pytest.mark.parametrize("name", MODELS)
def test_an_even_sky_shows_the_directional_albedo(tmp_path, name):
    model = MODELS[name]
    transport = made(tmp_path / "a.transport", tile(dl.Material(0, 1, model)))
    white = dl.Environment.from_cubemap(np.ones((6, 8, 8, 3), np.float32))
    B = transport.multiply(transport.coefficients(white))[:, 0]
    expected = model.albedo(eyes(transport))
    # Faces of 8 x 8 texels: of a lobe that reaches the horizon, a few rays in each texel there are all that is known.
    np.testing.assert_allclose(B, expected, atol=0.012 * expected.max())
    assert abs(B.mean() / expected.mean() - 1) < 0.006


@pytest.mark.parametrize("name", MODELS)
def test_one_texel_s_highlight_is_that_of_brute_force(tmp_path, name):
    """The light of one texel on all receivers, against 300 x 300 directions inside it (asked: 1 % of its energy)."""
    model, size = MODELS[name], 8
    transport = made(tmp_path / "a.transport", tile(dl.Material(0, 1, model), pixels=24))
    sky = np.zeros((6, size, size, 3), np.float32)
    # The face +y; the mirror image of the camera lies in it.
    sky[2, 3, 4] = 1.0
    B = transport.multiply(transport.coefficients(dl.Environment.from_cubemap(sky)))[:, 0].astype(np.float64)
    n = 300
    s, t = np.meshgrid(2 * (4 + (np.arange(n) + 0.5) / n) / size - 1, 2 * (3 + (np.arange(n) + 0.5) / n) / size - 1)
    points = np.stack([s, np.ones_like(s), t], -1).reshape(-1, 3)
    length = np.linalg.norm(points, axis=1)
    wi = local(points / length[:, None])
    weight = (2 / size / n) ** 2 / length**3 * wi[:, 2]
    wo = eyes(transport)
    some = np.arange(0, len(wo), 7)
    exact = np.array([model.evaluate(wi, eye) @ weight for eye in wo[some]])
    narrow = name in ("Phong 1e5", "GGX 0.002")
    # Samples of a narrow lobe fall to one side or the other of the texel's edge; together they are right.
    assert abs(B[some].sum() / exact.sum() - 1) < (0.03 if narrow else 0.01)
    np.testing.assert_allclose(B[some], exact, atol=(0.05 if narrow else 0.02) * exact.max())


def test_a_row_is_grey_and_its_colour_stays_outside(tmp_path):
    one = made(tmp_path / "one.transport", tile(dl.Material(0.2, (0.9, 0.5, 0.1), brdf.GGX(0.3))))
    other = made(tmp_path / "other.transport", tile(dl.Material((0.1, 0, 0.3), 0.4, brdf.GGX(0.3))))
    assert one.channels == 1 and len(one.receivers) == 2 * 144
    V = one.coefficients(dl.Environment.builtin("studio"))
    np.testing.assert_array_equal(one.multiply(V), other.multiply(V))
    np.testing.assert_allclose(one.albedo[:144], [[0.2, 0.2, 0.2]] * 144)
    np.testing.assert_allclose(one.albedo[144:], [[0.9, 0.5, 0.1]] * 144)
    np.testing.assert_array_equal(one.pixels.pixel[:144], one.pixels.pixel[144:])


def test_what_a_scene_does_not_need_is_left_out(tmp_path):
    scene = tile(dl.Material(0, 0.7, brdf.Phong(50)))
    black = made(tmp_path / "black.transport", scene, columns="haar:8+texels")
    assert len(black.receivers) == 144 and str(black.columns) == "haar:8"
    assert "texel columns" in str(black.plan) and "1 of 1 materials are glossy" in str(black.plan)
    matt = scene.with_material(0, dl.Material(0.3))
    assert matt.models == () and matt.specular is None
    plain = made(tmp_path / "plain.transport", matt, columns="haar:8+texels")
    shiny = scene.with_material(0, dl.Material(0.3, 0.7, brdf.Phong(50)))
    off = made(tmp_path / "off.transport", shiny, columns="haar:8+texels", gloss=False)
    V = off.coefficients(dl.Environment.builtin("sky"))
    assert "rows of glossy lobes" in str(off.plan) and len(off.receivers) == 144
    np.testing.assert_array_equal(off.multiply(V), plain.multiply(V))
    # Another camera is not asked for what the first was not.
    again = off.for_camera(off.camera, tmp_path / "again.transport", progress=False)
    np.testing.assert_array_equal(again.multiply(V), off.multiply(V))


def test_other_views_of_glossy_scenes(tmp_path):
    scene = tile(dl.Material(0.3, 0.5, brdf.Lafortune(30, (-1.0, -0.9, 0.8))))
    transport = made(tmp_path / "a.transport", scene, bounces=1)
    again = transport.for_camera(transport.camera, tmp_path / "b.transport", progress=False)
    V = transport.coefficients(dl.Environment.builtin("hall"))
    np.testing.assert_array_equal(again.multiply(V), transport.multiply(V))
    assert transport.surface.models == scene.models
    other = transport.for_camera(
        replace(transport.camera, position=(1, 2, 1)), tmp_path / "c.transport", progress=False
    )
    assert not np.array_equal(other.image(other.multiply(V)), transport.image(transport.multiply(V)))


@pytest.mark.skipif(not RGL.exists(), reason="needs a measured material")
def test_a_measured_material_has_three_rows(tmp_path):
    model = brdf.Measured.load(RGL)
    transport = made(tmp_path / "a.transport", tile(dl.Material(0.9, 0.8, model)))
    assert len(transport.receivers) == 3 * 144
    white = dl.Environment.from_cubemap(np.ones((6, 8, 8, 3), np.float32))
    picture = transport.image(transport.multiply(transport.coefficients(white))).reshape(-1, 3)
    order = transport.pixels.pixel[:144]
    expected = 0.8 * model.albedo(eyes(transport)[:144])
    np.testing.assert_allclose(picture[order], expected, rtol=0.02)
    with pytest.raises(ValueError, match="keeps its scene"):
        _ = transport.surface
    with pytest.raises(ValueError, match="a material is measured"):
        made(tmp_path / "v.transport", tile(dl.Material(0.9, 0.8, model)), receivers="vertices")


def test_a_million_frames_leave_the_bits_of_a_fresh_product(tmp_path):
    """Some hundred here: bounces and lobes change nothing of what makes a frame exact."""
    scene = tile(dl.Material(0.3, 0.5, brdf.GGX(0.2)))
    transport = made(tmp_path / "a.transport", scene, bounces=2, quality="preview")
    relighter = dl.Relighter(transport, dl.PerBand(terms=10))
    env = dl.Environment.builtin("hall")
    for k in range(150):
        frame = relighter.step(env.rotated(3.7 * k))
        np.testing.assert_array_equal(frame.values, transport.multiply(relighter.values))


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"albedo": 1.2}, "albedo to be"),
        ({"albedo": (0.1, 0.2)}, "albedo to be"),
        ({"albedo": float("nan")}, "albedo to be"),
        ({"specular": 0.5}, "expected a model for the specular colour"),
        ({"model": "GGX"}, "expected a model of dl.brdf"),
        ({"model": brdf.GGX(0.2), "specular": -0.1}, "specular to be"),
    ],
)
def test_materials_are_checked(options, words):
    with pytest.raises(ValueError, match=words):
        dl.Material(**options)


def test_scenes_take_materials():
    a, b = dl.Material(0.5), dl.Material((0.1, 0.2, 0.3), 0.4, brdf.GGX(0.1))
    square = np.array([[0, 0, 0], [1, 0, 0], [1, 0, 1], [0, 0, 1]], float)
    triangles = [[0, 2, 1], [0, 3, 2]]
    scene = dl.Scene.from_arrays(square, triangles, materials=[a, b], material=[1, 0])
    assert scene.material.tolist() == [1, 0] and [m.model for m in scene.materials] == [None, b.model]
    np.testing.assert_allclose(scene.materials[1].albedo, b.albedo, atol=1e-7)
    hashes = {scene.with_material(1, m).content_hash() for m in (a, b, replace(b, model=brdf.GGX(0.2)))}
    assert len(hashes) == 3 and scene.content_hash() in hashes
    for options, words in [
        ({"materials": []}, "materials must be"),
        ({"materials": [0.5]}, "materials must be"),
        ({"materials": [a, b]}, "must say which"),
        ({"materials": [a, b], "material": [0, 2]}, "in \\[0, 2\\)"),
        ({"materials": [a], "material": [0.0, 0.0]}, "integers"),
        ({"material": [0, 0]}, "beside material"),
    ]:
        with pytest.raises(ValueError, match=words):
            dl.Scene.from_arrays(square, triangles, **options)
    for number in (2, -1, "0"):
        with pytest.raises(ValueError, match="a material from 0 to 1"):
            scene.with_material(number, a)


# --- seen from anywhere -----------------------------------------------------------------------------------------------


def quad(model, cells: int = 6) -> dl.Scene:
    """A square in the plane y = 0 of some cells, seen obliquely."""
    at = np.linspace(-1, 1, cells + 1)
    x, z = np.meshgrid(at, at)
    vertices = np.stack([x, np.zeros_like(x), z], -1).reshape(-1, 3)
    k = np.arange((cells + 1) ** 2).reshape(cells + 1, cells + 1)
    a, b, c, d = (part.ravel() for part in (k[:-1, :-1], k[:-1, 1:], k[1:, :-1], k[1:, 1:]))
    triangles = np.concatenate([np.stack([a, c, d], -1), np.stack([a, d, b], -1)])
    camera = dl.Camera((0.3, 2, 1.2), (0, 0, 0), vertical_fov=40, width=16, height=16)
    return dl.Scene.from_arrays(vertices, triangles, camera=camera, materials=[dl.Material(0.2, 0.7, model)])


@pytest.mark.parametrize("model", [brdf.Phong(20), brdf.GGX(0.4), brdf.Ward(0.3, 0.5)], ids=repr)
def test_factors_are_the_lobe_as_far_as_they_say(model):
    """Against the lobe itself, at random pairs: the rest, under the light prior, is what `left` says; all is all."""
    many = factored(model, 600)
    assert (np.diff(many.left) <= 1e-12).all() and many.left[0] == 1
    auto = factored(model, "auto")
    assert auto.left[auto.count] <= 0.10 < auto.left[auto.count - 1] and auto.count <= MOST
    rings, columns = many.eye.shape[1:]
    edges = np.linspace(0, np.pi / 2, rings + 1)
    solid = np.repeat((np.cos(edges[:-1]) - np.cos(edges[1:])) * 2 * np.pi / columns, columns)
    h = auto.eye.reshape(auto.count, -1).astype(np.float64)
    np.testing.assert_allclose(h * solid @ h.T, np.eye(auto.count), atol=1e-6)
    theta = np.repeat(0.5 * (edges[:-1] + edges[1:]), columns)
    phi = np.tile(2 * np.pi * (np.arange(columns) + 0.5) / columns, rings)
    at = np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], -1)
    some = np.random.default_rng(1).integers(0, len(at), (2, 300))
    exact = model.evaluate(at[some[0]], at[some[1]]) * at[some[0], 2]
    g, eye = (table.reshape(many.count, -1)[:, own] for table, own in zip((many.light, many.eye), some, strict=True))
    assert np.linalg.norm((g * eye).sum(axis=0) - exact) < max(0.02, 2 * many.left[many.count]) * np.linalg.norm(exact)


def test_vertices_are_seen_by_factors(tmp_path):
    """Of a wide lobe, whose factors leave next to nothing: the picture of pixels, from any side."""
    scene = quad(brdf.GGX(0.5))
    transport = made(tmp_path / "v.transport", scene, receivers="vertices", factors=40, columns="haar:16")
    assert transport.factors == 40 and len(transport.receivers) == 2 * 49 * 41
    env = dl.Environment.builtin("hall")
    V = transport.coefficients(env)
    B = transport.multiply(V)
    for position in ((0.3, 2, 1.2), (-1.5, 1, 0.2), (0.2, -2, 0.3)):
        camera = replace(scene.camera, position=position)
        pixels = made(tmp_path / "p.transport", scene.with_camera(camera), columns="haar:16")
        theirs, ours = pixels.image(pixels.multiply(V)), transport.render(camera, B)
        assert np.linalg.norm(ours - theirs) < 0.04 * np.linalg.norm(theirs)
        diffuse = transport.render(camera, np.where(np.arange(len(B))[:, None] < 98, B, 0))
        assert np.linalg.norm(diffuse - theirs) > 0.2 * np.linalg.norm(theirs)


def test_a_view_alone_changes_no_response(tmp_path):
    """Fig. 7.2, third column: the light stands still, the camera moves; nothing of M is sent, and all is exact."""
    transport = made(tmp_path / "v.transport", quad(brdf.Phong(20)), receivers="vertices", factors=4)
    assert transport.factors == 4 and "4 factors leave 4" in str(transport.plan)
    env = dl.Environment.builtin("hall")
    relighter = dl.Relighter(transport, dl.PerBand(terms=30))
    frame = relighter.step(env)
    for k in range(4):
        camera = replace(transport.camera, position=(np.sin(k), 1.5, np.cos(k)))
        again = relighter.step(env)
        np.testing.assert_array_equal(again.values, frame.values)
        assert len(again.columns) == 0
        exact = transport.render(camera, transport.multiply(relighter.values), env)
        np.testing.assert_array_equal(again.render(camera), exact)
    colours = transport.colours(frame.values)
    assert colours.shape == (98, 3)
    transport.save_colours(tmp_path / "a.glb", frame.values)


@pytest.mark.parametrize("factors", ["some", 0, -1, 1.5])
def test_numbers_of_factors_are_checked(tmp_path, factors):
    with pytest.raises(ValueError, match="factor"):
        made(tmp_path / "v.transport", quad(brdf.Phong(20)), receivers="vertices", factors=factors)


def test_forged_factors_are_refused(tmp_path):
    transport = made(tmp_path / "v.transport", quad(brdf.Phong(20), 1), receivers="vertices", factors=2)
    arrays = transport._core.beside("scene")
    assert Gloss.of(arrays, transport.receivers).first == 8
    for name, forged in {
        "base": arrays["base"] * 0 + 9,
        "factor": arrays["factor"] * 0 + 7,
        "eye.00000": arrays["eye.00000"].astype(np.float64),
        "eye.00000 of one number": np.array(1, np.float32),
        "eye.00000 without rings": arrays["eye.00000"][:, :0],
        "eye.00000 of no numbers": arrays["eye.00000"] * np.float32(np.nan),
    }.items():
        name = name.split()[0]
        with pytest.raises(ValueError, match="expected"):
            Gloss.of({**arrays, name: forged}, transport.receivers)
    with pytest.raises(ValueError, match="factors of lobes"):
        transport.clustered(tmp_path / "c.transport", clusters=2, representatives=1)
    assert not list(tmp_path.glob("c.*"))


def test_what_a_lobe_takes_from_nodes_is_its_albedo(tmp_path):
    """Inside a closed box every ray of a lobe meets something: weights are as many 4,096ths as the lobe reflects."""
    x = np.array([[i, j, k] for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)], float)
    sides = [(0, 1, 3, 2), (4, 5, 7, 6), (0, 1, 5, 4), (2, 3, 7, 6), (0, 2, 6, 4), (1, 3, 7, 5)]
    triangles = [t for a, b, c, d in sides for t in ((a, b, c), (a, c, d))]
    camera = dl.Camera((0.2, 0.3, 0.9), (0, -1, -0.4), vertical_fov=50, width=10, height=10)
    model = brdf.GGX(0.5, n=1.5)
    scene = dl.Scene.from_arrays(x, triangles, camera=camera, materials=[dl.Material(0.5, 1, model)])
    prepared = Prepared(scene, Request("haar:4", "preview", between=between(1, 1e-3, "auto")))
    sources = prepared.between.sources(lambda done: None)
    links = linked(sources, prepared.core, prepared.rows, prepared.settings, lambda done: None)
    assert links.gathering[3] == (prepared.rows.lobe >= 0).sum() == 100
    # Nodes that shine by 1: what rows take is the sum of their weights.
    rows, nodes = len(prepared.rows), 2 * len(sources)
    core = [_core.Transport.from_dense(np.zeros((rows, 6)), columns="haar:1")]
    core.append(_core.Transport.from_dense(np.ones((nodes, 6)), columns="haar:1"))
    V = np.zeros((1, 6, 3))
    V[0, 0] = 1
    taken = _core.Transport.join(core, links.link).multiply(V)[0, 100:, 0]
    table = prepared.rows.table(prepared.albedo(), np.zeros(rows, np.uint16))
    way = np.array(camera.position) - table.position[100:]
    wo = np.einsum("rk,rk->r", way / np.linalg.norm(way, axis=1, keepdims=True), table.normal[100:])
    expected = model.albedo(np.stack([np.sqrt(1 - wo**2), 0 * wo, wo], -1))
    assert abs(taken.mean() / expected.mean() - 1) < 0.02
