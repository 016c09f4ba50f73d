"""Choosing from Python: against a plain reading of the papers, with lights made by hand and no scene."""

from types import SimpleNamespace

import numpy as np
import pytest
from deltalux.columns import Haar, parse
from deltalux.update.approximation import Approximation
from deltalux.update.methods import Full, HarmonicOrder, Incremental, Linear, Nonlinear, PerBand
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

# The one list that a new method joins.
METHODS = [
    Full(),
    Nonlinear(terms=5),
    Linear(terms=5),
    Incremental(terms=5),
    Incremental(terms=5, weight="none", channels="separate"),
    Incremental(error=0.25),
    PerBand(terms=5),
    PerBand(terms=5, norm="l2", weight="root-area"),
    PerBand(terms=5, test="dealer"),
    PerBand(terms=5, test="exhaustive", weight="transport"),
    PerBand(terms=5, test="fixed", fixed=1),
    PerBand(terms=5, weight="cost", channels="separate"),
    HarmonicOrder(terms=5),
]
NEVER_THERE = ("Nonlinear", "Linear", "fixed='", "test='fixed'")

SPACE = SimpleNamespace(bands=np.repeat([0, 1, 2], [4, 8, 12]), areas=np.repeat([16.0, 4.0, 1.0], [4, 8, 12]))
SIZE = len(SPACE.bands)
OF_M = {"column_norms": np.linspace(0.0, 2.0, SIZE), "column_bytes": np.arange(SIZE) % 5, "band_norms": [3.0, 2.0, 1.0]}


def lights():
    """Coefficients with ties and zeros, or of wildly different size."""
    tied = arrays(np.float64, (SIZE, 3), elements=st.integers(-2, 2).map(float))
    wild = arrays(np.float64, (SIZE, 3), elements=st.floats(-1e38, 1e38))
    return tied | wild


def exact_lights():
    """Coefficients whose sums are exact in any order, so that two programs cannot differ by rounding."""
    few, many = st.integers(-2, 2), st.integers(-(2**40), 2**40)
    return st.sampled_from([few, many]).flatmap(lambda of: arrays(np.float64, (SIZE, 3), elements=of.map(float)))


def printed(values, target, space, method, terms):
    """Fig. 6.1 with the simple test, and NWA and BI in the same words. Returns the new values and the reset bands."""
    values, key, resets = values.copy(), np.zeros(len(target)), []
    for band in range(space.bands.max() + 1):
        inside = space.bands == band
        difference, light = np.abs(target - values)[inside].sum(), np.abs(target)[inside].sum()
        nearer = difference < light or difference == 0
        if method == "incremental" or (method == "per-band" and nearer):
            key[inside] = space.areas[inside] * np.abs(target - values)[inside].sum(axis=1)
        else:
            key[inside] = space.areas[inside] * np.abs(target)[inside].sum(axis=1)
            if values[inside].any():
                resets.append(band)
            values[inside] = 0.0
    chosen = np.argsort(-key, kind="stable")[:terms]
    chosen = chosen[key[chosen] > 0]
    values[chosen] = target[chosen]
    return values, resets


@settings(deadline=None, max_examples=60)
@given(before=lights(), target=lights(), method=st.sampled_from(METHODS))
def test_step_is_an_update(before, target, method):
    """Every method: what is sent is the light itself, what is not sent stays, and the changes tell it all."""
    follow = Approximation(SPACE, method, initial=before, **OF_M)
    np.testing.assert_array_equal(follow.values, before)
    update = follow.step(target)
    assert update.columns.dtype == np.uint32 and np.all(np.diff(update.columns.astype(int)) > 0)
    assert update.changes.shape == (len(update.columns), 3) and update.changes.dtype == np.float64

    after = np.where(np.isin(SPACE.bands, update.resets)[:, None], 0.0, before)
    rounding = 1e-15 * (np.abs(after) + np.abs(target))
    sent = np.zeros((SIZE, 3), bool)
    sent[update.columns] = update.changes != 0
    np.testing.assert_array_equal(follow.values, np.where(sent, target, after))
    after[update.columns] += update.changes
    assert np.all(np.abs(after - follow.values) <= rounding)


