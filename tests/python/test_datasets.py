"""Data sets: lights drawn by a rule, pictures that their sidecars make again, and the same bytes from any run."""

import hashlib
import json
import os
import signal
import subprocess
import sys
import tarfile
import textwrap
import time
from concurrent.futures import Future
from dataclasses import replace
from pathlib import Path

import deltalux as dl
import numpy as np
import OpenImageIO as oiio
import pytest
from deltalux.command.cli import main
from deltalux.datasets.lights import read_recipes, sources_of
from deltalux.datasets.shards import split_of

SMALL = {"columns": "haar:8", "quality": "preview", "progress": False}
CORNELL = dl.Scene.builtin("cornell")
CORNELL = CORNELL.with_camera(CORNELL.camera.resized(16, 16))


@pytest.fixture(scope="module")
def transport(tmp_path_factory):
    path = tmp_path_factory.mktemp("datasets") / "a.transport"
    return dl.precompute(CORNELL, path, bounces=1, **SMALL)


def pixels(path):
    """All channels of a file, as its numbers are."""
    read = oiio.ImageInput.open(str(path))
    return read.read_image(oiio.FLOAT)


def tree(folder):
    """What lies in a data set, by its name; locks and transports aside."""
    files = [file for file in sorted(Path(folder).rglob("*")) if file.is_file()]
    names = {str(file.relative_to(folder)): file for file in files if file.name != ".deltalux-files"}
    return {
        name: hashlib.sha256(file.read_bytes()).hexdigest() for name, file in names.items() if "transports" not in name
    }


def test_a_light_belongs_to_its_seed_and_number():
    rule = dl.LightRule()
    assert rule.recipes(9, 3)[:4] == rule.recipes(4, 3) and rule.recipes(4, 3) != rule.recipes(4, 4)
    plain = dl.LightRule(crossfades=0, lamps=0, stops=0)
    for light, other in zip(rule.recipes(20), plain.recipes(20), strict=True):
        # Who asks for less gets the same environments, turned alike.
        assert len(other.layers) == 1 and other.layers[0].environment == light.layers[0].environment
        assert other.layers[0].degrees == light.layers[0].degrees
    for other in dl.LightRule(rotation="none", crossfades=0, lamps=0, stops=0).recipes(9):
        assert other.light().cubemap(1).mean() == pytest.approx(1.0, rel=1e-5)
    many = rule.recipes(400)
    lamps = [light.layers[-1] for light in many if light.layers[-1].disc]
    assert 150 < len(lamps) < 250 and all(0 <= lamp.disc[1] <= 90 and 0.5 <= lamp.disc[2] <= 10 for lamp in lamps)
    flux = [np.mean(lamp.gain) * 2 * np.pi * (1 - np.cos(np.radians(lamp.disc[2]))) / np.pi for lamp in lamps]
    assert 0.24 < min(flux) < 0.5 and 1.5 < max(flux) < 2.05
    assert {light.layers[0].environment for light in many} == {"sky", "studio", "hall"}


def test_any_rotation_goes_anywhere_evenly():
    turned = dl.LightRule(("hall",), rotation="any", crossfades=0, lamps=0).recipes(2000)
    up = np.array([light.layers[0].matrix for light in turned])[:, :, 1]
    # Of even directions the mean is 0 and the mean square a third, within four standard deviations of 2,000.
    assert np.abs(up.mean(axis=0)).max() < 4 / np.sqrt(3 * 2000)
    assert np.abs((up**2).mean(axis=0) - 1 / 3).max() < 4 * np.sqrt(4 / 45 / 2000)


def test_lights_are_lines(tmp_path):
    drawn = dl.LightRule(rotation="any").recipes(6)
    path = tmp_path / "lights.jsonl"
    path.write_text("".join(f"{light.to_json()}\n" for light in drawn) + "\n")
    assert read_recipes(path) == drawn
    mixed = dl.LightRecipe((dl.Layer("hall", 30, gain=(2, 2, 2)), dl.Layer(disc=(40, 20, 5), gain=(1, 2, 3))))
    by_hand = dl.Environment.builtin("hall").rotated(30) * 2 + dl.Environment.disc(40, 20, 5) * (1, 2, 3)
    np.testing.assert_array_equal(mixed.light().cubemap(8), by_hand.cubemap(8))
    path.write_text('{"layers": [{"environment": "hall"}]}\n{"layers": [{"environmen": "hall"}]}\n')
    with pytest.raises(ValueError, match="lights.jsonl, line 2: expected a light like"):
        read_recipes(path)


