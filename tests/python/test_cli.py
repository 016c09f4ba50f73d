"""The command line, in process, on a tiny transport: what works, and every way in which input can be bad."""

import csv
import os
import re
import subprocess
import sys

import deltalux as dl
import numpy as np
import pytest
from deltalux import io
from deltalux.command import cli
from deltalux.light.sequences import SEQUENCES


@pytest.fixture(scope="module")
def tiny(tmp_path_factory):
    """A Cornell box of 24 x 24 pixels, made by the command line itself."""
    path = tmp_path_factory.mktemp("cli") / "cornell.transport"
    settings = ["--size", "24x24", "--columns", "haar:8", "--quality", "preview"]
    assert cli.main(["precompute", "cornell", "-o", str(path), *settings]) == 0
    return path


def everything(folder):
    return sorted(path for path in folder.rglob("*"))


def test_precompute_prints_the_plan_and_info_the_transport(tiny, capsys):
    assert cli.main(["precompute", "cornell", "--plan", "--size", "24x24"]) == 0
    assert "left out" in capsys.readouterr().out
    assert cli.main(["info", str(tiny)]) == 0
    out = capsys.readouterr().out
    assert "haar:8" in out and "tiles-direct-00000.safetensors" in out and "bounces: 0" in out
    # One line for every band: 6 faces of 2 x 2, then each finer one four times as many.
    assert re.findall(r"^ +\d +(\d+) +\d+ +[\d.]+$", out, re.M) == ["24", "72", "288"]


def test_a_camera_replaces_the_scene_s_own(tmp_path, capsys):
    path = tmp_path / "seen.transport"
    camera = ["--camera", "0,1,4:0,1,0:50", "--size", "8x6", "--columns", "haar:4", "--quality", "preview"]
    assert cli.main(["precompute", "cornell", "-o", str(path), *camera]) == 0
    found = dl.Transport.open(path).camera
    assert found == dl.Camera((0, 1, 4), (0, 1, 0), vertical_fov=50, width=8, height=6)


def test_render_writes_one_picture(tiny, tmp_path, capsys):
    exr = tmp_path / "a.exr"
    assert cli.main(["render", str(tiny), "--env", "sky", "--rotate", "30", "-o", str(exr)]) == 0
    transport, env = dl.Transport.open(tiny), dl.Environment.builtin("sky").rotated(30)
    expected = transport.image(transport.multiply(transport.coefficients(env)), env)
    np.testing.assert_array_equal(io.load_image(exr)[0], expected)
    assert "24 x 24 pixels" in capsys.readouterr().out


def test_render_shows_vertices_from_any_camera(tmp_path):
    path, png = tmp_path / "cornell.transport", tmp_path / "a.png"
    made = ["precompute", "cornell", "--receivers", "vertices", "--normals", "flat", "--columns", "haar:4"]
    assert cli.main([*made, "-o", str(path), "--quality", "preview"]) == 0
    seen = ["--camera", "0,1,4:0,1,0:50", "--size", "20x12", "--exposure", "1"]
    assert cli.main(["render", str(path), *seen, "-o", str(png)]) == 0
    transport, env = dl.Transport.open(path), dl.Environment.builtin("hall")
    camera = dl.Camera((0, 1, 4), (0, 1, 0), vertical_fov=50, width=20, height=12)
    expected = transport.render(camera, transport.multiply(transport.coefficients(env)), env)
    np.testing.assert_array_equal(io.to_display(io.load_image(png)[0]), io.to_display(expected, 1.0))


@pytest.mark.parametrize("method", ["full", "nwa", "bi", "pbi", "linear", "harmonic-order"])
def test_relight_writes_frames_and_a_table(tiny, tmp_path, method, capsys):
    out = tmp_path / "frames"
    terms = [] if method == "full" else ["--terms", "7"]
    motion = ["--rotate", "90", "--frames", "5", "--hold", "1", "--format", "both"]
    assert cli.main(["relight", str(tiny), "--env", "hall", *motion, "--method", method, *terms, "-o", str(out)]) == 0
    with open(out / "frames.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert list(rows[0]) == [
        "frame", "angle", "seconds", "choosing", "multiplying", "bound", "columns", "resets", "converged",
    ]  # fmt: skip
    assert [float(row["angle"]) for row in rows] == pytest.approx([0, 90 * 0.15625, 45, 90 * 0.84375, 90, 90])
    assert sorted(path.name for path in out.glob("frame-*")) == sorted(
        f"frame-{k:04d}{suffix}" for k in range(6) for suffix in (".png", ".exr")
    )
    # The EXR is the linear radiance of the exact product where the method is exact.
    if method == "full":
        transport = dl.Transport.open(tiny)
        env = dl.Environment.builtin("hall").rotated(90)
        expected = transport.image(transport.multiply(transport.coefficients(env)), env)
        np.testing.assert_allclose(io.load_image(out / "frame-0005.exr")[0], expected, rtol=1e-6, atol=1e-6)
    else:
        assert all(int(row["columns"]) <= 7 for row in rows[1:])


