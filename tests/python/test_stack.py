"""Light stacks: pictures under one light at a time, as M."""

from __future__ import annotations

from pathlib import Path

import deltalux as dl
import numpy as np
import pytest
from deltalux.io import load_image
from deltalux.transport.stack import read_lights
from deltalux.viewer.lights import Group, Lights
from deltalux.viewer.relit import Relit

OLAT = Path(__file__).parents[3] / "shared" / "data" / "olat"
HEIGHT, WIDTH = 6, 8


@pytest.fixture(scope="module")
def directions():
    """24, spread evenly over the sphere (Fibonacci's spiral)."""
    z = 1 - (2 * np.arange(24) + 1) / 24
    angle = np.arange(24) * np.pi * (3 - np.sqrt(5))
    return np.stack([np.sqrt(1 - z * z) * np.cos(angle), np.sqrt(1 - z * z) * np.sin(angle), z], -1)


@pytest.fixture(scope="module")
def images():
    return np.random.default_rng(5).random((24, HEIGHT, WIDTH, 3)).astype(np.float32)


@pytest.fixture(scope="module")
def transport(directions, images, tmp_path_factory):
    path = tmp_path_factory.mktemp("stack") / "a.transport"
    return dl.Transport.from_images(images, directions, path, progress=False)


def test_a_lamp_alone_gives_its_picture(transport, images, directions):
    assert transport.shape == (48, 24) and transport.channels == 3 and transport.version == (2, 3)
    V = np.zeros((24, 3))
    V[7] = (1, 2, 0)
    np.testing.assert_allclose(transport.image(transport.multiply(V)), images[7] * (1, 2, 0), atol=1e-4)
    again = dl.Transport(transport._path)
    np.testing.assert_allclose(again.columns.directions, directions, rtol=1e-15)
    assert again.columns.reach == transport.columns.reach and again.columns.names is None


def test_an_environment_is_the_sum_over_all_texels(transport, images, directions):
    """Texel by texel in plain numpy: the cells of all lamps, and what a lamp there would take of them."""
    env, size = dl.Environment.builtin("hall").rotated(20), 32
    at = (2 * np.arange(size) + 1) / size - 1
    t, s = np.meshgrid(at, at, indexing="ij")
    one = np.ones_like(s)
    faces = [(one, -t, -s), (-one, -t, s), (s, one, t), (s, -one, -t), (s, -t, one), (-s, -t, -one)]
    texels = np.concatenate([np.stack(face, -1).reshape(-1, 3) for face in faces])
    lengths = np.linalg.norm(texels, axis=1)
    # A texel of a face looks at the sphere by the cube of its cosine; all of them together are the sphere.
    areas = lengths**-3.0
    areas *= 4 * np.pi / areas.sum()
    texels /= lengths[:, None]
    cosines = texels @ directions.T
    radiance = env.cubemap(size).reshape(-1, 3).astype(np.float64)
    cells, nearest, V = cosines.argmax(axis=1), cosines.max(axis=1), np.zeros((24, 3))
    for texel in range(len(texels)):
        nearer = texels @ texels[texel] > nearest
        shares = np.bincount(cells[nearer], areas[nearer], 24)
        shares = shares / shares.sum() if nearer.any() else np.eye(24)[cells[texel]]
        V += shares[:, None] * radiance[texel] * areas[texel]
    picture = np.einsum("nhwc,nc->hwc", images, V)
    found = transport.image(transport.multiply(transport.coefficients(env)))
    np.testing.assert_allclose(found, picture, rtol=2e-3)
    assert np.isclose(transport.columns.solid_angles.sum(), 4 * np.pi) and transport.columns.covered == pytest.approx(1)


