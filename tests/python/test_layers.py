"""Who may import whom, in both languages: one table of rooms and floors, held however long the way.

An arrow, from the file that imports to the file that is imported, stays in its room or goes down; rooms on one floor do
not see each other; and no two files need each other, not even by a detour. ``python tests/python/test_layers.py``
prints the house.
"""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from pathlib import Path

import pytest
from arrows import Graph, circles, python_graph, python_imports, reach, rust_code, rust_graph, use_items, way

ROOT = Path(__file__).parents[2]
RUST, PYTHON = ROOT / "rust", ROOT / "python" / "deltalux"

# The floors of both languages, from the ground up. A room is a folder or, where there is none, a file.
RUST_FLOORS = (
    ("error", "sampling", "metrics", "twice"),
    ("basis",),
    ("light", "transport", "brdf"),
    ("scene", "update"),
    ("precompute", "relight", "edit"),
    ("python",),
    ("lib",),
)
PYTHON_FLOORS = (
    ("_core",),
    ("mistakes", "plain", "starting"),
    ("checks", "images"),
    ("rotation", "sphere", "io", "output", "progress", "tasks"),
    ("light", "update", "columns", "brdf", "camera"),
    ("surface",),
    ("transport", "scene", "pages"),
    ("relight", "precomputation"),
    ("report", "edit", "datasets"),
    ("viewer", "torch"),
    ("__init__",),
    ("studies",),
    ("command",),
    ("__main__",),
)
# What a room never reaches, though floors would let it, however long the way.
RUST_NEVER = {
    "scene": {"light", "transport"},
    "update": {"light", "brdf"},
    "precompute": {"light"},
    "edit": {"scene", "light"},
    "relight": {"scene"},
}
PYTHON_NEVER = {
    "scene": {"light", "columns", "update"},
    # A file opens without a reader of meshes, and M knows no light.
    "transport": {"light", "update"},
    # M is the same under every method, and under every light: it only knows those that it is measured under.
    "precomputation": {"update"},
    "relight": {"scene"},
    # The report and the studies look at transports and light.
    "report": {"scene", "precomputation"},
    "studies": {"scene", "precomputation"},
}
# Studies that trace scenes, and what lists or runs all studies.
TRACES = {
    "studies/harmonics/blocker",
    *(f"studies/interreflection/{name}" for name in ("tracing", "furnaces", "furnace_pages", "bounces", "slides")),
    *(f"studies/factored/{name}" for name in ("findings", "factors", "views", "__init__")),
    *(f"studies/reflectance/{name}" for name in ("carriers", "freezing", "freezing_findings")),
    *(f"studies/interreflection/bounce_{name}" for name in ("findings", "pictures", "claims")),
    *(f"studies/reflectance/{name}" for name in ("pearls", "curves")),
    *("studies/catalogue", "studies/run", "studies/__init__"),
}
# What a type checker sees upwards or across a floor, and no program runs.
GLANCES = {
    # Light projects itself: columns only say in their signatures that they are asked with light.
    ("columns/daubechies4", "light/environment"),
    ("columns/haar", "light/environment"),
    ("columns/harmonics", "light/environment"),
    ("columns/inner", "light/environment"),
    ("columns/lamps", "light/environment"),
}
# Foreign crates and packages enter through one file, or one folder, each.
CRATES = {
    "obvhs": "scene/(rays/)?tracer",
    "pyo3": "python/",
    "numpy": "python/",
    "memmap2": "transport/",
}
PACKAGES = {
    "OpenImageIO": {"images/oiio"},
    "trimesh": {"scene/files"},
    "matplotlib": {"pages/plotting", "report/gallery"},
    "mapbox_earcut": {"scene/polygons"},
    "PIL": {"images/colour", "images/encoded", "relight/video", "scene/texture", "report/gallery"},
    "scipy": {"transport/matrix"},
    "imageio_ffmpeg": {"relight/video"},
    "websockets": {"viewer/server"},
    # A module that is asked for by who has PyTorch, and by nobody else.
    "torch": {"torch"},
    "dask": {"datasets/arrays", "datasets/run"},
    "zarr": {"transport/matrix"},
    "mitsuba": set(),
    "embreex": set(),
    "pickle": set(),
}


def room(file: str) -> str:
    """The first part of a file's path."""
    return file.split("/")[0].removesuffix(".rs")


def floors(table: tuple[tuple[str, ...], ...]) -> dict[str, int]:
    return {name: number for number, names in enumerate(table) for name in names}


