"""Ctrl-C from the first moment of the command line on: one line, 130, no traceback."""

import os
import shlex
import signal
import subprocess
import sys
import time
from pathlib import Path

import deltalux as dl
import numpy as np
import pytest
from deltalux.command.cli import main


def stopped(words: list[str], after: float) -> tuple[int, str]:
    """The exit status and standard error of a command that hears Ctrl-C so many seconds after it has begun."""
    # A shell that runs things in the background has them ignore Ctrl-C.
    own = {"preexec_fn": lambda: signal.signal(signal.SIGINT, signal.default_int_handler)}
    command = [sys.executable, "-m", "deltalux", *words]
    child = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, **own)
    time.sleep(after)
    child.send_signal(signal.SIGINT)
    _, said = child.communicate(timeout=60)
    return child.returncode, said


@pytest.mark.skipif(sys.platform == "win32", reason="needs signals")
def test_ctrl_c_at_any_moment_is_one_line(tmp_path):
    """A traceback of whatever package was just being imported."""
    path = tmp_path / "a.transport"
    words = ["precompute", "cornell", "-o", str(path), "--size", "64x64", "--columns", "haar:16", "--again"]
    for after in np.linspace(0.05, 1.2, 8):
        status, said = stopped(words, float(after))
        # Until our package is there, Ctrl-C is Python's own.
        if status != 0 and "deltalux" in said:
            assert status == 130 and "Traceback" not in said, f"after {after:.2f} s: {said}"
            assert said.strip().splitlines()[-1].startswith("deltalux: stopped"), said
    # And the same command goes on.
    assert main(words) == 0 and dl.Transport.open(path).shape[0] > 0


@pytest.mark.parametrize("of", ["-m deltalux --version", "-c 'import deltalux'"])
def test_ctrl_c_while_the_first_module_is_read(tmp_path, of):
    """Until `starting` is there, Ctrl-C was Python's own."""
    (tmp_path / "sitecustomize.py").write_text(
        """
import sys
class Finder:
    def find_spec(self, name, path=None, target=None):
        if name == "deltalux.starting":
            sys.meta_path.remove(self)
            raise KeyboardInterrupt
sys.meta_path.insert(0, Finder())
"""
    )
    own = {**os.environ, "PYTHONPATH": os.pathsep.join([str(tmp_path), str(Path(dl.__file__).parents[1])])}
    done = subprocess.run([sys.executable, *shlex.split(of)], env=own, capture_output=True, text=True)
    if of.startswith("-m"):
        assert (done.returncode, done.stderr) == (130, "deltalux: stopped\n")
    else:
        assert "KeyboardInterrupt" in done.stderr and done.returncode != 0


def test_programs_that_import_us_keep_their_own_ctrl_c():
    text = "import signal, deltalux; assert signal.getsignal(signal.SIGINT) is signal.default_int_handler"
    before = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler); "
    subprocess.run([sys.executable, "-c", before + text], check=True)


@pytest.mark.skipif(sys.platform == "win32", reason="needs signals")
def test_a_bus_error_is_not_silent():
    """As a mapped file brings that somebody shortens."""
    text = """
import os, signal
from deltalux.command import cli
cli.main = lambda: os.kill(os.getpid(), signal.SIGBUS)
cli.run()
"""
    done = subprocess.run([sys.executable, "-c", text], capture_output=True, text=True)
    assert done.returncode == -signal.SIGBUS
    assert "Bus error" in done.stderr, done.stderr
