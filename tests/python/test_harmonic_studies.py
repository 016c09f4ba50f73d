"""The studies of spherical harmonics: one M in two bases, flicker, and lights behind a blocker."""

from __future__ import annotations

import csv
import tempfile
import xml.etree.ElementTree as ElementTree

import deltalux as dl
import numpy as np
import pytest
from deltalux.light.motion import Motion
from deltalux.studies import study
from deltalux.studies.harmonics import blocker
from deltalux.studies.harmonics.flicker import Track
from deltalux.studies.harmonics.projection import HarmonicView, harmonics_in_haar


def table(path):
    with open(path, newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def page(path):
    """The page's text, parsed: well-formed XML; every file that it shows is there."""
    root = ElementTree.fromstring(path.read_text(encoding="utf-8").replace("<!DOCTYPE html>", ""))
    for image in root.iter("img"):
        assert (path.parent / image.get("src")).stat().st_size > 1000
    for link in root.iter("a"):
        assert (path.parent / link.get("href")).exists()
    return root


def verdicts(root):
    """Claims of the page, and whether they hold."""
    rows = [[cell.text for cell in row] for row in root.iter("tr")]
    return {row[1]: row[3] for row in rows if len(row) == 5 and row[3] in ("holds", "does not hold")}


# --- One M in two bases.


def test_projected_rows_are_a_dense_product(cornell, rng):
    view = HarmonicView.of(cornell, 6)
    M = cornell.to_scipy().toarray().astype(np.float64)
    np.testing.assert_allclose(view.rows, M @ view.basis, atol=1e-5 * np.abs(M).sum(axis=1).max())
    c = rng.normal(size=(36, 3))
    np.testing.assert_allclose(view.multiply(c), cornell.multiply(view.wavelets(c)), atol=1e-4)
    # Fewer coefficients are a lower order.
    low = np.where(np.arange(36)[:, None] < 9, c, 0.0)
    np.testing.assert_allclose(view.multiply(c[:9]), view.multiply(low), atol=1e-5)


def test_the_constant_light_is_the_first_harmonic_alone(cornell):
    """y_0 = 1 / sqrt(4 pi): light of 1 from everywhere is sqrt(4 pi) of it, at every order, and no basis differs."""
    view = HarmonicView.of(cornell, 5)
    V = cornell.coefficients(dl.Environment.from_cubemap(np.ones((6, 8, 8, 3))))
    np.testing.assert_allclose(view.basis[:, 0], V[:, 0] / np.sqrt(4 * np.pi), atol=1e-6)
    c = view.light(V)
    np.testing.assert_allclose(c[0], np.sqrt(4 * np.pi), rtol=1e-6)
    # What is left is the error of summing over points.
    np.testing.assert_allclose(c[1:], 0, atol=3e-4)
    np.testing.assert_allclose(view.multiply(c[:1]), cornell.multiply(V), atol=1e-5)


def test_harmonics_on_texels_are_nearly_orthonormal_and_those_of_the_core():
    """What S loses is detail within texels of 1.4 degrees: little at order 5."""
    S, columns = harmonics_in_haar(dl.Haar(64), 5), dl.SphericalHarmonics(5)
    np.testing.assert_allclose(S.T @ S, np.eye(25), atol=1e-3)
    env = dl.Environment.builtin("studio")
    ours, theirs = S.T @ dl.Haar(64).coefficients(env), columns.coefficients(env)
    assert np.linalg.norm(ours - theirs) < 2e-3 * np.linalg.norm(theirs)


def test_projected_is_traced(make, tmp_path):
    """The same scene traced in harmonics: another way through the tracer to the same rows."""
    scene = dl.Scene.builtin("cornell")
    scene = scene.with_camera(scene.camera.resized(12, 12))
    view = HarmonicView.of(make(scene, 64, "lossless"), 6)
    traced = dl.precompute(scene, tmp_path / "sh", columns="sh:6", quality="lossless", progress=False)
    expected = traced.matmat(np.eye(36))
    assert np.linalg.norm(view.rows - expected) < 3e-3 * np.linalg.norm(expected)


# --- Flicker.


def test_flicker_of_an_exact_method_is_none_and_of_an_alternating_one_known(rng):
    """Errors of +a and -a in turn: error a, flicker 2 a; the pictures' second difference is 4 a."""
    exact, a = rng.random((5, 4, 3), np.float32), 0.25
    still, alternating, off = Track(), Track(), Track()
    for k in range(6):
        still.add(exact, exact)
        alternating.add(exact * np.float32(1 + a * (-1) ** k), exact)
        off.add(2 * exact, exact)
    for series in (still.errors, still.edges, still.flicker, still.unrest, off.flicker, off.unrest):
        assert series == [0.0] * 6
    np.testing.assert_allclose(off.errors, 1)
    np.testing.assert_allclose(alternating.errors, a, rtol=1e-6)
    np.testing.assert_allclose(alternating.edges, a, rtol=1e-6)
    np.testing.assert_allclose(alternating.flicker, [0] + 5 * [2 * a], rtol=1e-6)
    np.testing.assert_allclose(alternating.unrest, [0, 0] + 4 * [4 * a], rtol=1e-6)


def test_a_picture_that_follows_evenly_has_no_unrest():
    """A ramp of pictures flickers against an exact picture that stands still, but does not jump."""
    exact, track = np.ones((2, 2, 3), np.float32), Track()
    for k in range(4):
        track.add(exact * np.float32(k), exact)
    np.testing.assert_allclose(track.flicker, [0, 1, 1, 1])
    assert track.unrest == [0.0] * 4


# --- The studies.


@pytest.fixture(scope="module")
def harmonics(cornell, tmp_path_factory):
    """Under a light that turns eight frames and stands still until PBI-SH has all of order 20."""
    env, motion = dl.Environment.builtin("studio"), Motion(10.0, frames=8, hold=17)
    return study("harmonics", tmp_path_factory.mktemp("study"), env, cornell, motion=motion, progress=False)


def test_harmonics_leaves_what_it_promises(harmonics):
    root = page(harmonics)
    kinds = ("bases.png", "moments.png", "frames.png", "terms.png", "frames.csv", "terms.csv")
    assert {path.name for path in harmonics.parent.glob("1-*")} == {f"1-studio-on-cornell-{kind}" for kind in kinds}
    assert len(verdicts(root)) == 7


def test_harmonics_figures(harmonics):
    rows = table(next(harmonics.parent.glob("*-frames.csv")))
    methods = {row["method"] for row in rows}
    errors = {name: [float(row["errors"]) for row in rows if row["method"] == name] for name in methods}
    assert all(len(series) == 25 and min(series) >= 0 for series in errors.values())
    exact = [row for row in rows if row["method"] == "exact"]
    assert all(float(row["errors"]) == float(row["edges"]) == float(row["flicker"]) == 0 for row in exact)
    assert errors["SH order 20"][-1] < errors["SH order 10"][-1] < errors["SH order 5"][-1]
    assert errors["PBI-SH-25"][-1] == errors["SH order 20"][-1] > 0
    # Haar 8 has 384 columns: four frames of a hundred.
    assert errors["PBI-100"][-1] == 0.0 < errors["PBI-100"][7]
    # Under light that stands still, linear methods stand still.
    still = [row for row in rows if int(row["frame"]) > 9 and row["method"].startswith(("SH", "NWA"))]
    assert all(float(row["flicker"]) == float(row["unrest"]) == 0 for row in still)


def test_harmonics_claims_that_hold_by_construction(harmonics):
    found = verdicts(page(harmonics))
    for mark in ("Harmonics have no exact limit", "A band that gets no term keeps its values"):
        assert [holds for claim, holds in found.items() if mark in claim] == ["holds"]


def test_terms_never_hurt_in_the_long_run(harmonics):
    rows = table(next(harmonics.parent.glob("*-terms.csv")))
    curves = {(row["basis"], int(row["terms"])): float(row["image_l2"]) for row in rows}
    for basis in ("SH", "NWA by area", "NWA by transport"):
        assert curves[basis, 400] < curves[basis, 100] < curves[basis, 4]
    assert curves["NWA by area", 400] < 1e-6


def test_harmonics_needs_a_scene(tmp_path):
    with pytest.raises(ValueError, match="expected a scene"):
        study("harmonics", tmp_path / "out", dl.Environment.builtin("hall"))
    assert not (tmp_path / "out").exists()


@pytest.fixture
def small(monkeypatch, tmp_path):
    """A small picture, and a place for temporary files that can be looked into."""
    monkeypatch.setattr(blocker, "_PICTURE", (24, 18))
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))


