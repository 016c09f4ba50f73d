"""The fuzzer finds what it is made for, and repeats itself; faults that it found, each with its name."""

import json
import os
import sys
from pathlib import Path
from random import Random

import numpy as np
import pytest
from deltalux import CurveTransport, Environment, FileError, Scene, StudioTransport, Transport
from deltalux.brdf import Measured
from deltalux.scene import content
from deltalux.scene.content import Content
from deltalux.transport.folder import Folder
from deltalux.transport.plan import Plan
from tools import needed

FUZZ = Path(__file__).parents[1] / "fuzz"
if not FUZZ.exists():
    pytest.skip("needs the source tree", allow_module_level=True)
sys.path.insert(0, str(FUZZ))
needed("xxhash")
fuzz = needed("fuzz")
samples, mu = fuzz.samples, fuzz.mu


@pytest.fixture(scope="module")
def bases(tmp_path_factory):
    return fuzz.bases_of(list(fuzz.TARGETS), tmp_path_factory.mktemp("fuzz"))


@pytest.mark.parametrize("target", fuzz.TARGETS)
def test_what_is_not_harmed_is_taken(bases, tmp_path, target):
    before: dict = {}
    for base in bases[target]:
        before = fuzz.put(tmp_path, before, base)
        assert fuzz.fault(fuzz.TARGETS[target][1], tmp_path) == ("", True)


@pytest.mark.parametrize("target", fuzz.TARGETS)
def test_a_file_depends_on_its_number_and_seed_only(bases, target):
    made = [fuzz.make(target, bases[target], 3, number) for number in range(40)]
    assert made == [fuzz.make(target, bases[target], 3, number) for number in range(40)]
    assert len({tuple(files.values()) for files in made}) > 30
    assert made != [fuzz.make(target, bases[target], 4, number) for number in range(40)]


def test_checks_behind_the_checksum_are_reached(bases, tmp_path):
    """Most harmed tiles are refused, or taken, for what is in them and not for their size or checksum."""
    reasons, before = [], {}
    for number in range(60):
        before = fuzz.put(tmp_path, before, fuzz.make("tile", bases["tile"], 1, number))
        try:
            fuzz.open_transport(tmp_path)
        except ValueError as error:
            reasons.append(str(error))
    assert 10 < len(reasons) and sum("checksum" in reason or "truncated" in reason for reason in reasons) < 15


def _raise(folder):
    raise KeyError("rows")


def _abort(folder):
    os.abort()


def _hang(folder):
    import time

    time.sleep(60)


def _refuse_for_memory(folder):
    try:
        raise MemoryError
    except MemoryError as error:
        raise FileError("broken file") from error


@pytest.mark.parametrize(
    ("use", "found"),
    [(_raise, "raised KeyError"), (_refuse_for_memory, "memory ran out"), (lambda folder: None, "")],
    ids=["exception", "memory", "none"],
)
def test_a_fault_is_seen(tmp_path, use, found):
    what, _ = fuzz.fault(use, tmp_path)
    assert what.startswith(found) and bool(what) == bool(found)


class _Reader:
    """Takes the samples, and treats everything after them badly; the child process makes it anew."""

    def __init__(self, bad, good):
        self.bad, self.good = bad, good

    def __call__(self, folder):
        self.good -= 1
        if self.good < 0:
            self.bad(folder)


@pytest.mark.parametrize(
    ("bad", "said"), [(_raise, "raised KeyError"), (_abort, "ended the process"), (_hang, "took more than")]
)
def test_a_fault_ends_the_run_and_leaves_its_file(bases, tmp_path, monkeypatch, capsys, bad, said):
    """Also one that takes the process along, and one that never comes back."""
    monkeypatch.setattr(fuzz, "SECONDS", 1.0)
    reader = _Reader(bad, len(bases["gltf"]) + 2)
    assert not fuzz.run("gltf", bases["gltf"], 5, 10, 20, 1e9, tmp_path, use=reader)
    printed = capsys.readouterr().out
    assert said in printed and "--target gltf --seed 5 --first 12 --files 1" in printed
    assert fuzz.samples.contents(tmp_path / "gltf-5-12") == fuzz.make("gltf", bases["gltf"], 5, 12)


# Faults that were found -----------------------------------------------------------------------------------------------


def test_zeros_that_no_file_holds_are_not_made_without_end(tmp_path):
    """Of 1.5 kB, 41 s and 4.5 GB were made: a sparse accessor without a buffer view may have any count."""
    (_, files) = samples.scenes()
    tree = json.loads(files["scene.gltf"])
    tree["accessors"][3]["count"] = 20_000_000
    fuzz.put(tmp_path, {}, files | {"scene.gltf": json.dumps(tree).encode()})
    with pytest.raises(FileError, match="20000000 elements without data"):
        Scene.load(tmp_path / "scene.gltf")


