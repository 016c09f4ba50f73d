"""Spherical harmonics: against scipy, as columns of an environment and of a transport, and in PBI."""

import deltalux as dl
import numpy as np
import pytest
import scipy.special
from deltalux import Environment, SphericalHarmonics
from deltalux.columns import parse
from deltalux.rotation import rotation_matrix
from deltalux.sphere import face_directions
from hypothesis import given, settings
from hypothesis import strategies as st


def directions(count, seed=0):
    d = np.random.default_rng(seed).normal(size=(count, 3))
    d /= np.linalg.norm(d, axis=1, keepdims=True)
    # The poles and the axes, where angles are not defined.
    return np.concatenate([d, np.eye(3), -np.eye(3)])


def of_scipy(order, d):
    """scipy's complex functions, which carry the Condon-Shortley sign, as our real ones; polar axis +Z."""
    theta, phi = np.arccos(np.clip(d[:, 2], -1, 1)), np.arctan2(d[:, 1], d[:, 0])
    y = scipy.special.sph_harm_y_all(order - 1, order - 1, theta, phi)
    columns = []
    for degree in range(order):
        for m in range(-degree, degree + 1):
            both = np.sqrt(2) * (-1) ** m * y[degree, abs(m)]
            columns.append(both.real if m > 0 else both.imag if m < 0 else y[degree, 0].real)
    return np.stack(columns, axis=-1)


def smooth_light(order, seed):
    """Coefficients of a positive light of an order that falls with the degree, as natural light does."""
    V = np.random.default_rng(seed).normal(size=(order**2, 3)) / (1.0 + SphericalHarmonics(order).bands[:, None]) ** 2
    V[0] = 8.0
    return V


def cubemap(V):
    """The light of coefficients, six faces of 64 x 64: nearly its average over each texel, from four points."""
    fine = SphericalHarmonics(int(np.sqrt(len(V)))).evaluate(face_directions(128)) @ V
    return fine.reshape(6, 64, 2, 64, 2, 3).mean(axis=(2, 4))


@pytest.mark.parametrize("order", [1, 2, 5, 20, 30])
def test_against_scipy(order):
    d = directions(200)
    np.testing.assert_allclose(SphericalHarmonics(order).evaluate(d), of_scipy(order, d), rtol=0, atol=1e-12)


def test_columns():
    columns = SphericalHarmonics(20)
    assert str(columns) == "sh:20" and parse("sh:20") == columns and columns.columns == 400
    np.testing.assert_array_equal(np.bincount(columns.bands), 2 * np.arange(20) + 1)
    np.testing.assert_array_equal(columns.areas, np.ones(400))
    # Nothing vanishes from degree 18 on.
    norms = np.linalg.norm(columns.evaluate(directions(500)), axis=0) / np.sqrt(506 / (4 * np.pi))
    assert norms.min() > 0.8 and norms.max() < 1.25


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: SphericalHarmonics(0), "at least 1, got 0"),
        (lambda: SphericalHarmonics(31), "from 1 to 30, got 31"),
        (lambda: SphericalHarmonics(2.5), "whole number, got 2.5"),
        (lambda: parse("sh:31"), "from 1 to 30"),
        (lambda: parse("sh:"), "expected columns like"),
        (lambda: SphericalHarmonics(2).project(np.ones((6, 3, 3, 3))), "even cubemap face"),
        (lambda: SphericalHarmonics(2).project(np.ones((5, 4, 4, 3))), r"\(6, n, n, 3\)"),
        (lambda: SphericalHarmonics(2).evaluate([0.0, 0.0, 0.0]), "other than"),
        (lambda: SphericalHarmonics(2).evaluate([1.0, 0.0]), r"\(\.\.\., 3\)"),
        (lambda: SphericalHarmonics(2).rotated(np.ones((5, 3)), 10), r"\(4, 3\), got \(5, 3\)"),
        (lambda: SphericalHarmonics(2).windowed(np.ones((4, 3)), 0.0), "width above 0"),
        (lambda: dl.Linear(), "expected one budget"),
    ],
)
def test_bad_input_says_what_was_expected(make, message):
    with pytest.raises(ValueError, match=message):
        make()


@settings(deadline=None, max_examples=20)
@given(
    seed=st.integers(0, 1000),
    degrees=st.floats(-400, 400),
    axis=st.sampled_from(["x", "y", "z", (1.0, -2.0, 0.5)]),
    order=st.integers(1, 12),
)
def test_rotation_is_that_of_the_environment(seed, degrees, axis, order):
    """The light from d after the turn is the light from R^-1 d before it, as `Environment.rotated` has it."""
    columns, V = SphericalHarmonics(order), smooth_light(order, seed)
    turned = columns.rotated(V, degrees, axis)
    d = directions(20, seed)
    before = columns.evaluate(d @ rotation_matrix(degrees, axis)) @ V
    np.testing.assert_allclose(columns.evaluate(d) @ turned, before, atol=1e-12)


def test_projection_finds_the_coefficients_of_a_cubemap():
    columns, V = SphericalHarmonics(6), smooth_light(6, 1)
    env = Environment.from_cubemap(cubemap(V))
    np.testing.assert_allclose(columns.project(cubemap(V)), V, atol=5e-3)
    np.testing.assert_array_equal(columns.coefficients(env), columns.project(env.cubemap(64)))


