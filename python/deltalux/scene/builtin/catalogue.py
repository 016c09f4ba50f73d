"""The built-in scenes: procedural, deterministic, in colours of everyday things; each with a camera of its own."""

from __future__ import annotations

from collections.abc import Callable

from ...camera import Camera
from ..scene import Scene
from .cornell import cornell
from .plant import plant
from .still_life import still_life
from .street import street


def build(name: str, camera: Camera | None = None) -> Scene:
    """The built-in scene of this name, seen by its own camera unless one is given."""
    if name not in SCENES:
        raise ValueError(f"there is no built-in scene {name!r}; expected one of {', '.join(SCENES)}")
    scene = SCENES[name]()
    return scene if camera is None else scene.with_camera(camera)


SCENES: dict[str, Callable[[], Scene]] = {
    "plant": plant,
    "cornell": cornell,
    "still-life": still_life,
    "street": street,
}
