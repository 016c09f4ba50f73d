"""Transport: products, rows, transposes and pictures against dense float64 algebra."""

from __future__ import annotations

import deltalux as dl
import numpy as np
import pytest
from deltalux import _core
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

COLUMNS = 24  # haar:2


def in_memory(array, columns="haar:2", **options) -> dl.Transport:
    return dl.Transport(_core.Transport.from_dense(array, columns=columns, tile_rows=32, **options))


def dense(transport) -> np.ndarray:
    return np.array([transport.row(i) for i in range(transport.shape[0])], np.float64)


matrices = hnp.arrays(
    np.float64,
    st.tuples(st.integers(1, 70), st.just(COLUMNS)),
    elements=st.floats(-10, 10, width=32),
    fill=st.just(0.0),
)
widths = st.sampled_from(["i8", "i16"])
# Multiples of 2^-10 below 2^10. Values of M are multiples of 2^-24 below 2^4: sums of 24 products are below 2^19 and
# multiples of 2^-34, which float64 holds. Dense float64 algebra is then exact, and rounding it once is the answer.
lights = hnp.arrays(np.int32, (2, COLUMNS, 3), elements=st.integers(-(2**20), 2**20)).map(lambda k: k * 2.0**-10)


@settings(deadline=None, max_examples=60)
@given(matrices, widths, lights, st.sampled_from([0.0, 0.05]))
def test_multiply_is_the_dense_product_rounded_once(array, width, V, threshold):
    transport = in_memory(array, width=width, threshold=threshold)
    M = dense(transport)
    expected = (M @ V).astype(np.float32)
    np.testing.assert_array_equal(transport.multiply(V), expected)
    np.testing.assert_array_equal(transport.multiply(V[0]), expected[0])
    np.testing.assert_array_equal(transport.to_scipy().toarray(), M)


@settings(deadline=None, max_examples=30)
@given(matrices, widths, st.integers(0, 2**32 - 1))
def test_rows_norms_and_transpose(array, width, seed):
    transport = in_memory(array, width=width)
    M = dense(transport)
    operator = transport.linear_operator()
    rng = np.random.default_rng(seed)
    x, y = rng.normal(size=(COLUMNS, 4)), rng.normal(size=(len(array), 4))
    # x is rounded to a grid of norm(row) norm(x) 2^-28, and y to 2^-34 of its largest.
    row = np.linalg.norm(M, axis=1).max()
    allowed = np.full((len(M), 4), 2.0**-26 * row * max(row, 1e-7) * np.linalg.norm(x, axis=0).max() + 1e-30)
    back = np.repeat(2.0**-34 * np.abs(M).sum(axis=0)[:, None] * np.abs(y).max() + 1e-30, 4, 1)
    np.testing.assert_array_less(np.abs(operator @ x - M @ x), allowed)
    np.testing.assert_array_less(np.abs(operator.rmatmat(y) - M.T @ y), back)
    np.testing.assert_array_less(np.abs(operator @ x[:, 0] - M @ x[:, 0]), allowed[:, 0])
    np.testing.assert_array_less(np.abs(operator.rmatvec(y[:, 0]) - M.T @ y[:, 0]), back[:, 0])
    np.testing.assert_allclose(transport.column_norms, np.linalg.norm(M, axis=0), rtol=1e-12)


def test_a_batch_is_its_lights_one_by_one(cornell, rng):
    V = rng.normal(size=(7, cornell.shape[1], 3)) * 10.0 ** rng.integers(-6, 6, (7, 1, 1))
    batch = cornell.multiply(V)
    assert batch.shape == (7, cornell.shape[0], 3) and batch.dtype == np.float32
    for light, product in zip(V, batch, strict=True):
        np.testing.assert_array_equal(cornell.multiply(light), product)
    assert cornell.multiply(V[:0]).shape == (0, cornell.shape[0], 3)
    # An array that is not contiguous, or of another kind, is the same light.
    turned = np.asfortranarray(V[0])
    np.testing.assert_array_equal(cornell.multiply(turned), batch[0])
    np.testing.assert_array_equal(cornell.multiply(V[0].astype(np.float32)), cornell.multiply(np.float32(V[0]) * 1.0))


def test_the_product_of_a_real_transport(cornell):
    # 2^-16 of a light of norm 1 is lost to the grid at the very most; float32 rounds once.
    V = cornell.coefficients(dl.Environment.builtin("hall"))
    M = cornell.to_scipy().astype(np.float64)
    expected = M @ V
    scale = np.linalg.norm(V, axis=0).max()
    assert np.abs(cornell.multiply(V) - expected).max() <= 2.0**-23 * np.abs(expected).max() + 2.0**-24 * scale
    np.testing.assert_array_equal(M[[5]].toarray()[0], cornell.row(5))


def test_threads_do_not_change_the_product(cornell, rng):
    V = rng.normal(size=(cornell.shape[1], 3))
    products = []
    for threads in (1, 2, 3, 7):
        dl.set_threads(threads)
        products.append(cornell.multiply(V).tobytes())
    assert len(set(products)) == 1


