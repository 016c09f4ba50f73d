"""The fuzzer finds what it is made for, and repeats itself; faults that it found, each with its name."""

import json
import os
import sys
from pathlib import Path

import numpy as np
import pytest
from deltalux import FileError, Scene
from deltalux.scene import content
from deltalux.scene.content import Content
from tools import needed

FUZZ = Path(__file__).parents[1] / "fuzz"
if not FUZZ.exists():
    pytest.skip("needs the source tree", allow_module_level=True)
sys.path.insert(0, str(FUZZ))
needed("xxhash")
fuzz = needed("fuzz")
samples = fuzz.samples


@pytest.fixture(scope="module")
def bases(tmp_path_factory):
    transports = samples.transports(tmp_path_factory.mktemp("fuzz"))
    return {"manifest": transports, "tile": transports, "gltf": samples.scenes()}


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
