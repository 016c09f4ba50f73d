"""The README's examples are the manual: they run as they stand."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
# A source distribution holds the tests, but not what runs them.
SOURCE = pytest.mark.skipif(not (ROOT / ".ci").exists(), reason="needs the source tree")
README, CONTRIBUTING = ROOT / "README.md", ROOT / "CONTRIBUTING.md"


def test_the_examples_run(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    first, *others = re.findall(r"```python\n(.*?)```", README.read_text(encoding="utf-8"), flags=re.S)
    names = {}
    for example in (first, *others):
        exec(compile(example, "README.md", "exec"), names)
    assert names["picture"].shape == (64, 64, 3)
    out = capsys.readouterr().out
    assert "left out" in out
    assert others and "Loudest(terms=30) image error" in out


def test_the_map_names_rooms_that_exist():
    rooms = re.findall(r"^\| `([^`]+/)`", README.read_text(encoding="utf-8"), flags=re.M)
    assert len(rooms) > 8
    for room in rooms:
        assert (README.parent / room).is_dir(), room


@SOURCE
def test_where_to_knock_names_rooms_that_exist():
    table = re.findall(r"^\| (?!---|I want)(.*?) \| (.*) \|$", CONTRIBUTING.read_text(encoding="utf-8"), flags=re.M)
    assert len(table) > 8
    for wish, rooms in table:
        paths = [path for path in re.findall(r"`([^`]+)`", rooms) if "/" in path]
        assert paths, wish
        for path in paths:
            assert (ROOT / path).exists(), path


@SOURCE
def test_gates_by_hand_are_those_of_ci():
    """What CONTRIBUTING says to run is what `.ci/run` runs, but for where tools are and how much is fuzzed."""
    ci = (ROOT / ".ci" / "run").read_text(encoding="utf-8")
    told = CONTRIBUTING.read_text(encoding="utf-8").partition("## The gates")[2]
    (block,) = re.findall(r"```sh\n(.*?)```", told.partition("## ")[0], flags=re.S)
    plain = ci.replace("--locked ", "").replace("-q ", "").replace("env ", "")
    commands = [part.strip() for line in block.splitlines() for part in line.partition("#")[0].split("&&")]
    assert len(commands) > 9
    for command in commands:
        assert re.sub(r" --(seconds|seed) \d+", "", command) in plain, command
