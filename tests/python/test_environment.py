"""Environments: every layout, orientation, what resampling keeps, and bad input."""

import os
import warnings
from pathlib import Path

import numpy as np
import OpenImageIO
import pytest
from deltalux import _core
from deltalux.io import load_image, save_image, to_display
from deltalux.light.environment import Environment
from deltalux.sphere import face_directions
from hypothesis import given, settings
from hypothesis import strategies as st

DATA = Path(__file__).parents[2] / "../shared/data/env"


def solid_angles(n: int) -> np.ndarray:
    """Of one face's texels, by the antiderivative at their corners."""
    edge = np.linspace(-1, 1, n + 1)
    corner = np.arctan2(np.outer(edge, edge), np.sqrt(edge[:, None] ** 2 + edge[None] ** 2 + 1))
    return corner[1:, 1:] - corner[:-1, 1:] - corner[1:, :-1] + corner[:-1, :-1]


def gradient(directions: np.ndarray) -> np.ndarray:
    """Radiance that tells every direction from every other: 2 + d."""
    return 2 + directions


def lat_long(height: int, width: int) -> np.ndarray:
    """The gradient in Mitsuba's convention, written independently of the package: forward is the middle, +Z."""
    v, u = np.meshgrid((np.arange(height) + 0.5) / height, (np.arange(width) + 0.5) / width, indexing="ij")
    theta, phi = np.pi * v, 2 * np.pi * u
    return gradient(np.stack([np.sin(theta) * np.sin(phi), np.cos(theta), -np.sin(theta) * np.cos(phi)], axis=-1))


def eye_tile(n: int, out, right, down) -> np.ndarray:
    """The gradient on a square tile of 90 degrees, by the vectors that the eye sees."""
    c = (2 * np.arange(n) + 1 - n) / n
    d = np.array(out) + c[None, :, None] * np.array(right) + c[:, None, None] * np.array(down)
    return gradient(d / np.linalg.norm(d, axis=-1, keepdims=True))


X, Y, Z = np.eye(3)


def in_layout(layout: str, n: int) -> np.ndarray:
    """The gradient as an image in a layout; what lies outside a cross is bright, not black."""
    if layout == "latlong":
        return lat_long(2 * n, 4 * n)
    if layout == "angular":
        c = (2 * np.arange(4 * n) + 1 - 4 * n) / (4 * n)
        u, v = np.meshgrid(c, -c)  # v points up.
        r = np.hypot(u, v)
        phi, theta = np.pi * r, np.arctan2(v, u)
        d = np.stack([np.sin(phi) * np.cos(theta), np.sin(phi) * np.sin(theta), -np.cos(phi)], axis=-1)
        return np.where(r[..., None] <= 1, gradient(d), 1e6)
    if layout == "cube":
        return np.concatenate(list(gradient(face_directions(n))), axis=0)
    tiles = {
        "left": eye_tile(n, -X, -Z, -Y),
        "middle": eye_tile(n, -Z, X, -Y),
        "right": eye_tile(n, X, Z, -Y),
        "above": eye_tile(n, Y, X, -Z),
        "below": eye_tile(n, -Y, X, Z),
        "behind": eye_tile(n, Z, -X, -Y),
    }
    empty = np.full((n, n, 3), 1e6)
    if layout == "vertical-cross":
        rows = [
            (empty, tiles["above"], empty),
            (tiles["left"], tiles["middle"], tiles["right"]),
            (empty, tiles["below"], empty),
            (empty, tiles["behind"][::-1, ::-1], empty),
        ]
    else:
        rows = [
            (empty, tiles["above"], empty, empty),
            (tiles["left"], tiles["middle"], tiles["right"], tiles["behind"]),
            (empty, tiles["below"], empty, empty),
        ]
    return np.concatenate([np.concatenate(row, axis=1) for row in rows], axis=0)


