"""Clustered transport: what is built, that frames over it are exact and within their bounds, and what is refused."""

import deltalux as dl
import numpy as np
import pytest
from deltalux import _core
from deltalux.transport.clusters import colours_of
from forms import METHODS, NEVER_CONVERGE, STOP_SHORT, dense
from hypothesis import given, settings
from hypothesis import strategies as st

HAAR = dl.Haar(8)


@pytest.fixture(scope="module")
def source(tmp_path_factory):
    """A small box in haar:8, truncated to one percent; columns without texels."""
    scene = dl.Scene.builtin("cornell")
    scene = scene.with_camera(scene.camera.resized(24, 24))
    path = tmp_path_factory.mktemp("source") / "box.transport"
    return dl.precompute(scene, path, columns=HAAR, quality="publication", progress=False)


@pytest.fixture(scope="module")
def clustered(source, tmp_path_factory):
    return source.clustered(tmp_path_factory.mktemp("made") / "box.transport", 12, 5, progress=False)


@pytest.fixture(scope="module")
def built():
    """In memory: two stages of random rows of which many are alike, and the dense rows in their order."""
    rng = np.random.default_rng(5)
    M = dense(rng, 384, 12)[rng.integers(0, 12, 90)] * rng.uniform(0.5, 1, (90, 1)) + 0.01 * dense(rng, 384, 90)
    # In float32, as a pass delivers them.
    M = M.astype(np.float32).astype(np.float64)
    source = _core.Transport.from_dense(M, columns="haar:8", tile_rows=32, width="i8", threshold=0.01)
    made = _core.Clusters(source, clusters=8, representatives=2, tolerance=0.02)
    core = _core.Transport.join([made.representatives], made.link, [made.weights])
    return dl.Transport(core), M[made.order]


def picture_error(source, clustered, env):
    exact = source.image(source.multiply(source.coefficients(env)))
    found = clustered.image(clustered.multiply(clustered.coefficients(env)))
    return np.linalg.norm(found - exact) / np.linalg.norm(exact)


def test_what_is_built_is_opened_and_says_what_it_is(source, clustered):
    assert clustered.shape == source.shape and clustered.factors == 1
    assert str(clustered.second_columns) == "representatives:12x5"
    assert clustered.second_columns.band_names == ("means", "representatives")
    assert [part.make for part in clustered.plan.parts] == ["representatives", "weights"]
    assert clustered.plan.rows == source.shape[0] == clustered.plan.parts[1].rows
    assert clustered.plan.left_out == source.plan.left_out and clustered.plan.errors == {}
    assert "12 clusters of" in clustered.plan.notes[-1] and "receivers x 72 columns" in str(clustered.plan)
    # The same receivers in another order: the same albedos in the same pixels, and nothing else behind them.
    flat = np.ones((source.shape[0], 3), np.float32)
    np.testing.assert_allclose(clustered.image(flat), source.image(flat), rtol=1e-6)
    assert clustered.audit is None


def test_more_representatives_are_nearer(source, tmp_path):
    hall = dl.Environment.builtin("hall")
    made = [source.clustered(tmp_path / f"{each}.transport", 12, each, progress=False) for each in (0, 3, 25)]
    errors = [picture_error(source, transport, hall) for transport in made]
    assert errors[0] > 2 * errors[1] > 4 * errors[2] and errors[2] < 0.02
    assert made[0].second_columns.band_names == ("means",)


def test_a_cluster_for_every_row_is_the_transport(source, tmp_path):
    made = source.clustered(tmp_path / "all.transport", 4 * source.shape[0], 1, progress=False)
    assert picture_error(source, made, dl.Environment.builtin("hall")) < 2 * source.plan.tolerance
    assert len(set(made.cluster_map().tolist())) == len(np.unique(source.to_scipy().toarray(), axis=0))


def test_the_map_shows_clusters_where_their_rows_are(clustered):
    labels, picture = clustered.cluster_map(), clustered.cluster_picture()
    assert (np.diff(labels.astype(int)) >= 0).all() and set(labels.tolist()) == set(range(12))
    colours = colours_of(labels)
    assert len(np.unique(colours, axis=0)) == 12 and colours.min() >= 0 and colours.max() <= 1
    whole = np.bincount(clustered.pixels.pixel, clustered.pixels.weight)
    at = int(clustered.pixels.pixel[7])
    own = clustered.pixels.pixel == at
    expected = (clustered.pixels.weight[own, None] * colours[own]).sum(axis=0)
    np.testing.assert_allclose(picture.reshape(-1, 3)[at], expected, rtol=1e-5)
    assert picture.shape == (24, 24, 3) and whole[at] > 0


