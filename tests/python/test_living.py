"""Objects where users put them: pickled for workers, copied, shown in a notebook, and what they are made of."""

import copy
import pickle

import deltalux as dl
import numpy as np
import pytest

HALL = dl.Environment.builtin("hall")


@pytest.fixture(scope="module")
def transport(tmp_path_factory):
    scene = dl.Scene.builtin("cornell")
    path = tmp_path_factory.mktemp("living") / "a.transport"
    options = {"columns": "haar:8", "quality": "preview", "progress": False}
    return dl.precompute(scene.with_camera(scene.camera.resized(16, 16)), path, **options)


def again(thing):
    return pickle.loads(pickle.dumps(thing))


def test_workers_get_transport_and_light(transport):
    # Datasets of torch pickle what they hold for their workers; half of a process starts nothing new here.
    env = dl.Environment.from_latlong(np.random.default_rng(1).random((8, 16, 3))).rotated(20) * 0.5
    env = env + dl.Environment.from_cubemap(np.random.default_rng(2).random((6, 4, 4, 3)))
    other, light = again((transport, env))
    exact = transport.image(transport.multiply(transport.coefficients(env)), env)
    np.testing.assert_array_equal(other.image(other.multiply(other.coefficients(light)), light), exact)
    assert light.name == env.name and len(pickle.dumps(transport)) < 500


@pytest.mark.parametrize("how", [again, copy.copy, copy.deepcopy])
def test_a_relighter_goes_on_where_it_was(transport, how):
    relighter = dl.Relighter(transport, dl.PerBand(terms=5))
    assert how(relighter).step(HALL).converged
    relighter.step(HALL)
    relighter.step(HALL.rotated(9))
    other = how(relighter)
    np.testing.assert_array_equal(other.values, relighter.values)
    for degrees in (12, 15):
        mine, yours = relighter.step(HALL.rotated(degrees)), other.step(HALL.rotated(degrees))
        np.testing.assert_array_equal(mine.values, yours.values)
        np.testing.assert_array_equal(mine.columns, yours.columns)


def test_what_cannot_be_found_again_is_refused(transport, tmp_path):
    truncated = transport.truncated(tmp_path / "b.transport", 0.2)
    pickled = pickle.dumps(truncated)
    assert again(truncated).nbytes == truncated.nbytes
    for file in (tmp_path / "b.transport").iterdir():
        file.unlink()
    (tmp_path / "b.transport").rmdir()
    with pytest.raises(FileNotFoundError):
        pickle.loads(pickled)
    transport.truncated(tmp_path / "b.transport", 0.4)
    with pytest.raises(dl.FileError, match="found another one"):
        pickle.loads(pickled)
    with pytest.raises(TypeError, match="in memory only"):
        pickle.dumps(transport.coarsened(0.2, "i8"))


def test_copies_of_what_cannot_change_are_itself(transport):
    for thing in (transport, HALL):
        assert copy.copy(thing) is thing and copy.deepcopy(thing) is thing


def test_notebooks_show_things(transport):
    frame = dl.Relighter(transport, dl.PerBand(terms=5)).step(HALL)
    for thing in (HALL, frame):
        assert thing._repr_png_().startswith(b"\x89PNG") and len(repr(thing)) < 120
    assert "384 columns" in transport._repr_html_() and len(repr(transport)) < 120
    assert repr(dl.Relighter(transport, dl.PerBand(terms=5))).startswith("<Relighter by PerBand")


def test_reprs_are_short(transport):
    scene, backdrop = dl.Scene.builtin("cornell"), dl.Backdrop(transport)
    assert repr(scene).startswith("<Scene 'cornell', ") and len(repr(scene)) < 120
    assert repr(backdrop).startswith("<Backdrop 'none' of <Transport")


def test_lights_are_added_scaled_and_tinted():
    assert sum([HALL, HALL]).name == "hall and hall"
    d = np.random.default_rng(2).normal(size=(40, 3))
    sky = dl.Environment.builtin("sky").rotated(30)
    np.testing.assert_allclose((sky * 2).radiance(d), 2 * sky.radiance(d), rtol=1e-6)
    np.testing.assert_allclose((0.5 * sky + HALL).radiance(d), 0.5 * sky.radiance(d) + HALL.radiance(d), rtol=1e-6)
    tint = np.array([1, 0.5, 0.25])
    for tinted in (sky * tint, tint * sky, sky.tinted(tint), (sky + HALL) * (1, 0.5, 0.25)):
        assert isinstance(tinted, dl.Environment)
    np.testing.assert_allclose((tint * sky).radiance(d), tint * sky.radiance(d), rtol=1e-5)
    for wrong in ((1, 2), "red", (1, 2, np.nan)):
        with pytest.raises(ValueError, match="expected three finite factors|real numbers"):
            sky * wrong
    with pytest.raises(TypeError):
        sky + 1


def test_images_come_in_batches(transport):
    V = [transport.coefficients(HALL.rotated(degrees)) for degrees in (0, 30)]
    B = np.stack([transport.multiply(one) for one in V])
    np.testing.assert_array_equal(transport.image(B, [HALL, None])[0], transport.image(B[0], HALL))
    np.testing.assert_array_equal(transport.image(B)[1], transport.image(B[1]))
    with pytest.raises(ValueError, match="environment for each of 2"):
        transport.image(B, [HALL])


def test_layers_besides_light(transport):
    normal, depth = transport.aov("normal"), transport.aov("depth")
    position, material, mask = (transport.aov(name) for name in ("position", "material", "mask"))
    seen = mask > 0
    assert normal.shape == (16, 16, 3) and depth.shape == material.shape == mask.shape == (16, 16)
    np.testing.assert_allclose(np.linalg.norm(normal[seen], axis=-1), 1, atol=1e-5)
    np.testing.assert_allclose(
        np.linalg.norm(position - transport.camera.position, axis=-1)[seen], depth[seen], rtol=1e-5
    )
    assert np.isinf(depth[~seen]).all() and (material[~seen] == -1).all() and (material[seen] >= 0).all()
    albedo = transport.aov("albedo")
    assert (albedo[~seen] == 0).all() and albedo.max() <= 1
    # The picture under light that is the same everywhere in every receiver is that of the albedos.
    np.testing.assert_allclose(transport.image(np.ones((transport.shape[0], 3))), albedo, atol=1e-6)
    with pytest.raises(ValueError, match="did you mean 'albedo'"):
        transport.aov("albdeo")


def test_a_path_opens_and_a_picture_is_written(transport, tmp_path):
    opened = dl.Transport(transport._path)
    B = opened.multiply(opened.coefficients(HALL))
    np.testing.assert_array_equal(B, transport.multiply(transport.coefficients(HALL)))
    picture = opened.image(B, HALL)
    for name in ("a.png", "a.exr", "a.hdr"):
        dl.write(tmp_path / name, picture)
    np.testing.assert_array_equal(dl.io.load_image(tmp_path / "a.exr")[0], picture)
    shown = dl.io.to_display(dl.io.load_image(tmp_path / "a.png")[0])
    np.testing.assert_array_equal(shown, dl.io.to_display(picture))
    with pytest.raises(ValueError, match="expected a file name ending in"):
        dl.write(tmp_path / "a.bmp", picture)
