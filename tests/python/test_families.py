"""Families against the formulas of their models, their errors and borders; the paper's basis against plain numpy."""

from __future__ import annotations

import math

import deltalux as dl
import numpy as np
import pytest
from deltalux import brdf
from deltalux.studies.reflectance.family_findings import RANGES, albedo, printed_albedo
from hypothesis import given
from hypothesis import strategies as st

# Largest difference of the peak and of the energy over parameters held out, percent, at six live functions and three
# segments, as the prototype found them (Lafortune's as Ashikhmin and Shirley's).
PROTOTYPE = {
    "blinn-phong": (0.012, 0.028),
    "ward": (0.20, 0.36),
    "ward-duer": (0.20, 0.36),
    "lafortune": (0.013, 0.029),
    "cook-torrance": (0.34, 0.17),
    "ashikhmin-shirley": (0.013, 0.029),
}
# RMS of the paper's basis of seven, the worst parameter.
PAPERS_RMS = {"blinn-phong": 3.7e-3, "ward": 2.5e-2, "cook-torrance": 4.5e-2}


def formula(model, gamma, delta):
    """f_E as METHODS prints it."""
    cosine, tangent = np.cos(delta), np.tan(delta)
    return {
        "blinn-phong": lambda: (gamma + 2) * (gamma + 4) / (8 * np.pi * (2 ** (-gamma / 2) + gamma)) * cosine**gamma,
        "ward": lambda: np.exp(-((tangent / gamma) ** 2)) / (4 * np.pi * gamma**2),
        "ward-duer": lambda: np.exp(-((tangent / gamma) ** 2)) / (4 * np.pi * gamma**2),
        "lafortune": lambda: (gamma + 2) / (2 * np.pi) * cosine**gamma,
        "cook-torrance": lambda: np.exp(-((tangent / gamma) ** 2)) / (np.pi * gamma**2 * cosine**4),
        "ashikhmin-shirley": lambda: (gamma + 1) / (8 * np.pi) * cosine**gamma,
    }[model]()


@pytest.fixture(scope="module")
def six():
    """Six live functions of three segments, of all models."""
    return {model: dl.Family(model, ends, live=6, segments=3) for model, ends in RANGES.items()}


# One line for a new model: its formula above.
@pytest.mark.parametrize("model", RANGES)
def test_what_is_edited_is_the_models_own(six, model):
    delta = np.linspace(0, 1.5, 301)
    for gamma in np.geomspace(*RANGES[model], 7).clip(*RANGES[model]):
        np.testing.assert_allclose(
            six[model].exact(gamma, delta), formula(model, gamma, delta), rtol=1e-11, atol=1e-200
        )


@pytest.mark.parametrize("model", RANGES)
def test_edited_and_fixed_factors_make_the_model(six, model):
    """f = f_E f_F, against the models that are checked to 50 digits."""
    rng = np.random.default_rng(1)
    wi, wo = (w / np.linalg.norm(w, axis=1, keepdims=True) for w in np.abs(rng.normal(size=(2, 200, 3))))
    h = (wi + wo) / np.linalg.norm(wi + wo, axis=1, keepdims=True)
    low, high = RANGES[model]
    gamma = math.sqrt(low * high)
    vh, both = (h * wo).sum(axis=1), np.stack([wi[:, 2], wo[:, 2]])
    masked = np.minimum(1, 2 * h[:, 2] * both.min(axis=0) / vh)
    whole, fixed = {
        "blinn-phong": (brdf.BlinnPhong, 1),
        "ward": (brdf.Ward, both.prod(axis=0) ** -0.5),
        "ward-duer": (brdf.WardDuer, 1 / both.prod(axis=0)),
        "lafortune": (brdf.Phong, 1),
        "cook-torrance": (brdf.CookTorrance, masked / (4 * both.prod(axis=0))),
        "ashikhmin-shirley": (brdf.AshikhminShirley, 1 / (vh * both.max(axis=0))),
    }[model]
    cosine = (wi * wo * (-1, -1, 1)).sum(axis=1) if model == "lafortune" else h[:, 2]
    delta = np.arccos(cosine.clip(0, 1))
    np.testing.assert_allclose(
        six[model].exact(gamma, delta) * fixed, whole(gamma).evaluate(wi, wo), rtol=1e-9, atol=1e-13
    )


@pytest.mark.parametrize("model", RANGES)
def test_six_functions_of_three_segments(six, model):
    """Within 0.4 % in both norms, and at most a fifth above what the prototype reached."""
    family, (peak, energy) = six[model], PROTOTYPE[model]
    assert (family.live, family.segments) == (6, 3)
    assert max(family.errors[:2]) <= 0.004
    assert 100 * family.errors.peak <= 1.2 * peak and 100 * family.errors.energy <= 1.2 * energy
    # The paper's seven functions are worse by far.
    even = dl.Family.even(model, RANGES[model])
    assert max(even.errors[:2]) > 20 * max(family.errors[:2])


