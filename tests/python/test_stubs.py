"""The typed face of the Rust module says what is there, and users' type checkers take what the package offers."""

import json
import subprocess
import sys
from pathlib import Path

import deltalux
import pytest
from tools import needed


@pytest.mark.slow
def test_stubs_match_the_module(tmp_path):
    needed("mypy")
    command = [sys.executable, "-m", "mypy.stubtest", "deltalux._core"]
    checked = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=300)
    assert checked.returncode == 0, checked.stdout + checked.stderr


@pytest.mark.slow
def test_columns_are_what_an_approximation_asks_for(tmp_path):
    """Pyright, which takes no `cached_property` for a property, once refused the README's kind of line."""
    needed("basedpyright")
    (tmp_path / "user.py").write_text(
        "import deltalux as dl\n"
        "dl.Approximation(dl.Haar(64), dl.PerBand(terms=30))\n"
        "dl.Approximation(dl.SphericalHarmonics(20), dl.HarmonicOrder())\n"
    )
    package = str(Path(deltalux.__file__).parents[1])
    (tmp_path / "pyrightconfig.json").write_text(
        json.dumps({"include": ["user.py"], "extraPaths": [package], "typeCheckingMode": "standard"})
    )
    command = [sys.executable, "-m", "basedpyright", "--pythonpath", sys.executable]
    checked = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=300)
    assert checked.returncode == 0, checked.stdout + checked.stderr