def test_shares_pass_from_lamp_to_lamp_and_end_at_the_reach(directions):
    lamps = dl.Lamps(directions)
    np.testing.assert_allclose(lamps.shared_out(directions), np.eye(24), atol=0.1)
    way = np.linspace(0, 1, 200)[:, None]
    shares = lamps.shared_out((1 - way) * directions[3] + way * directions[11])
    np.testing.assert_allclose(shares.sum(axis=1), 1)
    assert np.abs(np.diff(shares, axis=0)).max() < 0.15
    # Half a sphere: what lies behind it was measured by none.
    half = dl.Lamps(directions[:12], reach=40)
    assert half.shared_out([[0, 0, -1.0]]).sum() == 0 and 0.4 < half.covered < 0.9
    dark = dl.Environment.from_cubemap(np.repeat(np.eye(6)[5], 192).reshape(6, 8, 8, 3).astype(np.float32))
    assert half.coefficients(dark).sum() < 0.2 * lamps.coefficients(dark).sum()


def test_it_is_followed_like_any_other(transport):
    env = dl.Environment.builtin("studio")
    relighter = dl.Relighter(transport, dl.PerBand(terms=6))
    for degrees in range(0, 40, 10):
        frame = relighter.step(env.rotated(degrees))
        exact = transport.multiply(transport.coefficients(env.rotated(degrees)), dtype=np.float64)
        assert np.abs(frame.values - exact).max() <= frame.bound
    while not frame.converged:
        frame = relighter.step(env.rotated(30))
    assert (frame.values == transport.multiply(relighter.values)).all() and frame.image.shape == (HEIGHT, WIDTH, 3)


def test_the_view_shows_it(transport):
    env = dl.Environment.builtin("studio")
    lights = Lights({"studio": env}, (Group("1", "environment", source="studio"),))
    relit = Relit(transport, lights, dl.Full(), {}, "a.transport")
    shot = relit.step({"a", "bound"}, True)
    assert shot.layers["a"].shape == (HEIGHT, WIDTH, 3) and relit.about()["kind"] == "pixels"
    assert relit.maps(shot) == {} and relit.exact(shot) is not None
    with pytest.raises(ValueError, match="Haar basis"):
        relit.look(1, 1)


def test_what_needs_a_scene_says_so(transport, tmp_path):
    with pytest.raises(ValueError, match="or from pictures"):
        transport.for_camera(transport.camera, tmp_path / "b.transport", progress=False)
    smaller = transport.truncated(tmp_path / "c.transport", 0.05)
    assert (smaller.columns.directions == transport.columns.directions).all()


def test_light_is_fitted_to_a_stack(transport, images):
    gains = np.random.default_rng(6).random((24, 3))
    fit = dl.fit_light(transport, np.einsum("nc,nhwc->hwc", gains, images), strength=1e-6, gap=1e-8, progress=False)
    np.testing.assert_allclose(fit.values, gains, atol=0.02)
    with pytest.raises(ValueError, match="these are lamps"):
        _ = fit.environment


def test_groups_masks_and_intensities(tmp_path, images):
    grey = images[:3, :, :, 0]
    mask = np.zeros((HEIGHT, WIDTH), bool)
    mask[2:4] = True
    made = dl.Transport.from_images(
        grey, ["key", "fill", "rim"], tmp_path / "g", mask=mask, intensities=[1, 2, 4], progress=False
    )
    assert made.channels == 1 and made.columns.names == ("key", "fill", "rim") and made.shape == (2 * WIDTH, 3)
    picture = made.image(made.multiply(np.array([[1.0, 0, 0], [0, 2, 0], [0, 0, 4]])))
    np.testing.assert_allclose(picture, np.where(mask[..., None], np.moveaxis(grey, 0, -1), 0), atol=1e-4)
    with pytest.raises(ValueError, match="these are groups"):
        made.coefficients(dl.Environment.builtin("sky"))