def test_an_environment_is_what_it_was(tmp_path):
    path = tmp_path / "a.exr"
    dl.io.save_image(path, np.ones((4, 8, 3), np.float32))
    recipe = dl.LightRecipe((dl.Layer(str(path)),))
    sources = sources_of([recipe])
    assert sources[str(path)].sha256 == hashlib.sha256(path.read_bytes()).hexdigest()
    dl.io.save_image(path, np.full((4, 8, 3), 2, np.float32))
    with pytest.raises(ValueError, match="expected the file that the data set began with"):
        recipe.light(sources)


def test_splits_part_lights_by_their_numbers():
    splits = (("train", 0.8), ("val", 0.1), ("test", 0.1))
    found = [split_of(1, k, splits) for k in range(3000)]
    assert all(abs(found.count(name) / 3000 - share) < 4 * np.sqrt(share / 3000) for name, share in splits)
    assert found[:10] == [split_of(1, k, splits) for k in range(10)]


def test_a_sidecar_makes_its_picture_again(transport, tmp_path):
    layers = ("mask", "depth", "direct", "indirect")
    cameras = [transport.camera, replace(transport.camera, position=(0.6, 1.0, 4.5))]
    made = dl.dataset(
        transport, tmp_path, count=5, seed=4, cameras=cameras, layers=layers, half=False, shard=2, progress=False
    )
    assert (made.pictures, made.made) == (10, 10)
    sidecars = sorted((tmp_path / "pictures").rglob("*.json"))
    assert [int(file.stem) for file in sidecars] == list(range(10))
    lights = read_recipes(tmp_path / "lights.jsonl")
    for file in sidecars[1::4]:
        about = json.loads(file.read_text())
        number = about["number"] % 5
        assert about["light"]["number"] == number and about["camera"]["number"] == about["number"] // 5
        fields = ("environment", "degrees", "axis", "gain", "disc")
        recipe = dl.LightRecipe(
            tuple(dl.Layer(**{name: layer[name] for name in fields}) for layer in about["light"]["layers"])
        )
        assert recipe == lights[number]
        seen = transport if about["number"] < 5 else dl.Transport(tmp_path / "transports" / "001.transport")
        assert seen.digest == about["transport"]
        V = seen.coefficients(recipe.light())
        expected = seen.image(seen.multiply(V), recipe.light())
        pictures = {name: pixels(file.parent / about["files"][name]) for name in ("picture", *layers)}
        np.testing.assert_array_equal(pictures["picture"], expected)
        np.testing.assert_array_equal(pictures["mask"].squeeze(), seen.aov("mask"))
        surfaces = seen.image(seen.multiply(V))
        np.testing.assert_allclose(pictures["direct"] + pictures["indirect"], surfaces, rtol=1e-5, atol=1e-7)
        assert (pictures["indirect"] >= -1e-6).all() and pictures["indirect"].max() > 0.01 * surfaces.max()
        # What a step that sends all of the light says of itself.
        step = dl.Relighter(seen, dl.Full()).step(V)
        assert about["bound"] == pytest.approx(float(step.bound), rel=0.01)


