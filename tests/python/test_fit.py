"""Light from pictures: fits against scipy's, their certificates, and M's gradient in torch and JAX."""

from __future__ import annotations

import deltalux as dl
import numpy as np
import pytest
from deltalux.relight.nonnegative import Problem, convex_shortfall, curvature, solve, tolled_shortfall
from hypothesis import given, settings
from hypothesis import strategies as st


@pytest.fixture(scope="module")
def shares(cornell):
    return cornell.shares()


@pytest.fixture(scope="module")
def hall():
    return dl.Environment.builtin("hall")


@pytest.fixture(scope="module")
def picture(cornell, hall):
    return cornell.image(cornell.multiply(cornell.coefficients(hall)))


def test_a_picture_of_shares_is_the_picture(cornell, shares, hall, rng):
    B = cornell.multiply(cornell.coefficients(hall))
    np.testing.assert_allclose(shares.picture(B), cornell.image(B), rtol=1e-5, atol=1e-7)
    numbers = rng.normal(size=(*shares.image_shape, 3))
    assert np.isclose((shares.picture(B) * numbers).sum(), (B * shares.back(numbers)).sum(), rtol=1e-10)


def test_so_it_is_at_vertices(make, hall, rng):
    scene = dl.Scene.builtin("cornell")
    transport = make(scene.with_camera(scene.camera.resized(12, 12)), 2, receivers="vertices")
    V, shares = transport.coefficients(hall), transport.shares()
    B = transport.multiply(V)
    np.testing.assert_allclose(shares.picture(B), transport.image(B), rtol=1e-4, atol=1e-6)
    map_, numbers = dl.gradients.Picture(transport), rng.normal(size=(12, 12, 3))
    assert np.isclose((map_.forward(V) * numbers).sum(), (V * map_.backward(numbers)).sum(), rtol=1e-9)


@pytest.mark.parametrize("tolled", [False, True])
@settings(max_examples=5)
@given(seed=st.integers(0, 2**32 - 1), negative=st.booleans())
def test_bounds_hold_and_are_met(tolled, seed, negative):
    """Against scipy, which knows nothing of bounds of ours: whatever the matrix, truncated rows of either sign too."""
    optimize = pytest.importorskip("scipy.optimize")
    rng = np.random.default_rng(seed)
    A, b = rng.random((30, 20)) - 0.3 * negative, rng.random(30)
    toll = np.full(20, 0.3) if tolled else np.zeros(20)
    ridge = np.zeros(20) if tolled else rng.uniform(0.01, 1, 20)
    shortfall = tolled_shortfall if tolled else convex_shortfall(0.1, lambda r: float((r**2 / ridge).sum()))
    problem = Problem(lambda x: A.T @ (A @ x) + ridge * x, A.T @ b, float(b @ b), toll, shortfall)
    objective = lambda x: 0.5 * ((A @ x - b) ** 2).sum() + toll @ x + 0.5 * (ridge * x * x).sum()  # noqa: E731
    slope = lambda x: problem.normal(x) - problem.target + toll  # noqa: E731
    best = optimize.minimize(
        objective, np.ones(20), jac=slope, bounds=[(0, None)] * 20, method="L-BFGS-B",
        options={"ftol": 1e-15, "gtol": 1e-12, "maxiter": 2000},
    ).fun  # fmt: skip
    bounds = []
    for iterations in (1, 3, 10, 30, 5000):
        found = solve(
            problem, np.zeros(20), curvature(problem.normal, problem.target), 1e-9, iterations, lambda _: None
        )
        assert (found.x >= 0).all() and np.isclose(found.objective, objective(found.x), rtol=1e-9)
        assert found.bound <= best + 1e-12 <= found.objective + 2e-9
        bounds.append(found.bound)
    assert bounds == sorted(bounds) and found.objective - found.bound <= 1e-9


def test_a_known_light_is_recovered_within_its_certificate(cornell, shares, hall, picture):
    """Where the prior is the light itself, the least objective is 0: half the square that is missed is in the gap."""
    fit = dl.fit_light(cornell, picture, prior=hall, strength=0.01, gap=1e-6, progress=False)
    counts = (shares.samples.background == 0)[..., None]
    scale = 0.5 * ((counts * picture.astype(np.float64)) ** 2).sum()
    missed = 0.5 * (counts * (fit.picture - picture) ** 2).sum()
    assert fit.converged and missed <= (fit.gap + 1e-9) * scale and fit.residual <= np.sqrt(1e-6)
    # Nor is the light itself off by more: what detail costs is strictly convex, least of all in the means of faces.
    cost = 0.01 * 4 / cornell.columns.areas[:, None]
    off = fit.values - cornell.coefficients(hall)
    assert 0.5 * (cost * off**2).sum() * _steepest(cornell, counts, picture) <= (fit.gap + 1e-9) * scale


def _steepest(cornell, counts, picture) -> float:
    """The picture's largest curvature, from below."""
    shares = cornell.shares()
    V = cornell.adjoint(shares.back(counts * picture))
    for _ in range(3):
        V = cornell.adjoint(shares.back(counts * shares.picture(cornell.multiply(V / np.linalg.norm(V)))))
    return 0.99 * float(np.linalg.norm(V))