@pytest.mark.parametrize("named", [False, True])
@pytest.mark.parametrize("layout", ["latlong", "vertical-cross", "horizontal-cross", "angular", "cube"])
def test_every_layout_shows_the_same_light(tmp_path, layout, named):
    path = tmp_path / "env.exr"
    save_image(path, in_layout(layout, 32))
    env = Environment.load(path, layout=layout if named else None)
    directions = face_directions(8)
    np.testing.assert_allclose(env.cubemap(8), gradient(directions), atol=0.02)
    np.testing.assert_allclose(env.radiance(directions), gradient(directions), atol=0.02)


def test_exr_cube_attribute_is_in_openexr_orientation(tmp_path):
    # ImfEnvmap.cpp: in +X columns grow with z, in +Y rows grow with -z, in -Y with +z; that is what the eye sees.
    tiles = [(X, Z, -Y), (-X, -Z, -Y), (Y, X, -Z), (-Y, X, Z), (Z, -X, -Y), (-Z, X, -Y)]
    image = np.concatenate([eye_tile(16, *tile) for tile in tiles], axis=0).astype(np.float32)
    path = tmp_path / "cube.exr"
    save_image(path, image, {"textureformat": "CubeFace Environment"})
    assert load_image(path)[1]["envmap"] == "cube"
    np.testing.assert_allclose(Environment.load(path).cubemap(16), gradient(face_directions(16)), atol=1e-5)


def test_six_colours_turn_with_the_axes():
    # One colour a face, and a mark in a corner of each: a quarter turn about +Y by the right hand carries +Z to +X.
    faces = np.zeros((6, 4, 4, 3), np.float32)
    faces[..., 0] = np.arange(1, 7)[:, None, None]
    faces[:, 0, 0, 1] = 9
    env = Environment.from_cubemap(faces)
    np.testing.assert_allclose(env.cubemap(4), faces, rtol=3e-7)
    turned = env.rotated(90, "y").cubemap(4)
    np.testing.assert_allclose(turned[:, 1:, 1:3, 0].mean(axis=(1, 2)), [5, 6, 3, 4, 2, 1], rtol=1e-6)
    np.testing.assert_allclose(turned[[0, 1, 4, 5], :, :, 1], faces[[0, 1, 4, 5], :, :, 1], rtol=1e-6, atol=1e-6)
    # About +X: +Y goes to +Z; about +Z: +X goes to +Y.
    np.testing.assert_allclose(env.rotated(90, "x").cubemap(1)[:, 0, 0, 0], [1, 2, 6, 5, 3, 4], rtol=1e-6)
    np.testing.assert_allclose(env.rotated(90, "z").cubemap(1)[:, 0, 0, 0], [4, 3, 1, 2, 5, 6], rtol=1e-6)


@settings(deadline=None, max_examples=25)
@given(st.floats(-720, 720), st.tuples(*[st.floats(-1, 1)] * 3).filter(lambda v: np.linalg.norm(v) > 0.1))
def test_rotation_turns_the_light(degrees, axis):
    env = Environment.from_latlong(lat_long(64, 128), rows="centre")
    directions = face_directions(6)
    turned = env.rotated(degrees, axis)
    # R^-1 d by Rodrigues' formula on the vectors themselves.
    k, angle = np.array(axis) / np.linalg.norm(axis), np.radians(-degrees)
    back = (
        directions * np.cos(angle)
        + np.cross(k, directions) * np.sin(angle)
        + (directions @ k)[..., None] * k * (1 - np.cos(angle))
    )
    np.testing.assert_allclose(turned.radiance(directions), gradient(back), atol=5e-3)
    np.testing.assert_allclose(turned.cubemap(6), gradient(back), atol=3e-2)
    np.testing.assert_allclose(turned.rotated(-degrees, axis).cubemap(6), env.cubemap(6), atol=1e-5)


