"""Mistakes of new users: each is refused at once, in a sentence that says what was given and what was meant."""

import deltalux as dl
import numpy as np
import pytest
from deltalux.command.cli import main

HALL = dl.Environment.builtin("hall")
CORNELL = dl.Scene.builtin("cornell")


@pytest.fixture(scope="module")
def transport(tmp_path_factory):
    path = tmp_path_factory.mktemp("mistakes") / "a.transport"
    options = {"columns": "haar:8", "quality": "preview", "progress": False}
    return dl.precompute(CORNELL.with_camera(CORNELL.camera.resized(8, 8)), path, **options)


# What is called, and what the answer must contain.
CALLS = {
    "a word for fov": (lambda t: dl.Camera((0, 0, 1), (0, 0, 0), fov=40), "did you mean 'vertical_fov'"),
    "a word for terms": (lambda t: dl.PerBand(term=30), "did you mean 'terms'"),
    "a weight": (lambda t: dl.PerBand(terms=3, weight="aera"), "did you mean 'area'"),
    "a quality": (lambda t: dl.precompute(CORNELL, "x", quality="prview"), "did you mean 'preview'"),
    "a light's name": (lambda t: dl.Environment.builtin("hal"), "did you mean 'hall'"),
    "precompute swapped": (lambda t: dl.precompute("x.transport", CORNELL), "a scene, and then the path"),
    "a scene's name": (lambda t: dl.precompute("cornell", "x"), r"got 'cornell'; dl.Scene.load\(path\)"),
    "a scene's path": (lambda t: dl.plan("a.glb"), r"got 'a.glb'; dl.Scene.load\(path\)"),
    "Relighter swapped": (lambda t: dl.Relighter(dl.Full(), t), r"a Transport, got a Full; dl.Transport\(path\)"),
    "a transport's path": (lambda t: dl.Relighter("a.transport", dl.Full()), r"dl.Transport\(path\) opens one"),
    "a method's name": (lambda t: dl.Relighter(t, "pbi"), "got 'pbi'"),
    "a method's class": (lambda t: dl.Relighter(t, dl.PerBand), "got the class PerBand"),
    "step of a name": (lambda t: dl.Relighter(t, dl.Full()).step("hall"), r"got 'hall'; dl.Environment.load\(path\)"),
    "step of nothing": (lambda t: dl.Relighter(t, dl.Full()).step(None), "shape"),
    "step of a scene": (lambda t: dl.Relighter(t, dl.Full()).step(CORNELL), "an Environment, got a Scene"),
    "coefficients of a name": (lambda t: t.coefficients("hall"), "an Environment, got 'hall'"),
    "image swapped": (lambda t: t.image(HALL, np.zeros((t.shape[0], 3))), "before the environment"),
    "image of a name": (lambda t: t.image(np.zeros((t.shape[0], 3)), "hall"), "an Environment, got 'hall'"),
    "product of a light": (lambda t: t.multiply(HALL), r"transport.coefficients\(env\) makes one"),
    "rotated swapped": (lambda t: HALL.rotated("y", 30), "an angle in degrees, and then an axis"),
    "mixed swapped": (lambda t: HALL.mixed(0.5, HALL), "an Environment, got 0.5"),
    "load of an array": (lambda t: dl.Environment.load(np.ones((2, 4, 3))), "from_latlong takes an array"),
    "load of a name": (lambda t: dl.Environment.load("hall"), r"dl.Environment.builtin\('hall'\)"),
    "load of a transport": (lambda t: dl.Environment.load(t._path), "expected a light, but this is a transport"),
    "builtin of a path": (lambda t: dl.Environment.builtin("a.hdr"), r"dl.Environment.load\(path\) reads"),
    "an array of a light": (lambda t: dl.Environment.from_latlong(HALL), "got an Environment"),
    "a light of a path": (lambda t: dl.Environment("a.hdr"), r"Environment.load\(path\)"),
    "a missing transport": (lambda t: dl.Transport("no.transport"), r"`deltalux precompute SCENE -o no.transport`"),
    "a transport of a scene": (lambda t: dl.Transport(CORNELL), "path of a transport, got a Scene"),
    "compare swapped": (lambda t: dl.compare(HALL, t, [dl.Full()]), "a Transport, got an Environment"),
    "compare by name": (lambda t: dl.compare(t, HALL, "pbi"), r"\[PerBand\(terms=30\)\]"),
    "truncated swapped": (lambda t: t.truncated(0.1, "x"), "expected a path, got 0.1"),
    "for_camera swapped": (lambda t: t.for_camera("x", t.camera), "a dl.Camera, and then a path"),
    "write swapped": (lambda t: dl.write(np.ones((2, 2, 3)), "a.png"), "a path, and then a picture, got an array"),
}


@pytest.mark.parametrize("name", CALLS)
def test_wrong_calls_are_answered(transport, name):
    call, answer = CALLS[name]
    with pytest.raises((TypeError, ValueError, FileNotFoundError), match=answer):
        call(transport)


RELIGHT = "relight {t} -o {f} --frames 2 "
LINES = {
    RELIGHT + "--env hall --terms 0": "at least 1 column a frame",
    RELIGHT + "--env hall --exposure inf": "from -64 to 64 stops",
    RELIGHT + "--env hall --env sky": "expected one, got 'hall' and 'sky'",
    RELIGHT + "--env hall --method pbu": "did you mean 'pbi'",
    RELIGHT + "--env hal": "did you mean 'hall'",
    RELIGHT + "--env {t}": "expected a light, but this is a transport",
    RELIGHT + "--env hall --sequense rotation": "did you mean '--sequence'",
    RELIGHT + "--env hall --threads 100000": "processors",
    "relight {f}.transport --env hall -o {f}": "deltalux precompute SCENE",
    "relight {t} --env hall -o {f}.transport": "a folder for frames",
    "relight {light} --env hall -o {f}": "expected a transport, but this is a light",
    "precompute {t} -o {f}": "expected a scene, but this is a transport",
    "precompute {light} -o {f}": "expected a scene, but this is a light",
    "precompute cornel -o {f}": "did you mean 'cornell'",
    "precompute cornell --quality publicaton -o {f}": "did you mean 'publication'",
    "report {t} --env hall --frames 1 -o {f}": "2 frames or more",
    "relit {t}": "did you mean 'relight'",
}


@pytest.mark.parametrize("line", LINES)
def test_wrong_lines_are_answered(transport, tmp_path, capsys, line):
    light = tmp_path / "a.hdr"
    light.write_bytes(b"#?RADIANCE\n\n-Y 1 +X 2\n" + bytes(8))
    words = line.format(t=transport._path, f=tmp_path / "f", light=light).split()
    assert main(words) == 2
    said = capsys.readouterr().err
    assert LINES[line] in said and said.count("\n") == 1
    assert sorted(file.name for file in tmp_path.iterdir()) == ["a.hdr"]


def test_numbers_below_zero_and_capitals_are_understood(transport, tmp_path, capsys):
    relight = f"relight {transport._path} --env hall --frames 1 --method PBI --exposure -1.5 -o {tmp_path / 'f'}"
    assert main(relight.split()) == 0 and "-1.50 stops" in capsys.readouterr().out
    plan = "precompute cornell --plan --size 8x8 --columns haar:4 --quality preview --camera -1,0,3:-.5,0,0:40"
    assert main(plan.split()) == 0