@settings(deadline=None, max_examples=60)
@given(before=lights(), target=lights(), method=st.sampled_from(METHODS))
def test_still_light_is_reached_bit_for_bit(before, target, method):
    if any(name in repr(method) for name in NEVER_THERE):
        return
    follow = Approximation(SPACE, method, initial=before, **OF_M)
    for _ in range(2 * 3 * SIZE):
        # A tolerated error may stop short of the light, but not before it.
        if not len(follow.step(target).columns):
            break
    if getattr(method, "error", None) is None:
        np.testing.assert_array_equal(follow.values, target)
        assert follow.is_converged(target)
    else:
        norms = [np.linalg.norm((target - follow.values)[SPACE.bands == band], axis=0) for band in range(3)]
        assert np.max(np.array(OF_M["band_norms"]) @ norms) <= method.error


@settings(deadline=None, max_examples=60)
@given(before=exact_lights(), frames=st.lists(exact_lights(), min_size=1, max_size=2), terms=st.integers(1, SIZE + 1))
def test_as_printed(before, frames, terms):
    makers = {"nonlinear": Nonlinear, "incremental": Incremental, "per-band": PerBand}
    for name, make in makers.items():
        follow, expected = Approximation(SPACE, make(terms=terms), initial=before), before
        for target in frames:
            update = follow.step(target)
            expected, resets = printed(expected, target, SPACE, name, terms)
            assert list(update.resets) == resets, name
            np.testing.assert_array_equal(follow.values, expected, err_msg=name)


@pytest.mark.parametrize("method", METHODS, ids=repr)
def test_bad_frames_are_refused(method):
    before = np.ones((SIZE, 3))
    follow = Approximation(SPACE, method, initial=before, **OF_M)
    for bad in (np.nan, np.inf, -np.inf, 1e200):
        target = 2 * before
        target[7, 1] = bad
        with pytest.raises(ValueError, match="column 7, colour 1"):
            follow.step(target)
    for wrong in (before[:-1], before[:, :2], before[None], before.astype(complex), before.astype(str)):
        with pytest.raises(ValueError, match=r"expected coefficients of shape \(24, 3\)"):
            follow.step(wrong)
    np.testing.assert_array_equal(follow.values, before)


def test_any_memory_layout():
    target = np.arange(SIZE * 3, dtype=np.float32).reshape(3, SIZE).T
    follow = Approximation(SPACE, Full())
    follow.step(target)
    np.testing.assert_array_equal(follow.values, target)


@pytest.mark.parametrize("make", [Nonlinear, Incremental, PerBand, HarmonicOrder])
@pytest.mark.parametrize("terms", [0, 1, 10**30])
def test_budgets_of_none_one_and_all(make, terms):
    before, target = np.ones((SIZE, 3)), np.full((SIZE, 3), -1.0)
    follow = Approximation(SPACE, make(terms=terms), initial=before)
    update = follow.step(target)
    assert len(update.columns) == min(terms, SIZE)
    if terms == 0 and make is not Nonlinear:
        np.testing.assert_array_equal(follow.values, before)
    if terms > SIZE:
        np.testing.assert_array_equal(follow.values, target)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: PerBand(), "expected one budget .* got none"),
        (lambda: PerBand(terms=3, error=0.1), "got terms and error"),
        (lambda: PerBand(terms=-1), "0 or more, got -1"),
        (lambda: PerBand(terms=2.5), "got 2.5"),
        (lambda: PerBand(terms=True), "got True"),
        (lambda: PerBand(terms=3, test="clever"), "'dealer'.*got 'clever'"),
        (lambda: PerBand(terms=3, norm="l3"), "got 'l3'"),
        (lambda: PerBand(terms=3, weight="colour"), "got 'colour'"),
        (lambda: PerBand(terms=3, channels="both"), "got 'both'"),
        (lambda: PerBand(terms=3, test="fixed"), "fixed=None"),
        (lambda: PerBand(terms=3, fixed=2), "fixed=2"),
        (lambda: PerBand(error=0.1, test="dealer"), "expected terms= or milliseconds="),
        (lambda: Incremental(error=float("nan")), "got nan"),
        (lambda: HarmonicOrder(tolerance=-1.0), "got -1.0"),
        (lambda: Approximation(SPACE, "pbi"), "got 'pbi'"),
        (lambda: Approximation(SPACE, PerBand(milliseconds=1.0)), "needs a Relighter"),
        (lambda: Approximation(SPACE, PerBand(error=1.0)), "needs band_norms"),
        (lambda: Approximation(SPACE, PerBand(error=1.0), band_norms=[1.0]), "expected 3 band factors, got 1"),
        (lambda: Approximation(SPACE, PerBand(terms=1, weight="transport")), "needs column_norms"),
        (lambda: Approximation(SPACE, PerBand(terms=1, weight="cost"), column_norms=np.ones(SIZE)), "column_bytes"),
        (lambda: Approximation(SPACE, PerBand(terms=1), column_norms=np.ones(3)), r"\(24,\), got \(3,\)"),
        (lambda: Approximation(SPACE, Full(), initial=np.full((SIZE, 3), np.nan)), "got NaN in column 0"),
        (lambda: Approximation(SimpleNamespace(bands=[1, 0], areas=[1, 1]), Full()), "in order of their bands"),
        (lambda: Approximation(SimpleNamespace(bands=[0, 0], areas=[1]), Full()), "of one length"),
        (lambda: Haar(48), "power of two"),
        (lambda: Haar(0), "at least 1 texel"),
        (lambda: Haar("64"), "whole number"),
        (lambda: parse("haar:x"), "expected columns like"),
        (lambda: parse("sh:"), "expected columns like"),
    ],
)
def test_bad_settings_say_what_was_expected(make, message):
    with pytest.raises(ValueError, match=message):
        make()


