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
    "threads below 0": (lambda t: dl.set_threads(-1), "expected 0 to 1024 threads, got -1"),
    "columns of a number": (lambda t: dl.plan(CORNELL, columns=32), r"got 32; did you mean dl.Haar\(32\)"),
    "columns of a class": (lambda t: dl.plan(CORNELL, columns=dl.Haar), "got the class Haar"),
    "columns of a kind": (lambda t: dl.plan(CORNELL, columns="harr:32"), 'did you mean "haar:32"'),
    "columns without a kind": (lambda t: dl.plan(CORNELL, columns="32"), 'did you mean "haar:32"'),
    "an approximation of a number": (lambda t: dl.Approximation(8, dl.Full()), r"did you mean dl.Haar\(8\)"),
    "Haar of a name": (lambda t: dl.Haar(8).coefficients("hall"), "an Environment, got 'hall'"),
    "harmonics of a name": (lambda t: dl.SphericalHarmonics(3).coefficients("hall"), "an Environment, got 'hall'"),
    "Haar of a class": (lambda t: dl.Haar(dl.Haar), "a whole number of texels"),
    "a scene seen by a place": (
        lambda t: CORNELL.with_camera((0, 0, 1)),
        r"a Camera, got a tuple; dl.Camera\(position",
    ),
    "a scene built for a place": (lambda t: dl.Scene.builtin("cornell", (0, 0, 1)), "a Camera, got a tuple"),
    "load of no scene": (lambda t: dl.Scene.load(None), "the path of a scene, got None"),
    "load of a scene's name": (lambda t: dl.Scene.load("cornell"), r"dl.Scene.builtin\('cornell'\) is a scene"),
    "load of a light": (lambda t: dl.Scene.load(__file__[:-3] + ".hdr"), "expected one of .glb"),
    "load of another program's": (lambda t: dl.Scene.load("a.blend"), "expected one of .glb"),
    "a scene of a transport": (lambda t: dl.Scene.load(t._path), r"is a transport; dl.Transport\(path\) opens it"),
    "a built-in scene": (lambda t: dl.Scene.builtin("cornel"), "did you mean 'cornell'"),
    "builtin of a scene's path": (lambda t: dl.Scene.builtin("a.glb"), r"dl.Scene.load\(path\) reads"),
    "corners from 1": (lambda t: dl.Scene.from_arrays(np.eye(3), [(1, 2, 3)]), "counted from 1"),
    "one material": (
        lambda t: dl.Scene.from_arrays(np.eye(3), [(0, 1, 2)], materials=dl.Material()),
        r"\[material\] is a list",
    ),
    "a word for albedo": (lambda t: dl.Material(color=1), r"keywords of Material \(albedo"),
    "a lamp added": (lambda t: HALL + dl.PointLight((0, 1, 0)), "an Environment, got a PointLight"),
    "a factor of three": (lambda t: HALL.scaled((1, 2, 3)), "tinted takes three"),
    "a tint of one": (lambda t: HALL.tinted(2), "three finite factors"),
    "precompute into nothing": (lambda t: dl.precompute(CORNELL, ""), "got an empty one"),
    "render swapped": (lambda t: t.render(np.ones((2, 3)), t.camera), "a Camera, got an array"),
    "write of a frame": (lambda t: dl.write("a.png", dl.Relighter(t, dl.Full()).step(HALL)), "floats, got a Frame"),
    "write of a product": (lambda t: dl.write("a.png", np.ones((t.shape[0], 3))), r"transport.image\(B\) makes one"),
    "write of bytes": (lambda t: dl.write("a.png", np.ones((2, 2, 3), np.uint8)), "save_image of deltalux.io"),
    "write into no folder": (lambda t: dl.write("no/a.png", np.ones((2, 2, 3))), "a directory to write a.png into"),
    "an exposure by a word": (lambda t: dl.write("a.png", np.ones((2, 2, 3)), exposure="auto"), "number of stops"),
    "a backdrop of a path": (lambda t: dl.Backdrop("a.transport"), "a Transport, got 'a.transport'"),
    "a backdrop in floats": (lambda t: dl.Backdrop(t, (1, 1, 1)), r"env, none or #rrggbb, got \(1, 1, 1\)"),
    "a backdrop under a name": (lambda t: dl.Backdrop(t).picture(np.ones((t.shape[0], 3)), "hall"), "got 'hall'"),
    "a transport's manifest": (lambda t: dl.Transport(t._path / "manifest.json"), "did you mean '.*a.transport'"),
    "a transport of a folder": (lambda t: dl.Transport(t._path.parent), "no manifest.json is in it"),
    "a transport of a file": (lambda t: dl.Transport(__file__), "the directory of a transport, got a file"),
    "curves of a transport": (lambda t: dl.CurveTransport.open(t._path), r"dl.Transport\(path\) opens it"),
    "write swapped": (lambda t: dl.write(np.ones((2, 2, 3)), "a.png"), "a path, and then a picture, got an array"),
}


@pytest.mark.parametrize("name", CALLS)
def test_wrong_calls_are_answered(transport, name):
    call, answer = CALLS[name]
    with pytest.raises((TypeError, ValueError, OSError), match=answer):
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
    RELIGHT + "--env hall --milliseconds 0": "more than 0 milliseconds",
    "precompute cornell -o {f} --env hall": "unrecognized arguments: --env hall (deltalux precompute --help",
    "precompute cornell -o {light}": "the directory of a transport or nothing, found a file",
    "precompute cornell -o {f} --columns haar64": 'did you mean "haar:64"',
    "render {t} --env hall -o {f}/a.png": "a directory to write a.png into",
    "render {t} --env hall --backgroud none -o {f}.png": "did you mean '--background'",
    "report {t} --env hall -o {t}": "is a transport; give another folder",
    "edit demo --terms 0 -o {f}": "at least 1 column a frame",
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


@pytest.mark.parametrize(("manifest", "opens"), [("curves", "CurveTransport.open"), ("studio", "StudioTransport.open")])
def test_directories_say_what_opens_them(transport, tmp_path, manifest, opens):
    (tmp_path / f"{manifest}.json").write_text("{}")
    for call in (dl.Transport, dl.Scene.load, dl.Environment.load):
        with pytest.raises(ValueError, match=f"this is a transport of .*; dl.{opens}"):
            call(tmp_path)
