"""Suns and lamps: peaks of maps, their way through texel columns, and the number that a preset promises."""

from __future__ import annotations

from pathlib import Path

import deltalux as dl
import numpy as np
import oracles
import pytest
from deltalux import _core

MAPS = Path(__file__).parents[2] / "../shared/data/env"
TEXELS = dl.Haar(64, texels=True)


def one_pixel(row=70, column=200, radiance=1e4):
    """A dark sky of 256 x 512 pixels with one bright one."""
    image = np.zeros((256, 512, 3), np.float32)
    image[row, column] = radiance
    return dl.Environment.from_latlong(image)


def small(name, width):
    scene = dl.Scene.builtin(name)
    return scene.with_camera(scene.camera.resized(width, width))


@pytest.fixture(scope="module")
def still_life(tmp_path_factory):
    """Publication and lossless transports of the same receivers."""
    folder = tmp_path_factory.mktemp("still-life")
    scene = small("still-life", 40)
    return [
        dl.precompute(scene, folder / f"{quality}.transport", quality=quality, progress=False)
        for quality in ("publication", "lossless")
    ]


def relative(found, exact):
    return float(np.linalg.norm(found - exact) / np.linalg.norm(exact))


# --- peaks -----------------------------------------------------------------------------------------------------------


def test_the_sun_of_the_sky_is_one_peak():
    env = dl.Environment.builtin("sky")
    (sun,) = env.peaks()
    assert np.linalg.norm(sun.direction) == pytest.approx(1, abs=1e-12)
    assert np.degrees(np.arcsin(sun.direction[1])) == pytest.approx(38, abs=0.2)
    turned = env.rotated(90).peaks()[0]
    assert np.allclose(turned.direction, [sun.direction[2], sun.direction[1], -sun.direction[0]], atol=1e-12)
    assert env.scaled(3).peaks()[0].flux == pytest.approx([3 * x for x in sun.flux])
    assert len(env.mixed(one_pixel(), 0.5).peaks()) == 2


def test_peaks_are_sorted_and_no_more_than_asked():
    env = dl.Environment.builtin("studio")
    peaks = env.peaks(20)
    flux = [max(peak.flux) for peak in peaks]
    assert len(peaks) == 20 and flux == sorted(flux, reverse=True)
    assert env.peaks(0) == []
    for bad in (-1, 1.5, True):
        with pytest.raises(ValueError, match="expected k to be a whole number"):
            env.peaks(bad)


@pytest.mark.parametrize("name", ["sky", "studio", "hall"])
@pytest.mark.parametrize("peaks", [0, 1, 16, None])
def test_what_is_taken_out_is_not_lost(name, peaks):
    """Flux of both parts together is that of the light; in the wavelets alone nothing is brighter than before."""
    env = dl.Environment.builtin(name).rotated(33, (1, 2, 0.5))
    plain, split = dl.Haar(64).coefficients(env), TEXELS.coefficients(env, peaks)
    areas = np.tile(oracles.solid_angles(64).ravel(), 6)
    whole = _core.haar_inverse(64, plain).reshape(-1, 3)
    soft = _core.haar_inverse(64, split[:24576]).reshape(-1, 3)
    peak = split[24576:] / np.sqrt(areas)[:, None]
    assert np.allclose(areas @ (soft + peak), areas @ whole, rtol=2e-3)
    # Squares that turn against the texels are spread a little differently where more of them are spread.
    assert soft.max() <= 1.1 * whole.max()
    assert (peak >= 0).all() and ((peak > 0).any() == (peaks != 0))


def test_columns_without_texels_take_no_peaks(still_life):
    env = dl.Environment.builtin("sky")
    with pytest.raises(ValueError, match="with texels"):
        dl.Haar(8).coefficients(env, 3)
    transport = still_life[0]
    assert (transport.coefficients(env, peaks=0)[24576:] == 0).all()
    with pytest.raises(ValueError, match="whole number"):
        transport.coefficients(env, peaks=-1)


def test_names_and_bands():
    assert str(TEXELS) == "haar:64+texels" and TEXELS.columns == 49152 and TEXELS.face == 64
    assert TEXELS.band_names == (*dl.Haar(64).band_names, "texels")
    assert (TEXELS.bands[:24576] == dl.Haar(64).bands).all() and (TEXELS.bands[24576:] == 6).all()
    assert (TEXELS.areas[24576:] == 64).all()
    for bad in ("haar:+texels", "haar:6+texels", "haar:64+texel", "sh:6+texels", "haar:64+texels+texels"):
        with pytest.raises(ValueError):
            dl.precompute(small("cornell", 8), "never.transport", columns=bad)