def misuses(graph: Graph, table: tuple[tuple[str, ...], ...]) -> list[str]:
    """Arrows that go up or across."""
    of = floors(table)
    unknown = sorted({room(file) for file in graph} - of.keys())
    wrong = [f"{name} is no room of the house" for name in unknown]
    arrows = [(a, b) for a, targets in graph.items() for b in sorted(targets) if {room(a), room(b)} <= of.keys()]
    return wrong + [f"{a} -> {b}" for a, b in arrows if room(a) != room(b) and of[room(a)] <= of[room(b)]]


def detours(graph: Graph, never: dict[str, set[str]], spared: frozenset[str] = frozenset()) -> list[str]:
    """Ways, however long, to rooms that a file must not reach."""
    found = []
    for file in graph:
        if room(file) in never and file not in spared:
            through = reach(graph, file)
            ends = [end for end in through if room(end) in never[room(file)]]
            found += [way(through, end) for end in ends]
    return found


@pytest.fixture(scope="module")
def rust() -> Graph:
    if not RUST.exists():
        pytest.skip("needs the source tree")
    return rust_graph(RUST)


@pytest.fixture(scope="module")
def python() -> Graph:
    return python_graph(PYTHON)[0]


def test_rust_arrows_go_down(rust):
    assert len(rust) > 30 and sum(map(len, rust.values())) > 60
    assert misuses(rust, RUST_FLOORS) == []
    assert detours(rust, RUST_NEVER) == []


def test_rust_has_no_circles(rust):
    assert [sorted(circle) for circle in circles(rust)] == []


def test_python_arrows_go_down(python):
    assert len(python) > 60 and sum(map(len, python.values())) > 120
    assert misuses(python, PYTHON_FLOORS) == []
    assert detours(python, PYTHON_NEVER, frozenset(TRACES)) == []


def test_python_has_no_circles(python):
    assert [sorted(circle) for circle in circles(python)] == []


def test_only_listed_glances_go_up():
    _, glances = python_graph(PYTHON)
    of = floors(PYTHON_FLOORS)
    pairs = {(a, b) for a, targets in glances.items() for b in targets if not b.endswith("__init__")}
    assert {(a, b) for a, b in pairs if room(a) != room(b) and of[room(a)] <= of[room(b)]} == GLANCES


@pytest.mark.skipif(not RUST.exists(), reason="needs the source tree")
def test_crates_enter_through_one_file():
    for path in sorted(RUST.rglob("*.rs")):
        for crate, home in CRATES.items():
            named = re.search(rf"\b{crate}::|\buse {crate}\b", rust_code(path.read_text()))
            assert not named or re.match(home, path.relative_to(RUST).as_posix()), f"{path}: {crate} enters at {home}"


@pytest.mark.parametrize("path", sorted(PYTHON.rglob("*.py")), ids=lambda path: str(path.relative_to(PYTHON)))
def test_python_files(path):
    file, text = path.relative_to(PYTHON).with_suffix("").as_posix(), path.read_text()
    tree = ast.parse(text)
    at_once = {id(node) for node in tree.body}
    for node, checking in python_imports(tree):
        own = isinstance(node, ast.ImportFrom) and bool(node.level)
        names = [node.module or ""] if isinstance(node, ast.ImportFrom) else [alias.name for alias in node.names]
        for package in {name.split(".")[0] for name in names} & PACKAGES.keys() if not own else ():
            assert file in PACKAGES[package], f"{package} enters through {sorted(PACKAGES[package])} only"
            late = checking or id(node) not in at_once or file == package
            assert late, f"{package} is imported where it is needed, not with deltalux"
        assert "deltalux" not in {name.split(".")[0] for name in names} or own, "our own modules are named relatively"
        if own:
            assert checking or id(node) in at_once, "imports of our own stand at the head of a file"
            private = [alias.name for alias in node.names if re.match("_(?!_)", alias.name)]
            assert not private, f"{private} belong to another file"
    assert not re.search(r"allow_pickle\s*=\s*True|\beval\(|\bexec\(", text)


def test_the_package_says_what_it_exports():
    import deltalux

    assert sorted(deltalux.__all__) == deltalux.__all__
    assert all(hasattr(deltalux, name) for name in deltalux.__all__)


def test_no_room_is_called_what_the_package_exports():
    """`deltalux.plan` is a function and nothing else."""
    import deltalux

    rooms = {room(path.relative_to(PYTHON).with_suffix("").as_posix()) for path in PYTHON.rglob("*.py")}
    assert not rooms & set(deltalux.__all__)


