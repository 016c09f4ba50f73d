"""The README's example is the manual: it runs as it stands."""

import re
from pathlib import Path

README = Path(__file__).parents[2] / "README.md"


def test_the_example_runs(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (example,) = re.findall(r"```python\n(.*?)```", README.read_text(encoding="utf-8"), flags=re.S)
    names = {}
    exec(compile(example, "README.md", "exec"), names)
    assert names["picture"].shape == (64, 64, 3)
    assert "left out" in capsys.readouterr().out


def test_the_map_names_rooms_that_exist():
    rooms = re.findall(r"^\| `([^`]+/)`", README.read_text(encoding="utf-8"), flags=re.M)
    assert len(rooms) > 8
    for room in rooms:
        assert (README.parent / room).is_dir(), room
