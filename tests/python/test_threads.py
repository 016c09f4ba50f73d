"""Objects that threads share: no call waits for another for ever, and what comes out is what one thread gets.

Each object is shared between two and eight threads over a transport of several tiles, so that every call is split over
the pool: work that waits for a lock inside the pool is stolen by the thread that holds the lock, sooner or later.
"""

from __future__ import annotations

import contextlib
import itertools
import sys
import threading

import deltalux as dl
import numpy as np
import pytest
from deltalux import _core
from deltalux.precomputation.preparation import Prepared, Request

COLUMNS = dl.Haar(8)
CALLS = 60

pytestmark = pytest.mark.timeout(120)


def tiled(rows: int = 1024, tile_rows: int = 64, seed: int = 0) -> dl.Transport:
    rng = np.random.default_rng(seed)
    M = 0.05 * rng.normal(size=(rows, COLUMNS.columns)) * (rng.random((rows, COLUMNS.columns)) < 0.2)
    return dl.Transport(_core.Transport.from_dense(M, columns=str(COLUMNS), tile_rows=tile_rows))


@pytest.fixture(scope="module")
def transport():
    return tiled()


@pytest.fixture(scope="module")
def lights():
    return list(np.random.default_rng(1).normal(size=(8, COLUMNS.columns, 3)))


def together(threads: int, work) -> None:
    """Runs work(k) in so many threads that start at once; what any of them raises is raised here."""
    start, raised = threading.Barrier(threads), []

    def run(k: int) -> None:
        try:
            start.wait()
            work(k)
        except BaseException as error:
            raised.append(error)

    running = [threading.Thread(target=run, args=(k,), daemon=True) for k in range(threads)]
    for thread in running:
        thread.start()
    for thread in running:
        thread.join(60)
        assert not thread.is_alive(), "a thread hangs"
    if raised:
        raise raised[0]


both = pytest.mark.parametrize("threads", [2, 8])


@both
def test_a_relighter_shared_by_threads(transport, lights, threads):
    relighter = dl.Relighter(transport, dl.PerBand(terms=200))

    def work(k):
        for call in range(CALLS):
            frame = relighter.step(lights[(call + k) % len(lights)])
            assert np.isfinite(frame.values).all() and relighter.nbytes > 0 and relighter.values.shape
            if call % 8 == 0:
                # Another thread may have made a frame since.
                with contextlib.suppress(ValueError):
                    relighter.bounds(frame)

    together(threads, work)
    frame = relighter.step(lights[0])
    np.testing.assert_array_equal(frame.values, transport.multiply(relighter.values))


class Counted(dl.Method):
    """Everything that differs, in turns of a hundred; says how often it was asked."""

    asked = 0

    def choose(self, state):
        Counted.asked += 1
        return dl.Choice(columns=np.flatnonzero(state.change.any(axis=1)))


@both
def test_a_relighter_by_a_method_of_ones_own_shared_by_threads(transport, lights, threads):
    """Every frame but the first is its own choice: nothing is chosen between a question and its answer."""
    for _ in range(10):
        Counted.asked = 0
        relighter = dl.Relighter(transport, Counted(terms=100))
        together(threads, lambda k, r=relighter: [r.step(lights[(call + k) % len(lights)]) for call in range(4)])
        assert Counted.asked == 4 * threads - 1
    frame = relighter.step(lights[0])
    np.testing.assert_array_equal(frame.values, transport.multiply(relighter.values))


@both
def test_a_mix_changed_by_threads(lights, threads):
    factors = [tiled(seed=seed) for seed in range(2)]
    transport = dl.Transport(_core.Transport.join([factor._core for factor in factors]))
    rng = np.random.default_rng(2)
    mixes = rng.normal(size=(8, transport.shape[0], 2)).astype(np.float32)
    relighter = dl.Relighter(transport, dl.PerBand(terms=100), mix=mixes[0])
    relighter.step(lights[0])

    def work(k):
        for call in range(CALLS):
            (relighter.step(lights[call % 8]) if call % 2 else relighter.mix(mixes[(call + k) % 8])).values.sum()

    together(threads, work)
    frame = relighter.mix(mixes[3])
    np.testing.assert_array_equal(frame.values, transport.multiply(relighter.values, mix=mixes[3]))


@both
def test_a_pass_shared_by_threads(tmp_path, threads):
    scene = dl.Scene.builtin("cornell")
    prepared = Prepared(scene.with_camera(scene.camera.resized(24, 24)), Request("haar:4", "preview"))

    def work(k):
        for call in range(8):
            if (call + k) % 2:
                prepared.direct.tile(64 * k % 256, 64, threshold=0.0, quantum=-24, width="i8")
            else:
                prepared.direct.survey(2, tolerance=0.01, quantum=-24, width="i8")

    together(threads, work)


@both
def test_an_approximation_shared_by_threads(lights, threads):
    approximation = dl.Approximation(COLUMNS, dl.PerBand(terms=50))

    def work(k):
        for call in range(CALLS):
            approximation.step(lights[(call + k) % len(lights)])
            approximation.is_converged(approximation.values)

    together(threads, work)


