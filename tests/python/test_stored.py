"""What version 0.1.0 computed and wrote: the same inputs give the same bits, and its files are read for good."""

from __future__ import annotations

from pathlib import Path

import deltalux as dl
import numpy as np
import pytest

STORED = Path(__file__).parent / "stored"
"""Made by 0.1.0 itself: a transport of its own format, and some rows, products, pictures and frames."""

METHODS = [dl.PerBand(terms=30), dl.Incremental(terms=10, weight="cost"), dl.Nonlinear(terms=50)]
SCENES = {
    "cornell": ((24, 24), dl.Haar(8), "lossless", METHODS),
    "plant": ((20, 15), dl.Haar(16), "publication", METHODS),
    "street": ((16, 16), dl.SphericalHarmonics(5), "preview", [*METHODS, dl.HarmonicOrder(terms=5)]),
}


def seen(name: str, size: tuple[int, int]) -> dl.Scene:
    scene = dl.Scene.builtin(name)
    return scene.with_camera(scene.camera.resized(*size))


MEANT = {"preview": 0.05, "publication": 0.012, "lossless": 0.0}


@pytest.fixture(scope="module")
def stored():
    return np.load(STORED / "0.1.0.npz")


@pytest.mark.parametrize("name", SCENES)
def test_the_same_inputs_give_the_bits_of_0_1_0(stored, name, tmp_path):
    size, columns, quality, methods = SCENES[name]
    path = tmp_path / "a.transport"
    # The number that a preset meant then.
    scene, tolerance = seen(name, size), MEANT[quality]
    transport = dl.precompute(scene, path, columns=columns, quality=quality, tolerance=tolerance, progress=False)
    assert transport.shape == tuple(stored[f"{name}-shape"])
    rows = np.linspace(0, transport.shape[0] - 1, 6).astype(int)

    def same(what, found):
        np.testing.assert_array_equal(found, stored[f"{name}-{what}"], err_msg=what)

    # NumPy makes the light, and its functions differ in their last bits between processors (AVX-512): a coefficient may
    # round to the next step of its grid, and a value to its neighbour.
    def alike(what, found, rtol):
        np.testing.assert_allclose(found, stored[f"{name}-{what}"], rtol=rtol, err_msg=what)

    env = dl.Environment.builtin("hall")
    B = transport.multiply(transport.coefficients(env))
    same("rows", np.stack([transport.row(int(row)) for row in rows]))
    alike("product", B[rows], 2e-7)
    # The light behind is looked up in f32 since 0.3: a hundredth of a pixel of its map.
    picture = transport.image(B, env)[::5, ::5]
    np.testing.assert_allclose(picture, stored[f"{name}-picture"], rtol=1e-3, err_msg="picture")
    for k, method in enumerate(methods):
        relighter = dl.Relighter(transport, method)
        for degrees in (0, 3, 7, 40):
            frame = relighter.step(env.rotated(degrees))
        alike(f"frame-{k}", frame.values[rows], 2e-7)
        alike(f"bound-{k}", frame.bound, 1e-9)
        same(f"columns-{k}", frame.columns)


def test_a_file_of_version_1_is_read_as_one_part(tmp_path):
    old = dl.Transport.open(STORED / "version1.transport")
    assert old.version == (1, 0) and (old.channels, old.factors) == (1, 1)
    new = dl.precompute(
        seen("cornell", (12, 12)),
        tmp_path / "new.transport",
        columns="haar:4",
        quality="preview",
        tolerance=0.05,
        progress=False,
    )
    assert new.version == (2, 3) and new.camera == old.camera and new.shape == old.shape
    np.testing.assert_array_equal(new.to_scipy().toarray(), old.to_scipy().toarray())
    for name in ("pixel", "weight", "background", "albedo", "position", "normal", "material"):
        np.testing.assert_array_equal(getattr(new.pixels, name), getattr(old.pixels, name))

    # Its plan told of one part in keys of its own.
    (part,) = old.plan.parts
    assert (part.name, part.rows, part.columns, part.channels) == ("direct", old.shape[0], "haar:4", 1)
    assert old.plan.scene == "cornell" and any("bounces" in reason.what for reason in old.plan.left_out)
    assert "left out" in str(old.plan)

    # And it is written as today's.
    smaller = old.truncated(tmp_path / "smaller.transport", 0.2)
    assert smaller.version == (2, 3) and smaller.nbytes < old.nbytes


def test_a_file_of_a_later_version_is_refused(tmp_path):
    path = tmp_path / "later.transport"
    path.mkdir()
    for entry in (STORED / "version1.transport").iterdir():
        text = entry.read_bytes()
        (path / entry.name).write_bytes(text.replace(b"1,\n    0", b"5,\n    0") if entry.suffix == ".json" else text)
    with pytest.raises(dl.FileError, match="version 1 to 4 of the format, found version 5"):
        dl.Transport.open(path)