@pytest.mark.parametrize("model", RANGES)
def test_nothing_jumps_at_a_border(six, model):
    family, delta = six[model], np.linspace(0, math.pi / 2, 3001)
    assert len(family.borders) == 4 and family.range == RANGES[model]
    for border in family.borders:
        exact = family.exact(border, delta)
        # Lines between the angles of the table are all that is off.
        np.testing.assert_allclose(family.evaluate(border, delta), exact, rtol=0, atol=4e-4 * exact.max())
    for border in family.borders[1:-1]:
        below, above = (family.evaluate(at, delta) for at in (border, np.nextafter(border, np.inf)))
        assert np.abs(above - below).max() <= 1e-6 * below.max()


@given(st.sampled_from(sorted(RANGES)), st.floats(0, 1), st.lists(st.floats(0, math.pi / 2), min_size=1, max_size=20))
def test_any_parameter_and_angle(six, model, share, angles):
    """Held against the formula where no parameter or angle is one that the family was made or measured at."""
    low, high = RANGES[model]
    gamma, delta = min(max(low * (high / low) ** share, low), high), np.array(angles)
    family = six[model]
    found = family.evaluate(gamma, delta)
    peak = family.exact(gamma, np.linspace(0, math.pi / 2, 2001)).max()
    assert np.isfinite(found).all()
    assert np.abs(found - family.exact(gamma, delta)).max() <= (1.05 * family.errors.peak + 4e-4) * peak
    np.testing.assert_allclose(
        family.basis(gamma, delta) @ family.coefficients(gamma), found, rtol=0, atol=1e-12 * peak
    )


@pytest.mark.parametrize(("model", "printed"), [("blinn-phong", False), ("blinn-phong", True), ("cook-torrance", True)])
def test_the_papers_basis_is_that_of_numpy(model, printed):
    """Nguyen 2010, eq. 10 to 15: the mean and six principal directions of 100 parameters at 400 angles."""
    low, high = RANGES[model]
    family = dl.Family.even(model, (low, high), 7, printed=printed)
    delta = np.linspace(0, math.pi / 2, 400)
    rows = np.stack([family.exact(g, delta) for g in np.linspace(low, high, 100)])
    mean = rows.mean(axis=0)
    directions = np.linalg.svd(rows - mean, full_matrices=False)[2][:6]
    for gamma in (low, 0.5 * (low + high), high):
        off = family.exact(gamma, delta) - mean
        wanted = mean + directions.T @ (directions @ off)
        np.testing.assert_allclose(family.evaluate(gamma, delta), wanted, rtol=0, atol=1e-6 * rows.max())
        assert family.coefficients(gamma)[0] == 1
    assert family.segments == 1 and family.live == 7


def test_printed_forms_are_others():
    """Blinn and Phong's by a constant (METHODS X13), Cook and Torrance's by cos^4 delta (X11)."""
    delta = np.linspace(0, 1.2, 50)
    printed, own = (dl.Family.even("blinn-phong", (3, 300), printed=form) for form in (True, False))
    ratio = printed.exact(300, delta) / own.exact(300, delta)
    np.testing.assert_allclose(ratio, 4 * 300 / 304, rtol=1e-12)
    printed, own = (dl.Family.even("cook-torrance", (0.1, 2), printed=form) for form in (True, False))
    np.testing.assert_allclose(printed.exact(2, delta) / own.exact(2, delta), np.cos(delta) ** 4, rtol=1e-12)


@pytest.mark.parametrize(("model", "rms"), PAPERS_RMS.items())
def test_the_papers_own_measure(model, rms):
    """The prototype's figures to a fifth; "1e-5" is the mean square of Blinn and Phong's (X12)."""
    assert dl.Family.even(model, RANGES[model]).errors.rms == pytest.approx(rms, rel=0.2)