def test_textures_are_bounded_together(monkeypatch):
    """Each was bounded by itself: 67 million pixels, of which a file may hold any number in 65 kB each."""
    monkeypatch.setattr(content, "MOST_TEXELS", 100)
    found, texture = Content("textures"), np.zeros((8, 8, 3), np.float32)
    found.add_material((1, 1, 1), texture)
    found.add_material((1, 0, 0), texture)
    with pytest.raises(ValueError, match="more than 100 pixels together"):
        found.add_material((1, 1, 1), texture.copy())


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="needs a pipe")
def test_a_picture_outside_the_folder_is_not_opened(tmp_path):
    """A material's picture was opened wherever it was: of a pipe, for ever."""
    os.mkfifo(tmp_path / "pipe")
    folder = tmp_path / "scene"
    folder.mkdir()
    (folder / "scene.obj").write_text("mtllib a.mtl\nusemtl m\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    (folder / "a.mtl").write_text("newmtl m\nKd 1 0 0\nmap_Kd ../pipe\n")
    scene = Scene.load(folder / "scene.obj")
    assert scene.counts["textures ignored"] == 1 and "../pipe cannot be read" in scene.warnings[0]


def test_zeros_that_go_with_nothing_are_not_made(tmp_path):
    """Of 686 bytes 1.3 GB were made: a million corners that no buffer could hold."""
    (_, files) = samples.scenes()
    tree = json.loads(files["scene.gltf"])
    tree["accessors"][3]["count"] = 1000
    fuzz.put(tmp_path, {}, files | {"scene.gltf": json.dumps(tree).encode()})
    with pytest.raises(FileError, match="1000 elements without data, too many for a file of 104 bytes"):
        Scene.load(tmp_path / "scene.gltf")


def test_zeros_are_bounded_together(tmp_path):
    (_, files) = samples.scenes()
    tree = json.loads(files["scene.gltf"])
    tree["meshes"][1]["primitives"] += 1000 * [{"attributes": {"POSITION": 3}}]
    fuzz.put(tmp_path, {}, files | {"scene.gltf": json.dumps(tree).encode()})
    with pytest.raises(FileError, match="3 elements without data, too many"):
        Scene.load(tmp_path / "scene.gltf")


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="needs a pipe")
@pytest.mark.parametrize(
    ("name", "read"),
    [
        ("manifest.json", Transport.open),
        ("curves.json", CurveTransport.open),
        ("studio.json", StudioTransport.open),
        ("scene.bin", lambda folder: Scene.load(folder / "scene.gltf")),
        ("scene.gltf", lambda folder: Scene.load(folder / "scene.gltf")),
    ],
)
@pytest.mark.parametrize("kind", ["pipe", "6 GB"])
def test_neither_a_pipe_nor_6_gb_are_read(tmp_path, name, read, kind):
    """A pipe was waited for, for ever, and a file of 6 GB that holds nothing was read whole."""
    fuzz.put(tmp_path, {}, samples.scenes()[1])
    path = tmp_path / name
    path.unlink(missing_ok=True)
    if kind == "pipe":
        os.mkfifo(path)
    else:
        with open(path, "wb") as file:
            file.truncate(6 << 30)
    with pytest.raises((FileError, FileNotFoundError), match="plain file|at most [0-9,]+ bytes|not there"):
        read(tmp_path)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="needs a pipe")
@pytest.mark.parametrize("read", [Environment.load, Measured.load])
def test_pictures_and_materials_are_plain_files(tmp_path, read):
    os.mkfifo(tmp_path / "pipe.hdr")
    with pytest.raises(FileError, match="plain file"):
        read(tmp_path / "pipe.hdr")


def test_the_files_of_a_scene_are_bounded_together(tmp_path, monkeypatch):
    (_, files) = samples.scenes()
    fuzz.put(tmp_path, {}, files)
    monkeypatch.setattr(content, "MOST_BYTES", len(files["scene.gltf"]) + len(files["scene.bin"]) - 1)
    with pytest.raises(FileError, match="at most 103 bytes"):
        Scene.load(tmp_path / "scene.gltf")


def test_hostile_plans_are_refused(bases):
    """An error of 400 digits was taken for one, and raised an OverflowError where it was shown."""
    plans = [dict(mu.parse(base["manifest.json"]))["plan"] for base in bases["manifest"]]
    plan, taken = next(plan for plan in plans if plan), 0
    for number in range(400):
        text = mu.write(mu.harm_tree(mu.parse(mu.write(plan)), Random(number)))
        try:
            str(Plan.from_json(text))
            taken += 1
        except ValueError:
            pass
    assert 20 < taken < 380
    huge = json.loads(mu.write(plan)) | {"errors": {"sky": 10**400}}
    with pytest.raises(ValueError, match="an error as the plan's errors of sky"):
        Plan.from_json(json.dumps(huge))


@pytest.mark.parametrize(
    "about",
    ["[]", "{}", '{"seconds": null}', '{"seconds": []}', '{"seconds": "now"}', "7", "null", "[" * 3000, "{",
     '{"seconds": ' + "9" * 400 + "}", '{"seconds": {"a": 1}}'],
)  # fmt: skip
def test_hostile_entries_of_a_folder_are_its_fault(tmp_path, about):
    """Whatever they made their reader raise came out as it was."""
    folder = Folder("a folder", "folder.json", 1)
    folder.write(tmp_path, {"seconds": 1.0}, {"a": np.zeros(3)})
    with folder.opened(tmp_path) as (found, stored):
        assert found["seconds"] == 1.0 and stored["a"].shape == (3,)
    if about.startswith("{") and about.endswith("}"):
        about = json.dumps(json.loads(about) | {"version": 1})
    (tmp_path / "folder.json").write_text(about)
    with pytest.raises(FileError), folder.opened(tmp_path) as (found, _):
        float(found["seconds"])


def test_arrays_of_a_folder_do_not_unfold(tmp_path):
    """A kilobyte may say a gigabyte of zeros where arrays are compressed."""
    folder = Folder("a folder", "folder.json", 1)
    folder.write(tmp_path, {}, {})
    np.savez_compressed(tmp_path / "arrays.npz", a=np.zeros(1000))
    with pytest.raises(FileError, match="compressed"), folder.opened(tmp_path):
        pass
