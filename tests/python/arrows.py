"""Who imports whom, read from the source of both languages: every file is a room, every import an arrow between rooms.

Rust: all paths that begin with ``crate``, ``super``, ``self`` or a module in sight, in `use` lines and in code, are
followed through what a `mod.rs` hands on to the file that an item stands in. Test modules inside a file may look
anywhere.
Python: all imports that run, those inside functions included; what stands under `TYPE_CHECKING` is kept apart, as a
glance, which no program makes. Who enters a package passes its door: an import of ``a.b`` from outside runs
``a/__init__`` as well.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path

Graph = dict[str, set[str]]
"""For every file, by its path in the tree, the files that it needs."""

# ---- Rust ------------------------------------------------------------------------------------------------------------

# Comments, strings and characters: what is in them is no code. A lifetime ('a) has no second quote.
_NO_CODE = re.compile(
    r"//[^\n]*|/\*.*?\*/|b?r(#*)\".*?\"\1|b?\"(?:\\.|[^\"\\])*\"|b?'(?:\\[^\n]*?|[^'\\\n])'", flags=re.S
)
_TESTS = re.compile(r"#\[cfg\((?:all\()?test\b[^\]]*\)\]\s*(?:#\[[^\]]*\]\s*)*(?:pub\s+)?mod\s+\w+\s*\{")
_USE = re.compile(r"(?<!\w)(?:pub\s+)?use\s+([^;]+);")
_INLINE = re.compile(r"(?<!\w)mod\s+(\w+)\s*\{")
_SCOPE = re.compile(r"\bpub\s*\([^)]*\)")
_PATH = re.compile(r"(?<![\w:])(?:::)?((?:[a-zA-Z_]\w*\s*::\s*)+[a-zA-Z_]\w*)")


def rust_graph(root: Path) -> Graph:
    """The arrows between the files under a crate's source folder."""
    tree = _Crate(root)
    graph: Graph = {path: set() for path in tree.files.values()}
    for module, path in tree.files.items():
        graph[path] |= tree.arrows(module)
    return graph


def rust_code(text: str) -> str:
    """The text without comments, strings, test modules, and what says how far an item is seen."""
    code = _SCOPE.sub("pub", _NO_CODE.sub(" ", text))
    while found := _TESTS.search(code):
        code = code[: found.start()] + code[_closing(code, found.end()) :]
    return code


def _closing(code: str, at: int) -> int:
    """Behind the brace that closes the one before `at`."""
    depth = 1
    for end in range(at, len(code)):
        depth += {"{": 1, "}": -1}.get(code[end], 0)
        if depth == 0:
            return end + 1
    return len(code)


def use_items(tree: str) -> Iterator[tuple[list[str], str]]:
    """The paths of a `use` tree with the names that they bind: ``a::{b as c, d::*}`` is (a b, c) and (a d *, *)."""
    tree = tree.strip()
    if "{" not in tree:
        path, _, alias = re.sub(r"\s+as\s+", " as ", tree).partition(" as ")
        parts = [part.strip() for part in path.split("::") if part.strip()]
        if parts and parts[-1] == "self" and len(parts) > 1:
            parts.pop()
        if parts:
            yield parts, alias.strip() or parts[-1]
        return
    head, _, rest = tree.partition("{")
    depth, start, body = 0, 0, rest[: rest.rindex("}")]
    for k, letter in enumerate(f"{body},"):
        depth += {"{": 1, "}": -1}.get(letter, 0)
        if letter == "," and depth == 0:
            yield from use_items(head + body[start:k]) if body[start:k].strip() else ()
            start = k + 1