@pytest.mark.parametrize("kind", ["exr", "png16", "npz"])
def test_formats_hold_the_picture(transport, tmp_path, kind):
    options = {"count": 3, "format": kind, "tar": True, "exposure": 1.5, "background": "none", "coefficients": True}
    dl.dataset(transport, tmp_path, layers=("mask", "normal"), shard=8, progress=False, **options)
    light = dl.LightRule().recipes(3)[1].light()
    V = transport.coefficients(light)
    expected = dl.Backdrop(transport, "none").picture(transport.multiply(V), light)
    with tarfile.open(tmp_path / "pictures" / "00000.tar") as archive:
        entries = {name: archive.extractfile(name).read() for name in archive.getnames()}
        assert {(entry.mtime, entry.uid, entry.uname) for entry in archive} == {(0, 0, "")}
    about = json.loads(entries["00000001.json"])
    assert sorted(about["files"]) == ["light", "mask", "normal", "picture"]
    files = {name: tmp_path / file for name, file in about["files"].items()}
    for file in set(files.values()):
        file.write_bytes(entries[file.name])
    if kind == "npz":
        held = dict(np.load(files["picture"]))
        picture, mask, kept = held["picture"], held["mask"], held["light"]
    else:
        kept = np.load(files["light"])
        mask = pixels(files["mask"]).squeeze()
        picture = pixels(files["picture"])
    np.testing.assert_array_equal(kept, V)
    if kind == "png16":
        assert about["encoding"] == "srgb" and about["exposure"] == 1.5
        shown = np.frombuffer(png_rows(entries[about["files"]["picture"]]), ">u2").reshape(16, 16, 4)
        straight = dl.io.to_display(expected, 1.5)
        np.testing.assert_allclose(shown / 257.0, straight, atol=0.6)
    else:
        np.testing.assert_array_equal(picture, expected.astype(np.float16))
        np.testing.assert_array_equal(mask, transport.aov("mask").astype(np.float16))


