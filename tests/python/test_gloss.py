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
from deltalux.transport.gloss import Gloss, looked_up
from forms import texel_areas

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


# --- suns and lamps ----------------------------------------------------------------------------------------------


def texel_rows(transport: dl.Transport, some: np.ndarray) -> np.ndarray:
    """What rows hold in texel columns, times pi over the roots of their areas: f cos where a row sees all."""
    stored = 6 * transport.columns.face**2
    rows = np.array([transport.row(int(row))[stored:] for row in some], np.float64)
    return rows / np.sqrt(texel_areas(transport.columns.face))


@pytest.mark.parametrize("name", MODELS)
def test_a_texel_column_is_the_mean_of_the_lobe(tmp_path, name):
    """Against 240 x 240 directions in the texel: in that of the middle pixel's mirror image, and two beside."""
    model, size = MODELS[name], 8
    scene = tile(dl.Material(0, 1, model), pixels=9)
    transport = made(tmp_path / "a.transport", scene, columns="haar:8+texels")
    wo = eyes(transport)
    found, texels = texel_rows(transport, np.arange(81)), []
    n, exact = 240, []
    for row, column in ((3, 4), (3, 3), (1, 5)):
        s, t = (2 * (at + (np.arange(n) + 0.5) / n) / size - 1 for at in (column, row))
        points = np.stack([*np.broadcast_arrays(s[None], 1.0, t[:, None])], -1).reshape(-1, 3)
        length = np.linalg.norm(points, axis=1)
        wi = local(points / length[:, None])
        values = [np.average(model.evaluate(wi, eye) * wi[:, 2], weights=length**-3) for eye in wo]
        exact.append(values)
        texels.append(found[:, 2 * 64 + row * 8 + column])
    np.testing.assert_allclose(texels, exact, atol=0.02 * np.max(exact))


@pytest.mark.slow
@pytest.mark.parametrize("name", ["Phong 1e5", "GGX 0.05"])
def test_a_sun_that_moves_less_than_a_texel_moves_its_highlight(tmp_path, name):
    """On a ball, seen closely: its light is that of brute force within 1 %, and its middle goes where the sun does.

    The sun takes 17 steps of a quarter of a degree; a texel is 2.8 degrees wide, and wavelets stand still meanwhile.
    """
    model, pixels = MODELS[name], 40
    ball, fov = (0.09, 1.8) if name == "Phong 1e5" else (0.55, 10.5)
    image = np.full((1024, 2048, 3), 1e-4, np.float32)
    image[380:382, 1000:1002] = 1e5
    sun = dl.Environment.from_latlong(image)
    eye = np.array([0, 0, 5.0])
    middle = mirror(np.array(sun.rotated(2).peaks(1)[0].direction), eye)
    scene = piece_of_ball(middle, ball, 360, eye, fov, pixels, model)
    path = tmp_path / "a.transport"
    transport = dl.precompute(scene, path, columns="haar:32+texels", quality="publication", progress=False)
    rows, columns = np.divmod(transport.pixels.pixel, pixels)
    weights = transport.pixels.weight
    energies, errors = [], []
    for degrees in np.arange(0, 4.01, 0.25):
        env = sun.rotated(float(degrees))
        (peak,) = env.peaks()
        B = weights * transport.multiply(transport.coefficients(env))[:, 0].astype(np.float64)
        exact = peak.flux[0] * highlight(scene.camera, model, np.array(peak.direction), 8)
        energies.append(B.sum() / exact.sum())
        places = np.array([(B * at).sum() / B.sum() for at in (columns, rows)])
        y, x = np.mgrid[:pixels, :pixels]
        errors.append(places - [(exact * at).sum() / exact.sum() for at in (x, y)])
    assert np.abs(np.array(energies) - 1).max() < 0.01
    # A texel is 4 pixels wide, or 14.
    assert np.abs(errors).max() < (0.15 if name == "Phong 1e5" else 0.05)
    assert np.abs(np.diff(energies)).max() < 0.003


def mirror(light: np.ndarray, eye: np.ndarray) -> np.ndarray:
    """The point of the unit sphere that mirrors the light to the eye."""
    normal = light
    for _ in range(60):
        normal = light + (eye - normal) / np.linalg.norm(eye - normal)
        normal /= np.linalg.norm(normal)
    return normal


