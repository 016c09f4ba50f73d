"""Tasks on other people's executors: bits equal to a run alone, and a worker that is killed costs its task."""

import os
import shutil
import signal
import subprocess
import sys
import textwrap
from concurrent.futures import BrokenExecutor, ProcessPoolExecutor, ThreadPoolExecutor
from functools import partial
from multiprocessing import get_context
from pathlib import Path

import deltalux as dl
import pytest
from deltalux.light.motion import Motion
from deltalux.studies import study
from deltalux.tasks import completed, spawned
from test_datasets import tree

CORNELL = dl.Scene.builtin("cornell")
# More rows than a shard has.
LARGE = CORNELL.with_camera(CORNELL.camera.resized(256, 256))
TRACED = {"columns": "haar:2", "quality": "preview", "progress": False}
DATA = {"count": 6, "shard": 1, "format": "png16", "progress": False}
pytestmark = pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="needs SIGKILL")


def die_once(marker, function, task):
    """Kills its worker the first time, and does the task the second."""
    try:
        Path(marker).touch(exist_ok=False)
    except FileExistsError:
        return function(task)
    os.kill(os.getpid(), signal.SIGKILL)


class Deadly:
    """Somebody's executor, of whose tasks the third kills the worker that does it."""

    def __init__(self, executor, marker):
        self.executor, self.marker, self.count = executor, str(marker), 0

    def submit(self, function, task):
        self.count += 1
        return self.executor.submit(partial(die_once, self.marker, function) if self.count == 3 else function, task)


def square(x):
    return x * x


def dead(x):
    os.kill(os.getpid(), signal.SIGKILL)


@pytest.fixture(scope="module")
def transport(tmp_path_factory):
    path = tmp_path_factory.mktemp("executors") / "a.transport"
    scene = CORNELL.with_camera(CORNELL.camera.resized(16, 16))
    return dl.precompute(scene, path, columns="haar:8", quality="preview", progress=False)


@pytest.fixture(scope="module")
def alone(transport, tmp_path_factory):
    """A data set and a transport that nobody else had a hand in."""
    folder = tmp_path_factory.mktemp("alone")
    dl.dataset(transport, folder / "data", **DATA)
    dl.precompute(LARGE, folder / "large.transport", **TRACED)
    return folder


def same_transport(a, b):
    """All but the plan, which tells the time that it took."""
    names = [file.name for file in a.iterdir() if file.suffix == ".safetensors"]
    assert len([name for name in names if "direct" in name or "tiles" in name]) > 1
    return all((a / name).read_bytes() == (b / name).read_bytes() for name in names)


def test_without_an_executor_tasks_are_done_here():
    assert sorted(completed(square, range(4), None)) == [(0, 0), (1, 1), (2, 4), (3, 9)]


def test_what_a_task_raises_is_raised():
    with ThreadPoolExecutor(2) as executor, pytest.raises(ZeroDivisionError):
        list(completed((1).__truediv__, [1, 0, 2], executor))


def test_threads_trace_the_same_bits(alone, tmp_path):
    with ThreadPoolExecutor(2) as executor:
        dl.precompute(LARGE, tmp_path / "a.transport", executor=executor, **TRACED)
    assert same_transport(alone / "large.transport", tmp_path / "a.transport")


def test_processes_leave_the_same_bits_though_one_is_killed(transport, alone, tmp_path):
    with ProcessPoolExecutor(2, get_context("spawn")) as executor:
        with pytest.warns(UserWarning, match="a worker died, and its pool with it"):
            dl.dataset(transport, tmp_path / "data", executor=Deadly(executor, tmp_path / "dead"), **DATA)
    assert tree(tmp_path / "data") == tree(alone / "data")


def test_processes_trace_the_same_bits(alone, tmp_path):
    with ProcessPoolExecutor(1, get_context("spawn")) as executor:
        dl.precompute(LARGE, tmp_path / "a.transport", executor=executor, **TRACED)
    assert same_transport(alone / "large.transport", tmp_path / "a.transport")