# --- transport -------------------------------------------------------------------------------------------------------


def test_a_texel_is_a_bit_and_a_cosine(make, tmp_path):
    """Every entry of the texel columns: what a first ray says, times cos / pi times the root of the solid angle."""
    scene = small("cornell", 12)
    transport = dl.precompute(
        scene, tmp_path / "c.transport", columns="haar:8+texels", quality="preview", progress=False
    )
    receivers = transport.receivers
    directions, areas = oracles.directions(8).reshape(-1, 3), np.tile(oracles.solid_angles(8).ravel(), 6)
    full = np.maximum(receivers.normal.astype(np.float64) @ directions.T, 0) / np.pi * np.sqrt(areas)
    N = transport.to_scipy().toarray()[:, 384:]
    # Without samples of edges the wavelets are made of the same bits.
    rows = make(scene, 8).to_scipy().toarray().astype(np.float64)
    lit = np.array([_core.haar_inverse(8, np.repeat(row[:, None], 3, axis=1))[..., 0].ravel() for row in rows])
    open_ = lit / np.sqrt(areas) * areas / np.maximum(full * np.sqrt(areas), 1e-30) > 0.5
    assert np.abs(N - np.where(open_, full, 0)).max() < 1e-6
    assert np.array_equal(transport.row(5)[384:], N[5])


def test_a_sun_that_moves_moves_its_shadow_smoothly(tmp_path):
    """0.1 degrees a frame over a box on a floor: no step of a picture, or of a pixel, is twice the mean step."""
    floor, box = oracles.quad((-4, 0, -4), (8, 0, 0), (0, 0, 8)), oracles.box((-0.5, 0, -0.5), (0.5, 1, 0.5))
    camera = dl.Camera((0, 6, 6), (0, 0, 0), vertical_fov=40, width=64, height=64)
    scene = dl.Scene.from_arrays(*oracles.merged(floor, box), (1, 1, 1), camera)
    transport = dl.precompute(scene, tmp_path / "s.transport", quality="preview", progress=False)
    env = one_pixel()
    B = np.stack([transport.multiply(transport.coefficients(env.rotated(0.1 * k)))[:, 0] for k in range(120)])
    steps = np.abs(np.diff(B.astype(np.float64), axis=0))
    moved = np.linalg.norm(steps, axis=1)
    assert moved.max() < 2 * moved.mean()
    # Pixels that the edge of the shadow passes, in the frames in which it does.
    passed = np.flatnonzero(steps.sum(axis=0) > 0.5 * B.max())
    assert len(passed) > 10
    for pixel in passed:
        own = steps[:, pixel]
        assert own.max() < 2 * own[own > 1e-3 * B.max()].mean()


def test_followers_of_a_turning_sun_end_exact(still_life):
    transport, env = still_life[0], dl.Environment.builtin("sky")
    for method in (dl.PerBand(terms=30), dl.Incremental(terms=30), dl.PerBand(terms=30, weight="cost")):
        relighter = dl.Relighter(transport, method)
        for degrees in (0, 1, 2, 3):
            frame = relighter.step(env.rotated(degrees))
        while not frame.converged:
            frame = relighter.step(env.rotated(3))
        assert (frame.values == transport.multiply(relighter.values)).all()


# --- what a preset promises ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["hall", "studio"])
def test_lamps_that_move_are_followed_by_no_more_peaks_than_a_budget_holds(still_life, name):
    transport, env = still_life[0], dl.Environment.builtin(name)
    split, all_peaks = dl.Relighter(transport, dl.PerBand(100)), dl.Relighter(transport, dl.PerBand(100))
    errors = []
    for k in range(12):
        light = env.rotated(0.45 * k)
        V = transport.coefficients(light)
        exact = transport.multiply(V)
        errors.append([relative(frame.values, exact) for frame in (split.step(light), all_peaks.step(V))])
    assert np.mean(errors[1:], axis=0)[0] < 0.5 * np.mean(errors[1:], axis=0)[1]
    assert np.mean(errors[1:], axis=0)[0] < 0.015

    frames = 0
    while not (frame := split.step(light)).converged:
        frames += 1
    assert frames > 3
    assert (frame.values == transport.multiply(split.values)).all()
    # The same light as all peaks at once, but for the grid that it lies on.
    assert np.allclose(split.values, V, rtol=0, atol=1e-5 * np.abs(V).max())
    assert relative(frame.values, exact) < 1e-4
    # On the move again: few peaks again.
    assert not split.step(env.rotated(7)).converged


