"""Every public name says what it does, takes, returns and refuses, in sections that a reader and a machine find.

The rule, for all that `deltalux` exports, with the public methods of its classes, and for the doors of its rooms:

- there is a docstring;
- **Parameters** (of a class also **Attributes**) names every parameter but self;
- **Returns** or **Yields** is there where the annotation says that something comes back; properties need none;
- **Raises** is there where the body, or a function or method of ours that it calls by a name that can be looked up, has
  a ``raise``; it names what the body itself raises.

``python tests/python/test_docstrings.py`` prints what does not hold.
"""

from __future__ import annotations

import ast
import builtins
import importlib
import inspect
import re
import textwrap
from collections.abc import Iterator
from dataclasses import dataclass, is_dataclass
from functools import cached_property
from pathlib import Path
from types import FunctionType, ModuleType
from typing import Any

import deltalux
import pytest

ROOMS = ("brdf", "columns", "io", "light.motion", "light.sequences", "relight.gradients", "report", "studies")
DOORS = ("deltalux", *(f"deltalux.{room}" for room in ROOMS))


@dataclass(frozen=True)
class Public:
    """A name of the public face, and what stands behind it."""

    name: str
    thing: Any
    owner: type | None = None

    @property
    def home(self) -> str:
        """The module that it stands in."""
        function = self.function or self.thing
        return str(getattr(function, "__module__", None) or (self.owner.__module__ if self.owner else "deltalux._core"))

    @property
    def is_property(self) -> bool:
        return isinstance(self.thing, (property, cached_property))

    @property
    def function(self) -> Any:
        """What runs when it is used; of a class nothing here, since more than one thing does."""
        if isinstance(self.thing, property):
            return self.thing.fget
        if isinstance(self.thing, cached_property):
            return self.thing.func
        return getattr(self.thing, "__func__", self.thing)

    @property
    def doc(self) -> str:
        # A method that is written anew may be told of where it was first.
        inherits = isinstance(self.thing, FunctionType)
        return (inspect.getdoc(self.thing) if inherits else inspect.cleandoc(self.thing.__doc__ or "")) or ""


def public_face() -> list[Public]:
    """All names, each once, under the shortest path that leads to it."""
    found: dict[int, Public] = {}
    for door in DOORS:
        module = importlib.import_module(door)
        for name in module.__all__:
            thing = getattr(module, name)
            if isinstance(thing, ModuleType) or not (inspect.isclass(thing) or callable(thing)):
                continue
            if str(getattr(thing, "__module__", "")).startswith("deltalux") or inspect.isbuiltin(thing):
                found.setdefault(id(thing), Public(f"{door}.{name}", thing))
                for member in members(f"{door}.{name}", thing) if inspect.isclass(thing) else ():
                    found.setdefault(id(member.thing), member)
    return list(found.values())


def members(path: str, owner: type) -> Iterator[Public]:
    """Public methods and properties, inherited ones of ours included."""
    for base in owner.__mro__:
        if not base.__module__.startswith("deltalux"):
            continue
        for name, thing in vars(base).items():
            runs = isinstance(thing, (FunctionType, classmethod, staticmethod, property, cached_property))
            if runs and not name.startswith("_"):
                yield Public(f"{path}.{name}", thing, owner)


# What a docstring says ------------------------------------------------------------------------------------------------


def sections(doc: str) -> dict[str, list[str]]:
    """The lines of each section by its title: a line, and dashes below it."""
    lines, found, title = doc.splitlines(), {}, ""
    for line, below in zip(lines, [*lines[1:], ""], strict=True):
        if re.fullmatch(r"-{3,}", below.strip()) and line.strip():
            title = line.strip()
            found[title] = []
        elif title and not re.fullmatch(r"-{3,}", line.strip()):
            found[title].append(line)
    return found


def entries(lines: list[str]) -> set[str]:
    """The names that a section lists: at the margin, before a colon, apart by commas."""
    heads = [line.split(" : ")[0] for line in lines if line and not line[0].isspace()]
    return {name.strip().strip("*").strip("`") for head in heads for name in head.split(",")}


# What a body does -----------------------------------------------------------------------------------------------------


def parameters(public: Public) -> list[str]:
    """Names of what is passed, self and cls left out; of a class, what makes one."""
    thing = public.thing
    if public.is_property or (inspect.isclass(thing) and issubclass(thing, BaseException)):
        return []
    if inspect.isclass(thing) and not is_dataclass(thing) and "__init__" not in vars(thing):
        return []
    function = thing if inspect.isclass(thing) else public.function
    try:
        names = list(inspect.signature(function).parameters)
    except (TypeError, ValueError):
        return []
    return [name for name in names if name not in ("self", "cls") and not name.startswith("_")]


def bodies(public: Public) -> list[Any]:
    if inspect.isclass(public.thing):
        # A dataclass that writes its own maker has no use for what comes after a written one.
        written = getattr(public.thing, "__dataclass_params__", None)
        names = ("__init__",) if written is not None and not written.init else ("__init__", "__post_init__")
        found = [getattr(public.thing, name, None) for name in names]
        return [function for function in found if isinstance(function, FunctionType)]
    return [public.function] if isinstance(public.function, FunctionType) else []


def tree(function: FunctionType) -> ast.AST | None:
    try:
        return ast.parse(textwrap.dedent(inspect.getsource(function)))
    except (OSError, TypeError, SyntaxError):
        # Written by `dataclass`.
        return None