def test_a_lamp_is_found(cornell):
    lamp = np.zeros((6, 8, 8, 3), np.float32)
    lamp[4, 3, 4] = (50, 40, 30)
    V = cornell.columns.coefficients(dl.Environment.from_cubemap(lamp))
    fit = dl.fit_light(cornell, cornell.image(cornell.multiply(V)), prior="lamps", gap=1e-4, progress=False)
    found = fit.environment.cubemap(8)
    assert np.unravel_index(found.sum(-1).argmax(), (6, 8, 8)) == (4, 3, 4)
    assert (found.sum(-1) > 1).sum() < 12
    areas = cornell.columns.solid_angles.reshape(6, 8, 8, 1)
    assert 0.9 < (found * areas).sum() / (lamp * areas).sum() < 1.0


def test_a_spot_is_made_brighter(cornell, hall, picture, shares):
    target, weights = picture.copy(), np.full(shares.image_shape, 0.01)
    target[14:18, 6:10] *= 1.5
    weights[14:18, 6:10] = 10.0
    fit = dl.fit_light(cornell, target, prior=hall, weights=weights, strength=1e-3, progress=False)
    spot, before = fit.picture[14:18, 6:10].mean(), picture[14:18, 6:10].mean()
    assert spot > 1.3 * before
    # Masked out, the rest does not count at all: the spot may be as bright as it was asked to be.
    mask = np.zeros(shares.image_shape)
    mask[14:18, 6:10] = 1
    alone = dl.fit_light(cornell, target, prior=hall, mask=mask, strength=1e-4, gap=1e-4, progress=False)
    assert alone.residual < 0.05 and alone.values.shape == (384, 3)


def test_a_fit_goes_on_and_may_be_interrupted(cornell, picture):
    told = []
    first = dl.fit_light(cornell, picture, progress=lambda done, total: told.append((done, total)))
    again = dl.fit_light(cornell, 1.01 * picture, start=first, progress=False)
    assert first.converged and again.converged and again.iterations < first.iterations / 2
    assert told[-1] == (1000, 1000) and told == sorted(told)

    def stop(done, total):
        if done > 5:
            raise KeyboardInterrupt

    part = dl.fit_light(cornell, picture, gap=1e-9, progress=stop)
    assert not part.converged and part.gap > 1e-9 and part.iterations < 10 and part.environment is not None


def test_texel_columns_are_fitted_through_wavelets(cornell_texels, hall):
    V = cornell_texels.coefficients(hall)
    fit = dl.fit_light(cornell_texels, cornell_texels.image(cornell_texels.multiply(V)), iterations=60, progress=False)
    assert fit.residual < 0.1 and (fit.values[384:] == 0).all()


def test_what_cannot_be_fitted_is_refused(cornell, picture):
    with pytest.raises(ValueError, match=r"expected a finite picture of shape \(24, 24, 3\)"):
        dl.fit_light(cornell, picture[:3])
    with pytest.raises(ValueError, match="expected prior="):
        dl.fit_light(cornell, picture, prior="bright")
    with pytest.raises(ValueError, match="expected a strength"):
        dl.fit_light(cornell, picture, strength=0)
    with pytest.raises(ValueError, match="expected weights"):
        dl.fit_light(cornell, picture, weights=-np.ones((24, 24)))
    with pytest.raises(ValueError, match="to begin with"):
        dl.fit_light(cornell, picture, start=np.zeros((3, 3)))
    with pytest.raises(ValueError, match="expected gap"):
        dl.fit_light(cornell, picture, gap=-1)
    with pytest.raises(ValueError, match="dark one"):
        dl.fit_light(cornell, 0 * picture)
    with pytest.raises(TypeError, match="expected a Transport"):
        dl.fit_light("a.transport", picture)


@pytest.mark.parametrize("make_map", [dl.gradients.Response, dl.gradients.Picture], ids=["response", "picture"])
def test_torch_backpropagates_through_m(cornell, make_map, rng):
    torch = pytest.importorskip("torch")
    map_ = make_map(cornell)
    function, V = dl.gradients.torch(map_), rng.normal(size=(384, 3))
    light = torch.tensor(V, requires_grad=True)
    found = function(light)
    assert tuple(found.shape) == map_.shape and (found.detach().numpy() == map_.forward(V)).all()
    (found**2).sum().backward()
    np.testing.assert_array_equal(light.grad.numpy(), map_.backward(2 * map_.forward(V)))
    single = torch.tensor(V, dtype=torch.float32, requires_grad=True)
    assert function(single).dtype == torch.float32


def test_jax_has_the_gradient_too(cornell, rng):
    jax = pytest.importorskip("jax")
    map_, V = dl.gradients.Response(cornell), rng.normal(size=(384, 3)).astype(np.float32)
    function = dl.gradients.jax(map_)
    grad = jax.jit(jax.grad(lambda V: (function(V) ** 2).sum()))(V)
    expected = map_.backward(2 * map_.forward(V))
    np.testing.assert_allclose(np.asarray(grad), expected, rtol=1e-4, atol=1e-5 * np.abs(expected).max())