def piece_of_ball(middle, half, count, eye, fov, pixels, model) -> dl.Scene:
    u = np.cross(middle, [0, 1, 0])
    u /= np.linalg.norm(u)
    x, y = np.meshgrid(*2 * [np.tan(half) * np.linspace(-1, 1, count)])
    points = middle + x[..., None] * u + y[..., None] * np.cross(u, middle)
    points /= np.linalg.norm(points, axis=-1, keepdims=True)
    a = np.arange(count * (count - 1)).reshape(-1, count)[:, :-1].ravel()
    triangles = np.concatenate([np.stack([a, a + 1, a + count], 1), np.stack([a + 1, a + count + 1, a + count], 1)])
    camera = dl.Camera(tuple(eye), tuple(middle), vertical_fov=fov, width=pixels, height=pixels)
    materials = [dl.Material(0, 1, model)]
    return dl.Scene.from_arrays(points.reshape(-1, 3), triangles, camera=camera, materials=materials, name="ball")


def highlight(camera: dl.Camera, model, light: np.ndarray, side: int) -> np.ndarray:
    """f cos of the unit sphere at side x side points of every pixel, in the mean: (height, width)."""
    eye = np.array(camera.position)
    forward = np.array(camera.target) - eye
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, camera.up)
    right /= np.linalg.norm(right)
    half, n = np.tan(np.radians(camera.vertical_fov) / 2), camera.width * side
    x, y = np.meshgrid(*2 * [half * (2 * np.arange(n) + 1 - n) / n])
    way = forward + x[..., None] * right - y[..., None] * np.cross(right, forward)
    way /= np.linalg.norm(way, axis=-1, keepdims=True)
    b = way @ eye
    point = eye + (-b - np.sqrt(b * b - eye @ eye + 1))[..., None] * way
    # Isotropic: any frame about the normal will do.
    wo, normal = -way.reshape(-1, 3), point.reshape(-1, 3)
    tangent = np.cross(normal, [0.3, 0.9, 0.1])
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    frame = np.stack([tangent, np.cross(normal, tangent), normal], 1)
    wi = frame @ light
    f = model.evaluate(wi, np.einsum("nij,nj->ni", frame, wo)) * np.maximum(wi[:, 2], 0)
    return f.reshape(camera.height, side, camera.width, side).mean(axis=(1, 3))


def test_rows_of_narrow_lobes_are_followed_exactly(tmp_path):
    """Their texels hold more than 2^27 of the quantum: a group of such rows has a coarser unit."""
    scene = tile(dl.Material(0, 1, brdf.Phong(1e5)), pixels=5)
    path = tmp_path / "a.transport"
    transport = dl.precompute(scene, path, columns="haar:16+texels", quality="publication", progress=False)
    rows = np.array([transport.row(k) for k in range(len(transport.receivers))], np.float64)
    assert np.linalg.norm(rows, axis=1).max() > 8
    integers = rows * 2.0**24
    assert (integers == np.round(integers)).all() and (integers % 2 == 0).all(axis=1).any()
    relighter = dl.Relighter(transport, dl.PerBand(terms=20))
    sky = dl.Environment.builtin("sky")
    for degrees in np.linspace(0, 10, 21):
        frame = relighter.step(sky.rotated(float(degrees)))
        np.testing.assert_array_equal(frame.values, transport.multiply(relighter.values))
        exact = rows @ transport.coefficients(sky.rotated(float(degrees)))
        assert (np.abs(frame.values - exact) <= relighter.bounds(frame)).all()


def test_a_file_has_the_version_that_reads_it(tmp_path):
    """One with lobes is not for readers that would take them for cosines; what they know stays as it was."""
    shiny, matt = tile(dl.Material(0.1, 1, brdf.GGX(0.3)), pixels=4), tile(dl.Material(0.5), pixels=4)
    cases = {"lobes": (shiny, "haar:8+texels", [3, 2]), "texels": (matt, "haar:8+texels", [2, 3])}
    cases |= {"wavelets": (shiny, "haar:8", [2, 3])}
    for name, (scene, columns, version) in cases.items():
        made(tmp_path / f"{name}.transport", scene, columns=columns)
        assert _core.Transport.open(tmp_path / f"{name}.transport").version == version


# --- rows --------------------------------------------------------------------------------------------------------


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
    assert len(black.receivers) == 144 and str(black.columns) == "haar:8+texels"
    assert "texel columns" not in str(black.plan) and "1 of 1 materials are glossy" in str(black.plan)
    options = {"columns": "haar:8+texels", "receivers": "vertices", "factors": 2}
    vertices = made(tmp_path / "vertices.transport", scene, **options)
    assert str(vertices.columns) == "haar:8" and "texel columns: factors of lobes are signed" in str(vertices.plan)
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
    texels = made(tmp_path / "b.transport", tile(dl.Material(0.9, 0.8, model), pixels=4), columns="haar:8+texels")
    assert str(texels.columns) == "haar:8" and "tables of measured materials are not kept" in str(texels.plan)
    white = dl.Environment.from_cubemap(np.ones((6, 8, 8, 3), np.float32))
    picture = transport.image(transport.multiply(transport.coefficients(white))).reshape(-1, 3)
    order = transport.pixels.pixel[:144]
    expected = 0.8 * model.albedo(eyes(transport)[:144])
    np.testing.assert_allclose(picture[order], expected, rtol=0.02)
    with pytest.raises(ValueError, match="keeps its scene"):
        _ = transport.surface


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