@both
def test_the_first_product_of_a_transport_by_all_threads_at_once(lights, threads):
    fresh = [tiled(seed=seed) for seed in range(CALLS)]
    products = [[None] * threads for _ in fresh]

    def work(k):
        for transport, row in zip(fresh, products, strict=True):
            row[k] = transport.multiply(lights[0])

    together(threads, work)
    for row in products:
        assert all(np.array_equal(row[0], other) for other in row[1:])


@both
def test_a_transport_asked_everything_by_all_threads(transport, lights, threads):
    asked = [
        lambda: transport.multiply(np.stack(lights)),
        lambda: transport.column_norms,
        lambda: transport.column_bytes,
        lambda: transport.to_scipy(),
        lambda: transport.rmatmat(np.ones(transport.shape[0])),
        lambda: transport.row(5),
        lambda: dl.Relighter(transport, dl.Incremental(terms=5)).step(lights[0]),
    ]

    def work(k):
        for call in range(CALLS):
            asked[(call + k) % len(asked)]()

    together(threads, work)


@both
def test_an_environment_prepared_by_all_threads_at_once(threads):
    rng = np.random.default_rng(2)
    for _ in range(8):
        env = dl.Environment.from_latlong(rng.random((32, 64, 3)))
        found = [None] * threads

        def work(k, env=env, found=found):
            found[k] = [(columns, columns.coefficients(env)) for columns in (dl.Haar(16), dl.SphericalHarmonics(6))]

        together(threads, work)
        for mine, theirs in itertools.pairwise(found):
            assert all(np.array_equal(a[1], b[1]) for a, b in zip(mine, theirs, strict=True))


@both
def test_many_files_opened_and_written_by_all_threads(tmp_path, threads):
    scene = dl.Scene.builtin("cornell")
    scene = scene.with_camera(scene.camera.resized(24, 24))

    def work(k):
        path = tmp_path / f"{k}.transport"
        made = dl.precompute(scene, path, columns=dl.Haar(4), quality="preview", progress=False)
        again = [dl.Transport.open(path) for _ in range(4)]
        assert all(transport.nbytes == made.nbytes for transport in again)

    together(threads, work)


@both
def test_a_writer_shared_by_threads(tmp_path, threads):
    writer = _core.TransportWriter(tmp_path / "a.transport", "{}")
    tiles = tiled()._core.tiles()

    def work(k):
        for call in range(8):
            writer.write_shard("direct", (call + k) % 4, tiles[:4])
            assert writer.finished("direct")

    together(threads, work)


@contextlib.contextmanager
def spoiled(array, bad):
    """While this lasts another thread writes what is refused into an array and takes it back, again and again."""
    good, stop = array.copy(), threading.Event()

    def spoil() -> None:
        while not stop.is_set():
            array[:] = bad
            array[:] = good

    thread, interval = threading.Thread(target=spoil, daemon=True), sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    thread.start()
    try:
        yield
    finally:
        sys.setswitchinterval(interval)
        stop.set()
        thread.join(60)
        array[:] = good


@pytest.mark.parametrize("method", [dl.PerBand(terms=100), Counted(terms=100)], ids=["built-in", "own"])
def test_a_light_that_changes_during_a_step_is_taken_or_refused_whole(method):
    """A NaN that came between the check and the product stayed in all later frames."""
    columns = dl.Haar(64)
    M = np.random.default_rng(0).normal(size=(16, columns.columns))
    transport = dl.Transport(_core.Transport.from_dense(M, columns=str(columns), tile_rows=16))
    good = np.random.default_rng(1).normal(size=(columns.columns, 3))
    light, relighter = good.copy(), dl.Relighter(transport, method)
    with spoiled(light, np.nan):
        for _ in range(100):
            with contextlib.suppress(ValueError):
                assert np.isfinite(relighter.step(light).values).all()
    frame = relighter.step(good)
    np.testing.assert_array_equal(frame.values, transport.multiply(relighter.values))


def test_arrays_that_change_during_a_call_are_taken_or_refused_whole(transport, lights):
    factors = [tiled(seed=seed) for seed in range(2)]
    joined = dl.Transport(_core.Transport.join([factor._core for factor in factors]))
    light, mix = lights[0].copy(), np.ones((joined.shape[0], 2), np.float32)
    approximation = dl.Approximation(COLUMNS, dl.PerBand(terms=50))
    relighter = dl.Relighter(joined, dl.Full(), mix=mix)
    relighter.step(light)
    calls = [
        lambda: approximation.step(light).changes,
        lambda: transport.multiply(light),
        lambda: relighter.mix(mix).values,
        lambda: joined.multiply(lights[0], mix=mix),
    ]
    with spoiled(light, np.nan), spoiled(mix, np.inf):
        for call in calls * 60:
            with contextlib.suppress(ValueError):
                assert np.isfinite(call()).all()
    approximation.step(lights[0])
    assert np.isfinite(approximation.values).all()
