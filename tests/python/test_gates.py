"""The gates of `.ci/` themselves: what they let through, and that a hang does not hang them."""

import importlib.util
import subprocess
import sys
import time
from pathlib import Path

import pytest
from tools import missing

CI = Path(__file__).parents[2] / ".ci"
if not CI.exists():
    pytest.skip("needs the source tree", allow_module_level=True)


@pytest.fixture(scope="module")
def licences():
    spec = importlib.util.spec_from_file_location("licences", CI / "licences.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize(
    ("expression", "holds"),
    [
        ("MIT", True),
        ("GPL-3.0-only", False),
        ("GPL-3.0-only OR MIT", True),
        ("Unlicense/MIT", True),
        ("MIT AND GPL-3.0-only", False),
        ("(MIT OR GPL-3.0-only) AND Zlib", True),
        ("(MIT OR GPL-3.0-only) AND (GPL-3.0-only OR GPL-2.0-only)", False),
        # AND binds more tightly than OR.
        ("MIT OR GPL-3.0-only AND GPL-2.0-only", True),
        ("Apache-2.0 WITH LLVM-exception", True),
        ("GPL-3.0-only WITH LLVM-exception OR Zlib", True),
        ("unstated", False),
    ],
)
def test_licences(licences, expression, holds):
    assert licences.allowed(expression, {"MIT", "Zlib", "Apache-2.0 WITH LLVM-exception"}) is holds


def test_crates_come_from_the_registry_with_a_checksum(licences):
    ours = {"name": "deltalux", "version": "1", "source": None, "license": None}
    good = {"name": "a", "version": "1", "source": licences.REGISTRY, "license": "MIT"}
    locked = [{"name": "a", "version": "1", "checksum": "0"}]
    assert licences.complaints([ours, good], locked, {"MIT"}) == []
    fork = good | {"source": "git+https://example.org/a"}
    assert licences.complaints([fork], locked, {"MIT"}) == ["a 1 comes from git+https://example.org/a"]
    assert licences.complaints([good], [], {"MIT"}) == ["a 1 has no checksum in Cargo.lock"]
    (unstated,) = licences.complaints([good | {"license": None}], locked, {"MIT"})
    assert "no stated licence" in unstated


HANGS = {
    # Nothing in it hears a signal.
    "a lock": "import threading; lock = threading.Lock(); lock.acquire(); lock.acquire()",
    # Nor does any other thread of Python run.
    "the interpreter's lock": "import ctypes; ctypes.PyDLL(None).sleep(30)",
}


@pytest.mark.skipif(sys.platform == "win32", reason="needs sleep of the C library")
@pytest.mark.parametrize("hang", HANGS)
def test_a_test_that_hangs_is_killed(tmp_path, hang):
    """By the means of pyproject.toml, with less patience."""
    (tmp_path / "test_hang.py").write_text(f"def test_hang():\n    {HANGS[hang]}\n")
    options = ["-c", str(CI.parent / "pyproject.toml"), "--rootdir", str(tmp_path), "-p", "no:cacheprovider"]
    patience = ["-o", "timeout=1", "-o", "faulthandler_timeout=3"]
    command = [sys.executable, "-m", "pytest", *options, *patience, str(tmp_path)]
    started = time.monotonic()
    ended = subprocess.run(command, capture_output=True, text=True, timeout=60)
    printed = ended.stdout + ended.stderr
    assert ended.returncode != 0 and time.monotonic() - started < 20
    assert "Timeout" in printed and "in test_hang" in printed


@pytest.mark.parametrize("ci", ["", "true"])
def test_a_missing_tool_is_a_failure_in_ci_and_a_skip_at_the_desk(monkeypatch, ci):
    monkeypatch.setenv("CI", ci)
    with pytest.raises(pytest.fail.Exception if ci else pytest.skip.Exception, match="no such tool"):
        missing("no such tool")