@pytest.mark.skipif(not RGL.exists(), reason="needs a measured material")
def test_a_measured_material_is_seen_by_factors_of_three_colours(tmp_path):
    """All factors are the lobe, but for what its left and its right differ by; the picture is that of pixels; the file
    keeps the factors, and not the table."""
    model = brdf.Measured.load(RGL)
    many = factored(model, 300)
    rings, columns = many.light.shape[1:]
    (i, o), (a, b) = (np.random.default_rng(1).integers(0, most, (2, 300)) for most in (rings, columns))

    def way(ring: np.ndarray, turn: np.ndarray) -> np.ndarray:
        theta, phi = np.pi / 2 * (ring + 0.5) / rings, 2 * np.pi * (turn + 0.5) / columns
        return np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], -1)

    exact = 0.5 * sum(model.evaluate(way(i, x), way(o, y)) for x, y in ((a, b), (b, a))) * way(i, a)[:, 2:]
    found = np.einsum("kp,kpc->pc", many.light[:, i, a], many.eye[:, o, b])
    assert np.linalg.norm(found - exact) < max(0.02, 2 * many.left[many.count]) * np.linalg.norm(exact)

    scene = quad(brdf.Phong(20), cells=2).with_material(0, dl.Material(0.9, 0.8, model))
    transport = made(tmp_path / "v.transport", scene, receivers="vertices", columns="haar:16")
    count = transport.factors
    assert 2 <= count <= MOST and len(transport.receivers) == 18 * (1 + count)
    env = dl.Environment.builtin("hall")
    B = transport.multiply(transport.coefficients(env))
    pixels = made(tmp_path / "p.transport", scene, columns="haar:16")
    theirs, ours = pixels.image(pixels.multiply(pixels.coefficients(env))), transport.render(scene.camera, B)
    assert np.linalg.norm(ours - theirs) < 0.05 * np.linalg.norm(theirs)
    assert transport.surface.models == (None,) and transport.surface.albedo.max() == 0


def test_a_measured_material_that_differs_as_it_turns_is_refused_at_vertices(monkeypatch):
    monkeypatch.setattr("deltalux.precomputation.factoring.Measured", brdf.Ward)
    monkeypatch.setattr(brdf.Ward, "evaluate", lambda self, wi, wo: np.ones((*np.shape(wi)[:-1], 3)) * wi[..., :1] ** 2)
    with pytest.raises(ValueError, match="isotropic measured material for vertices"):
        factored(brdf.Ward(0.3, 0.5), 4)


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


def hall_of(model, closed: bool = True) -> dl.Scene:
    """A box over a `quad`, which is its floor."""
    floor = quad(model)
    x = np.array([[i, j, k] for i in (-1, 1) for j in (0, 2) for k in (-1, 1)], float)
    walls = [(0, 1, 3, 2), (4, 5, 7, 6), (0, 2, 6, 4), (1, 3, 7, 5), (2, 3, 7, 6)][: 5 if closed else 4]
    triangles = np.array([t for a, b, c, d in walls for t in ((a, b, c), (a, c, d))]) + len(floor.vertices)
    return dl.Scene.from_arrays(
        np.concatenate([floor.vertices, x]),
        np.concatenate([floor.triangles, triangles]),
        camera=replace(floor.camera, position=(0.3, 1.2, 0.8)),
        materials=[dl.Material(0.2, 0.7, model), dl.Material((0.7, 0.3, 0.2))],
        material=[0] * len(floor.triangles) + [1] * len(triangles),
    )