@settings(deadline=None, max_examples=25)
@given(st.integers(0, 511), st.integers(0, 1023), st.floats(0, 360), st.sampled_from([1, 5, 16, 64]))
def test_a_sun_of_one_pixel_keeps_its_flux(row, column, degrees, size):
    image = np.zeros((512, 1024, 3), np.float32)
    image[row, column] = 1e5, 2e5, 3e5
    flux = np.cos(np.pi * row / 512) - np.cos(np.pi * (row + 1) / 512)
    flux *= 2 * np.pi / 1024 * image[row, column].astype(float)
    cubemap = Environment.from_latlong(image, rows="centre").rotated(degrees, (1, 2, 3)).cubemap(size).astype(float)
    assert cubemap.min() >= 0
    got = np.einsum("fijc,ij->c", cubemap, solid_angles(size))
    np.testing.assert_allclose(got, flux, rtol=1e-3)


@settings(deadline=None, max_examples=30)
@given(st.integers(1, 9), st.integers(1, 9), st.integers(1, 20), st.floats(0, 360))
def test_constants_stay(height, width, size, degrees):
    env = Environment.from_latlong(np.full((height, width, 3), 0.3)).rotated(degrees, (3, -1, 2))
    np.testing.assert_allclose(env.cubemap(size), 0.3, rtol=1e-6)
    np.testing.assert_allclose(env.radiance(face_directions(2)), 0.3, rtol=1e-6)


def test_blends_are_linear():
    a, b = Environment.builtin("studio").rotated(20), Environment.from_latlong(np.full((1, 2, 3), 2.0)).scaled(0.25)
    mixed = a.mixed(b, 0.25).scaled(3.0)
    expected = 3 * (0.75 * a.cubemap(16).astype(float) + 0.25 * 0.5)
    np.testing.assert_allclose(mixed.cubemap(16), expected, rtol=2e-6)
    d = face_directions(3)
    np.testing.assert_allclose(mixed.radiance(d), 3 * (0.75 * a.radiance(d) + 0.25 * 0.5), rtol=1e-5)


@pytest.mark.parametrize("size", [1, 2, 16, 64])
def test_coefficients_of_a_frame_are_those_of_its_cubemap(size):
    env = Environment.builtin("sky").rotated(33).mixed(Environment.builtin("studio"), 0.3)
    cubemap = env.cubemap(size)
    coefficients = _core.environment_coefficients(env._layers, size)
    assert coefficients.shape == (6 * size * size, 3) and coefficients.dtype == np.float64
    np.testing.assert_array_equal(coefficients, _core.haar_coefficients(size, cubemap))
    np.testing.assert_allclose(_core.haar_inverse(size, coefficients), cubemap, rtol=1e-6)
    energy = np.einsum("fijc,ij->", cubemap.astype(float) ** 2, solid_angles(size))
    np.testing.assert_allclose((coefficients**2).sum(), energy, rtol=1e-12)


@pytest.mark.parametrize(("name", "least_range"), [("sky", 1e5), ("studio", 1e5), ("hall", 1e3)])
def test_builtin_environments(name, least_range):
    env = Environment.builtin(name)
    assert Environment.builtin(name) is env
    _, theta = np.meshgrid(np.arange(1024), (np.arange(512) + 0.5) * np.pi / 512)
    phi = np.broadcast_to((np.arange(1024) + 0.5) * np.pi / 512, theta.shape)
    pixels = env.radiance(np.stack([np.sin(theta) * np.sin(phi), np.cos(theta), -np.sin(theta) * np.cos(phi)], axis=-1))
    brightness = pixels.sum(axis=-1)
    assert brightness.min() > 0 and brightness.max() / np.median(brightness) > least_range
    # Light comes from above: a ground plane receives more than a ceiling.
    up = np.where(face_directions(32)[..., 1] > 0, 1.0, -1.0)
    assert np.einsum("fijc,fij,ij->", env.cubemap(32).astype(float), up, solid_angles(32)) > 0


def test_the_sun_has_its_true_size_and_strength():
    cubemap = Environment.builtin("sky").cubemap(64).astype(float)
    sun = cubemap[..., 1] > 50
    flux = (cubemap[..., 1] * solid_angles(64))[sun].sum()
    disc = 2 * np.pi * (1 - np.cos(np.radians(0.265)))
    np.testing.assert_allclose(flux, 0.93 * 0.1 * 1.2e6 * disc, rtol=0.02)