def test_blocker(small, tmp_path):
    found = study("blocker", tmp_path / "out", dl.Environment.builtin("studio"), progress=False)
    assert [path.name for path in tmp_path.iterdir()] == ["out"], "transports are removed"
    assert len(verdicts(page(found))) == 3
    rows = table(next(found.parent.glob("*-blocker.csv")))
    error = {(row["light"], int(row["order"]), row["windowed"] == "True"): float(row["image_l2"]) for row in rows}
    assert len(error) == 4 * 7 * 2
    for order in (5, 8, 12, 20, 30):
        assert error["0°", order, False] > error["20°", order, False] > error["40°", order, False]
    for name in ("0°", "20°", "40°"):
        assert error[name, 2, False] > error[name, 5, False] > error[name, 12, False] > error[name, 30, False]
        # The window blurs: in the norm it never helps.
        assert all(error[name, order, True] > error[name, order, False] for order in blocker._ORDERS)


def test_unshadowed_ground_shows_its_own_colour(small):
    """Flux pi / sin(elevation) from one direction makes the irradiance pi; a disc of radius r spreads it round that
    direction, and the mean of the cosine falls by (1 + cos r) / 2."""
    with blocker._traced(lambda done, total: None) as (haar, _):
        for size in (0, 20, 40):
            light = blocker._disc_light(size)
            ground = haar.image(haar.multiply(haar.coefficients(light)))[-1, 0]
            falls = (1 + np.cos(np.radians(size / 2))) / 2
            np.testing.assert_allclose(ground, np.array([0.75, 0.73, 0.70]) * falls, rtol=0.03)