def test_import_is_light():
    """`import deltalux` loads none of the heavy packages, and neither the report nor a study nor the command line."""
    script = "import sys, deltalux; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    loaded = set(done.stdout.split())
    assert loaded & PACKAGES.keys() <= {"pickle"}
    assert not {name for name in loaded if re.match(r"deltalux\.(pages|report|studies|command)\b", name)}


def test_how_use_lines_are_read():
    tree = "crate::{light::cubemap as faces, basis::{Bands, haar::*}, scene::self}"
    assert [("::".join(path), name) for path, name in use_items(tree)] == [
        ("crate::light::cubemap", "faces"),
        ("crate::basis::Bands", "Bands"),
        ("crate::basis::haar::*", "*"),
        ("crate::scene", "scene"),
    ]


def test_rust_paths_lead_to_the_file_that_an_item_stands_in(tmp_path):
    files = {
        "lib.rs": "pub mod a; pub mod b;",
        "a/mod.rs": "mod deep; mod far;\npub use deep::Deep;\npub use far::*;\n",
        "a/deep.rs": (
            "use super::Far; pub struct Deep;\n"
            "mod own { use super::Deep; pub(in crate::b) fn f() {} }\n"
            "#[cfg(test)]\nmod tests { use crate::b::B; fn f() { '{'; } }"
        ),
        "a/far.rs": "// use crate::b::B;\npub struct Far; const S: &str = \"use crate::b::B;\"; fn f<'a>(x: &'a u8) {}",
        "b.rs": "use crate::a; pub struct B;\nfn f() -> a::Deep { crate::a::Far::new() }",
    }
    for name, text in files.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text)
    graph = rust_graph(tmp_path)
    assert graph["a/deep.rs"] == {"a/far.rs"} and graph["a/far.rs"] == set()
    assert graph["b.rs"] == {"a/mod.rs", "a/deep.rs", "a/far.rs"}
    assert misuses(graph, (("a",), ("b",), ("lib",))) == []
    assert misuses(graph, (("b",), ("a",), ("lib",))) == [f"b.rs -> a/{name}.rs" for name in ("deep", "far", "mod")]
    assert detours(graph, {"b": {"a"}})[0] == "b.rs -> a/deep.rs"


def test_python_arrows_pass_doors_and_run_inside_functions(tmp_path):
    files = {
        "p/__init__.py": "from .low import one",
        "p/_core.pyi": "",
        "p/low/__init__.py": "",
        "p/low/one.py": "from .two import X\nfrom .._core import Y",
        "p/low/two.py": "def f():\n    from . import one",
        "p/high.py": (
            "from typing import TYPE_CHECKING\n"
            "if TYPE_CHECKING:\n    from .low.two import X\nelse:\n    from .low.one import X"
        ),
    }
    for name, text in files.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text)
    running, glances = python_graph(tmp_path / "p")
    assert running["high"] == {"low/__init__", "low/one"} and glances["high"] == {"low/__init__", "low/two"}
    assert running["low/one"] == {"low/two", "_core"}
    assert circles(running) == [{"low/one", "low/two"}]


def show(title: str, graph: Graph, table: tuple[tuple[str, ...], ...]) -> None:
    """A language's floors from the top, its rooms with their files and where their arrows go."""
    arrows = [(a, b) for a, targets in graph.items() for b in targets]
    between = {(room(a), room(b)) for a, b in arrows if room(a) != room(b)}
    found = [circle for circle in circles(graph)]
    rooms = {room(file) for file in graph}
    stairs = [names for names in table if rooms & set(names)]
    print(
        f"{title}: {len(graph)} files in {len(rooms)} rooms on {len(stairs)} floors, {len(arrows)} arrows, "
        f"{len(between)} between rooms, {len(misuses(graph, table))} up or across, {len(found)} circles"
    )
    for number, names in reversed(list(enumerate(table))):
        for name in names:
            files = sum(room(file) == name for file in graph)
            if files:
                below = ", ".join(sorted(b for a, b in between if a == name))
                print(f"  {number}  {name:<16}{files:>3} file{'s' * (files > 1):<2}-> {below or '-'}")
    for line in misuses(graph, table):
        print(f"  up or across: {line}")
    for circle in found:
        print(f"  circle: {', '.join(sorted(circle))}")


if __name__ == "__main__":
    show("Rust", rust_graph(RUST), RUST_FLOORS)
    show("Python", python_graph(PYTHON)[0], PYTHON_FLOORS)
