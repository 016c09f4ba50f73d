"""The loop over tiles: interruption and resumption, refusals before work, and what it never damages."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import textwrap
import time
from pathlib import Path

import deltalux as dl
import numpy as np
import oracles
import pytest
from deltalux.precomputation import run
from deltalux.surface.surface import Surface
from deltalux.transport.entry import TILE_ROWS

# Tiles are of 8192 rows and shards of 4: more than 32768 pixels make two shards.
SIZE = 192
FLOOR = oracles.merged(oracles.quad((-3, 0, -3), (6, 0, 0), (0, 0, 6)), oracles.box((-1, 0, -1), (0.5, 1, 1)))
CAMERA = dl.Camera((0.5, 3, 1), (0, 0, 0), vertical_fov=40, width=SIZE, height=SIZE)
OPTIONS = {"columns": "haar:2", "quality": "preview", "progress": False}


def room(camera=CAMERA):
    return dl.Scene.from_arrays(*FLOOR, (0.5, 0.4, 0.3), camera)


def small(**camera):
    return room(dl.Camera((0.5, 3, 1), (0, 0, 0), vertical_fov=40, **{"width": 8, "height": 8, **camera}))


def contents(path: Path) -> dict[str, bytes]:
    return {entry.name: entry.read_bytes() for entry in path.iterdir()}


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """The files of a run that nothing interrupted."""
    path = tmp_path_factory.mktemp("whole") / "room.transport"
    transport = dl.precompute(room(), path, **OPTIONS)
    assert transport.shape[0] > 4 * TILE_ROWS, "two shards, or there is nothing to resume"
    return contents(path)


class Stop(Exception):
    pass


def stop_after(share, error):
    def progress(done, total):
        if done > share * total:
            raise error

    return progress


@pytest.mark.parametrize("error", [KeyboardInterrupt, Stop])
@pytest.mark.parametrize("share", [0.0, 0.5, 0.95])
def test_stopped_and_resumed_gives_the_same_bits(tmp_path, whole, error, share):
    path = tmp_path / "room.transport"
    with pytest.raises(error):
        dl.precompute(room(), path, **{**OPTIONS, "progress": stop_after(share, error)})
    assert not path.exists()
    with pytest.raises(OSError):
        dl.Transport.open(path)
    steps = []
    dl.precompute(room(), path, **{**OPTIONS, "progress": lambda done, total: steps.append((done, total))})
    assert contents(path) == whole
    assert [entry.name for entry in tmp_path.iterdir()] == ["room.transport"], "nothing is left beside it"
    assert steps == sorted(steps) and steps[-1][0] == steps[-1][1]


def test_threads_do_not_change_the_files(tmp_path, whole):
    dl.set_threads(3)
    dl.precompute(room(), tmp_path / "a.transport", **OPTIONS)
    found, expected = contents(tmp_path / "a.transport"), dict(whole)
    # What the plan tells of the machine that it was made for is not in the file.
    assert found == expected


# The child announces its first shard, so that it is killed between two of them.
CHILD = """
    import signal, sys, time
    # A shell that runs things in the background has them ignore Ctrl-C.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    sys.path.insert(0, sys.argv[2])
    import test_precompute as here
    import deltalux as dl

    def progress(done, total):
        if done > 0.9 * total:
            print("near the end", flush=True)
            time.sleep(60)

    dl.precompute(here.room(), sys.argv[1], **{**here.OPTIONS, "progress": progress})