def test_environments_are_linear_and_turn():
    columns = SphericalHarmonics(8)
    a, b = Environment.builtin("studio"), Environment.builtin("sky")
    mixed = a.rotated(30, "x").mixed(b.rotated(200).rotated(40, "z"), 0.25)
    turned = columns.rotated(columns.rotated(columns.coefficients(b), 200), 40, "z")
    expected = 0.75 * columns.rotated(columns.coefficients(a), 30, "x") + 0.25 * turned
    np.testing.assert_allclose(columns.coefficients(mixed), expected, atol=1e-12 * np.abs(expected).max())


def test_rotate_then_project_is_project_then_rotate():
    """Up to what resampling a rotated map blurs: little for a smooth light, texels' worth for a hall of small lamps."""
    columns, smooth = SphericalHarmonics(10), Environment.from_cubemap(cubemap(smooth_light(6, 2)))
    for env, blur in ((smooth, 1e-3), (Environment.builtin("hall"), 0.02)):
        np.testing.assert_array_equal(columns.coefficients(env), columns.project(env.cubemap(64)))
        for degrees in (72, 144, 216, 288):
            turned = env.rotated(degrees, (1, 2, 3))
            V, direct = columns.coefficients(turned), columns.project(turned.cubemap(64))
            assert np.linalg.norm(V - direct) < blur * np.linalg.norm(V)


def test_lower_orders_are_first_columns():
    env = Environment.builtin("sky")
    np.testing.assert_array_equal(
        SphericalHarmonics(20).coefficients(env)[:25], SphericalHarmonics(5).coefficients(env)
    )


# --- With a transport.


@pytest.fixture(scope="module")
def transports(tmp_path_factory):
    """A blocker over a floor, in both bases, without truncation."""
    vertices = [[-3, 0, -3], [3, 0, -3], [3, 0, 3], [-3, 0, 3], [-1, 1, -1], [1, 1, -1], [1, 1, 1], [-1, 1, 1]]
    triangles = [[0, 2, 1], [0, 3, 2], [4, 6, 5], [4, 7, 6]]
    camera = dl.Camera((0, 4, 6), (0, 0, 0), width=20, height=16)
    scene = dl.Scene.from_arrays(vertices, triangles, camera=camera)
    folder = tmp_path_factory.mktemp("harmonics")
    return {
        columns: dl.precompute(scene, folder / columns[:2], columns=columns, quality="lossless", progress=False)
        for columns in ("sh:20", "haar:64")
    }


def test_harmonics_and_haar_give_the_same_picture(transports):
    """Under a light of order 10 both are the same integral: M's rows beyond order 20 meet no light."""
    V = smooth_light(10, 4)
    env = Environment.from_cubemap(cubemap(V))
    harmonic, haar = transports["sh:20"], transports["haar:64"]
    assert harmonic.columns == SphericalHarmonics(20) and harmonic.shape == (haar.shape[0], 400)
    expected = haar.multiply(haar.coefficients(env))
    np.testing.assert_allclose(harmonic.multiply(harmonic.coefficients(env)), expected, atol=2e-4 * expected.max())


def test_pbi_for_harmonics(transports):
    """25 columns of 400 follow a turning light nearly as well as the linear 10th order, and arrive exactly."""
    transport, env = transports["sh:20"], Environment.builtin("hall")
    frames = [transport.coefficients(light) for light in dl.sequences.rotation(env, 20.0, 20)]
    errors = {}
    for method in (dl.HarmonicOrder(terms=25, tolerance=5e-4), dl.Linear(terms=25), dl.Linear(terms=100)):
        relighter = dl.Relighter(transport, method)
        error = []
        for V in frames:
            exact = transport.multiply(V)
            error.append(np.linalg.norm(relighter.step(V).values - exact) / np.linalg.norm(exact))
        errors[method] = np.mean(error[1:])
        if isinstance(method, dl.HarmonicOrder):
            for _ in range(16):
                last = relighter.step(frames[-1])
            assert last.converged
            np.testing.assert_array_equal(last.values, transport.multiply(relighter.values))
            np.testing.assert_allclose(relighter.values, frames[-1], atol=1e-6)
        else:
            np.testing.assert_array_equal(relighter.values[method.terms :], 0.0)
    pbi, fifth, tenth = errors.values()
    assert tenth < fifth and pbi < fifth and pbi < 2 * tenth


def test_untouched_bands_keep_their_values():
    """METHODS T10: Fig. 8.1 taken literally would zero the bands that get no term."""
    columns, env = SphericalHarmonics(20), Environment.builtin("hall")
    before, after = columns.coefficients(env), columns.coefficients(env.rotated(3))
    follow = dl.Approximation(columns, dl.HarmonicOrder(terms=25, tolerance=5e-4), initial=before)
    update = follow.step(after)
    assert len(update.columns) == 25 and update.resets == ()
    untouched = np.setdiff1d(np.arange(400), update.columns)
    np.testing.assert_array_equal(follow.values[untouched], before[untouched])
    assert len(np.setdiff1d(np.arange(20), columns.bands[update.columns])) > 0
    for _ in range(15):
        follow.step(after)
    assert follow.is_converged(after)


def test_window_takes_ringing_away():
    """A small lamp at order 5: its negative lobes shrink, its flux stays."""
    columns = SphericalHarmonics(5)
    V = columns.evaluate([0.0, 1.0, 0.0])[:, None] * np.ones(3)
    soft, d = columns.windowed(V), directions(2000)
    ringing = [(columns.evaluate(d) @ light)[:, 0].min() for light in (V, soft)]
    assert ringing[0] < 0 and ringing[1] > 0.5 * ringing[0]
    np.testing.assert_array_equal(soft[0], V[0])