def test_lists_of_lights(tmp_path, images):
    for k in range(3):
        dl.write(tmp_path / f"photo {k}.exr", images[k])
    lines = [f"C:\\\\rti\\\\photo {k}.exr {k} 0.5 1" for k in range(3)]
    (tmp_path / "a.lp").write_text("\n".join(["3", *lines]) + "\n")
    names, found = read_lights(tmp_path / "a.lp")
    assert [name.name for name in names] == [f"photo {k}.exr" for k in range(3)] and found[2].tolist() == [2, 0.5, 1]
    made = dl.Transport.from_images(None, tmp_path / "a.lp", tmp_path / "a.transport", progress=False)
    V = np.zeros((3, 3))
    V[1] = 1
    np.testing.assert_allclose(made.image(made.multiply(V)), images[1], atol=1e-4)
    (tmp_path / "b.txt").write_text("2\n1 0 0\n0 1 0\n")
    assert read_lights(tmp_path / "b.txt")[0] is None
    for wrong in ("3\n1 0 0\n", "no list", "", "1\n1 0 x\n"):
        (tmp_path / "c.lp").write_text(wrong)
        with pytest.raises(ValueError, match="expected"):
            read_lights(tmp_path / "c.lp")


def test_what_is_no_stack_is_refused(tmp_path, images, directions):
    def make(images=images, lights=directions, **options):
        return dl.Transport.from_images(images, lights, tmp_path / "x", progress=False, **options)

    for arguments, message in (
        ({"images": images[:5]}, "a picture for each of 24 lights, got 5"),
        ({"images": [*images[:23], images[0][:3]]}, "pictures of one size"),
        ({"images": (255 * images).astype(np.uint8)}, "expected linear floats"),
        ({"images": images * np.nan}, "finite"),
        ({"lights": directions[:, :2]}, r"directions of shape \(n, 3\)"),
        ({"lights": np.repeat(directions[:1], 24, 0)}, "different places"),
        ({"mask": np.zeros((HEIGHT, WIDTH))}, "leaves none"),
        ({"mask": np.ones((2, 2))}, "expected a mask of shape"),
        ({"intensities": np.zeros(24)}, "above 0"),
        ({"reach": 500}, "expected a reach"),
        ({"images": "a.exr"}, "names of an image's layers"),
    ):
        with pytest.raises(ValueError, match=message):
            make(**arguments)
    assert not (tmp_path / "x").exists()


def held_out(images, directions, mask, some) -> list[float]:
    """Relative L2 of pictures predicted from those of the other lamps."""
    errors = []
    for k in some:
        others = np.delete(np.arange(len(images)), k)
        shares = dl.Lamps(directions[others]).shared_out(directions[k : k + 1])[0]
        found = np.tensordot(shares, images[others], 1)[mask]
        errors.append(np.linalg.norm(found - images[k][mask]) / np.linalg.norm(images[k][mask]))
    return errors


@pytest.mark.skipif(not OLAT.exists(), reason="needs the light stacks")
def test_pictures_that_were_held_out():
    """A rendered bunny with cast shadows, and photographs: of a lamp at the rim the others say less."""
    images = np.load(OLAT / "rps_bunny" / "bunny_lambert_50x256x256.npz")["images"][:, ::4, ::4].astype(np.float32)
    mask = load_image(OLAT / "rps_bunny" / "mask.png")[0][::4, ::4, 0] > 0.5
    errors = held_out(images, np.load(OLAT / "rps_bunny" / "lights.npy"), mask, range(0, 50, 7))
    assert np.median(errors) < 0.045 and max(errors) < 0.1
    folder = OLAT / "uw_buddha"
    photographs = np.stack([load_image(folder / f"buddha.{k}.png")[0][::4, ::4] for k in range(12)])
    mask = load_image(folder / "buddha.mask.png")[0][::4, ::4, 0] > 0.5
    errors = held_out(photographs, read_lights(OLAT / "uw_lights.txt")[1], mask, range(12))
    assert np.median(errors) < 0.18 and min(errors) < 0.08 and max(errors) < 0.4
