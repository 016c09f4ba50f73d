"""The built-in scenes: procedural, deterministic, in colours of everyday things; each with a camera of its own."""

from __future__ import annotations

from collections.abc import Callable

from ...mistakes import kind_of, near
from ..content import Content
from .cornell import cornell
from .plant import plant
from .still_life import still_life
from .street import street
from .studios import studio_box, studio_figures, studio_room, studio_still_life


def build(name: str) -> Content:
    """The built-in scene of this name."""
    if name not in SCENES:
        read = "; dl.Scene.load(path) reads a file" if kind_of(str(name)) else near(name, SCENES)
        raise ValueError(f"expected a built-in scene of {', '.join(SCENES)}, got {name!r}{read}")
    return SCENES[name]()


SCENES: dict[str, Callable[[], Content]] = {
    "plant": plant,
    "cornell": cornell,
    "still-life": still_life,
    "street": street,
    "studio-box": studio_box,
    "studio-figures": studio_figures,
    "studio-still-life": studio_still_life,
    "studio-room": studio_room,
}