@pytest.mark.parametrize(("model", "by_links", "in_all"), [(brdf.GGX(0.25), 0.05, 0.06), (brdf.Phong(20), 0.07, 0.11)])
def test_factors_reflect_a_coloured_box(model, by_links, in_all):
    """Nodes shine by a given function of their place, which jumps from wall to wall. Against quadrature: what links
    leave of the factors, and what they leave with those of the lobe itself, in five directions."""
    prepared = Prepared(
        hall_of(model), Request("haar:4", "preview", receivers="vertices", between=between(1, 1e-3, "auto"))
    )
    sources = prepared.between.sources(lambda done: None)
    links = linked(sources, prepared.core, prepared.rows, prepared.settings, lambda done: None)

    def shine(place: np.ndarray) -> np.ndarray:
        wall = np.where(place[:, :1] < -0.999, [1.0, 0.1, 0.1], np.where(place[:, :1] > 0.999, [0.1, 0.5, 0.1], 0.5))
        return wall * (1 + 0.5 * np.sin(3 * place[:, 1:2] + 2 * place[:, 2:]))

    place = sources.kept()[:, :3]
    low, high = place.min(axis=0), place.max(axis=0)
    radiosity = shine((2 * place - low - high) / (high - low).max() + [0, 1, 0])
    taken = links.weights.taken(np.concatenate([np.zeros_like(radiosity), radiosity]))
    rows, factors = prepared.rows, prepared.factored[0]
    table = rows.table(prepared.albedo(), np.zeros(len(rows), np.uint16))

    # 200 x 400 directions that stand for as much each.
    up, turn = np.meshgrid((np.arange(200) + 0.5) / 200, 2 * np.pi * (np.arange(400) + 0.5) / 400)
    wi = np.stack([np.sqrt(1 - up**2) * np.cos(turn), np.sqrt(1 - up**2) * np.sin(turn), up], -1).reshape(-1, 3)
    world, size = wi @ local(np.eye(3)).T, 2 * np.pi / len(wi)
    eyes = np.array([[0.3, 0.2, 0.9], [-0.6, 0, 0.6], [0, 0.8, 0.4], [0.5, -0.5, 0.5], [0, 0, 1]])
    eyes /= np.linalg.norm(eyes, axis=1, keepdims=True)
    each = np.arange(factors.count)
    g = np.stack([looked_up(factors.light, np.full(len(wi), k), wi) for k in each]) * size
    h = np.stack([looked_up(factors.eye, each, np.tile(eye, (len(each), 1))) for eye in eyes])
    lobe = np.stack([model.evaluate(wi, eye) for eye in eyes]) * wi[:, 2] * size
    of_factors, of_lobe = [], []
    inside = (np.abs(table.position[:, [0, 2]]) < 0.9).all(axis=1) & (table.normal[:, 1] > 0.9)
    for vertex in np.flatnonzero(inside & (rows.lobe < 0))[::4]:
        at, ends = table.position[vertex].astype(np.float64), np.where(world > 0, [1, 2, 1], [-1, 0, -1])
        light = shine(at + world * np.min((ends - at) / world, axis=1)[:, None])
        own = np.flatnonzero((rows.base == vertex) & (rows.lobe >= 0))
        np.testing.assert_array_equal(rows.lobe[own], each)
        of_factors.append((taken[own], g @ light))
        of_lobe.append((h @ taken[own], lobe @ light))
    for pairs, most in ((of_factors, by_links), (of_lobe, in_all)):
        found, exact = np.swapaxes(pairs, 0, 1)
        assert np.linalg.norm(found - exact) < most * np.linalg.norm(exact)


def test_reflections_at_vertices_are_followed_exactly(tmp_path):
    """Rows take by weights of either sign: the bits of a fresh product after any frames, and within the bound."""
    scene = hall_of(brdf.Phong(20), closed=False)
    options = {"receivers": "vertices", "factors": 4, "columns": "haar:4", "quality": "preview"}
    transport = made(tmp_path / "a.transport", scene, bounces=1, **options)
    assert transport._core.version == [4, 2] and "weights of either sign" in str(transport.plan)
    env = dl.Environment.builtin("hall")
    relighter = dl.Relighter(transport, dl.PerBand(terms=5))
    for degrees in range(0, 200, 20):
        frame = relighter.step(env.rotated(degrees))
        np.testing.assert_array_equal(frame.values, transport.multiply(relighter.values))
        exact = transport.multiply(transport.coefficients(env.rotated(degrees)))
        assert (np.abs(frame.values - exact) <= relighter.bounds(frame)).all()
    # The walls are red, and so is what the floor reflects of them.
    direct = made(tmp_path / "b.transport", scene, **options)
    lobe = np.arange(len(frame.values)) >= transport._views._gloss.first
    V = transport.coefficients(dl.Environment.from_cubemap(np.ones((6, 4, 4, 3), np.float32)))
    red, green, _ = np.abs(transport.multiply(V) - direct.multiply(V))[lobe].sum(axis=0)
    assert red > 1.8 * green > 0
