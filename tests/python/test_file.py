"""The transport file from Python: any matrix through a file and back, killed runs, full disks, foreign directories."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import textwrap
from pathlib import Path

import numpy as np
import pytest
from deltalux import _core
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

COLUMNS = 24  # haar:2


def receivers(rows: int) -> dict:
    triple = np.linspace(0, 1, 3 * rows, dtype=np.float32).reshape(rows, 3)
    return dict(
        image=(2, rows), pixel=np.arange(rows, dtype=np.uint32), weight=np.ones(rows, np.float32), albedo=triple,
        position=triple, normal=triple, background=np.zeros(2 * rows, np.float32),
    )  # fmt: skip


def describe(rows: int, *, quantum: int = -24, width: str = "i16", tile_rows: int = 16, **changed) -> dict:
    """Everything that `finish` asks for, made up."""
    return dict(
        parts=[("direct", "haar:2", rows, 1, quantum, width, tile_rows)],
        receivers=_core.ReceiverTable.pixels(**receivers(rows) | changed),
        camera='{"vertical_fov": 40.0}', plan='{"quality": "preview"}', scene="abc",
    )  # fmt: skip


def dense_rows(rows: int, seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return rng.normal(size=(rows, COLUMNS)) * (rng.random((rows, COLUMNS)) < 0.3)


def write(path: Path, array: np.ndarray, *, width: str = "i16", job: str = "{}") -> _core.Transport:
    made = _core.Transport.from_dense(array, columns="haar:2", tile_rows=16, width=width)
    tiles = made.tiles()
    writer = _core.TransportWriter(path, job)
    for number in range(0, len(tiles), 4):
        writer.write_shard("direct", number // 4, tiles[number : number + 4])
    writer.finish(**describe(len(array), width=width))
    return made


def read_dense(transport: _core.Transport) -> np.ndarray:
    return np.array([transport.row(i)[:, 0] for i in range(transport.rows)])


def contents(path: Path) -> dict[str, bytes]:
    return {entry.name: entry.read_bytes() for entry in path.iterdir()}


matrices = hnp.arrays(
    np.float64,
    st.tuples(st.integers(1, 70), st.just(COLUMNS)),
    elements=st.floats(-1000, 1000, width=32),
    fill=st.just(0.0),
)


@settings(deadline=None, max_examples=30)
@given(matrices, st.sampled_from(["i8", "i16"]))
def test_round_trip(tmp_path_factory, array, width):
    path = tmp_path_factory.mktemp("file") / "a.transport"
    made = write(path, array, width=width)
    opened = _core.Transport.open(path)
    stored = read_dense(opened)
    np.testing.assert_array_equal(stored, read_dense(made))

    # Each entry is within half a step of its group, and the stated loss of each row is not below the true one.
    groups = [slice(first, first + 16) for first in range(0, len(array), 16)]
    for group in groups:
        largest = np.abs(array[group]).max(axis=0)
        # No row spans more than 27 bits from its group's unit, so that sums with light are exact.
        longest = max(np.linalg.norm(array[group], axis=1).max() * 65 / 64, 2.0**-24)
        unit = max(2.0**-24, 2.0 ** (np.ceil(np.log2(longest)) - 27))
        step = np.maximum(unit, 2.0 ** np.ceil(np.log2(np.maximum(largest, 1e-30) / (127 if width == "i8" else 32767))))
        assert (np.abs(stored[group] - array[group]) <= step).all()
    lost = np.stack([np.linalg.norm((stored - array)[:, :24], axis=1)], axis=1)
    stated = np.linalg.norm(opened.dropped().astype(np.float64), axis=1, keepdims=True)
    assert (lost <= stated * (1 + 1e-12)).all()
    assert (
        np.linalg.norm(stored, axis=1) <= np.linalg.norm(opened.kept().astype(np.float64), axis=1) * (1 + 1e-12)
    ).all()


def test_what_a_file_says(tmp_path):
    array = dense_rows(70)
    write(tmp_path / "a.transport", array)
    opened = _core.Transport.open(tmp_path / "a.transport")
    given_ = describe(70)
    assert opened.shape == (70, COLUMNS) and opened.columns == "haar:2" and opened.width == "i16"
    assert opened.camera == given_["camera"] and opened.plan == given_["plan"] and opened.scene == "abc"
    table = opened.receivers
    assert table.kind == "pixels" and table.image_shape == (2, 70) and table.material is None and len(table) == 70
    for name in ("pixel", "weight", "albedo", "position", "normal"):
        np.testing.assert_array_equal(getattr(table, name), receivers(70)[name])
    assert table.background.shape == (2, 70) and opened.audit() is None and opened.version == [2, 3]
    assert opened.nbytes > 0 and table.nbytes == 70 * 44 + 140 * 4
    indptr, indices, data = opened.to_csr(0)
    stored = read_dense(opened)
    np.testing.assert_array_equal(data, stored[stored != 0])
    np.testing.assert_array_equal(np.diff(indptr), (stored != 0).sum(axis=1))
    np.testing.assert_array_equal(indices, np.nonzero(stored)[1])
    np.testing.assert_allclose(opened.column_norms(), np.linalg.norm(stored.astype(np.float64), axis=0), rtol=1e-12)
    assert opened.column_bytes().sum() == opened.entries * _core.entry_bytes("i16", 1)
    with pytest.raises(IndexError):
        opened.row(70)
    with pytest.raises(ValueError, match="expected an array"):
        opened.adjoint(np.zeros((1, 3, 3)))


def test_a_smaller_version(tmp_path):
    array = dense_rows(200)
    write(tmp_path / "a.transport", array, width="i8")
    opened = _core.Transport.open(tmp_path / "a.transport")
    threshold, error, entries = opened.threshold_for(0.3)
    assert 0.2 < error <= 0.3
    done = []
    opened.truncate_to(tmp_path / "b.transport", threshold, plan="{}", progress=done.append)
    smaller = _core.Transport.open(tmp_path / "b.transport")
    assert smaller.width == "i8" and smaller.nbytes < opened.nbytes
    assert smaller.entries == pytest.approx(entries * 13)
    np.testing.assert_array_equal(read_dense(smaller), read_dense(opened.truncated(threshold)))
    lost = np.linalg.norm(read_dense(smaller) - array, axis=1)
    assert (lost <= np.linalg.norm(smaller.dropped().astype(np.float64), axis=1)).all()
    # haar:2 has areas of 4 throughout, so the error under the prior is the plain relative norm.
    assert np.linalg.norm(lost) / np.linalg.norm(array) == pytest.approx(error, rel=1e-2)
    np.testing.assert_array_equal(smaller.receivers.albedo, opened.receivers.albedo)


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs a child process")
def test_an_open_transport_outlives_files_that_are_cut_or_written_over(tmp_path):
    """What had been mapped ended the process with SIGBUS, or changed products without a word."""
    path = tmp_path / "a.transport"
    write(path, dense_rows(70))
    child = os.fork()
    if child == 0:
        same = False
        try:
            opened = _core.Transport.open(path)
            before = read_dense(opened)
            for file in path.glob("*.safetensors"):
                os.truncate(file, 0)
                file.write_bytes(os.urandom(100))
            same = np.array_equal(read_dense(opened), before) and before.any()
        finally:
            os._exit(0 if same else 1)
    assert os.waitpid(child, 0)[1] == 0


def test_an_open_transport_outlives_its_replacement(tmp_path):
    path = tmp_path / "a.transport"
    write(path, dense_rows(70))
    before = _core.Transport.open(path)
    old = read_dense(before)
    write(path, dense_rows(50, seed=1))
    np.testing.assert_array_equal(read_dense(before), old)
    assert _core.Transport.open(path).rows == 50
    assert [entry.name for entry in tmp_path.iterdir()] == ["a.transport"]


WRITE_FOR_EVER = """
    import sys, numpy as np
    sys.path[:0] = {path!r}
    from test_file import _core, dense_rows, describe
    tiles = _core.Transport.from_dense(dense_rows(2000), columns="haar:2", tile_rows=16).tiles()
    writer = _core.TransportWriter({target!r}, "{{}}")
    print("ready", flush=True)
    for number in range(0, len(tiles), 4):
        if number // 4 not in writer.finished("direct"):
            writer.write_shard("direct", number // 4, tiles[number : number + 4])
    writer.finish(**describe(2000))
"""


def child(target: Path, before: str = "") -> subprocess.Popen:
    script = textwrap.dedent(WRITE_FOR_EVER).format(path=[str(Path(__file__).parent), *sys.path], target=str(target))
    return subprocess.Popen(
        [sys.executable, "-c", before + script], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )


@pytest.mark.skipif(sys.platform == "win32", reason="kill -9 is a Unix signal")
def test_killed_and_resumed_gives_the_same_bits(tmp_path):
    write(tmp_path / "whole.transport", dense_rows(2000))
    target = tmp_path / "killed.transport"
    for delay in (0.001, 0.01, 0.03):
        process = child(target)
        assert process.stdout.readline() == "ready\n"
        try:
            process.wait(timeout=delay)
        except subprocess.TimeoutExpired:
            process.send_signal(signal.SIGKILL)
        process.communicate()
        # Nothing half-written is ever taken for whole.
        if target.exists():
            assert _core.Transport.open(target).rows == 2000
    process = child(target)
    _, errors = process.communicate()
    assert process.returncode == 0, errors
    assert contents(target) == contents(tmp_path / "whole.transport")
    assert not (tmp_path / "killed.transport.partial").exists()


@pytest.mark.skipif(sys.platform == "win32", reason="the limit is a Unix one")
def test_a_full_disk_is_an_os_error_and_harms_nothing(tmp_path):
    target = tmp_path / "a.transport"
    write(target, dense_rows(70))
    before = contents(target)
    # A file may not grow beyond 12 kB: writing fails as on a full disk, with another number.
    limit = "import resource, signal; signal.signal(signal.SIGXFSZ, signal.SIG_IGN); "
    limit += "resource.setrlimit(resource.RLIMIT_FSIZE, (12000, 12000))\n"
    process = child(target, before=limit)
    _, errors = process.communicate()
    assert process.returncode == 1 and "OSError: [Errno 27]" in errors
    assert contents(target) == before
    # The run resumes when there is room again, and no temporary file is left in the meantime.
    assert not [entry for entry in (tmp_path / "a.transport.partial").iterdir() if entry.name.startswith(".tmp")]
    process = child(target)
    _, errors = process.communicate()
    assert process.returncode == 0, errors
    assert _core.Transport.open(target).rows == 2000


@pytest.mark.skipif(not Path("/dev/full").exists() or not Path("/proc").exists(), reason="needs Linux")
def test_a_directory_that_cannot_be_written(tmp_path):
    # The kernel's own directories refuse even the superuser.
    with pytest.raises(OSError):
        _core.TransportWriter("/proc/nowhere/a.transport", "{}")
    with pytest.raises(OSError):
        _core.TransportWriter("/proc/a.transport", "{}")
    if os.geteuid() != 0:
        tmp_path.chmod(0o500)
        with pytest.raises(PermissionError):
            _core.TransportWriter(tmp_path / "a.transport", "{}")
        tmp_path.chmod(0o700)


def test_foreign_directories_stay(tmp_path):
    (tmp_path / "thesis.txt").write_text("mine")
    with pytest.raises(_core.FileError, match="thesis.txt"):
        _core.TransportWriter(tmp_path, "{}")
    assert (tmp_path / "thesis.txt").read_text() == "mine"
    assert not tmp_path.with_name(tmp_path.name + ".partial").exists()


def test_damage_is_named(tmp_path):
    path = tmp_path / "a.transport"
    write(path, dense_rows(70))
    shard = path / "tiles-direct-00000.safetensors"
    whole = shard.read_bytes()
    for harm, reason in [
        (whole[:-1], "truncated"),
        (whole[:200] + bytes([whole[200] ^ 1]) + whole[201:], "checksum"),
        (b"", "truncated"),
    ]:
        shard.write_bytes(harm)
        with pytest.raises(ValueError, match=reason) as raised:
            _core.Transport.open(path)
        assert isinstance(raised.value, _core.FileError) and "tiles-direct-00000" in str(raised.value)
    shard.unlink()
    with pytest.raises(_core.FileError, match="missing"):
        _core.Transport.open(path)
    shutil.rmtree(path)
    with pytest.raises(FileNotFoundError):
        _core.Transport.open(path)


def test_bad_arguments(tmp_path):
    array = dense_rows(10)
    for changed, reason in [
        (dict(columns="haar:3"), "power of two"),
        (dict(columns="fourier"), "haar:64"),
        (dict(columns="haar:4"), "columns"),
        (dict(columns="haar:2", tile_rows=10), "multiple of 16"),
        (dict(columns="haar:2", width="f32"), "width"),
        (dict(columns="haar:2", quantum=60), "quantum"),
        (dict(columns="haar:2", threshold=-1.0), "threshold"),
    ]:
        with pytest.raises(ValueError, match=reason):
            _core.Transport.from_dense(array, **changed)
    for bad in (np.nan, np.inf, 3e6):
        array[3, 7] = bad
        with pytest.raises(ValueError, match="expected"):
            _core.Transport.from_dense(array, columns="haar:2")

    made = _core.Transport.from_dense(dense_rows(10), columns="haar:2", tile_rows=16)
    writer = _core.TransportWriter(tmp_path / "a.transport", "{}")
    with pytest.raises(ValueError, match="1 to 4 tiles"):
        writer.write_shard("direct", 0, [])
    with pytest.raises(ValueError, match="name of a part"):
        writer.write_shard("../direct", 0, made.tiles())
    writer.write_shard("direct", 0, made.tiles())
    with pytest.raises(ValueError, match="albedo"):
        describe(10, albedo=np.zeros((9, 3), np.float32))
    with pytest.raises(ValueError, match="background"):
        describe(10, background=np.zeros(3, np.float32))
    # Receivers of other rows are refused, and the run can still be finished.
    with pytest.raises(ValueError, match="30 numbers of albedo"):
        writer.finish(**describe(10) | dict(receivers=_core.ReceiverTable.pixels(**receivers(9))))
    writer.finish(**describe(10))
    with pytest.raises(ValueError, match="finished"):
        writer.finished("direct")
    with pytest.raises(ValueError, match="file"):
        made.receivers  # noqa: B018