def png_rows(data):
    """The samples of a PNG, by the text of its standard: the reader of ours gives floats."""
    import zlib

    place, packed = 8, b""
    while place < len(data):
        size, name = int.from_bytes(data[place : place + 4], "big"), data[place + 4 : place + 8]
        if name == b"IHDR":
            width, height, depth, colours = (
                *(int.from_bytes(data[place + k : place + k + 4], "big") for k in (8, 12)),
                data[place + 16],
                data[place + 17],
            )
            assert (depth, colours) == (16, 6)
        packed += data[place + 8 : place + 8 + size] if name == b"IDAT" else b""
        place += size + 12
    raw, step = zlib.decompress(packed), 8
    rows = np.zeros((height, width * step), np.uint8)
    for y in range(height):
        kind, line = raw[y * (1 + width * step)], raw[y * (1 + width * step) + 1 :][: width * step]
        for x in range(width * step):
            a = int(rows[y, x - step]) if x >= step else 0
            b = int(rows[y - 1, x]) if y else 0
            assert kind in (0, 1, 2, 3)
            rows[y, x] = (line[x] + (0, a, b, (a + b) // 2)[kind]) % 256
    return rows.tobytes()


class Stopping:
    """Does two tasks; the third meets Ctrl-C, and none begins after it."""

    count = 0

    def submit(self, function, task):
        future = Future()
        self.count += 1
        if self.count <= 2:
            future.set_result(function(task))
        elif self.count == 3:
            future.set_exception(KeyboardInterrupt())
        return future


def test_any_run_leaves_the_same_bytes(transport, tmp_path):
    # EXR: its files are dated, unless somebody sees to it.
    options = {"count": 12, "shard": 3, "progress": False}
    alone = tmp_path / "alone"
    dl.dataset(transport, alone, **options)
    # Stopped after two of four shards, with remains of one that was killed.
    stopped = tmp_path / "stopped"
    with pytest.raises(KeyboardInterrupt):
        dl.dataset(transport, stopped, executor=Stopping(), **options)
    (stopped / "pictures" / ".00003.1234").mkdir()
    time.sleep(1.0 - time.time() % 1.0)
    again = dl.dataset(transport, stopped, **options)
    assert again.made == 6 and tree(stopped) == tree(alone)
    assert "there already" in str(dl.dataset(transport, stopped, **options))


KILLED = """
import sys, time
import deltalux as dl
if __name__ == "__main__":
    slow = lambda done, total: (print(done, flush=True), time.sleep(0.2))
    dl.dataset(dl.Transport(sys.argv[1]), sys.argv[2], count=12, shard=3, format="png16", progress=slow)
"""


@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="needs SIGKILL")
def test_kill_9_costs_nothing_that_is_whole(transport, tmp_path):
    dl.dataset(transport, tmp_path / "alone", count=12, shard=3, format="png16", progress=False)
    command = [sys.executable, "-c", textwrap.dedent(KILLED), str(transport._path), str(tmp_path / "killed")]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as child:
        while child.stdout.readline().strip() not in ("3", "6", "9", ""):
            pass
        child.send_signal(signal.SIGKILL)
    assert child.returncode == -signal.SIGKILL
    made = dl.dataset(transport, tmp_path / "killed", count=12, shard=3, format="png16", progress=False)
    assert made.made < 12 and tree(tmp_path / "killed") == tree(tmp_path / "alone")


@pytest.mark.parametrize("options", [{}, {"tar": True, "format": "npz"}], ids=["exr", "npz in tar"])
def test_pictures_are_an_array(transport, tmp_path, options):
    pytest.importorskip("dask.array", reason="needs dask")
    made = dl.dataset(transport, tmp_path / "a", count=5, shard=2, half=False, progress=False, **options)
    array = made.array()
    assert array.shape == (5, 16, 16, 3) and array.chunks[0] == (2, 2, 1)
    light = dl.LightRule().recipes(5)[4].light()
    expected = transport.image(transport.multiply(transport.coefficients(light)), light)
    np.testing.assert_array_equal(array[4].compute(scheduler="synchronous"), expected)


def test_a_transport_is_an_array_of_zarr(tmp_path):
    zarr = pytest.importorskip("zarr", reason="needs zarr")
    transport = dl.precompute(CORNELL, tmp_path / "b.transport", **SMALL)
    transport.to_zarr(tmp_path / "b.zarr")
    group = zarr.open_group(tmp_path / "b.zarr", mode="r")
    held, own = group["0"], transport.to_scipy()
    assert tuple(group.attrs["shape"]) == transport.shape and group.attrs["columns"] == "haar:8"
    for name in ("indptr", "indices", "data"):
        np.testing.assert_array_equal(held[name][:], getattr(own, name))
    with pytest.raises(FileExistsError, match="never written over"):
        transport.to_zarr(tmp_path / "b.zarr")


def test_a_scene_is_traced_once(tmp_path):
    options = {"count": 2, "layers": (), "bounces": 1, **SMALL}
    cameras = tmp_path / "cameras.json"
    cameras.write_text(
        json.dumps([{"position": [0, 1, 4.7], "target": [0, 1, 0]}, {"position": [1, 1, 4.5], "target": [0, 1, 0]}])
    )
    dl.dataset(CORNELL, tmp_path / "a", cameras=cameras, **options)
    before = {file: file.stat().st_mtime_ns for file in (tmp_path / "a" / "transports").rglob("manifest.json")}
    assert len(before) == 2
    dl.dataset(CORNELL, tmp_path / "a", cameras=cameras, **options)
    assert before == {file: file.stat().st_mtime_ns for file in before}
    with pytest.raises(FileExistsError, match="a data set of another request"):
        dl.dataset(CORNELL, tmp_path / "a", cameras=cameras, **options | {"bounces": 0})


def test_vertices_are_seen_from_anywhere(tmp_path):
    rows = dl.precompute(CORNELL, tmp_path / "v.transport", receivers="vertices", **SMALL)
    cameras = dl.turntable(CORNELL.camera, 3)
    dl.dataset(rows, tmp_path / "a", count=1, cameras=cameras, layers=(), half=False, progress=False)
    light = dl.LightRule().recipes(1)[0].light()
    B = rows.multiply(rows.coefficients(light))
    for k, camera in enumerate(cameras):
        picture = pixels(tmp_path / "a" / "pictures" / f"{k:05}" / f"{k:08}.exr")
        np.testing.assert_array_equal(picture, rows.render(camera, B, light))
    with pytest.raises(ValueError, match="a transport of pixels for layers"):
        dl.dataset(rows, tmp_path / "b", count=1)


def test_the_command(transport, tmp_path, capsys):
    path = tmp_path / "a"
    words = f"dataset {transport._path} -o {path} --env hall --count 4 --turntable 2 --lamps 1 --layers none --shard 4"
    assert main(words.split()) == 0
    assert "holds 8 pictures, of which 8 are new" in capsys.readouterr().out
    light = dl.LightRule(("hall",), lamps=1).recipes(4)[3].to_json()
    assert (path / "lights.jsonl").read_text().splitlines()[3] == light
    lines = f"dataset {transport._path} -o {tmp_path / 'b'} --lights {path / 'lights.jsonl'} --layers none"
    assert main(lines.split()) == 0
    assert main(f"{lines} --lamps 0.3".split()) == 2
    assert "--lamps where lights are drawn" in capsys.readouterr().err


# What is called, and what the answer must contain.
REFUSED = {
    "no source": (lambda t, f: dl.dataset("a.transport", f), "a Scene or a Transport, and then a folder"),
    "a light": (lambda t, f: dl.dataset(t, f, [dl.Environment.builtin("hall")]), "a LightRule, LightRecipes"),
    "a layer": (lambda t, f: dl.dataset(t, f, layers=["mask", "nomals"]), "got 'nomals'"),
    "a format": (lambda t, f: dl.dataset(t, f, format="png"), "did you mean 'png16'"),
    "a level": (lambda t, f: dl.dataset(t, f, compression=10), "from 0 to 9, got 10"),
    "an exposure": (lambda t, f: dl.dataset(t, f, exposure="auto"), "or \"each\", got 'auto'"),
    "splits": (lambda t, f: dl.dataset(t, f, splits={"train": 0}), "shares above 0"),
    "an executor": (lambda t, f: dl.dataset(t, f, executor=4), r"an executor to submit tasks to, got 4"),
    "jobs and executor": (lambda t, f: dl.dataset(t, f, jobs=2, executor=Nothing()), "jobs or an executor, got both"),
    "an environment": (lambda t, f: dl.LightRule("hal").recipes(1), "did you mean 'hall'"),
    "a rotation": (lambda t, f: dl.LightRule(rotation="upwards"), "to be one of 'none', 'upright', 'any'"),
    "a share": (lambda t, f: dl.LightRule(lamps=2), "lamps from 0 to 1, got 2"),
    "no layers": (lambda t, f: dl.LightRecipe(()), "at least one layer"),
    "an empty layer": (lambda t, f: dl.Layer(), "an environment or of a disc"),
    "a camera": (lambda t, f: dl.dataset(t, f, cameras=[(0, 0, 1)]), "a Camera, got a tuple"),
    "count of a list": (lambda t, f: dl.dataset(t, f, dl.LightRule().recipes(2), 3), "got 3 of a list"),
    "somebody's folder": (lambda t, f: dl.dataset(t, t._path), "something else than a data set"),
}


class Nothing:
    def submit(self, function, task):
        raise AssertionError


@pytest.mark.parametrize("name", REFUSED)
def test_wrong_data_sets_are_answered(transport, tmp_path, name):
    call, answer = REFUSED[name]
    with pytest.raises((TypeError, ValueError, OSError), match=answer):
        call(transport, tmp_path / "f")
    assert not (tmp_path / "f").exists()


def _worker_of(context):
    torch = pytest.importorskip("torch", reason="needs PyTorch")
    return torch, {} if context is None else {"num_workers": 2, "multiprocessing_context": context}


@pytest.mark.parametrize("context", [None, "fork", pytest.param("spawn", marks=pytest.mark.slow)])
def test_torch_reads_pictures_that_are_no_files(transport, context):
    if context == "fork" and not hasattr(os, "fork"):
        pytest.skip("needs fork")
    torch, options = _worker_of(context)
    data = dl.torch.RelitDataset(transport, count=6, layers=("mask", "direct"))
    batches = list(torch.utils.data.DataLoader(data, batch_size=4, **options))
    pictures = torch.cat([batch["picture"] for batch in batches])
    assert pictures.shape == (6, 3, 16, 16) and batches[0]["mask"].shape == (4, 16, 16)
    assert torch.cat([batch["number"] for batch in batches]).tolist() == list(range(6))
    for k, recipe in enumerate(data.recipes):
        V = transport.coefficients(recipe.light())
        expected = transport.image(transport.multiply(V), recipe.light())
        np.testing.assert_array_equal(pictures[k].permute(1, 2, 0).numpy(), expected)
        np.testing.assert_array_equal(data[k]["picture"].numpy(), pictures[k].numpy())
    with pytest.raises(IndexError):
        data[6]