def test_haar_columns():
    columns = Haar(64)
    assert str(columns) == "haar:64" and parse("haar:64") == columns and columns.columns == 24_576
    # METHODS D1: 24, 72, 288, 1152, 4608, 18432 wavelets of area 4096 down to 4.
    np.testing.assert_array_equal(np.bincount(columns.bands), [24, 72, 288, 1152, 4608, 18432])
    np.testing.assert_array_equal(columns.areas, 4096.0 / 4.0**columns.bands)
    assert columns.band_names == ("4,096", "1,024", "256", "64", "16", "4") and Haar(1).band_names == ("1",)
    with pytest.raises(ValueError, match="read-only"):
        columns.bands[0] = 1


def test_nine_frames():
    """256 coefficients at 30 a frame: exact in ceil(256 / 30) = 9 frames (Overbeck 2006, section 4.2)."""
    space = SimpleNamespace(bands=np.zeros(256, int), areas=np.ones(256))
    target = np.random.default_rng(1).normal(size=(256, 3))
    follow = Approximation(space, Incremental(terms=30))
    there = [follow.step(target) and follow.is_converged(target) for _ in range(9)]
    assert there == [False] * 8 + [True]


# A rotating light, with no scene: many small lamps over a cubemap, projected to the plain orthonormal Haar basis.

FACES = np.array(
    [
        [[0, 0, -1], [0, -1, 0], [1, 0, 0]],
        [[0, 0, 1], [0, -1, 0], [-1, 0, 0]],
        [[1, 0, 0], [0, 0, 1], [0, 1, 0]],
        [[1, 0, 0], [0, 0, -1], [0, -1, 0]],
        [[1, 0, 0], [0, -1, 0], [0, 0, 1]],
        [[-1, 0, 0], [0, -1, 0], [0, 0, -1]],
    ]
)


def lamps(size, degrees):
    """Radiance of 60 lamps of many sizes and powers after a turn about +Y: (6, size, size, 3)."""
    random = np.random.default_rng(2)
    centres = random.normal(size=(60, 3))
    centres /= np.linalg.norm(centres, axis=1, keepdims=True)
    sharpness, power = np.exp(random.uniform(2, 8, 60)), np.exp(random.normal(0, 1.5, (60, 3)))
    turn = np.radians(degrees)
    c, s = np.cos(turn), np.sin(turn)
    centres = centres @ np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]).T

    along = 2 * (np.arange(size) + 0.5) / size - 1
    t, u = np.meshgrid(along, along, indexing="ij")
    wi = np.einsum("hwk,fkx->fhwx", np.stack([u, t, np.ones_like(u)], axis=-1), FACES)
    wi /= np.linalg.norm(wi, axis=-1, keepdims=True)
    return np.exp(sharpness * (wi @ centres.T - 1)) @ power + 0.05