# --- bad input -------------------------------------------------------------------------------------------------------


def test_pixels_that_are_not_finite_are_refused_or_repaired():
    image = np.ones((4, 8, 3))
    image[2, 5, 1], image[3, 0, 0] = np.nan, np.inf
    with pytest.raises(ValueError, match="2 pixels are NaN or infinite, the first at row 2, column 5"):
        Environment.from_latlong(image)
    with pytest.warns(UserWarning, match="2 pixels"):
        env = Environment.from_latlong(image, repair="zero")
    assert np.isfinite(env.cubemap(4)).all()
    faces = np.ones((6, 2, 2, 3))
    faces[4, 1, 0] = 1e300
    with pytest.raises(ValueError, match="row 1, column 0 of face 4 .*overflowed"):
        Environment.from_cubemap(faces)


def test_negative_pixels_are_kept_with_a_warning():
    image = np.ones((8, 16, 3))
    image[3, 4] = -50
    with pytest.warns(UserWarning, match="1 pixels are negative"):
        env = Environment.from_latlong(image)
    assert env.cubemap(8).min() < 0


@pytest.mark.parametrize("shape", [(4, 8), (4, 8, 4), (0, 8, 3), (6, 4, 8, 3)])
def test_shapes_are_checked(shape):
    with pytest.raises(ValueError, match="shape"):
        Environment.from_latlong(np.ones(shape))
    with pytest.raises(ValueError, match="shape"):
        Environment.from_cubemap(np.ones(shape))


def test_arguments_are_checked(tmp_path):
    env = Environment.from_latlong(np.ones((1, 2, 3)))
    for call in (
        lambda: Environment.builtin("moon"),
        lambda: env.rotated(float("nan")),
        lambda: env.rotated(1, "w"),
        lambda: env.rotated(1, (0, 0, 0)),
        lambda: env.scaled(float("inf")),
        lambda: env.mixed(env, float("nan")),
        lambda: env.cubemap(0),
        lambda: env.cubemap(-1),
        lambda: env.cubemap(4096),
        lambda: env.radiance([[0, 0, 0]]),
        lambda: env.radiance([1, 2]),
        lambda: Environment.from_latlong(np.ones((1, 2, 3), complex)),
        lambda: Environment.from_latlong(np.ones((1, 2, 3)), repair="guess"),
        lambda: _core.environment_coefficients(env._layers, 48),
    ):
        with pytest.raises(ValueError, match="expected|must be"):
            call()
    with pytest.raises(AttributeError):
        env.name = "other"
    path = tmp_path / "odd.exr"
    save_image(path, np.ones((5, 7, 3)))
    with pytest.raises(ValueError, match="odd.exr: cannot recognise the layout of a 7x5 image"):
        Environment.load(path)
    with pytest.raises(ValueError, match="expected 3x4 square tiles"):
        Environment.load(path, layout="vertical-cross")
    with pytest.raises(ValueError, match="expected a layout"):
        Environment.load(path, layout="mirror-ball")


@pytest.mark.parametrize("suffix", [".exr", ".hdr"])
def test_bad_files(tmp_path, suffix):
    with pytest.raises(FileNotFoundError, match="nowhere"):
        Environment.load(tmp_path / "nowhere.exr")
    text = tmp_path / ("text" + suffix)
    text.write_text("no image")
    with pytest.raises(_core.FileError, match="not an image"):
        Environment.load(text)
    # Cut anywhere, a file is refused or (behind the last pixel) whole; it is never padded with zeros.
    whole = tmp_path / ("whole" + suffix)
    save_image(whole, np.random.default_rng(1).lognormal(size=(32, 64, 3)))
    data = whole.read_bytes()
    cut = tmp_path / ("cut" + suffix)
    for length in np.linspace(4, len(data) - 64, 12).astype(int):
        cut.write_bytes(data[:length])
        with pytest.raises(ValueError, match="cut"):
            Environment.load(cut)