class _Crate:
    """The modules of a crate, what each brings into sight, and where an item stands."""

    def __init__(self, root: Path) -> None:
        self.files: dict[tuple[str, ...], str] = {}
        self.code: dict[tuple[str, ...], str] = {}
        for file in sorted(root.rglob("*.rs")):
            path = file.relative_to(root)
            parts = path.with_suffix("").parts
            module = parts[:-1] if parts[-1] in ("mod", "lib") else parts
            self._add(module, path.as_posix(), rust_code(file.read_text()))
        self.uses = {module: list(self._uses(code)) for module, code in self.code.items()}

    def _add(self, module: tuple[str, ...], path: str, code: str) -> None:
        """A module and those that stand inside its file."""
        while found := _INLINE.search(code):
            end = _closing(code, found.end())
            self._add((*module, found[1]), path, code[found.end() : end - 1])
            code = code[: found.start()] + code[end:]
        self.files[module], self.code[module] = path, code

    @staticmethod
    def _uses(code: str) -> Iterator[tuple[list[str], str]]:
        for found in _USE.finditer(code):
            yield from use_items(found[1])

    def arrows(self, module: tuple[str, ...]) -> set[str]:
        """The files that a module's `use` lines and paths lead to."""
        paths = [path for path, _ in self.uses[module]]
        without_uses = _USE.sub(" ", self.code[module])
        paths += [re.split(r"\s*::\s*", found[1]) for found in _PATH.finditer(without_uses)]
        homes = {self.home(module, path) for path in paths}
        return {self.files[home] for home in homes if home is not None} - {self.files[module]}

    def home(
        self, module: tuple[str, ...], path: list[str], asked: frozenset[tuple[tuple[str, ...], str]] = frozenset()
    ) -> tuple[str, ...] | None:
        """The module that the item at a path stands in, seen from a module; None for what is not this crate's."""
        first, *rest = path
        if first == "crate":
            at: tuple[str, ...] = ()
        elif first == "self":
            at = module
        elif first == "super":
            at = module[:-1]
        elif (*module, first) in self.files:
            at = (*module, first)
        else:
            # A name that a `use` line of this very file brought here.
            if (module, first) in asked:
                return None
            for own, name in self.uses[module]:
                if name == first and own != path[: len(own)]:
                    return self.home(module, [*own, *rest], asked | {(module, first)})
            return None
        for k, name in enumerate(rest):
            if name == "super":
                at = at[:-1]
            elif (*at, name) in self.files:
                at = (*at, name)
            else:
                return self._item(at, rest[k:], asked)
        return at

    def _item(
        self, at: tuple[str, ...], rest: list[str], asked: frozenset[tuple[tuple[str, ...], str]]
    ) -> tuple[str, ...]:
        """Where an item of a module stands: there, or where the module's own `use` has it from."""
        if (at, rest[0]) in asked:
            return at
        for own, name in self.uses[at]:
            if name == rest[0] or (name == "*" and self._defines(at, own[:-1], rest[0])):
                target = own if name != "*" else [*own[:-1], rest[0]]
                found = self.home(at, [*target, *rest[1:]], asked | {(at, rest[0])})
                return at if found is None else found
        return at

    def _defines(self, at: tuple[str, ...], path: list[str], name: str) -> bool:
        there = self.home(at, path)
        return there is not None and bool(
            re.search(rf"\b(?:fn|struct|enum|trait|type|const|static|mod|union)\s+{name}\b", self.code[there])
        )


# ---- Python ----------------------------------------------------------------------------------------------------------


def python_graph(root: Path) -> tuple[Graph, Graph]:
    """The arrows that run between the files of a package, and the glances that only a type checker follows."""
    package = _Package(root)
    running, glances = {}, {}
    for module in package.files:
        running[package.files[module]], glances[package.files[module]] = package.arrows(module)
    return running, glances


def python_imports(tree: ast.AST, checking: bool = False) -> Iterator[tuple[ast.Import | ast.ImportFrom, bool]]:
    """All imports, wherever they stand, and whether they stand under `TYPE_CHECKING`."""
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, (ast.Import, ast.ImportFrom)):
            yield node, checking
        elif isinstance(node, ast.If) and "TYPE_CHECKING" in ast.dump(node.test):
            for inner in node.body:
                yield from python_imports(ast.Module([inner], []), True)
            for inner in node.orelse:
                yield from python_imports(ast.Module([inner], []), checking)
        else:
            yield from python_imports(node, checking)