def haar(cubemap):
    """Non-standard orthonormal Haar, band-major: face by face, block by block, then h, d, v."""
    bands, ll = [], cubemap
    while ll.shape[1] > 1:
        a, b, c, d = ll[:, ::2, ::2], ll[:, ::2, 1::2], ll[:, 1::2, ::2], ll[:, 1::2, 1::2]
        details = np.stack([a - b + c - d, a - b - c + d, a + b - c - d], axis=3) / 2
        bands.append(details.reshape(-1, 3))
        ll = (a + b + c + d) / 2
    return np.concatenate([ll.reshape(-1, 3), *bands[::-1]])


@pytest.fixture(scope="module")
def rotation():
    """V over 30 frames of 0.45 degrees each, eased in and out, then 25 frames at rest."""
    time = np.linspace(0, 1, 30)
    angles = 13.5 * time**2 * (3 - 2 * time)
    moving = [haar(lamps(32, angle)) for angle in angles]
    return moving + [moving[-1]] * 25


def mean_errors(space, method, frames):
    """Relative area-weighted L1 error of every frame."""
    follow, errors = Approximation(space, method, initial=frames[0]), []
    for target in frames:
        follow.step(target)
        errors.append((space.areas @ np.abs(target - follow.values)).sum() / (space.areas @ np.abs(target)).sum())
    return np.array(errors)


def test_per_band_follows_a_rotation_best(rotation):
    """The papers' claim (Fig. 6.2) at a moderate speed.

    PBI is below BI of its budget, below NWA of twice it, and nearer and nearer to a light that rests; the three tests
    agree within a few per cent; the coarsest band is never reset.
    """
    space = Haar(32)
    moving = slice(1, 30)
    pbi = mean_errors(space, PerBand(terms=30), rotation)
    assert pbi[moving].mean() < mean_errors(space, Incremental(terms=30), rotation)[moving].mean()
    assert pbi[moving].mean() < mean_errors(space, Nonlinear(terms=60), rotation)[moving].mean()
    assert pbi[-1] < mean_errors(space, Nonlinear(terms=300), rotation)[-1]
    assert np.all(np.diff(pbi[30:]) < 0)
    for test in ("dealer", "exhaustive"):
        assert mean_errors(space, PerBand(terms=30, test=test), rotation).mean() == pytest.approx(pbi.mean(), rel=0.05)

    follow = Approximation(space, PerBand(terms=30), initial=rotation[0])
    assert not any(0 in follow.step(target).resets for target in rotation)


def test_per_band_on_a_rotation_is_as_printed(rotation):
    """Frame by frame against the page, at a real size and a speed at which bands are reset."""
    space, values, resets = Haar(32), rotation[0], 0
    follow = Approximation(space, PerBand(terms=30), initial=values)
    for target in rotation[:30:4]:
        update = follow.step(target)
        values, expected = printed(values, target, space, "per-band", 30)
        assert list(update.resets) == expected
        np.testing.assert_array_equal(follow.values, values)
        resets += len(expected)
    assert resets > 0


def test_harmonic_order_keeps_what_it_does_not_send():
    """METHODS X6: bands without a term are no-ops; low bands go first however large the high ones are."""
    order = 20
    degree = np.repeat(np.arange(order), 2 * np.arange(order) + 1)
    space = SimpleNamespace(bands=degree, areas=np.ones(order * order))
    random = np.random.default_rng(3)
    start, target = random.normal(size=(2, order * order, 3))
    target[degree > 3] *= 100
    follow = Approximation(space, HarmonicOrder(terms=25, tolerance=0.0), initial=start)
    update = follow.step(target)
    np.testing.assert_array_equal(update.columns, np.arange(25))
    np.testing.assert_array_equal(follow.values[25:], start[25:])
    for _ in range(15):
        assert follow.step(target).resets == ()
    assert follow.is_converged(target)
