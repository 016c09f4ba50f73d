"""What to say of a mistake: what was given instead of what was meant, and how to come by that."""

from __future__ import annotations

import difflib
import functools
import os
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, TypeVar

_Type = TypeVar("_Type", bound=type[Any])

_LIGHTS = (".hdr", ".exr", ".pic", ".png", ".jpg", ".jpeg", ".tif", ".tiff", ".webp")
_SCENES = (".glb", ".gltf", ".obj", ".ply", ".stl")
_DIRECTORIES = {
    "curves.json": ("a transport of curves", "dl.CurveTransport.open(path)"),
    "studio.json": ("a transport of a studio", "dl.StudioTransport.open(path)"),
    "manifest.json": ("a transport", "dl.Transport(path)"),
}
"""What a directory is by its manifest, and what opens it."""

# Where what is asked for comes from.
_SOURCES = {
    "Environment": "dl.Environment.load(path) reads one, and dl.Environment.builtin(name) is sky, studio or hall",
    "Transport": "dl.Transport(path) opens one, and dl.precompute(scene, path) makes one",
    "Camera": "dl.Camera(position, target) is one",
    "Scene": "dl.Scene.load(path) reads one, and dl.Scene.builtin(name) is one of the package's own",
}


def near(value: Any, choices: Iterable[Any]) -> str:
    """A question that names what was probably meant, to stand behind a refusal; "" where nothing is near."""
    lower = {choice.lower(): choice for choice in choices if isinstance(choice, str)}
    text = str(value).lower()
    within = [name for name in lower if len(text) > 2 and text in name]
    found = difflib.get_close_matches(text, lower, 1, 0.6) or within[:1]
    return f"; did you mean {lower[found[0]]!r}?" if found else ""


def described(value: Any) -> str:
    """What was given, in a few words."""
    if isinstance(value, type):
        return f"the class {value.__name__}"
    if isinstance(value, (str, int, float)) or value is None:
        return repr(value)
    name = type(value).__name__.replace("ndarray", "array")
    return f"{_article(name)} {name}"


def _article(name: str) -> str:
    return "an" if name[0].lower() in "aeiou" else "a"


def instead_of(expected: str, value: Any) -> TypeError:
    """The refusal of something that is no object of a class of ours, with how to come by one."""
    return TypeError(f"expected {_article(expected)} {expected}, got {described(value)}; {_SOURCES[expected]}")


def no_columns(value: Any) -> TypeError:
    """The refusal of something that is no columns of light."""
    meant = f"; did you mean dl.Haar({value})?" if type(value) is int else ""
    return TypeError(f'expected columns such as dl.Haar(64) or "haar:64", got {described(value)}{meant}')


def checked_path(value: Any, what: str = "a path") -> None:
    """Refuses what is no path."""
    if not isinstance(value, (str, os.PathLike)):
        raise TypeError(f"expected {what}, got {described(value)}")
    if not os.fspath(value):
        raise ValueError(f"expected {what}, got an empty one")


def kind_of(path: str | os.PathLike[str]) -> str:
    """What a file is, by what it looks like: one of the transports, "a scene", "a light"; "" where none."""
    file = Path(path)
    for manifest, (kind, _) in _DIRECTORIES.items():
        if (file / manifest).exists():
            return kind
    suffix = file.suffix.lower()
    return "a light" if suffix in _LIGHTS else "a scene" if suffix in _SCENES else ""


def misplaced(path: str | os.PathLike[str], wanted: str) -> str:
    """What to say of a file that is there, and is something else than what is wanted: of directories, what opens them;
    "" where there is nothing to say."""
    kind = kind_of(path) if os.path.exists(path) else ""
    if kind in ("", wanted):
        return ""
    opens = "".join(f"; {how} opens it" for found, how in _DIRECTORIES.values() if found == kind)
    return f"{os.fspath(path)}: expected {wanted}, but this is {kind}{opens}"


def refuse_kind(path: str | os.PathLike[str], wanted: str) -> None:
    """Refuses a file that is there, and is something else than what is wanted."""
    if said := misplaced(path, wanted):
        raise ValueError(said)


def refuse_missing(path: str | os.PathLike[str]) -> None:
    """Refuses a transport that is not there, and says how one is made, or that is no whole directory."""
    if not os.path.exists(path):
        name = os.fspath(path)
        how = f"`deltalux precompute SCENE -o {name}` or dl.precompute(scene, {str(name)!r}) makes one"
        raise FileNotFoundError(f"{name}: there is no such transport; {how}")
    if os.path.isfile(path):
        inside = f"; did you mean {str(Path(path).parent)!r}?" if Path(path).name in _DIRECTORIES else ""
        raise NotADirectoryError(f"{os.fspath(path)}: expected the directory of a transport, got a file{inside}")
    if not kind_of(path):
        raise FileNotFoundError(
            f"{os.fspath(path)}: expected a transport, but no manifest.json is in it: none is whole"
        )


def suggests_keywords(cls: _Type) -> _Type:
    """A class whose constructor names the keyword that was probably meant."""
    made: Callable[..., None] = vars(cls)["__init__"]

    @functools.wraps(made)
    def init(self: object, *arguments: Any, **options: Any) -> None:
        try:
            made(self, *arguments, **options)
        except TypeError as error:
            names = list(getattr(cls, "__dataclass_fields__", {}))
            unknown = [name for name in options if name not in names]
            if not names or not unknown or "unexpected keyword" not in str(error):
                raise
            known = ", ".join(names)
            what = f"expected keywords of {cls.__name__} ({known}), got {unknown[0]!r}{near(unknown[0], names)}"
            raise TypeError(what) from None

    setattr(cls, "__init__", init)  # noqa: B010, a type checker refuses the assignment
    return cls
