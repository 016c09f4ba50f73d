"""M^T: exact like the product, through every form of storage."""

import deltalux as dl
import numpy as np
import pytest
from forms import FORMS, build
from hypothesis import given, settings
from hypothesis import strategies as st

PAIRS = [*((form, "haar:8") for form in FORMS), ("i16", "sh:8"), ("nodes", "sh:8")]
# What lies between the stages of these is rounded to the second one's grid, however few bits V has: it has at least 20
# bits of what the light may grow to, which is up to 2^7 of what it is.
ROUNDED = {"tree", "representatives", "clustered"}


def exact(a: np.ndarray, b: np.ndarray) -> int:
    """sum(a * b) in units of 2^-400: what none of them is finer than."""
    whole = [[int(x) for x in (array.ravel() * 2.0**200).tolist()] for array in (a, b)]
    return sum(x * y for x, y in zip(*whole, strict=True))


def few_bits(form):
    """A mix whose weights are quarters: with whole V and R nothing between them is ever rounded."""
    return None if form.mix is None else np.round(4 * form.mix).astype(np.float32) / 4


@pytest.mark.parametrize(("form", "space"), PAIRS)
@settings(max_examples=3, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), scale=st.sampled_from([2.0**-9, 1.0, 2.0**30]))
def test_the_adjoint_is_the_transpose_bit_for_bit(built, form, space, seed, scale):
    rng, case = np.random.default_rng(seed), built(form, space)
    mix, count = few_bits(case), case.count
    V, R = (scale * rng.integers(-8, 9, (length, 3)).astype(float) for length in (count, case.transport.shape[0]))
    if form == "nodes-under-texels":
        # Texels come to nodes as wavelets, by roots of areas.
        V[384:] = 0
    B = case.transport.multiply(V, mix=mix, dtype=np.float64)
    G = case.transport.adjoint(R, mix=mix)
    left, right = exact(B, R), exact(V, G)
    if form in ROUNDED:
        assert abs(left - right) <= 2.0**400 * 2.0**-13 * case.reach(V) * np.abs(R).sum()
    else:
        assert left == right


@pytest.fixture(scope="module")
def built():
    made = {}

    def of(form, space):
        if (form, space) not in made:
            made[form, space] = build(form, space)
        return made[form, space]

    return of


@pytest.mark.parametrize("form", FORMS)
def test_the_adjoint_of_any_numbers(built, form):
    """Numbers of five decades: as the plain transpose, which the columns of M make."""
    case = built(form, "haar:8")
    rng = np.random.default_rng(3)
    R = rng.normal(size=(case.transport.shape[0], 3)) * 10.0 ** rng.uniform(-4, 1, (case.transport.shape[0], 1))
    G = case.transport.adjoint(R, mix=case.mix)
    for column in rng.choice(case.count, 12, replace=False):
        V = np.zeros((case.count, 3))
        V[column] = 1
        truth = (case.transport.multiply(V, mix=case.mix, dtype=np.float64) * R).sum(axis=0)
        # R is off by 2^-35 of its largest, and so is what follows it; the product by its own grids.
        rounding = 2.0 ** (-13 if form in ROUNDED else -33) * case.reach(V) * np.abs(R).max() * len(R)
        np.testing.assert_allclose(G[column], truth, atol=rounding, rtol=0)
    assert (case.transport.adjoint(np.stack([R, -2 * R]), mix=case.mix) == np.stack([G, -2 * G])).all()


def test_the_same_bits_on_any_number_of_threads(built):
    case = built("nodes", "haar:8")
    R = np.random.default_rng(4).normal(size=(case.transport.shape[0], 3))
    before, bits = dl.threads(), []
    try:
        for threads in (1, 3):
            dl.set_threads(threads)
            bits.append(case.transport.adjoint(R).tobytes())
    finally:
        dl.set_threads(before)
    assert bits[0] == bits[1]


def test_what_is_no_number_for_each_row_is_refused(built):
    transport = built("i16", "haar:8").transport
    with pytest.raises(ValueError, match=r"expected R of shape \(40, 3\)"):
        transport.adjoint(np.zeros((39, 3)))
    with pytest.raises(TypeError, match="expected R"):
        transport.adjoint("light")
    for wrong in (np.nan, np.inf, 1e300):
        R = np.ones((40, 3))
        R[7, 1] = wrong
        with pytest.raises(ValueError, match="expected finite numbers"):
            transport.adjoint(R)
    with pytest.raises(ValueError, match="expected a mix"):
        built("factors", "haar:8").transport.adjoint(np.zeros((40, 3)))
    with pytest.raises(ValueError, match="float32 or float64"):
        transport.multiply(np.zeros((384, 3)), dtype=np.int32)
    assert (transport.adjoint(np.zeros((40, 3))) == 0).all()