def test_processes_of_ours_are_made_anew(tmp_path):
    """But not for ever: a task that kills whoever does it is an error."""
    with spawned(1) as executor:
        once = partial(die_once, str(tmp_path / "dead"), square)
        assert sorted(completed(once, range(3), executor)) == [(0, 0), (1, 1), (2, 4)]
        with pytest.raises(BrokenExecutor, match="workers keep dying over the same 1 tasks"):
            list(completed(dead, [1], executor))


def test_dask_leaves_the_same_bits_though_a_worker_is_killed(transport, alone, tmp_path):
    distributed = pytest.importorskip("distributed", reason="needs dask[distributed]")
    options = {"n_workers": 2, "threads_per_worker": 1, "dashboard_address": None, "silence_logs": 50}
    with distributed.LocalCluster(**options) as cluster, distributed.Client(cluster) as client:
        executor = client.get_executor(pure=False)
        dl.dataset(transport, tmp_path / "data", executor=Deadly(executor, tmp_path / "dead"), **DATA)
        assert tree(tmp_path / "data") == tree(alone / "data") and (tmp_path / "dead").exists()
        dl.precompute(LARGE, tmp_path / "a.transport", executor=executor, **TRACED)
    assert same_transport(alone / "large.transport", tmp_path / "a.transport")


def test_a_study_s_chapters_are_done_by_others(tmp_path):
    envs = [dl.Environment.builtin(name) for name in ("studio", "hall")]
    given = {"motion": Motion(rotate=20.0, frames=8, hold=2), "columns": dl.Haar(4), "progress": False}
    alone = study("energy", tmp_path / "alone", envs, **given)
    # One thread: plots are drawn by one at a time.
    with ThreadPoolExecutor(1) as executor:
        others = study("energy", tmp_path / "others", envs, executor=executor, **given)
    files = sorted(file.name for file in alone.parent.iterdir())
    assert files == sorted(file.name for file in others.parent.iterdir()) and len(files) > 4
    tables = [name for name in files if name.endswith(".csv")]
    assert tables and all((alone.parent / name).read_bytes() == (others.parent / name).read_bytes() for name in tables)
    # What follows says when it was made.
    said, found = (page.read_text().partition("Machine and run")[0] for page in (alone, others))
    assert said == found and said.index("studio") < said.index("hall")


MPI = """
import sys
import deltalux as dl
from mpi4py.futures import MPIPoolExecutor
from test_executors import DATA, LARGE, TRACED, Deadly

if __name__ == "__main__":
    transport, folder, deadly = sys.argv[1:]
    with MPIPoolExecutor() as executor:
        if deadly == "yes":
            executor = Deadly(executor, folder + "/dead")
        else:
            dl.precompute(LARGE, folder + "/a.transport", executor=executor, **TRACED)
        dl.dataset(dl.Transport(transport), folder + "/data", executor=executor, **DATA)
"""


@pytest.mark.slow
def test_mpi_leaves_the_same_bits_though_a_worker_is_killed(transport, alone, tmp_path):
    pytest.importorskip("mpi4py", reason="needs mpi4py and an MPI")
    mpiexec = shutil.which("mpiexec") or shutil.which("mpiexec", path=str(Path(sys.executable).parent))
    if mpiexec is None:
        pytest.skip("needs mpiexec")
    script = tmp_path / "run.py"
    script.write_text(textwrap.dedent(MPI))
    path = os.pathsep.join(
        filter(None, (str(Path(__file__).parent), str(Path(dl.__file__).parents[1]), os.environ.get("PYTHONPATH")))
    )
    command = [
        mpiexec,
        "-n",
        "2",
        sys.executable,
        "-m",
        "mpi4py.futures",
        str(script),
        str(transport._path),
        str(tmp_path),
    ]
    # A worker that dies takes the run with it, as MPI has it: what is whole stays, and the same call goes on.
    died = subprocess.run([*command, "yes"], env=os.environ | {"PYTHONPATH": path}, capture_output=True, timeout=120)
    assert died.returncode != 0 and (tmp_path / "dead").exists()
    subprocess.run(
        [*command, "no"], env=os.environ | {"PYTHONPATH": path}, capture_output=True, timeout=120, check=True
    )
    assert tree(tmp_path / "data") == tree(alone / "data")
    assert same_transport(alone / "large.transport", tmp_path / "a.transport")
