"""Ctrl-C from the first moment of the command line on: one line, 130, no traceback."""

import signal
import subprocess
import sys
import time

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
        # Until the first of our modules is there, Ctrl-C is Python's own.
        if status != 0 and "deltalux" in said and "starting.py" not in said:
            assert status == 130 and "Traceback" not in said, f"after {after:.2f} s: {said}"
            assert said.strip().splitlines()[-1].startswith("deltalux: stopped"), said
    # And the same command goes on.
    assert main(words) == 0 and dl.Transport.open(path).shape[0] > 0


def test_programs_that_import_us_keep_their_own_ctrl_c():
    text = "import signal, deltalux; assert signal.getsignal(signal.SIGINT) is signal.default_int_handler"
    before = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler); "
    subprocess.run([sys.executable, "-c", before + text], check=True)