def test_albedos_of_both_forms(six):
    """Of light along the normal: the forms in use as their models say; the printed ones METHODS X10 and X13."""
    for model, gamma, whole in (
        ("blinn-phong", 30, brdf.BlinnPhong(30)),
        ("ward", 0.3, brdf.Ward(0.3)),
        ("ward-duer", 0.3, brdf.WardDuer(0.3)),
        ("lafortune", 30, brdf.Phong(30)),
        ("cook-torrance", 0.3, brdf.CookTorrance(0.3)),
        ("ashikhmin-shirley", 30, brdf.AshikhminShirley(30)),
    ):
        assert albedo(model, six[model], gamma) == pytest.approx(float(whole.albedo((0, 0, 1))), rel=2e-3)
    phong = dl.Family.even("blinn-phong", (3, 300), printed=True)
    torrance = dl.Family.even("cook-torrance", (0.1, 2), printed=True)
    assert printed_albedo("blinn-phong", phong, 300) == pytest.approx(3.95, abs=0.01)
    assert printed_albedo("cook-torrance", torrance, 0.1) == pytest.approx(4.0, rel=0.01)


def test_the_fewest_that_reach_an_error():
    loose, tight = (dl.Family("blinn-phong", (3, 300), error) for error in (0.02, 0.0005))
    assert loose.live < tight.live and max(loose.errors[:2]) <= 0.02 and max(tight.errors[:2]) <= 0.0005
    # One live function fewer, in as many segments as there may be, does not.
    assert max(dl.Family("blinn-phong", (3, 300), live=tight.live - 1, segments=3).errors[:2]) > 0.0005
    if tight.segments > 1:
        fewer = dl.Family("blinn-phong", (3, 300), live=tight.live, segments=tight.segments - 1)
        assert max(fewer.errors[:2]) > 0.0005
    assert "blinn-phong" in repr(tight) and f"{tight.live} live" in repr(tight)


@pytest.mark.parametrize(
    ("model", "ends"), [("blinn-phong", (3, 1e4)), ("ward", (0.005, 10)), ("cook-torrance", (0.005, 10))]
)
def test_the_widest_ranges(model, ends):
    """No NaN from the narrowest lobe to the widest, and errors that are those found."""
    family, delta = (
        dl.Family(model, ends, live=8, segments=3),
        np.r_[0, np.geomspace(1e-9, math.pi / 2, 200)].clip(0, math.pi / 2),
    )
    for gamma in np.geomspace(*ends, 9).clip(*ends):
        exact, found = family.exact(gamma, delta), family.evaluate(gamma, delta)
        assert np.isfinite(found).all() and (exact >= 0).all()
        assert np.abs(found - exact).max() <= (1.05 * family.errors.peak + 2e-3) * exact.max()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("phong", (3, 300)), "expected model to be one of 'blinn-phong'"),
        (("ward", 3), "expected range to be two numbers, got 3"),
        (("ward", (0.05, 0.1, 2)), "expected range to be two numbers"),
        (("ward", (2, 0.05)), "expected a range of gamma that grows, got 2 to 0.05"),
        (("ward", (0.5, 0.5)), "expected a range of gamma that grows"),
        (("ward", (0.001, 2)), "expected gamma from 0.005 to 10, got 0.001"),
        (("ward", (float("nan"), 2)), "expected gamma from 0.005 to 10, got NaN"),
        (("blinn-phong", (0, 300)), "expected gamma from 1 to 10000, got 0"),
        (("blinn-phong", (3, 300), 0), "expected an error above 0, got 0"),
        (("blinn-phong", (3, 300), -1), "expected error to be a finite number of 0 or more"),
        (("cook-torrance", (0.1, 2), 1e-12), "expected an error that 12 live functions and 3 segments reach"),
    ],
)
def test_bad_families(arguments, message):
    with pytest.raises(ValueError, match=message):
        dl.Family(*arguments)


def test_bad_settings_and_questions(six):
    for alone in ({"live": 6}, {"segments": 3}):
        with pytest.raises(ValueError, match="expected live and segments, or none of them"):
            dl.Family("ward", (0.05, 2), **alone)
    for live, segments in ((1, 3), (13, 1), (6, 0), (6, 4)):
        with pytest.raises(ValueError, match="expected 2 to 12 live functions and 1 to 3 segments"):
            dl.Family("ward", (0.05, 2), live=live, segments=segments)
    with pytest.raises(ValueError, match="expected 2 to 12 live functions, got 1"):
        dl.Family.even("ward", (0.05, 2), 1)
    # Never clamped: the range is said.
    for ask in (lambda g: six["ward"].evaluate(g, [0]), six["ward"].coefficients, lambda g: six["ward"].errors_at([g])):
        for gamma in (0.049, 2.1, float("nan")):
            with pytest.raises(ValueError, match="expected gamma from 0.05 to 2, got"):
                ask(gamma)
    for delta in (-0.1, 1.6, float("nan")):
        with pytest.raises(ValueError, match="expected delta from 0 to pi / 2"):
            six["ward"].evaluate(1, [delta])
    with pytest.raises(ValueError, match="expected delta of shape"):
        six["ward"].evaluate(1, 0.5)