def test_a_budget_in_time_follows_a_sun_with_all_it_has(still_life):
    transport, env = still_life[0], dl.Environment.builtin("sky")
    relighter = dl.Relighter(transport, dl.PerBand(milliseconds=500))
    frames = [relighter.step(env.rotated(k)) for k in range(3)]
    exact = transport.multiply(transport.coefficients(env.rotated(2), 1))
    assert relative(frames[-1].values, exact) < 1e-4


def test_a_light_without_its_texels_is_the_same_light():
    env = dl.Environment.builtin("studio")
    merged = TEXELS.without_texels(TEXELS.coefficients(env))
    plain = dl.Haar(64).coefficients(env)
    assert merged.shape == plain.shape
    # A peak is spread over four texel centres, which a filtered map does otherwise: its flux is the same.
    assert np.allclose(merged[:6].sum(axis=0), plain[:6].sum(axis=0), rtol=0.01)
    assert dl.Haar(64).without_texels(plain) is plain
    with pytest.raises(ValueError, match="colours"):
        TEXELS.without_texels(plain)


def test_the_number_is_measured(still_life):
    transport, lossless = still_life
    assert set(transport.errors) == {"sky", "studio", "hall", "sun"}
    assert transport.error == max(transport.errors.values()) <= transport.plan.tolerance == 0.01
    assert transport.error > 0.008, "bytes are spent on no more than was asked for"
    for name in ("sky", "studio", "hall"):
        V = transport.coefficients(dl.Environment.builtin(name))
        found = relative(transport.multiply(V), lossless.multiply(V))
        assert found <= 1.25 * transport.error, name
    # What the texels are for: all of the light through the wavelets.
    assert transport.plan.without["sky"] > 3 * transport.errors["sky"]
    text = str(transport.plan)
    assert "measured" in text and "without texels" in text


@pytest.mark.skipif(not MAPS.exists(), reason="optional data")
@pytest.mark.parametrize("path", sorted(MAPS.glob("*.*")), ids=lambda path: path.name)
@pytest.mark.filterwarnings("ignore:.*negative")
def test_maps_that_the_code_has_not_seen(still_life, path):
    transport, lossless = still_life
    env = dl.Environment.load(path)
    for degrees in (0, 100, 200):
        V = transport.coefficients(env.rotated(degrees))
        assert relative(transport.multiply(V), lossless.multiply(V)) <= 1.25 * transport.error


def test_info_says_what_texels_hold(still_life, tmp_path, capsys):
    from deltalux.command import cli

    folder = tmp_path / "copy.transport"
    copy = still_life[0].truncated(folder, 0.05)
    assert 0 < copy.texel_bytes < copy.nbytes
    assert cli.main(["info", str(folder)]) == 0
    (line,) = (line for line in capsys.readouterr().out.splitlines() if line.split()[:1] == ["6"])
    assert line.split()[-1] == f"{copy.texel_bytes / 1e6:,.2f}"


def test_norms_and_costs_of_texels_are_those_of_their_columns(cornell_texels):
    M = abs(cornell_texels.to_scipy()).tocsc()
    norms = np.sqrt(np.asarray(M.multiply(M).sum(axis=0)).ravel())
    assert np.allclose(cornell_texels.column_norms, norms, rtol=1e-5, atol=1e-9)
    y = np.random.default_rng(3).normal(size=cornell_texels.shape[0])
    assert np.allclose(cornell_texels.rmatvec(y), cornell_texels.to_scipy().T @ y, rtol=1e-4, atol=1e-5)
    # A texel that no row sees costs nothing; one that some row sees, an entry for each group of 16 rows.
    entries = cornell_texels.column_bytes[384:] / 18
    groups = np.asarray(np.add.reduceat((M[:, 384:] > 0).toarray(), np.arange(0, M.shape[0], 16), axis=0) > 0).sum(
        axis=0
    )
    assert (entries >= groups).all() and ((entries == 0) <= (groups == 0)).all()


def test_a_truncated_copy_keeps_its_texels_and_forgets_its_numbers(still_life, tmp_path):
    transport = still_life[0]
    smaller = transport.truncated(tmp_path / "small.transport", 0.1)
    assert smaller.entries < transport.entries and smaller.columns == transport.columns
    V = np.zeros((49152, 3))
    V[24576:] = np.random.default_rng(1).normal(size=(24576, 3))
    assert np.array_equal(smaller.multiply(V), transport.multiply(V))
    assert smaller.errors == {}
    with pytest.raises(ValueError, match="no measured errors|has none"):
        _ = smaller.error


def test_columns_without_texels_tell_what_a_sun_does_to_them(tmp_path):
    transport = dl.precompute(small("cornell", 16), tmp_path / "c.transport", columns="haar:32", progress=False)
    assert transport.plan.without == {} and transport.errors["sun"] > transport.plan.tolerance
