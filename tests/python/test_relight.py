"""One suite for all update methods over all storage forms, against the dense product in float64."""

from __future__ import annotations

import math
import os
import signal
import time
import warnings

import deltalux as dl
import numpy as np
import pytest
from deltalux.light.motion import Motion
from forms import BUDGET, FORMS, METHODS, NEVER_CONVERGE, SPACES, STOP_SHORT, TIMED, Loudest, build

PAIRS = [(form, space) for form in FORMS for space in SPACES]


@pytest.fixture(scope="module", params=PAIRS, ids="-".join)
def form(request):
    return build(*request.param)


@pytest.fixture(scope="module", params=["i8", "tree"])
def one_of_each(request):
    """A form of one stage, and one of two, for what takes longer."""
    return build(request.param, "haar:8")


@pytest.fixture(params=METHODS)
def name(request):
    return request.param


@pytest.fixture(params=[name for name in METHODS if name not in TIMED])
def repeatable(request):
    """What is sent depends on nothing but the light."""
    return request.param


def path(form, frames, seed=5):
    """A light that moves, jumps once, and goes black once; multiples of 2^-8, which every grid holds that it meets."""
    rng = np.random.default_rng(seed)
    here, there, far = rng.lognormal(0, 2, (3, form.count, 3)) * rng.choice([-1, 1], (3, form.count, 3))
    lights = [here + (there - here) * math.sin(frame / 5) for frame in range(frames)]
    lights[frames // 2 :] = [far * (1 + frame / 50) for frame in range(frames - frames // 2)]
    lights[frames // 3] = np.zeros((form.count, 3))
    return [np.round(light * 256) / 256 for light in lights]


def assert_exact(form, relighter, frame):
    """What was applied is what a fresh product gives, to the last bit; of two stages, once the second has followed."""
    if not form.two_stages or frame.converged:
        np.testing.assert_array_equal(frame.values, form.multiply(relighter.values))


@pytest.mark.parametrize("initial", ["full", "nonlinear", None])
def test_every_frame_is_a_fresh_product_within_its_bound(form, name, initial):
    relighter = form.relighter(METHODS[name], initial)
    worst = 0.0
    for number, V in enumerate(path(form, 30)):
        frame = relighter.step(V)
        assert_exact(form, relighter, frame)
        error = np.abs(frame.values.astype(np.float64) - form.oracle(V))
        bounds = relighter.bounds(frame)
        assert (error <= bounds).all(), f"frame {number}: a receiver is beyond its bound"
        assert bounds.max() <= np.nextafter(np.float32(frame.bound), np.float32(np.inf))
        assert error.max() <= frame.bound
        worst = max(worst, error.max() / frame.bound)
        assert frame.converged == (relighter.values == V).all() or form.two_stages
        assert (relighter.values == V).all() or not frame.converged
        if name not in ("full", *STOP_SHORT, *TIMED) and not (initial == "full" and number == 0):
            assert len(frame.columns) <= BUDGET
    assert worst > (1e-4 if form.two_stages else 1e-3), "a bound far too large says nothing"


def remaining(form, relighter, V):
    """What is not yet applied, in the weights of the choice: sum of area |V - V~|."""
    return float((form.columns.areas[:, None] * np.abs(V - relighter.values)).sum())


def test_static_light_is_reached_bit_for_bit(form, name):
    relighter = form.relighter(METHODS[name], None)
    moving, still = path(form, 10)[:3], path(form, 10, seed=9)[0]
    for V in moving:
        relighter.step(V)
    wanted = form.multiply(still)

    # m columns differ, k are sent a frame; a reset makes a column differ that did not, at most all of them.
    budget = {"full": form.count, "incremental-separate": BUDGET / 3, "per-band-separate": BUDGET / 3}.get(name, BUDGET)
    # A second stage follows in four frames of a quarter of its columns, and takes one to hear of the last change.
    frames = math.ceil(form.count / budget) + (6 if form.two_stages else 0)
    errors = [remaining(form, relighter, still)]
    for _ in range(frames):
        frame = relighter.step(still)
        errors.append(remaining(form, relighter, still))
    if name not in NEVER_CONVERGE:
        assert all(later <= earlier * (1 + 1e-12) for earlier, later in zip(errors, errors[1:], strict=False)), errors
    if name in STOP_SHORT:
        # What is left to send is within the tolerance; what truncation took, no budget can change.
        assert form.reach(still - relighter.values) <= relighter.method.error * (1 + 1e-9)
        if isinstance(form.columns, dl.Haar):
            assert frame.bound <= relighter.method.error or frame.converged or form.two_stages
    elif name in NEVER_CONVERGE:
        assert not frame.converged
    else:
        assert frame.converged
        np.testing.assert_array_equal(relighter.values, still)
        np.testing.assert_array_equal(frame.values, wanted)
        # It stays, and nothing more is sent.
        for _ in range(3):
            frame = relighter.step(still)
            assert frame.converged and len(frame.columns) == 0 and frame.resets == ()
            np.testing.assert_array_equal(frame.values, wanted)


def test_a_light_that_is_refused_changes_nothing(form, repeatable):
    relighter, twin = (form.relighter(METHODS[repeatable], None) for _ in range(2))
    lights = path(form, 8)
    for V in lights[:4]:
        relighter.step(V), twin.step(V)
    before = relighter.values
    bad = lights[4].copy()
    bad[17, 1] = np.nan
    infinite, huge = np.full((form.count, 3), np.inf), np.full((form.count, 3), 1e200)
    for refused in (bad, infinite, lights[4][:-1], lights[4][:, :2], huge):
        with pytest.raises(ValueError):
            relighter.step(refused)
    np.testing.assert_array_equal(relighter.values, before)
    for V in lights[4:]:
        np.testing.assert_array_equal(relighter.step(V).values, twin.step(V).values)


@pytest.mark.parametrize("kind", [dl.Nonlinear, dl.Incremental, dl.PerBand, dl.HarmonicOrder])
def test_budgets_of_none_one_and_all(form, kind):
    first, second = path(form, 8)[0], path(form, 8, seed=8)[0]
    for terms in (0, 1, form.count, 10**9):
        relighter = form.relighter(kind(terms=terms))
        relighter.step(first)
        frame = relighter.step(second)
        assert_exact(form, relighter, frame)
        assert len(frame.columns) <= terms
        if form.two_stages and terms >= form.count:
            # The second stage has a budget of its own.
            frame = [relighter.step(second) for _ in range(5)][-1]
        if terms >= form.count:
            assert frame.converged
            np.testing.assert_array_equal(frame.values, form.multiply(second))
        elif kind is dl.Incremental:
            assert (relighter.values != first).any(axis=1).sum() == len(frame.columns) == terms


# Light that outgrows its grid is rounded to a coarser one, light that fades gets a finer one: exact all the way.
def test_light_grows_a_millionfold_and_fades(form, name):
    relighter = form.relighter(METHODS[name])
    V = np.random.default_rng(4).normal(size=(form.count, 3))
    for exponent in [*np.linspace(0, 6, 13), *np.linspace(6, -9, 21)]:
        light = V * 10.0**exponent
        frame = relighter.step(light)
        assert_exact(form, relighter, frame)
        assert np.abs(frame.values - form.oracle(light)).max() <= frame.bound
    frame = relighter.step(0 * V)
    for _ in range(-(-3 * form.count // BUDGET) + 3 + 6 * form.two_stages):
        frame = relighter.step(0 * V)
    if name not in STOP_SHORT:
        assert (frame.values == 0).all()


def test_a_loop_of_1000_frames_does_not_drift(form, name):
    relighter = form.relighter(METHODS[name])
    lights = path(form, 20)
    for _ in range(50):
        for V in lights:
            frame = relighter.step(V)
    assert_exact(form, relighter, frame)


# A sun of 1e5 in one texel wanders through a sky and goes: in float32 it would leave 1e-3 of the ambient light behind.
def test_a_passing_sun_leaves_no_trace(form, name):
    sky = np.random.default_rng(2).uniform(0.3, 0.8, (6, 8, 8, 3)).astype(np.float32)
    lights = [form.columns.coefficients(dl.Environment.from_cubemap(sky))]
    for texel in range(0, 384, 23):
        sunny = sky.reshape(384, 3).copy()
        sunny[texel] = 1e5
        lights.append(form.columns.coefficients(dl.Environment.from_cubemap(sunny.reshape(6, 8, 8, 3))))
    lights.append(lights[0])
    relighter = form.relighter(METHODS[name])
    for V in lights:
        frame = relighter.step(V)
        assert_exact(form, relighter, frame)
    for _ in range(-(-3 * form.count // BUDGET) + 3 + 6 * form.two_stages):
        frame = relighter.step(lights[0])
    assert_exact(form, relighter, frame)
    if name not in NEVER_CONVERGE | STOP_SHORT:
        assert frame.converged
        # The grid stays that of the sun until the light has faded 2^16-fold: its steps are all that is left.
        wanted, rounding = form.multiply(lights[0]), form.reach(lights[0] - relighter.values)
        assert rounding < 1e-5 * max(form.reach(V) for V in lights)
        # Where rows are short, that is nothing to be seen; rows of two stages are held to what their own norms say.
        slack = 0.0 if rounding < 1e-5 and not form.two_stages else rounding
        np.testing.assert_allclose(frame.values, wanted, rtol=1e-6, atol=1e-6 + slack)


def test_threads_do_not_change_a_bit(form, repeatable):
    films = []
    for threads in (1, 2, 3):
        dl.set_threads(threads)
        relighter = form.relighter(METHODS[repeatable], None)
        films.append([relighter.step(V).values.tobytes() for V in path(form, 12)])
    assert films[0] == films[1] == films[2]


def test_two_relighters_share_a_transport(form, repeatable):
    lights, others = path(form, 10), path(form, 10, seed=6)
    alone = [form.relighter(METHODS[repeatable]) for _ in range(2)]
    expected = [[one.step(V).values for V in film] for one, film in zip(alone, (lights, others), strict=True)]
    together = [form.relighter(METHODS[repeatable]) for _ in range(2)]
    for frame in range(10):
        for which, film in enumerate((lights, others)):
            np.testing.assert_array_equal(together[which].step(film[frame]).values, expected[which][frame])


# No budget in time is too small for a still light to be reached, a column a frame at least; one that is large is used.
@pytest.mark.parametrize("milliseconds", [0.0, 0.2, 1e4])
@pytest.mark.parametrize(
    ("kind", "settings"),
    [
        (dl.Incremental, {}),
        (dl.PerBand, {}),
        (dl.PerBand, {"weight": "cost", "norm": "l2"}),
        (dl.PerBand, {"weight": "transport", "test": "dealer"}),
        (dl.PerBand, {"weight": "transport", "test": "exhaustive"}),
        (dl.HarmonicOrder, {"terms": None}),
    ],
)
def test_an_idle_relighter_converges_within_milliseconds(one_of_each, kind, settings, milliseconds):
    form = one_of_each
    relighter = form.relighter(kind(milliseconds=milliseconds, **settings), None)
    for V in path(form, 9):
        frame = relighter.step(V)
        assert_exact(form, relighter, frame)
    still = path(form, 10, seed=9)[0]
    for frames in range(1, 2 * form.count):
        before = relighter.values
        frame = relighter.step(still)
        if frame.converged:
            break
        if form.two_stages and (before == still).all():
            continue
        assert (relighter.values != before).any()
        if milliseconds == 0.0:
            assert len(frame.columns) == 1
        assert milliseconds < 1e4 or frames == 1 or form.two_stages, "a second frame has the time for all"
    assert_exact(form, relighter, frame)
    np.testing.assert_array_equal(relighter.values, still)
    assert len(relighter.step(still).columns) == 0


def test_a_picture_that_is_kept_is_not_written_again(form):
    relighter, twin = (form.relighter(METHODS["per-band"]) for _ in range(2))
    kept = [relighter.step(V).values[:] for V in path(form, 6)]
    for V, values in zip(path(form, 6), kept, strict=True):
        # The twin's pictures are dropped at once, and their memory is used again.
        np.testing.assert_array_equal(twin.step(V).values, values)
    assert len({values.ctypes.data for values in kept}) == 6


@pytest.mark.parametrize("method", ["linear", "nonlinear", "incremental", "per-band", "harmonic-order", "own"])
def test_initial_says_what_the_first_frame_applies(form, method):
    V = np.random.default_rng(3).normal(size=(form.count, 3))
    full, nonlinear, black = (form.relighter(METHODS[method], i) for i in ("full", "nonlinear", None))
    assert full.step(V).converged
    if method == "harmonic-order":
        # Its weights are those of harmonics: none.
        key = np.abs(V).sum(axis=1)
        assert nonlinear.step(V).columns.tolist() == np.sort(np.argsort(-key, kind="stable")[:BUDGET]).tolist()
        return
    key = form.columns.areas * np.abs(V).sum(axis=1)
    largest = np.sort(np.argsort(-key, kind="stable")[:BUDGET])
    assert nonlinear.step(V).columns.tolist() == largest.tolist()
    assert len(black.step(V).columns) == BUDGET
    with pytest.raises(ValueError, match='expected initial="full"'):
        form.relighter(dl.Full(), "half")


@pytest.mark.parametrize("space", SPACES)
@pytest.mark.parametrize("kind", ["factors", "tree", "representatives"])
def test_a_new_mix_is_a_frame_of_its_own(kind, space):
    form = build(kind, space)
    relighter = form.relighter(METHODS["incremental"])
    with pytest.raises(ValueError, match="call step first"):
        relighter.mix(form.mix)
    with pytest.raises(ValueError, match="expected a mix of shape"):
        dl.Relighter(form.transport, METHODS["incremental"])
    lights = path(form, 12)
    for V in lights[:3]:
        frame = relighter.step(V)
    large, other = form.mix, np.random.default_rng(9).normal(size=form.mix.shape).astype(np.float32)
    for mix in (np.float32(1e-3) * large, np.float32(100) * other):
        earlier, frame = frame, relighter.mix(mix)
        bounds = relighter.bounds(frame)
        form.mix[...] = mix
        error = np.abs(frame.values.astype(np.float64) - form.oracle(lights[2]))
        assert (error <= bounds).all() and error.max() <= frame.bound and len(frame.columns) == 0
        # A bound is that of one picture.
        with pytest.raises(ValueError, match="made last"):
            relighter.bounds(earlier)
    with pytest.raises(ValueError, match="expected a mix of shape"):
        relighter.mix(mix[:, :1])
    with pytest.raises(ValueError, match="finite"):
        relighter.mix(np.full_like(mix, np.nan))
    for _ in range(200):
        frame = relighter.step(lights[2])
    assert frame.converged
    np.testing.assert_array_equal(frame.values, form.multiply(relighter.values))


def test_a_budget_in_error_holds_for_a_new_mix():
    # More than truncation takes under the new mix, which the old one hardly notices.
    form, error = build("factors", "haar:8"), 2000.0
    relighter = form.relighter(dl.Incremental(error=error))
    here, there = path(form, 9)[0], path(form, 9, seed=2)[0]
    relighter.step(here), relighter.step(there)
    relighter.mix(100 * form.mix)
    for _ in range(4):
        frame = relighter.step(there)
    twin = dl.Relighter(form.transport, dl.Incremental(error=error), mix=100 * form.mix)
    twin.step(here)
    for _ in range(4):
        expected = twin.step(there)
    assert expected.bound <= error or expected.converged
    assert frame.bound <= max(expected.bound, error) or frame.converged


class _Faulty(dl.Method):
    """Says what it is told to say."""

    answer: object = dl.Choice()

    def choose(self, state):
        if isinstance(_Faulty.answer, Exception):
            raise _Faulty.answer
        return _Faulty.answer


@pytest.mark.parametrize("scale", [1.0, 1e3, 1e12])
@pytest.mark.parametrize(
    "answer",
    [
        None,
        dl.Choice(columns=[10**6]),
        dl.Choice(resets=[99]),
        dl.Choice(columns=[[1], [2, 3]]),
        dl.Choice(columns=[-1]),
        dl.Choice(columns=[0.5]),
        ValueError("own"),
    ],
    ids=["none", "column", "band", "ragged", "negative", "half", "raises"],
)
def test_a_choice_that_is_refused_changes_nothing(one_of_each, scale, answer):
    form = one_of_each
    relighter, twin = (form.relighter(_Faulty(), None) for _ in range(2))
    lights = [V / 3 for V in path(form, 9)]
    everything = dl.Choice(columns=np.arange(form.count))
    for V in lights[:2]:
        _Faulty.answer = everything
        relighter.step(V), twin.step(V)
    _Faulty.answer = answer
    before = relighter.values
    with pytest.raises(ValueError):
        relighter.step(scale * lights[4])
    np.testing.assert_array_equal(relighter.values, before)
    _Faulty.answer = everything
    for V in lights[5:]:
        np.testing.assert_array_equal(relighter.step(V).values, twin.step(V).values)


def test_a_method_of_ones_own_looks_and_does_not_write(one_of_each):
    class Meddling(dl.Method):
        def choose(self, state):
            for array in (state.target, state.values, state.bands, state.areas, state.weights):
                with pytest.raises(ValueError, match="read-only"):
                    array[...] = 0
            return dl.Choice(columns=np.arange(len(state.target)))

    V = path(one_of_each, 5)[0]
    kept = V.copy()
    assert len(one_of_each.relighter(Meddling(), None).step(V).columns) > 0
    dl.Approximation(one_of_each.columns, Meddling(terms=5)).step(V)
    np.testing.assert_array_equal(V, kept)
    with pytest.raises(ValueError, match="Unwritten has none"):
        type("Unwritten", (dl.Method,), {})(terms=3)
    with pytest.raises(ValueError, match="Method has none"):
        dl.Method(terms=3)


def test_what_a_frame_says(cornell):
    env = dl.Environment.builtin("hall")
    relighter = dl.Relighter(cornell, dl.PerBand(terms=30))
    frame = relighter.step(env)
    assert frame.converged and frame.image.shape == (24, 24, 3)
    np.testing.assert_array_equal(frame.image, cornell.image(frame.values, env))
    assert 0 <= frame.choosing + frame.multiplying <= frame.seconds
    turned = relighter.step(env.rotated(20.0))
    assert not turned.converged and 0 < len(turned.columns) <= 30 and turned.bound > frame.bound
    from_V = dl.Relighter(cornell, dl.PerBand(terms=30)).step(cornell.coefficients(env))
    np.testing.assert_array_equal(from_V.values, frame.values)
    assert relighter.nbytes >= 3 * 8 * cornell.shape[0]
    with pytest.raises(ValueError, match="method such as"):
        dl.Relighter(cornell, "pbi")


# Worker threads do not survive a fork: a child that waited for them would hang.
@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")
def test_a_forked_child_multiplies(cornell):
    V = cornell.coefficients(dl.Environment.builtin("hall"))
    expected = cornell.multiply(V)
    relighter = dl.Relighter(cornell, dl.PerBand(terms=30))
    frame = relighter.step(V)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)
        child = os.fork()
    if child == 0:
        try:
            same = (cornell.multiply(V) == expected).all() and (relighter.step(V).values == frame.values).all()
            os._exit(0 if same else 1)
        finally:
            os._exit(2)
    deadline = time.monotonic() + 10
    while time.monotonic() < deadline:
        done, status = os.waitpid(child, os.WNOHANG)
        if done:
            assert os.waitstatus_to_exitcode(status) == 0
            return
        time.sleep(0.01)
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    pytest.fail("the child hangs")


def test_methods_side_by_side(cornell):
    env, motion = dl.Environment.builtin("hall"), Motion(rotate=20, frames=6, hold=2)
    methods = [dl.Full(), dl.PerBand(terms=30), Loudest(terms=30), Loudest(terms=30)]
    exact, *rows = dl.compare(cornell, env, methods, motion=motion)
    assert [row.method for row in rows] == ["PerBand(terms=30)", "Loudest(terms=30)", "Loudest(terms=30)"]
    assert exact.image_l2 == exact.light_l1 == 0 and exact.within_bound
    for row in rows:
        assert 0 < row.image_l2 < 1 and 0 < row.light_l1 < 1 and row.within_bound
        assert 0 < row.columns <= 30 and 0 < row.milliseconds <= row.p95_milliseconds and row.state_bytes > 0
        assert 0 < row.streamed_bytes < exact.streamed_bytes
    # What they choose is settled by the light.
    assert rows[1].image_l2 == rows[2].image_l2
    for wrong in ([], dl.PerBand(terms=30), ["pbi"]):
        with pytest.raises(ValueError, match="update method"):
            dl.compare(cornell, env, wrong, motion=motion)
    with pytest.raises(TypeError, match="expected an Environment"):
        dl.compare(cornell, cornell.coefficients(env), methods, motion=motion)