def test_half_overflow_is_named(tmp_path):
    path = tmp_path / "half.exr"
    spec = OpenImageIO.ImageSpec(4, 2, 3, "half")
    writer = OpenImageIO.ImageOutput.create(str(path))
    assert writer.open(str(path), spec)
    pixels = np.ones((2, 4, 3), np.float32)
    pixels[1, 2] = np.inf
    assert writer.write_image(pixels) and writer.close()
    with pytest.raises(ValueError, match="half.exr: 1 pixels .* row 1, column 2 .*half floats end at 65504"):
        Environment.load(path)
    with pytest.warns(UserWarning, match="taken as black"):
        Environment.load(path, repair="zero")


# --- images in files -------------------------------------------------------------------------------------------------


def test_images_round_trip(tmp_path):
    image = np.random.default_rng(2).lognormal(sigma=3, size=(5, 7, 3)).astype(np.float32)
    save_image(tmp_path / "a.exr", image, {"deltalux:method": "pbi", "deltalux:frame": 7})
    np.testing.assert_array_equal(load_image(tmp_path / "a.exr")[0], image)
    reader = OpenImageIO.ImageInput.open(str(tmp_path / "a.exr"))
    assert reader.spec().getattribute("deltalux:method") == "pbi" and reader.spec().getattribute("deltalux:frame") == 7
    reader.close()
    save_image(tmp_path / "a.hdr", image)
    error = np.abs(load_image(tmp_path / "a.hdr")[0] - image) / image.max(axis=-1, keepdims=True)
    assert error.max() < 0.01
    save_image(tmp_path / "a.png", to_display(image))
    again = to_display(load_image(tmp_path / "a.png")[0])
    np.testing.assert_array_equal(again, to_display(image))
    save_image(tmp_path / "gray.exr", image[..., 0])
    np.testing.assert_array_equal(load_image(tmp_path / "gray.exr")[0], np.repeat(image[..., :1], 3, axis=2))
    assert sorted(os.listdir(tmp_path)) == ["a.exr", "a.hdr", "a.png", "gray.exr"]


def test_what_cannot_be_written_leaves_the_old_file(tmp_path):
    path = tmp_path / "a.png"
    save_image(path, np.zeros((2, 2, 3), np.uint8))
    before = path.read_bytes()
    for target, image in [
        (path, np.zeros((2, 2, 3))),
        (path, np.zeros((2, 2, 2), np.uint8)),
        (tmp_path / "a.bmp", np.zeros((2, 2, 3), np.uint8)),
        (tmp_path / "a.exr", np.zeros((2, 2, 3), np.uint8)),
    ]:
        with pytest.raises(ValueError, match="expected"):
            save_image(target, image)
    with pytest.raises(FileNotFoundError):
        save_image(tmp_path / "no" / "a.exr", np.zeros((2, 2, 3)))
    assert path.read_bytes() == before and os.listdir(tmp_path) == ["a.png"]


def test_display_is_srgb():
    assert to_display(np.array([[0.0, 0.5, 1.0], [-1.0, np.nan, np.inf]])).tolist() == [[0, 188, 255], [0, 0, 255]]
    assert to_display(np.full((1, 1, 3), 0.25), exposure=1.0)[0, 0, 0] == 188


# --- real maps, where they are at hand -------------------------------------------------------------------------------


@pytest.mark.skipif(not DATA.is_dir(), reason="no shared environment maps")
@pytest.mark.parametrize("path", sorted(DATA.glob("*")) if DATA.is_dir() else [], ids=lambda path: path.name)
def test_real_maps_keep_their_light(path):
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message=".*pixels are negative")
        env = Environment.load(path)

    def total(cubemap):
        return np.einsum("fijc,ij->c", cubemap.astype(float), solid_angles(64))

    still = total(env.cubemap(64))
    for degrees in (17, 45, 133):
        np.testing.assert_allclose(total(env.rotated(degrees, (1, 3, -2)).cubemap(64)), still, rtol=5e-3)