MINE = """
from __future__ import annotations
from dataclasses import dataclass
import deltalux as dl

@dataclass(frozen=True, repr=False)
class Mine(dl.Method):
    first: int = 0

    def choose(self, state: dl.State) -> dl.Choice:
        return dl.Choice(columns=(-state.worth()).argsort()[self.first:])

class Stubborn(dl.Method):
    def __init__(self, colour):
        super().__init__()

    def choose(self, state):
        return dl.Choice()

class Wild(dl.Method):
    def choose(self, state):
        return dl.Choice(columns=[10**6])

class Nothing(dl.Method):
    pass
"""


def test_a_method_of_one_s_own_follows_reports_and_studies(tiny, tmp_path, capsys):
    (tmp_path / "mine.py").write_text(MINE)
    own, light = ["--method", f"{tmp_path / 'mine.py'}:Mine"], ["--env", "hall", "--frames", "4"]
    assert cli.main(["relight", str(tiny), *light, *own, "--terms", "7", "-o", str(tmp_path / "frames")]) == 0
    with open(tmp_path / "frames" / "frames.csv", newline="") as file:
        assert [int(row["columns"]) for row in csv.DictReader(file)][1:] == [7, 7, 7]
    assert cli.main(["report", str(tiny), *light, "--hold", "2", *own, *own, "-o", str(tmp_path / "report")]) == 0
    with open(tmp_path / "report" / "methods.csv", newline="") as file:
        text = file.read()
    assert "Mine-30," in text and "Mine-30 (2)," in text
    assert "Mine" in (tmp_path / "report" / "index.html").read_text()
    assert (
        cli.main(
            [
                "study",
                "lighting-error",
                "--scene",
                str(tiny),
                *light[:2],
                "--frames",
                "8",
                *own,
                "-o",
                str(tmp_path / "study"),
            ]
        )
        == 0
    )
    assert any("Mine" in path.read_text() for path in (tmp_path / "study").glob("*.csv"))
    # What a method answers is known only when it is asked: the frames before stay.
    wild = ["--method", f"{tmp_path / 'mine.py'}:Wild"]
    assert cli.main(["relight", str(tiny), *light, *wild, "-o", str(tmp_path / "wild")]) == 2
    assert "1000000" in capsys.readouterr().err and (tmp_path / "wild" / "frame-0000.png").exists()


@pytest.mark.parametrize("name", SEQUENCES)
def test_every_sequence_moves_the_light(tiny, tmp_path, name):
    out = tmp_path / name
    light = [] if name == "sunrise" else ["--env", "studio", "--hold", "1"]
    assert cli.main(["relight", str(tiny), "--sequence", name, *light, "--frames", "5", "-o", str(out)]) == 0
    frames = sorted(out.glob("frame-*.png"))
    pictures = [io.load_image(path)[0] for path in frames]
    assert len(frames) == 5 + (name != "sunrise")
    assert not np.array_equal(pictures[1], pictures[3]) and max(picture.max() for picture in pictures) > 0.2
    with open(out / "frames.csv", newline="") as file:
        angles = [row["angle"] for row in csv.DictReader(file)]
    assert all(angles) if name == "rotation" else not any(angles)


@pytest.mark.parametrize("budget", [["--milliseconds", "50"], ["--error", "2"], ["--terms", "3", "--weight", "cost"]])
@pytest.mark.parametrize("method", ["pbi", "harmonic-order"])
def test_budgets_of_every_kind(tiny, tmp_path, budget, method):
    command = ["relight", str(tiny), "--env", "hall", "--frames", "4", "--method", method, *budget]
    assert cli.main([*command, "-o", str(tmp_path / "out")]) == 0
    with open(tmp_path / "out" / "frames.csv", newline="") as file:
        rows = list(csv.DictReader(file))[1:]
    assert all(0 < int(row["columns"]) <= (3 if "--terms" in budget else 384) for row in rows)


def test_a_second_run_replaces_the_first_and_nothing_else(tiny, tmp_path):
    out = tmp_path / "frames"
    command = ["relight", str(tiny), "--env", "hall", "-o", str(out), "--frames"]
    assert cli.main([*command, "4"]) == 0
    (out / "notes.txt").write_text("mine")
    assert cli.main([*command, "2"]) == 0
    assert sorted(path.name for path in out.glob("frame-*")) == ["frame-0000.png", "frame-0001.png"]
    assert (out / "notes.txt").read_text() == "mine"


