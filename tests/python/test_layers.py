"""Who may import whom: the `use crate::` lines of Rust and the imports of Python, held against the house's table."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
RUST, PYTHON = ROOT / "rust", ROOT / "python" / "deltalux"

ANYONE = {"error", "sampling", "metrics"}
# A floor may use itself, `ANYONE`, and these.
FLOORS = {
    "error": set(),
    "sampling": set(),
    "metrics": set(),
    "basis": set(),
    "light": {"basis"},
    "brdf": set(),
    "scene": {"brdf"},
    "transport": {"basis"},
    "precompute": {"scene", "brdf", "light", "transport", "basis"},
    "update": {"transport", "basis"},
    "relight": {"update", "light", "transport", "brdf"},
    "edit": {"update", "transport", "brdf"},
}
# Foreign crates that enter through one file, or one folder, each.
CRATES = {"obvhs": "scene/tracer.rs", "pyo3": "python/", "numpy": "python/", "memmap2": "transport/"}
# Python packages that enter through these modules only.
PACKAGES = {
    "OpenImageIO": {"io"},
    "trimesh": {"io", "scene_io", "gltf"},
    "matplotlib": {"plotting", "pictures"},
    "PIL": {"gltf", "pictures", "scene_io"},
    "scipy": {"transport"},
    "mitsuba": set(),
    "embreex": set(),
    "pickle": set(),
}


def without_comments(text: str) -> str:
    return re.sub(r"//[^\n]*", "", re.sub(r"/\*.*?\*/", "", text, flags=re.S))


def crate_paths(text: str) -> set[str]:
    """The first names after `crate::`, in `use` lines, braces and paths alike."""
    code = without_comments(text)
    found = set(re.findall(r"\bcrate::(\w+)", code))
    for group in re.findall(r"\bcrate::\{(.*?)\};", code, flags=re.S):
        while "{" in group:
            group = re.sub(r"\{[^{}]*\}", "", group)
        found |= {re.match(r"\s*(\w+)", item).group(1) for item in group.split(",") if item.strip()}
    return found


def rust_files():
    files = sorted(RUST.rglob("*.rs"))
    assert len(files) > 30
    return files


def floor(path: Path) -> str:
    return path.relative_to(RUST).parts[0].removesuffix(".rs")


def misuses(name: str, text: str) -> set[str]:
    return crate_paths(text) - FLOORS[name] - ANYONE - {name}


@pytest.mark.skipif(not RUST.exists(), reason="needs the source tree")
@pytest.mark.parametrize("path", rust_files() if RUST.exists() else [], ids=lambda path: str(path.relative_to(RUST)))
def test_rust_floors(path):
    name = floor(path)
    text = path.read_text()
    if name not in ("python", "lib"):
        assert name in FLOORS, f"{name} is no floor of the house"
        assert misuses(name, text) == set(), f"{name} may use {sorted(FLOORS[name] | ANYONE)}"
        assert "super::super::super" not in text
    for crate, home in CRATES.items():
        named = re.search(rf"\b{crate}::|\buse {crate}\b", without_comments(text))
        assert not named or path.relative_to(RUST).as_posix().startswith(home), f"{crate} enters through {home}"


def test_the_reading_of_use_lines():
    text = "use crate::scene::{Mesh, Tracer};\nuse crate::{light::cubemap, basis::{Bands, haar}};\n// crate::edit;\n"
    assert crate_paths(text + "fn f() -> crate::brdf::Brdf {}") == {"scene", "light", "basis", "brdf"}
    assert misuses("update", text) == {"scene", "light"}
    assert misuses("precompute", text) == set()


def imports(tree: ast.AST) -> set[str]:
    """Top-level names of all imports, wherever they stand; relative ones with a leading dot."""
    found = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            found |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.level:
            found |= {f".{node.module}"} if node.module else {f".{alias.name}" for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            found.add(node.module.split(".")[0] if not node.module.startswith("deltalux.") else f".{node.module[9:]}")
    return found


def lazily(tree: ast.Module) -> set[str]:
    """Imports that run with the module itself: those outside functions and outside `if TYPE_CHECKING`."""
    body = [node for node in tree.body if not (isinstance(node, ast.If) and "TYPE_CHECKING" in ast.dump(node.test))]
    return set().union(*(imports(node) for node in body if isinstance(node, (ast.Import, ast.ImportFrom))), set())


# What a Python module must not reach: choosing knows no scene, and nothing below the command line knows of it.
NEVER = {
    "approximation": {".scene", ".precompute", ".transport", ".relight", ".environment"},
    "methods": {".scene", ".precompute", ".transport", ".relight", ".environment", "._core"},
    "columns": {".scene", ".precompute", ".transport", ".relight"},
    "environment": {".scene", ".precompute", ".transport", ".relight"},
    "scene": {".precompute", ".transport", ".relight", ".environment"},
    "transport": {".scene", ".precompute", ".relight"},
    "relight": {".scene", ".precompute"},
}
# Studies look at light and at transports; the light behind a blocker brings a scene of its own.
STUDIES = {".scene", ".precompute"}
TRACES = {"blocker": {".precompute"}}
TOP = {".cli", ".report", ".viewer", ".demo", ".studies"}


@pytest.mark.parametrize("path", sorted(PYTHON.rglob("*.py")), ids=lambda path: str(path.relative_to(PYTHON)))
def test_python_modules(path):
    tree = ast.parse(path.read_text())
    found = imports(tree)
    for package, homes in PACKAGES.items():
        assert package not in found or path.stem in homes, f"{package} enters through {sorted(homes)} only"
        assert package not in lazily(tree), f"{package} is imported where it is needed, not with deltalux"
    study = path.parent != PYTHON
    never = STUDIES - TRACES.get(path.stem, set()) if study else NEVER.get(path.stem, set())
    assert not found & never
    if f".{path.stem}" not in TOP and path.stem not in ("__init__", "__main__"):
        assert not found & TOP, "the command line and the report are on top"
    assert not re.search(r"allow_pickle\s*=\s*True|\beval\(|\bexec\(", path.read_text())


def test_the_package_says_what_it_exports():
    import deltalux

    assert sorted(deltalux.__all__) == deltalux.__all__
    assert all(hasattr(deltalux, name) for name in deltalux.__all__)


def test_import_is_light():
    """`import deltalux` loads none of the heavy packages."""
    import subprocess
    import sys

    script = "import sys, deltalux; print(*(name for name in sys.argv[1:] if name in sys.modules))"
    done = subprocess.run(
        [sys.executable, "-c", script, *PACKAGES], capture_output=True, text=True, check=True
    )  # fmt: skip
    loaded = set(done.stdout.split())
    assert loaded <= {"pickle"}, loaded
