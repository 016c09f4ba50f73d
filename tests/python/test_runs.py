"""Runs of the command line: what is there already, what is kept apart, what is shown how, and what is said."""

import io
import shutil
import subprocess
import sys
from pathlib import Path

import deltalux as dl
import numpy as np
import pytest
from deltalux import output
from deltalux.command.cli import main
from deltalux.io import auto_exposure
from deltalux.output import claim
from deltalux.pages.plotting import INK, drawing, logarithmic
from deltalux.pages.verdict import Verdict, summed, tied
from deltalux.progress import reporter, steps
from PIL import Image

SMALL = "--size 16x16 --columns haar:8 --quality preview"


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    path = tmp_path_factory.mktemp("runs") / "a.transport"
    assert main(f"precompute cornell -o {path} {SMALL}".split()) == 0
    return path


def test_an_identical_request_returns_at_once(made, capsys):
    before = (made / "manifest.json").stat().st_mtime_ns
    assert main(f"precompute cornell -o {made} {SMALL}".split()) == 0
    assert "is there already" in capsys.readouterr().out
    assert (made / "manifest.json").stat().st_mtime_ns == before
    scene = dl.Scene.builtin("cornell")
    asked = {"columns": "haar:8", "quality": "preview", "progress": False}
    dl.precompute(scene.with_camera(scene.camera.resized(16, 16)), made, **asked)
    assert (made / "manifest.json").stat().st_mtime_ns == before


def test_another_request_or_again_computes(made, tmp_path, capsys):
    path = tmp_path / "a.transport"
    shutil.copytree(made, path)
    first = (path / "manifest.json").stat().st_mtime_ns
    assert main(f"precompute cornell -o {path} {SMALL} --again".split()) == 0
    second = (path / "manifest.json").stat().st_mtime_ns
    assert second != first and "is there already" not in capsys.readouterr().out
    assert main(f"precompute cornell -o {path} {SMALL} --tolerance 0.3".split()) == 0
    assert (path / "manifest.json").stat().st_mtime_ns != second
    # What was made of a transport is no answer to the request that made that one.
    assert dl.Transport(path).truncated(tmp_path / "b.transport", 0.4).plan.job == ""


