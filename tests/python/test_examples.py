"""The examples are part of the manual: they run, on a small model under a small light, and leave what they promise."""

import runpy
import sys
from pathlib import Path

import deltalux as dl
import numpy as np
import pytest
from deltalux.io import load_image, save_image

EXAMPLES = Path(__file__).parents[2] / "python" / "examples"
if not EXAMPLES.exists():
    pytest.skip("needs the source tree", allow_module_level=True)


@pytest.fixture
def model(tmp_path):
    """A ball on a plate, as a GLB."""
    import trimesh

    ball = trimesh.creation.icosphere(subdivisions=2)
    plate = trimesh.creation.box((6, 0.2, 6)).apply_translation((0, -1.2, 0))
    path = tmp_path / "ball.glb"
    trimesh.Scene([ball, plate]).export(path)
    return path


@pytest.fixture
def light(tmp_path):
    """A bright half and a dim half, 32 x 16 pixels, as HDR."""
    path = tmp_path / "light.hdr"
    save_image(path, np.where(np.arange(32)[None, :, None] < 16, 2.0, 0.125) * np.ones((16, 1, 3), np.float32))
    return path


def run(monkeypatch, name, *arguments):
    monkeypatch.setattr(sys, "argv", [name, *map(str, arguments)])
    runpy.run_path(str(EXAMPLES / name), run_name="__main__")


@pytest.mark.parametrize("kind", ["png", "exr"])
def test_relight_hdri(tmp_path, monkeypatch, capsys, model, light, kind):
    out = tmp_path / "frames"
    options = ["--size", "32x24", "--columns", "haar:8", "--frames", 4, "--hold", 12, "--degrees", 90]
    run(monkeypatch, "relight_hdri.py", model, light, out, *options, *["--exr"] * (kind == "exr"))
    frames = sorted(out.glob(f"frame-*.{kind}"))
    assert len(frames) == 16 and capsys.readouterr().out.rstrip().endswith("exact")
    first, last = (load_image(path)[0] for path in (frames[0], frames[-1]))
    assert first.shape == (24, 32, 3) and np.abs(first - last).max() > 0.05

    # Where it stands still at last, it is the product under the light as turned.
    transport = dl.Transport.open(out / "ball-32x24-preview.transport")
    env = dl.Environment.load(light).rotated(90)
    if kind == "exr":
        # V lies on another grid than that of a single product: a few parts in ten million.
        expected = transport.image(transport.multiply(transport.coefficients(env)), env)
        np.testing.assert_allclose(last, expected, atol=1e-5)
    # A second run finds the transport.
    run(monkeypatch, "relight_hdri.py", model, light, out, *options)


def test_data_set(tmp_path, monkeypatch, model, light):
    out = tmp_path / "set.npz"
    run(monkeypatch, "data_set.py", model, out, light, "--count", 11, "--size", "20x16", "--columns", "sh:3")
    with np.load(out) as found:
        images, lights, mask, albedo = (found[name] for name in ("images", "lights", "mask", "albedo"))
        assert str(found["columns"]) == "sh:3"
    assert images.shape == (11, 16, 20, 3) and lights.shape == (11, 9, 3)
    assert mask.shape == (16, 20) and 0 <= mask.min() < 0.5 and mask.max() == 1
    assert albedo.shape == (16, 20, 3) and (albedo[mask == 0] == 0).all() and (images[:, mask == 0] == 0).all()
    assert len(np.unique(images.sum(axis=(1, 2, 3)))) == 11

    # Pictures are linear in their lights: ten pictures of nine coefficients a colour foretell the eleventh.
    weights = np.linalg.lstsq(lights[:10, :, 0].T.astype(float), lights[10, :, 0].astype(float), rcond=None)[0]
    foretold = np.tensordot(weights, images[:10, ..., 0], axes=1)
    np.testing.assert_allclose(foretold, images[10, ..., 0], atol=2e-3 * images.max())


def test_own_method(monkeypatch, capsys, model, light):
    run(monkeypatch, "own_method.py", model, light, "--size", "16x16", "--columns", "haar:8", "--terms", 12)
    head, *rows = capsys.readouterr().out.splitlines()
    assert head.split()[:2] == ["image", "error"]
    assert [row.split("(")[0] for row in rows] == ["Nonlinear", "Incremental", "PerBand", "Energy"]
    assert all(row.endswith("yes") for row in rows)


def test_data_set_without_a_light_takes_the_built_in_ones(tmp_path, monkeypatch, model):
    run(monkeypatch, "data_set.py", model, tmp_path / "set.npz", "--count", 1, "--size", "8x8", "--columns", "sh:2")
    with np.load(tmp_path / "set.npz") as found:
        assert found["images"].max() > 0
