"""The seeded faults of tests/faults stay what they are: patches that apply, each with a test that there is.

That the tests catch them takes a build each: `python benches/reliability.py --rows faults`.
"""

import re
import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PATCHES = sorted((ROOT / "tests/faults").glob("*.patch"))

if not PATCHES or not (ROOT / "rust").exists():
    pytest.skip("needs the source tree", allow_module_level=True)


def test_there_are_as_many_as_ways_to_be_silently_wrong():
    assert len(PATCHES) >= 15


@pytest.mark.skipif(shutil.which("git") is None, reason="needs git")
@pytest.mark.parametrize("patch", PATCHES, ids=lambda patch: patch.stem)
def test_each_applies_says_what_it_is_and_names_a_test(patch):
    what, test, blank, *_ = patch.read_text().splitlines()
    assert what.endswith(".") and blank == "", "expected a sentence, the test, and an empty line before the patch"
    checked = subprocess.run(["git", "apply", "--check", str(patch)], cwd=ROOT, capture_output=True, text=True)
    assert checked.returncode == 0, checked.stderr
    kind, name = re.fullmatch(r"Test: (cargo|pytest) (\S+)", test).groups()
    file, function = name.split("::")
    file = ROOT / (f"tests/rust/{file}.rs" if kind == "cargo" else file)
    assert re.search(rf"^\s*(fn|def) {function}\(", file.read_text(), re.MULTILINE), f"no test {name}"