def test_two_runs_into_one_folder_are_kept_apart(tmp_path):
    folder = tmp_path / "f"
    program = f"from deltalux.output import claim; claim({str(folder)!r}, ['a']); print('ready'); input()"
    other = subprocess.Popen([sys.executable, "-uc", program], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    assert other.stdout.readline() == "ready\n"
    with pytest.raises(FileExistsError, match="another run is writing"):
        claim(folder, ["b"])
    other.communicate("\n")
    claim(folder, ["b"])
    claim(folder, ["b"])


def test_exposure_is_that_of_what_is_seen(tmp_path, capsys):
    # A small dark triangle before a bright hall, which fills most of the picture.
    triangle = [(-0.1, 0, 0), (0.1, 0, 0), (0, 0.2, 0)]
    camera = dl.Camera((0, 0.1, 2), (0, 0.1, 0), width=32, height=32)
    scene = dl.Scene.from_arrays(triangle, [(0, 1, 2)], (0.05, 0.05, 0.05), camera)
    path = tmp_path / "t.transport"
    dl.precompute(scene, path, columns="haar:8", quality="preview", progress=False)
    assert main(f"relight {path} --env hall --rotate 0 --frames 1 --method full -o {tmp_path / 'f'}".split()) == 0
    shown = np.asarray(Image.open(tmp_path / "f" / "frame-0000.png").convert("RGB"))
    assert (shown == 255).any(-1).mean() < 0.1


def test_a_locked_exposure_is_that_of_the_run_before(made, tmp_path, capsys):
    for light, folder in (("hall", "a"), ("sky", "b")):
        words = f"relight {made} --env {light} --frames 2 --exposure lock -o {tmp_path / folder}"
        assert main(words.split()) == 0
    stops = [line.split("exposure ")[1].split(",")[0] for line in capsys.readouterr().out.splitlines()]
    transport, hall = dl.Transport(made), dl.Environment.builtin("hall")
    exact = auto_exposure(transport.image(transport.multiply(transport.coefficients(hall)), hall))
    assert stops == [f"{exact:+.2f} stops"] * 2
    (tmp_path / ".deltalux-exposure").write_text("much\n")
    assert main(f"relight {made} --env sky --frames 2 --exposure lock -o {tmp_path / 'c'}".split()) == 2


def test_frames_go_into_a_video_with_a_tone(made, tmp_path, capsys):
    words = f"relight {made} --env hall --frames 3 --tone agx --video {tmp_path / 'a.webp'} -o {tmp_path / 'f'}"
    assert main(words.split()) == 0
    with Image.open(tmp_path / "a.webp") as film:
        assert film.n_frames == 3 and film.size == (16, 16)
    assert sorted(file.name for file in tmp_path.iterdir()) == ["a.webp", "f"]
    assert main(f"relight {made} --env hall --video a.gif -o {tmp_path / 'g'}".split()) == 2
    assert not (tmp_path / "g").exists()


def test_scenes_are_cut_out_with_the_shadow_on_their_ground(tmp_path, capsys):
    path, out = tmp_path / "t.transport", tmp_path / "f"
    scene = dl.Scene.builtin("cornell").with_ground()
    scene = scene.with_camera(scene.camera.resized(16, 16))
    dl.precompute(scene, path, columns="haar:8", quality="preview", progress=False)
    film = f"--frames 3 --rotate 90 --format both --video {tmp_path / 'a.webp'}"
    assert main(f"relight {path} --env hall --background none --catcher {film} -o {out}".split()) == 0
    assert main(f"render {path} --env hall --background none --catcher -o {tmp_path / 'a.png'}".split()) == 0
    with Image.open(tmp_path / "a.png") as still, Image.open(out / "frame-0000.png") as frame:
        np.testing.assert_array_equal(np.array(still)[..., 3], np.array(frame)[..., 3])
    last = np.array(Image.open(out / "frame-0002.png"))
    assert last.shape == (16, 16, 4) and len(np.unique(last[..., 3])) > 2
    with Image.open(tmp_path / "a.webp") as video:
        video.seek(2)
        shown = np.array(video.convert("RGBA"))
    # Lossy colours, and alpha as it is.
    np.testing.assert_array_equal(shown[..., 3], last[..., 3])
    assert main(f"relight {path} --env hall --catcher --frames 1 -o {tmp_path / 'g'}".split()) == 0


def test_a_budget_in_time_says_how_often_it_was_kept(made, tmp_path, capsys):
    assert main(f"relight {made} --env hall --frames 4 --milliseconds 1e6 -o {tmp_path / 'f'}".split()) == 0
    assert "3 of 3 within 1e+06 ms" in capsys.readouterr().out


def test_claims_have_more_than_two_answers():
    words = [Verdict("c", *of).word for of in ((True, ""), (False, ""), (None, ""), (False, "", "", True))]
    assert words == ["holds", "does not hold", "not tested", "a tie"]
    found = [Verdict("c", True, ""), Verdict("c", True, ""), Verdict("c", None, "")]
    assert summed(found) == "Of 3 claims: 2 hold, 1 not tested."
    assert tied(1, 1.004) and not tied(1, 1.006) and tied(0, 0)


def test_public_pages_carry_no_codes():
    import re

    sources = Path(dl.__file__).parent.glob("studies/**/*.py")
    assert [file.name for file in sources if re.search(r"\([A-Z]\d+[,)-]", file.read_text(encoding="utf-8"))] == []


def test_steps_share_one_bar(capsys):
    shares = []
    for name in ("a", "b"):
        steps(lambda done, total: shares.append((done, total)), "work", 2)(name)(1, 2)
    assert shares == [(1, 2), (1, 2)]
    step_of = steps(True, "work", 2)
    first, second = step_of("errors"), step_of("pictures")
    first._whole._started -= 20
    first._whole._drawn -= 20
    first(1, 2)
    first._whole._drawn -= 20
    second(2, 2)
    lines = capsys.readouterr().err.splitlines()
    assert (
        not shares[2:]
        and "work, errors" in lines[0]
        and "25 %" in lines[0]
        and "work, pictures" in lines[1]
        and "100 %" in lines[1]
    )


def test_steps_of_a_step_share_its_part_of_the_bar(capsys):
    step_of = steps(True, "work", 2)
    first = step_of("making")
    bar = first._whole
    steps(first, "unsaid", 4)("unseen")
    assert reporter(first, "unsaid") is first
    second = steps(step_of("showing"), "unsaid", 4)
    second("pictures")
    third = second("tables")
    bar._started -= 20
    bar._drawn -= 20
    third(1, 2)
    line = capsys.readouterr().err
    # Half, and of the other half three of eight.
    assert "work, tables" in line and f"{50 + 50 * 3 / 8:.0f} %" in line


def test_plots_around_pictures_are_read_on_any_page(tmp_path):
    with drawing(tmp_path / "a.png", 1, 1, (2, 2)) as (_, axes):
        axes.imshow(np.zeros((4, 4)))
        axes.set_title("title")
    with drawing(tmp_path / "b.png", 1, 1, (2, 2)) as (_, lines):
        lines.plot([1.0, 1e-3, 1e-15])
        logarithmic(lines)
    with Image.open(tmp_path / "a.png") as around, Image.open(tmp_path / "b.png") as alone:
        assert around.convert("RGBA").getpixel((0, 0))[3] == 0 and alone.convert("RGBA").getpixel((0, 0)) == (255,) * 4
    assert axes.title.get_color() == INK and lines.get_ylim()[0] == pytest.approx(1e-8)
    assert len(lines.get_yticks()) > 2


def test_a_kill_while_files_are_noted_leaves_them_ours(tmp_path, monkeypatch):
    output.claim(tmp_path, ["a.png", "b.png"])
    (tmp_path / "a.png").write_bytes(b"ours")

    class Killed(io.FileIO):
        def truncate(self, size=None):
            raise KeyboardInterrupt

    with monkeypatch.context() as patched, pytest.raises(KeyboardInterrupt):
        patched.setattr(output, "open", Killed, raising=False)
        output._note(tmp_path, ["a.png"])
    output.check_folder(tmp_path, ["a.png"])
    output.claim(tmp_path, ["a.png"])
    assert (tmp_path / ".deltalux-files").read_text() == "a.png\n"