def test_files_of_others_are_not_overwritten(tiny, tmp_path, capsys):
    (tmp_path / "frame-0001.png").write_bytes(b"mine")
    assert cli.main(["relight", str(tiny), "--env", "hall", "--frames", "2", "-o", str(tmp_path)]) == 2
    assert "frame-0001.png" in capsys.readouterr().err
    assert (tmp_path / "frame-0001.png").read_bytes() == b"mine"
    assert len(everything(tmp_path)) == 1


BAD = {
    "two budgets": ["relight", "TINY", "--env", "hall", "--terms", "3", "--error", "1", "-o", "OUT"],
    "a budget with the exact method": [
        "relight",
        "TINY",
        "--env",
        "hall",
        "--method",
        "full",
        "--error",
        "1",
        "-o",
        "OUT",
    ],
    "a light for the sunrise": ["relight", "TINY", "--env", "hall", "--sequence", "sunrise", "-o", "OUT"],
    "a rotation of the painting": [
        "relight",
        "TINY",
        "--env",
        "hall",
        "--sequence",
        "painting",
        "--rotate",
        "9",
        "-o",
        "OUT",
    ],
    "a sequence without light": ["relight", "TINY", "--sequence", "painting", "-o", "OUT"],
    "an own method without choose": ["relight", "TINY", "--env", "hall", "--method", "PY/mine.py:Nothing", "-o", "OUT"],
    "an own method that is not there": ["relight", "TINY", "--env", "hall", "--method", "PY/mine.py:Nope", "-o", "OUT"],
    "a file of methods that is not there": ["report", "TINY", "--env", "hall", "--method", "PY/x.py:Mine", "-o", "OUT"],
    "a file of methods that fails": ["report", "TINY", "--env", "hall", "--method", "PY/broken.py:Mine", "-o", "OUT"],
    "an own method without terms": [
        "study",
        "lighting-error",
        "--env",
        "hall",
        "--method",
        "PY/mine.py:Stubborn",
        "-o",
        "OUT",
    ],
    "an unknown sequence": ["relight", "TINY", "--env", "hall", "--sequence", "walk", "-o", "OUT"],
    "an unknown study": ["study", "energies", "-o", "OUT"],
    "a study of pictures without a scene": ["study", "equal-time", "-o", "OUT"],
    "a picture of another kind": ["render", "TINY", "-o", "OUT.jpg"],
    "stops of linear radiance": ["render", "TINY", "-o", "OUT.exr", "--exposure", "1"],
    "half floats in a PNG": ["render", "TINY", "-o", "OUT.png", "--half"],
    "another camera of pixels": ["render", "TINY", "-o", "OUT.png", "--camera", "0,1,4:0,1,0"],
    "no command": [],
    "an unknown command": ["paint"],
    "an unknown scene": ["precompute", "nowhere", "-o", "OUT"],
    "a missing scene file": ["precompute", "nowhere.glb", "-o", "OUT"],
    "no output": ["precompute", "cornell"],
    "a size of 0": ["precompute", "cornell", "-o", "OUT", "--size", "0x8"],
    "half a size": ["precompute", "cornell", "-o", "OUT", "--size", "8"],
    "a negative size": ["precompute", "cornell", "-o", "OUT", "--size", "-8x8"],
    "columns that are no power of two": ["precompute", "cornell", "-o", "OUT", "--columns", "haar:9"],
    "another basis": ["precompute", "cornell", "-o", "OUT", "--columns", "fourier:8"],
    "a tolerance above 1": ["precompute", "cornell", "-o", "OUT", "--tolerance", "2"],
    "a camera that looks nowhere": ["precompute", "cornell", "-o", "OUT", "--camera", "0,1,2:0,1,2"],
    "half a camera": ["precompute", "cornell", "-o", "OUT", "--camera", "0,1,2"],
    "a camera with words": ["precompute", "cornell", "-o", "OUT", "--camera", "0,1,x:0,0,0"],
    "a field of view of 180": ["precompute", "cornell", "-o", "OUT", "--camera", "0,1,4:0,1,0:180"],
    "a camera that sees nothing": ["precompute", "cornell", "-o", "OUT", "--size", "8x8", "--camera", "0,1,9:0,1,99"],
    "too many threads": ["precompute", "cornell", "-o", "OUT", "--threads", "9999"],
    "fewer than no threads": ["precompute", "cornell", "-o", "OUT", "--threads", "-1"],
    "more than the disk holds": [
        "precompute",
        "cornell",
        "-o",
        "OUT",
        "--size",
        "16384x16384",
        "--columns",
        "haar:512",
    ],
    "no such folder": ["precompute", "cornell", "-o", "OUT/in/x.transport", "--size", "8x8"],
    "no transport": ["info", "OUT"],
    "a transport that is a file": ["info", "FILE"],
    "a missing environment": ["relight", "TINY", "--env", "no.hdr", "-o", "OUT"],
    "an unknown environment": ["relight", "TINY", "--env", "moon", "-o", "OUT"],
    "an environment that is no image": ["relight", "TINY", "--env", "FILE", "-o", "OUT"],
    "an unknown layout": ["relight", "TINY", "--env", "sky", "--layout", "round", "-o", "OUT"],
    "no frames": ["relight", "TINY", "--env", "sky", "--frames", "0", "-o", "OUT"],
    "a negative hold": ["relight", "TINY", "--env", "sky", "--hold", "-1", "-o", "OUT"],
    "an endless angle": ["relight", "TINY", "--env", "sky", "--rotate", "inf", "-o", "OUT"],
    "an axis of no length": ["relight", "TINY", "--env", "sky", "--axis", "0,0,0", "-o", "OUT"],
    "an unknown axis": ["relight", "TINY", "--env", "sky", "--axis", "up", "-o", "OUT"],
    "negative terms": ["relight", "TINY", "--env", "sky", "--terms", "-3", "-o", "OUT"],
    "terms for the exact method": ["relight", "TINY", "--env", "sky", "--method", "full", "--terms", "3", "-o", "OUT"],
    "an output that is a file": ["relight", "TINY", "--env", "sky", "-o", "FILE"],
    "an output below a file": ["report", "TINY", "--env", "sky", "-o", "FILE/report"],
    "a report of no transport": ["report", "OUT", "--env", "sky", "-o", "OUT"],
    "a demo of no size": ["demo", "-o", "OUT", "--size", "0x0"],
    "a demo of no frames": ["demo", "-o", "OUT", "--frames", "0"],
}