def raised(function: FunctionType) -> set[str]:
    """Names of the exceptions that a body raises by itself."""
    nodes = ast.walk(body) if (body := tree(function)) else ()
    calls = [
        node.exc.func if isinstance(node.exc, ast.Call) else node.exc for node in nodes if isinstance(node, ast.Raise)
    ]
    return {node.id for node in calls if isinstance(node, ast.Name)}


def called(function: FunctionType, owner: type | None) -> list[FunctionType]:
    """Functions and methods of ours that a body calls, as far as their names can be looked up."""
    found = []
    for node in ast.walk(body) if (body := tree(function)) else ():
        if not isinstance(node, ast.Call):
            continue
        thing: Any = None
        if isinstance(node.func, ast.Name):
            thing = function.__globals__.get(node.func.id)
        elif isinstance(node.func, ast.Attribute) and isinstance(node.func.value, ast.Name):
            at = node.func.value.id
            thing = getattr(owner if at in ("self", "cls") else function.__globals__.get(at), node.func.attr, None)
        thing = inspect.unwrap(getattr(thing, "__func__", thing)) if callable(thing) else None
        made = (
            [getattr(thing, name, None) for name in ("__init__", "__post_init__")]
            if inspect.isclass(thing)
            else [thing]
        )
        found += [one for one in made if isinstance(one, FunctionType) and one.__module__.startswith("deltalux")]
    return found


def can_raise(public: Public) -> bool:
    """Whether a ``raise`` stands in the body or on the way down from it."""
    waiting, seen = [(function, public.owner or public.thing) for function in bodies(public)], set()
    while waiting:
        function, owner = waiting.pop()
        if function in seen:
            continue
        seen.add(function)
        if raised(function):
            return True
        waiting += [(one, owner if one.__qualname__.split(".")[0] == getattr(owner, "__name__", "") else None)
                    for one in called(function, owner)]  # fmt: skip
    return False


def complaints(public: Public) -> list[str]:
    """What the rule asks of a public name and does not find."""
    if not public.doc:
        return ["no docstring"]
    said, found = sections(public.doc), []
    named = entries(said.get("Parameters", []))
    if inspect.isclass(public.thing):
        named |= entries(said.get("Attributes", []))
    if silent := [name for name in parameters(public) if name not in named]:
        found.append(f"Parameters without {', '.join(silent)}")
    function = public.function
    back = getattr(function, "__annotations__", {}).get("return", "None")
    if isinstance(function, FunctionType) and not public.is_property and back not in ("None", None, "NoReturn"):
        if not said.keys() & {"Returns", "Yields"}:
            found.append("no Returns")
    # A property that refuses is the exception: what it computes was checked when its object was made.
    if can_raise(public) and "Raises" not in said and not public.is_property:
        found.append("no Raises")
    listed = " ".join(said.get("Raises", []))
    own = {name for body in bodies(public) for name in raised(body)} if "Raises" in said else set()
    # A FileError is a ValueError.
    missed = sorted(name for name in own if name not in listed and hasattr(builtins, name))
    if missed:
        found.append(f"Raises without {', '.join(missed)}")
    return found


FACE = public_face()


@pytest.mark.parametrize("public", FACE, ids=lambda public: public.name)
def test_public_names_say_what_they_do(public):
    assert complaints(public) == []


def test_the_whole_face_is_walked():
    names = {public.name for public in FACE}
    assert len(names) > 80
    assert {f"deltalux.{name}" for name in deltalux.__all__} - names <= {
        *("deltalux.__version__", "deltalux.gradients", "deltalux.sequences")
    }
    for name in ("Camera.framing", "Environment.rotated", "Haar.bands", "Relighter.step", "Scene.load"):
        assert f"deltalux.{name}" in names
    assert {"deltalux.light.sequences.sunrise", "deltalux.report.report", "deltalux.studies.study"} <= names


def test_the_api_pages_show_the_whole_face():
    page = Path(__file__).parents[2] / "python" / "docs" / "api.rst"
    if not page.exists():
        pytest.skip("needs the source tree")
    shown = re.findall(r"^\.\. auto\w+:: deltalux\.([\w.]+)$", page.read_text(), flags=re.M)
    assert {name for name in deltalux.__all__ if name != "__version__"} <= set(shown)
    assert len(shown) == len(set(shown))


def _check(value):
    if value < 0:
        raise ValueError(value)


def undocumented(a, *, b=1) -> int:
    """Something."""
    _check(a)
    return a + b


def documented(a, *, b=1) -> int:
    """Something.

    Parameters
    ----------
    a, b : int
        Summands.

    Returns
    -------
    int
        The sum.

    Raises
    ------
    TypeError
        For text.
    """
    if isinstance(a, str):
        raise TypeError(a)
    return a + b


def half(a) -> int:
    """Something.

    Parameters
    ----------
    b
        Another.

    Returns
    -------
    int

    Raises
    ------
    ValueError
        Never.
    """
    raise TypeError(a)


def test_the_rule_itself(monkeypatch):
    monkeypatch.setattr(_check, "__module__", "deltalux.checks")
    assert complaints(Public("undocumented", undocumented)) == ["Parameters without a, b", "no Returns", "no Raises"]
    assert complaints(Public("documented", documented)) == []
    assert complaints(Public("half", half)) == ["Parameters without a", "Raises without TypeError"]
    assert complaints(Public("nothing", lambda: None)) == ["no docstring"]


if __name__ == "__main__":
    for public in FACE:
        for complaint in complaints(public):
            print(f"{public.home}: {public.name}: {complaint}")