@pytest.mark.parametrize("name", METHODS)
@settings(max_examples=8, deadline=None)
@given(data=st.data())
def test_frames_are_within_their_bound_and_end_exact(built, name, data):
    """Lights that move a little, much or not at all, whatever is sent in either step: against the rows as they were."""
    transport, M = built
    terms = data.draw(st.integers(0, 24), label="terms of the second step")
    rng = np.random.default_rng(data.draw(st.integers(0, 2**32 - 1), label="seed"))
    relighter = dl.Relighter(transport, METHODS[name], second=dl.Incremental(terms=terms, weight="transport"))
    V = rng.normal(size=(384, 3)) * 10.0 ** rng.uniform(-4, 2, (384, 1))
    for size in [0.0, *data.draw(st.lists(st.sampled_from([0.0, 0.01, 1.0, 1e4]), max_size=5), label="moves")]:
        V = V + size * rng.normal(size=V.shape)
        frame = relighter.step(V)
        error = np.abs(frame.values.astype(np.float64) - M @ V)
        bounds = relighter.bounds(frame)
        assert (error <= bounds).all() and error.max() <= frame.bound and bounds.max() <= frame.bound
    if terms and name not in NEVER_CONVERGE | STOP_SHORT:
        frame = next(frame for frame in (relighter.step(V) for _ in range(400)) if frame.converged)
        np.testing.assert_array_equal(frame.values, transport.multiply(relighter.values))


def test_a_bound_is_of_some_use(built):
    """Of light that stands still it is what a row has lost in every band: some times the error, not hundreds."""
    transport, M = built
    V = np.random.default_rng(8).normal(size=(384, 3))
    frame = dl.Relighter(transport, dl.Full()).step(V)
    error = np.abs(frame.values - M @ V)
    lost = frame.bound / error.max()
    assert frame.converged and 1 < lost < 60, lost


def test_a_budget_in_error_is_kept(built):
    """The second stage sends all, so that what the first leaves is all that is left besides what was lost."""
    transport, _ = built
    V = np.random.default_rng(9).normal(size=(384, 3))
    everything = dl.Incremental(terms=10**6)
    rest = dl.Relighter(transport, dl.Full(), second=everything).step(V).bound
    for error in (1.1 * rest, 3 * rest):
        frame = dl.Relighter(transport, dl.Incremental(error=error), None, second=everything).step(V)
        assert frame.bound <= error and len(frame.columns) > 0
    with pytest.raises(ValueError, match="what truncation takes"):
        dl.Relighter(transport, dl.Incremental(error=0.9 * rest), None, second=everything).step(V)


def test_what_cannot_be_clustered_is_refused(source, clustered, tmp_path):
    path = tmp_path / "a.transport"
    for arguments, message in (
        ((0, 5), "at least one cluster"),
        ((-1, 5), "clusters"),
        ((4, 256), "at most 255 representatives"),
        ((4.5, 2), "clusters"),
        ((2**20, 25), "1048576 in all"),
    ):
        with pytest.raises((ValueError, TypeError), match=message):
            source.clustered(path, *arguments, progress=False)
    with pytest.raises(ValueError, match="one matrix"):
        clustered.clustered(path, 4, 2, progress=False)
    with pytest.raises(ValueError, match="expected a clustered transport"):
        source.cluster_map()
    texels = dl.Scene.builtin("cornell")
    texels = texels.with_camera(texels.camera.resized(6, 6))
    made = dl.precompute(texels, tmp_path / "t.transport", columns="haar:2+texels", quality="preview", progress=False)
    with pytest.raises(ValueError, match="without texels"):
        made.clustered(path, 4, 2, progress=False)
    (tmp_path / "foreign").mkdir()
    (tmp_path / "foreign" / "letter.txt").write_text("dear")
    with pytest.raises(ValueError, match="will not be replaced"):
        source.clustered(tmp_path / "foreign", 4, 2, progress=False)
    assert not path.exists() and not path.with_name("a.transport.partial").exists()


def test_an_interrupted_build_leaves_nothing(source, tmp_path):
    path = tmp_path / "stopped.transport"

    class Stop(Exception):
        pass

    def stop(done, total):
        assert 0 <= done <= total
        raise Stop

    with pytest.raises(Stop):
        source.clustered(path, 12, 5, progress=stop)
    assert list(tmp_path.iterdir()) == []
    heard = []
    source.clustered(path, 12, 5, progress=lambda done, total: heard.append((done, total)))
    assert heard[-1][0] == heard[-1][1] and heard == sorted(heard)


def test_threads_leave_the_same_files(source, tmp_path):
    before = dl.threads()
    made = {}
    try:
        for threads in (1, 3):
            dl.set_threads(threads)
            path = tmp_path / f"{threads}.transport"
            source.clustered(path, 12, 5, progress=False)
            made[threads] = {file.name: file.read_bytes() for file in path.iterdir()}
    finally:
        dl.set_threads(before)
    assert made[1] == made[3]


def test_norms_in_a_file_are_checked(clustered, source, tmp_path):
    path = tmp_path / "a.transport"
    source.clustered(path, 12, 5, progress=False)
    assert "link.safetensors" in dict(dl.Transport.open(path).files)
    (path / "link.safetensors").unlink()
    with pytest.raises((dl.FileError, OSError)):
        dl.Transport.open(path)
    kept = np.ones((20, 1, 1))
    with pytest.raises(ValueError, match="finite norms"):
        _core.Link.representatives([(kept, -kept)])
    with pytest.raises(ValueError, match="norms a row"):
        _core.Link.representatives([(kept, kept[:3])])