@pytest.mark.parametrize("what", BAD)
def test_bad_input_is_one_sentence_and_status_2_with_nothing_written(what, tiny, tmp_path, capsys):
    (tmp_path / "file.hdr").write_text("not a picture")
    (tmp_path / "mine.py").write_text(MINE)
    (tmp_path / "broken.py").write_text("import nothing_of_the_kind")
    before = everything(tmp_path), everything(tiny.parent)
    names = {"OUT": str(tmp_path / "out"), "FILE": str(tmp_path / "file.hdr"), "TINY": str(tiny), "PY": str(tmp_path)}
    arguments = [re.sub("^(OUT|FILE|TINY|PY)", lambda name: names[name[0]], text) for text in BAD[what]]
    try:
        assert cli.main(arguments) == 2
    finally:
        dl.set_threads(0)
    err = capsys.readouterr().err
    assert err.startswith("deltalux: error: ") and err.count("\n") == 1, err
    assert "Traceback" not in err and len(err) > 30
    assert (everything(tmp_path), everything(tiny.parent)) == before


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() == 0, reason="root may write everywhere")
def test_a_folder_without_permission(tiny, tmp_path, capsys):
    (tmp_path / "locked").mkdir(mode=0o500)
    for command in (["precompute", "cornell", "--size", "8x8"], ["report", str(tiny), "--env", "sky"]):
        assert cli.main([*command, "-o", str(tmp_path / "locked" / "x")]) == 2
        assert "ermission" in capsys.readouterr().err


def test_nan_pixels_are_counted_or_repaired(tiny, tmp_path, capsys):
    pixels = np.ones((8, 16, 3), np.float32)
    pixels[2, 5] = np.nan
    io.save_image(tmp_path / "holes.exr", pixels)
    command = ["relight", str(tiny), "--env", str(tmp_path / "holes.exr"), "--frames", "1", "-o", str(tmp_path / "out")]
    assert cli.main(command) == 2
    assert "row 2, column 5" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
    assert cli.main([*command, "--repair", "zero"]) == 0
    assert "deltalux: warning: " in capsys.readouterr().err


def test_a_damaged_transport_is_refused(tiny, tmp_path, capsys):
    copy = tmp_path / "damaged.transport"
    copy.mkdir()
    for path in tiny.iterdir():
        data = bytearray(path.read_bytes())
        if path.name.startswith("tiles"):
            data[len(data) // 2] ^= 1
        (copy / path.name).write_bytes(data)
    assert cli.main(["info", str(copy)]) == 2
    assert "tiles-direct-00000" in capsys.readouterr().err


def test_ctrl_c_says_that_the_run_resumes(tmp_path, capsys, monkeypatch):
    def interrupted(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr(cli.precompute.Precomputation, "run", interrupted)
    assert cli.main(["precompute", "cornell", "-o", str(tmp_path / "x"), "--size", "8x8"]) == 130
    assert "resumes" in capsys.readouterr().err


def test_module_runs_and_help_names_every_command():
    done = subprocess.run([sys.executable, "-m", "deltalux", "--help"], capture_output=True, text=True)
    assert done.returncode == 0 and done.stderr == ""
    assert all(name in done.stdout for name in ("demo", "precompute", "info", "relight", "report"))