"""


@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="needs signals")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGKILL], ids=lambda n: n.name)
def test_killed_and_resumed_gives_the_same_bits(tmp_path, whole, number):
    path = tmp_path / "room.transport"
    command = [sys.executable, "-c", textwrap.dedent(CHILD), str(path), str(Path(__file__).parent)]
    package = str(Path(dl.__file__).parents[1])
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env={**os.environ, "PYTHONPATH": package}
    ) as child:
        assert child.stdout.readline() == "near the end\n", child.stderr.read()
        child.send_signal(number)
        started = time.monotonic()
        _, complaint = child.communicate(timeout=30)
    assert child.returncode != 0 and time.monotonic() - started < 10
    if number == signal.SIGINT:
        assert "KeyboardInterrupt" in complaint
    assert not path.exists()
    kept = {entry.name for entry in (tmp_path / "room.transport.partial").iterdir()}
    assert any("00000" in name or "shard" in name for name in kept), kept
    dl.precompute(room(), path, **OPTIONS)
    assert contents(path) == whole


# What comes before the first ray of a pass; each takes seconds here.
BEFORE = {
    "tree": """
        triangles = np.arange(3 * 2_000_000, dtype=np.uint32).reshape(-1, 3)
        vertices = rng.random((3 * len(triangles), 3))
        print("begun", flush=True)
        _core.Scene(vertices, triangles, np.zeros(len(triangles), np.uint32))
    """,
    "receivers": """
        triangles = np.arange(3 * 20_000, dtype=np.uint32).reshape(-1, 3)
        vertices = rng.random((len(triangles), 1, 3)) + 0.05 * rng.random((len(triangles), 3, 3))
        scene = _core.Scene(vertices.reshape(-1, 3), triangles, np.zeros(len(triangles), np.uint32))
        print("begun", flush=True)
        camera = _core.Camera(
            position=(0.5, 0.5, 4.0), right=(1.0, 0.0, 0.0), up=(0.0, 1.0, 0.0), forward=(0.0, 0.0, -1.0),
            half_height=0.2, width=6144, height=6144,
        )
        scene.receivers(camera, edges=True)
    """,
}


@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="needs signals")
@pytest.mark.parametrize("what", BEFORE)
def test_what_comes_before_the_pass_hears_ctrl_c(what):
    head = """
        import signal, time
        import numpy as np
        from deltalux import _core
        signal.signal(signal.SIGINT, signal.default_int_handler)
        rng = np.random.default_rng(1)
    """
    # The child itself takes the time: how long a process takes to leave is not ours.
    tail = """
        try:
            work()
        except KeyboardInterrupt:
            print(time.time(), flush=True)
        else:
            print("too fast", flush=True)
    """
    body = "def work():\n" + textwrap.indent(textwrap.dedent(BEFORE[what]), "    ")
    text = textwrap.dedent(head) + body + textwrap.dedent(tail)
    package = str(Path(dl.__file__).parents[1])
    with subprocess.Popen(
        [sys.executable, "-c", text], stdout=subprocess.PIPE, text=True, env={**os.environ, "PYTHONPATH": package}
    ) as child:
        assert child.stdout.readline() == "begun\n"
        time.sleep(0.3)
        asked = time.time()
        child.send_signal(signal.SIGINT)
        answer, _ = child.communicate(timeout=60)
    assert float(answer) - asked < 0.5


def test_another_job_does_not_resume_this_one(tmp_path):
    path, other = tmp_path / "a.transport", tmp_path / "b.transport"
    with pytest.raises(Stop):
        dl.precompute(room(), path, **{**OPTIONS, "progress": stop_after(0.95, Stop)})
    # The same picture of another scene, at the same place: shards of the first would fit, and be wrong.
    moved = dl.Scene.from_arrays(FLOOR[0] + (0, 0.1, 0), FLOOR[1], (0.5, 0.4, 0.3), CAMERA)
    for target in (path, other):
        dl.precompute(moved, target, **OPTIONS)
    assert contents(path) == contents(other)


def test_an_existing_result_stays_until_the_new_one_is_whole(tmp_path):
    path = tmp_path / "a.transport"
    dl.precompute(small(), path, **OPTIONS)
    before = contents(path)
    for error in (Stop, KeyboardInterrupt):
        with pytest.raises(error):
            dl.precompute(room(), path, **{**OPTIONS, "progress": stop_after(0.5, error)})
        assert contents(path) == before
    opened = dl.Transport.open(path)
    V = opened.coefficients(dl.Environment.builtin("hall"))
    B = opened.multiply(V)
    new = dl.precompute(room(), path, **OPTIONS)
    assert new.shape[0] > opened.shape[0]
    # A reader that has the old one open keeps it.
    np.testing.assert_array_equal(opened.multiply(V), B)


def test_a_directory_that_is_no_transport_is_left_alone(tmp_path):
    photos = tmp_path / "photos"
    photos.mkdir()
    (photos / "cat.txt").write_text("meow")
    (tmp_path / "letter").write_text("dear")
    for name in ("photos", "letter"):
        with pytest.raises((ValueError, OSError)):
            dl.precompute(small(), tmp_path / name, **OPTIONS)
    assert (photos / "cat.txt").read_text() == "meow" and (tmp_path / "letter").read_text() == "dear"
    assert sorted(entry.name for entry in tmp_path.iterdir()) == ["letter", "photos"]


def refuse_rays(monkeypatch):
    """Any ray from here on is a failure: refusals come before work."""

    def ray(*_):
        raise AssertionError("work has begun")

    monkeypatch.setattr(Surface, "traced", ray)


def test_what_does_not_fit_on_the_disk_is_refused_before_work(tmp_path, monkeypatch):
    needed = dl.plan(small(), columns="haar:2").bytes_on_disk

    def work(*_):
        raise AssertionError("work has begun")

    # The plan's own probe, of a moment, is all that comes before.
    monkeypatch.setitem(run._PASSES, "direct", work)

    free = shutil._ntuple_diskusage(10**12, 10**12, int(needed) - 1)
    monkeypatch.setattr(shutil, "disk_usage", lambda path: free)
    with pytest.raises(ValueError, match=r"MB on disk, but only [\d.,]+ MB are free"):
        dl.precompute(small(), tmp_path / "a.transport", columns="haar:2")
    assert list(tmp_path.iterdir()) == []
    # Enough by one byte is enough.
    monkeypatch.setattr(shutil, "disk_usage", lambda path: free._replace(free=int(needed) + 1))
    with pytest.raises(AssertionError, match="work has begun"):
        dl.precompute(small(), tmp_path / "a.transport", columns="haar:2")


def test_what_does_not_fit_in_memory_is_refused_before_work(tmp_path):
    resource = pytest.importorskip("resource")
    # Room for the interpreter as it is, and for 60 % of what the plan needs.
    script = f"""
        import resource, sys
        sys.path.insert(0, {str(Path(__file__).parent)!r})
        import test_precompute as here
        import deltalux as dl
        from pathlib import Path

        scene = here.small(width=2000, height=2000)
        needed = dl.plan(scene, columns="haar:64").bytes_in_memory
        used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
        resource.setrlimit(resource.RLIMIT_AS, (int(used + 0.6 * needed), resource.RLIM_INFINITY))
        try:
            dl.precompute(scene, {str(tmp_path / "a.transport")!r}, columns="haar:64", progress=False)
        except ValueError as error:
            print(error)
    """
    if not Path("/proc/self/statm").exists() or resource.RLIM_INFINITY is None:
        pytest.skip("needs Linux")
    package = str(Path(dl.__file__).parents[1])
    done = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(script)], capture_output=True, text=True, timeout=200,
        env={**os.environ, "PYTHONPATH": package},
    )  # fmt: skip
    assert "MB of memory, but only" in done.stdout, done.stdout + done.stderr
    assert list(tmp_path.iterdir()) == []


# Each is one sentence, before any ray, and leaves nothing behind.
@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"columns": "haar:3"}, "power of two"),
        ({"columns": "haar:0"}, "at least 1|columns"),
        ({"columns": "dct:4"}, 'expected columns like "haar:64"'),
        ({"columns": "haar:1e9"}, 'expected columns like "haar:64"'),
        ({"columns": "haar:65536"}, "from 1 to 512"),
        ({"quality": "best"}, "expected a quality of preview, publication, lossless"),
        ({"receivers": "faces"}, 'expected receivers to be "pixels" or "vertices"'),
        ({"tolerance": -0.1}, "expected a tolerance"),
        ({"tolerance": float("nan")}, "expected a tolerance"),
        ({"tolerance": 1.0}, "expected a tolerance"),
    ],
    ids=str,
)
def test_arguments_that_are_refused(tmp_path, monkeypatch, options, message):
    refuse_rays(monkeypatch)
    with pytest.raises(ValueError, match=message):
        dl.precompute(small(), tmp_path / "a.transport", **{**OPTIONS, **options})
    assert list(tmp_path.iterdir()) == []


def test_places_that_are_refused(tmp_path, monkeypatch):
    refuse_rays(monkeypatch)
    with pytest.raises(FileNotFoundError, match="does not exist"):
        dl.precompute(small(), tmp_path / "nowhere" / "a.transport", **OPTIONS)


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() == 0, reason="root may write everywhere")
def test_a_directory_without_write_permission(tmp_path, monkeypatch):
    refuse_rays(monkeypatch)
    locked = tmp_path / "locked"
    locked.mkdir(mode=0o500)
    with pytest.raises(PermissionError):
        dl.precompute(small(), locked / "a.transport", **OPTIONS)
    assert list(locked.iterdir()) == []


NAN = float("nan")
VERTICES, TRIANGLES = FLOOR


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: dl.Scene.from_arrays(VERTICES, np.zeros((0, 3), int)), "no triangles"),
        (lambda: dl.Scene.from_arrays(np.zeros((0, 3)), np.zeros((0, 3), int)), "no triangles"),
        (lambda: dl.Scene.from_arrays([(0, 0, 0), (1, NAN, 0), (0, 1, 0)], [(0, 1, 2)]), "vertex 1"),
        (lambda: dl.Scene.from_arrays([(0, 0, 0), (np.inf, 0, 0), (0, 1, 0)], [(0, 1, 2)]), "vertex 1"),
        (lambda: dl.Scene.from_arrays(np.eye(3), [(0, 1, 3)]), "triangle 0"),
        (lambda: dl.Scene.from_arrays(np.eye(3), [(0, 1, -1)]), "triangle 0"),
        (lambda: dl.Scene.from_arrays(np.eye(3), [(0.0, 1.0, 2.0)]), "integers"),
        (lambda: dl.Scene.from_arrays(np.eye(3), [(0, 1, 1)]), "no area"),
        (lambda: dl.Scene.from_arrays(np.eye(3), [(0, 1, 2)], albedo=(2, 0, 0)), "albedo"),
        (lambda: dl.Scene.from_arrays(np.eye(3), [(0, 1, 2)], albedo=(NAN, 0, 0)), "albedo"),
        (lambda: dl.Camera((0, 0, 1), (0, 0, 0), width=0), "1 to 16384 pixels, got 0"),
        (lambda: dl.Camera((0, 0, 1), (0, 0, 0), height=10**9), "1 to 16384"),
        (lambda: dl.Camera((0, 0, 1), (0, 0, 1)), "must differ"),
        (lambda: dl.Camera((0, 1, 0), (0, 0, 0)), "parallel"),
        (lambda: dl.Camera((NAN, 0, 1), (0, 0, 0)), "finite"),
        (lambda: dl.Camera((0, 0, 1), (0, 0, 0), vertical_fov=-40), "vertical_fov"),
        (lambda: dl.Scene.builtin("teapot"), "a built-in scene of .* got 'teapot'"),
        (lambda: dl.Environment.builtin("moon"), "expected|no built-in"),
        (lambda: dl.Environment.from_latlong(np.full((4, 8, 3), NAN)), "NaN|finite"),
        (lambda: dl.Environment.from_cubemap(np.ones((6, 4, 5, 3))), "expected a cubemap"),
        (lambda: dl.Haar(3), "power of two"),
        (lambda: dl.PerBand(terms=-1), "whole number of 0 or more"),
    ],
)
def test_scenes_cameras_lights_and_methods_that_are_refused(build, message):
    with pytest.raises(ValueError, match=message) as failure:
        build()
    assert "\n" not in str(failure.value), "one sentence"


@pytest.mark.parametrize("name", ["gone.glb", "gone.hdr"])
def test_missing_files(tmp_path, name):
    load = dl.Scene.load if name.endswith("glb") else dl.Environment.load
    with pytest.raises(FileNotFoundError, match="gone"):
        load(tmp_path / name)


@pytest.mark.parametrize("name", ["text.glb", "text.hdr", "text.exr"])
def test_files_that_are_something_else(tmp_path, name):
    (tmp_path / name).write_text("not what its name says\n" * 10)
    load = dl.Scene.load if name.endswith("glb") else dl.Environment.load
    with pytest.raises(dl.FileError, match="text"):
        load(tmp_path / name)


def test_a_camera_that_sees_nothing(tmp_path):
    away = dl.Camera((0, 3, 0), (0, 10, 0), (0, 0, 1), width=8, height=8)
    with pytest.raises(ValueError, match="the camera sees nothing of arrays"):
        dl.precompute(room(away), tmp_path / "a.transport", **OPTIONS)
    assert not (tmp_path / "a.transport").exists()
    # Nothing that is there is damaged by it either.
    dl.precompute(small(), tmp_path / "a.transport", **OPTIONS)
    before = contents(tmp_path / "a.transport")
    with pytest.raises(ValueError):
        dl.precompute(room(away), tmp_path / "a.transport", **OPTIONS)
    assert contents(tmp_path / "a.transport") == before


def test_the_plan_says_what_is_left_out(tmp_path):
    scene = small()
    before = dl.plan(scene, columns=dl.Haar(2), quality="preview")
    assert before.rays > 0 and before.bytes_on_disk > 0 and before.bytes_in_memory > 0 and before.seconds > 0
    text = str(before)
    for word in ("channel", "bounces", "view factors", "horizon", "MB on disk", "MB in memory", "rays"):
        assert word in text, word
    transport = dl.precompute(scene, tmp_path / "a.transport", **OPTIONS)
    after = transport.plan
    assert after.rows == transport.shape[0] <= before.rows
    assert after.left_out == dl.plan(scene, columns=OPTIONS["columns"], quality=OPTIONS["quality"]).left_out
    # Each reason is the scene's own: one that has no sky behind it leaves none out.
    behind = int((transport.pixels.background == 1).sum())
    assert any(f"{behind:,} pixels" in reason.why for reason in after.left_out) == (behind > 0)
    assert any("truncated" in note for note in after.notes)
    assert [part.name for part in after.parts] == ["direct"] and after.parts[0].cost is None
    assert dl.Plan.from_json(after.to_json()) == after


def test_progress_bar_is_quiet_for_short_work(tmp_path, capsys):
    dl.precompute(small(), tmp_path / "a.transport", columns="haar:2", quality="preview")
    output = capsys.readouterr()
    assert output.out == "" and output.err == ""


def test_a_plan_of_a_stranger_is_read_or_refused():
    plan = dl.plan(room(), columns="haar:4").done([], {"sky": 0.01}, {})
    found = json.loads(plan.to_json())
    assert dl.Plan.from_json(json.dumps({**found, "mood": "good"})) == plan
    harmed = [
        {**found, "triangles": -1},
        {**found, "triangles": True},
        {**found, "tolerance": 2},
        {**found, "scene": 5},
        {**found, "picture": [8]},
        {**found, "parts": []},
        {**found, "parts": [{**found["parts"][0], "rows": "many"}]},
        {**found, "left_out": [{"what": "everything"}]},
        {**found, "notes": [1]},
        {},
        [],
        None,
    ]
    for wrong in harmed:
        with pytest.raises(ValueError, match="expected"):
            dl.Plan.from_json(json.dumps(wrong))
    for text in ("", "{", "[" * 100_000, '{"parts": 1e999}'):
        with pytest.raises(ValueError):
            dl.Plan.from_json(text)