def test_shares_of_every_pixel_sum_to_one(cornell):
    core = cornell.pixels
    height, width = core.image_shape
    shares = np.bincount(core.pixel, core.weight, height * width).reshape(height, width) + core.background
    np.testing.assert_allclose(shares, 1, atol=1e-6)
    split = np.bincount(core.pixel, minlength=height * width)
    assert split.max() > 1 and 0 < core.background.max() <= 1 and core.weight.min() > 0


def test_image_is_albedo_times_response(cornell, rng):
    core = cornell.pixels
    height, width = core.image_shape
    B = rng.random((cornell.shape[0], 3)).astype(np.float32)
    expected = np.zeros((height * width, 3))
    np.add.at(expected, core.pixel, core.weight[:, None].astype(float) * cornell.albedo * B)
    image = cornell.image(B)
    assert image.dtype == np.float32
    np.testing.assert_allclose(image, expected.reshape(height, width, 3), rtol=1e-6, atol=1e-7)

    # B = 1: where one wall fills the pixel, its albedo. The left wall is red, the right one green.
    flat = cornell.image(np.ones_like(B))
    np.testing.assert_allclose(flat[12, 3], (0.57, 0.04, 0.04), rtol=1e-6)
    np.testing.assert_allclose(flat[12, 20], (0.12, 0.42, 0.09), rtol=1e-6)


def test_background_shows_the_environment(make):
    mesh = np.array([(-1, 0, -1), (1, 0, -1), (0, 0, 1.0)]), np.array([(0, 1, 2)])
    camera = dl.Camera((0.3, 4, 0.2), (0, 0, 0.1), (0, 0, -1), vertical_fov=50, width=20, height=14)
    transport = make(dl.Scene.from_arrays(*mesh, (1, 1, 1), camera), 8, "lossless")
    light = np.random.default_rng(2).random((6, 8, 8, 3)).astype(np.float32)
    env = dl.Environment.from_cubemap(light)
    B = transport.multiply(transport.coefficients(env))
    black, image = transport.image(B), transport.image(B, env)
    share = transport.pixels.background[..., None]
    seen = env.radiance(camera.directions())
    np.testing.assert_allclose(image, black + share * seen, rtol=1e-6, atol=1e-7)
    assert (share == 1).any() and (share == 0).any() and ((share > 0) & (share < 1)).any()
    assert (black[share[..., 0] == 1] == 0).all() and (image[share[..., 0] == 1] > 0).all()


def test_what_a_transport_says_of_itself(cornell):
    assert cornell.shape == (len(cornell.albedo), 384) and cornell.columns == dl.Haar(8) and cornell.channels == 1
    assert (cornell.camera.width, cornell.camera.height) == (24, 24)
    assert cornell.plan.rows == cornell.shape[0] and "cornell" in str(cornell.plan)
    assert cornell.nbytes >= 17 * cornell._core.entries
    assert f"{cornell.shape[0]:,} x 384" in repr(cornell)
    # The file keeps its opened form: the same bits after another opening.
    assert cornell.column_bytes.sum() == pytest.approx(34 * cornell._core.entries)


def test_truncated_keeps_its_word(cornell, tmp_path):
    V = cornell.coefficients(dl.Environment.builtin("hall"))
    exact = cornell.multiply(V)
    entries = [cornell._core.entries]
    for tolerance in (0.01, 0.05):
        small = cornell.truncated(tmp_path / f"{tolerance}.transport", tolerance)
        entries.append(small._core.entries)
        error = np.linalg.norm(small.multiply(V) - exact) / np.linalg.norm(exact)
        assert 0 < error < 2 * tolerance
        # The stated losses bound the error of every row: Cauchy-Schwarz in every band.
        bands = np.array([np.linalg.norm(V[small.columns.bands == b], axis=0) for b in np.unique(small.columns.bands)])
        allowed = small._core.dropped() @ bands
        assert (np.abs(small.multiply(V) - exact) <= allowed + 1e-6 * np.abs(exact)).all()
    assert entries[0] > entries[1] > entries[2]


@pytest.mark.parametrize(
    ("light", "message"),
    [
        (lambda n: np.zeros((n, 2)), "expected V of shape"),
        (lambda n: np.zeros((n - 1, 3)), "expected V of shape"),
        (lambda n: np.zeros((1, 1, n, 3)), "expected V of shape"),
        (lambda n: np.zeros(n), "expected V of shape"),
        (lambda n: np.full((n, 3), np.nan), "finite"),
        (lambda n: np.full((2, n, 3), np.inf), "finite"),
        (lambda n: np.full((n, 3), 1e300), "sane size|finite"),
    ],
)
def test_lights_that_are_refused(cornell, light, message):
    with pytest.raises(ValueError, match=message):
        cornell.multiply(light(cornell.shape[1]))
    with pytest.raises(TypeError, match="expected V, an array of shape"):
        cornell.multiply([["a"] * 3] * cornell.shape[1])


def test_rows_and_responses_that_are_refused(cornell):
    rows = cornell.shape[0]
    for i in (rows, rows + 10**6):
        with pytest.raises(IndexError, match=f"below {rows}"):
            cornell.row(i)
    for shape in ((rows, 2), (rows - 1, 3), (rows,)):
        with pytest.raises(ValueError, match="expected B of shape"):
            cornell.image(np.zeros(shape))