class _Package:
    """The modules of a package, by their names as Python knows them."""

    def __init__(self, root: Path) -> None:
        self.root, self.name = root, root.name
        self.files: dict[tuple[str, ...], str] = {}
        for file in sorted([*root.rglob("*.py"), *root.glob("_core.pyi")]):
            path = file.relative_to(root)
            parts = path.with_suffix("").parts
            self.files[parts[:-1] if parts[-1] == "__init__" else parts] = path.with_suffix("").as_posix()

    def arrows(self, module: tuple[str, ...]) -> tuple[set[str], set[str]]:
        """What a module imports when it runs, and what it only looks at."""
        if module == ("_core",):
            return set(), set()
        is_door = self.files[module].endswith("__init__")
        folder = module if is_door else module[:-1]
        kinds: tuple[set[str], set[str]] = (set(), set())
        for node, checking in python_imports(ast.parse((self.root / f"{self.files[module]}.py").read_text())):
            for target in self._targets(node, folder):
                doors = (target[:k] for k in range(1, len(target)))
                # The face of the whole package is every room's door, and so nobody's.
                passed = [door for door in doors if door in self.files and module[: len(door)] != door]
                kinds[checking].update(self.files[room] for room in (*passed, target) if room != module)
        return kinds

    def _targets(self, node: ast.Import | ast.ImportFrom, folder: tuple[str, ...]) -> Iterator[tuple[str, ...]]:
        """The modules of ours that an import names: `from x import y` is y if that is a module, and otherwise x."""
        if isinstance(node, ast.Import):
            for alias in node.names:
                name, *rest = alias.name.split(".")
                if name == self.name:
                    yield self._module(tuple(rest))
            return
        own = (node.module or "").split(".") if node.module else []
        if node.level:
            base = (*folder[: len(folder) - node.level + 1], *own)
        elif own[:1] == [self.name]:
            base = tuple(own[1:])
        else:
            return
        for alias in node.names:
            yield (*base, alias.name) if (*base, alias.name) in self.files else self._module(base)

    def _module(self, name: tuple[str, ...]) -> tuple[str, ...]:
        assert name in self.files, f"{'.'.join(name)} is no module of {self.name}"
        return name


# ---- graphs ----------------------------------------------------------------------------------------------------------


def circles(graph: Mapping[str, Iterable[str]]) -> list[set[str]]:
    """Files that need each other, however long the way round (strongly connected components, after Tarjan 1972)."""
    number: dict[str, int] = {}
    lowest: dict[str, int] = {}
    stack: list[str] = []
    found: list[set[str]] = []

    def visit(room: str) -> None:
        number[room] = lowest[room] = len(number)
        stack.append(room)
        for other in graph[room]:
            if other not in number:
                visit(other)
            if other in stack:
                lowest[room] = min(lowest[room], lowest[other])
        if lowest[room] == number[room]:
            circle = set(stack[stack.index(room) :])
            del stack[stack.index(room) :]
            if len(circle) > 1:
                found.append(circle)

    for room in graph:
        if room not in number:
            visit(room)
    return found


def reach(graph: Mapping[str, Iterable[str]], start: str) -> dict[str, str]:
    """All that a file needs, however long the way, each with the file that it was reached through."""
    through = {start: ""}
    waiting = [start]
    for room in waiting:
        for other in sorted(graph[room]):
            if other not in through:
                through[other] = room
                waiting.append(other)
    return through


def way(through: Mapping[str, str], end: str) -> str:
    """How a file was reached."""
    steps = [end]
    while through[steps[-1]]:
        steps.append(through[steps[-1]])
    return " -> ".join(reversed(steps))
