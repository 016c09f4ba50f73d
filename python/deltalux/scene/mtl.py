"""Libraries of materials of Wavefront OBJ: colours, textures with their options, opacity, emission.

Textures multiply Kd. ``map_d`` cuts out where it is below one half of what it may be, by the picture's alpha where it
has one; ``d`` and ``Tr`` let a share of all rays through. ``norm`` is a picture of normals. What else a material says
is not shown, and what of it would be seen is noted.
Source: Ramey, Rose and Tyerman, MTL material format (1995).
"""

from __future__ import annotations

import os
import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from ..surface.cutout import Cutout
from ..surface.texture import Sampler
from .content import DEFAULT_ALBEDO, Content
from .nearby import nearby
from .texture import Picture, read_picture

__all__ = ["Finish", "read_libraries"]

_OPTIONS = {"-blendu": 1, "-blendv": 1, "-bm": 1, "-boost": 1, "-cc": 1, "-clamp": 1, "-imfchan": 1, "-mm": 2,
            "-texres": 1, "-type": 1, "-o": 3, "-s": 3, "-t": 3}  # fmt: skip
"""Options of maps, and how many values they have at the most."""
_UNSEEN = {"map_bump": "bump maps", "bump": "bump maps", "disp": "displacements", "map_ke": "emissive textures"}
"""Maps that are not shown, and what they are called."""


@dataclass
class _Map:
    """A texture that a material names."""

    name: str
    scale: tuple[float, ...] = (1.0, 1.0)
    offset: tuple[float, ...] = (0.0, 0.0)
    clamp: bool = False
    channel: str = ""
    strength: float = 1.0


@dataclass
class Finish:
    """A material, as it was read; it is added to the content when it is first used."""

    albedo: Any = None
    name: str = ""
    emission: Any = (0.0, 0.0, 0.0)
    opacity: float = 1.0
    folder: Path = Path()
    maps: dict[str, _Map] = field(default_factory=dict)
    numbers: dict[bool, int] = field(default_factory=dict)
    """Its place in the content, by whether it is white where it says nothing."""

    def placed(self, uv: np.ndarray) -> np.ndarray:
        """Texture coordinates as its textures are placed: scaled, and then moved."""
        for own in self.maps.values():
            return uv * own.scale + own.offset
        return uv

    def added(self, content: Content, white: bool) -> int:
        """Its number in the content; `white` is what it is where it has no colour of its own."""
        if white not in self.numbers:
            self.numbers[white] = self._added(content, white)
        return self.numbers[white]

    def _added(self, content: Content, white: bool) -> int:
        pictures = {
            key: read_picture(content, nearby(self.folder, own.name), own.name) for key, own in self.maps.items()
        }
        placed = {(own.scale, own.offset, own.clamp) for own in self.maps.values()}
        if len(placed) > 1:
            content.leave_out("texture transforms", f"all textures of {self.name} are placed as the first")
        kd, bent = pictures.get("map_kd"), pictures.get("norm")
        albedo = self.albedo
        if albedo is None:
            albedo = DEFAULT_ALBEDO if kd is None and not white else (1.0, 1.0, 1.0)
        clamp = any(own.clamp for own in self.maps.values())
        return content.add_material(
            albedo,
            None if kd is None else kd.linear,
            self.emission,
            self.name,
            sampler=Sampler(("clamp", "clamp")) if clamp else Sampler(),
            relief=None if bent is None else bent.normals(self.maps["norm"].strength),
            cutout=self._cutout(pictures.get("map_d")),
        )

    def _cutout(self, picture: Picture | None) -> Cutout | None:
        if picture is None:
            return Cutout(self.opacity) if self.opacity < 1.0 else None
        channel = self.maps["map_d"].channel
        alpha = picture.alpha if channel in ("", "m") and picture.alpha is not None else picture.grey
        return Cutout(self.opacity, 0.5 if self.opacity >= 1.0 else None, alpha)


def read_libraries(content: Content, folder: Path, libraries: list[str]) -> dict[str, Finish]:
    """The materials of all libraries by name; of equal names the first."""
    finishes: dict[str, Finish] = {}
    for line in libraries:
        # A name with spaces, or several names.
        for name in [line] if nearby(folder, line) else line.split():
            path = nearby(folder, name)
            if path is None:
                content.leave_out("missing material files", f"{name} is not beside the mesh")
                continue
            for finish in _library(content, path):
                finishes.setdefault(finish.name, finish)
    return finishes


def _library(content: Content, path: Path) -> list[Finish]:
    found: list[Finish] = []
    dissolve: dict[str, float] = {}
    for line in os.fsdecode(content.read(path)).splitlines():
        keyword, _, rest = line.strip().replace("\t", " ").partition(" ")
        keyword, rest = keyword.lower(), rest.strip()
        if keyword == "newmtl":
            found.append(Finish(name=rest, folder=path.parent))
            dissolve = {}
        elif not found or not rest:
            continue
        elif keyword in ("kd", "ke"):
            setattr(found[-1], "albedo" if keyword == "kd" else "emission", _colour(content, keyword, rest))
        elif keyword in ("d", "tr"):
            dissolve[keyword] = float(rest.split()[-1])
            # Both are written by some; they mean opposite things, and d is the older.
            found[-1].opacity = min(max(dissolve.get("d", 1.0 - dissolve.get("tr", 0.0)), 0.0), 1.0)
        elif keyword in ("map_kd", "map_d", "norm"):
            found[-1].maps[keyword] = _map(rest)
        elif keyword in _UNSEEN:
            content.leave_out(_UNSEEN[keyword], "they are not shown")
    return found


def _colour(content: Content, keyword: str, rest: str) -> Any:
    parts = rest.split()
    if parts[0] in ("spectral", "xyz"):
        content.leave_out("colours that are not RGB", f"{keyword} {parts[0]} is not shown")
        return None if keyword == "kd" else (0.0, 0.0, 0.0)
    return np.broadcast_to([float(part) for part in parts[:3]] if len(parts) >= 3 else float(parts[0]), 3)


def _map(rest: str) -> _Map:
    """A map's options and its file, whose name may have spaces."""
    found, parts = _Map(""), rest.split()
    while parts and parts[0].lower() in _OPTIONS:
        option = parts.pop(0).lower()
        values = [parts.pop(0)]
        while len(values) < _OPTIONS[option] and len(parts) > 1 and re.fullmatch(r"[-+.\d][-+.\deE]*", parts[0]):
            values.append(parts.pop(0))
        if option == "-clamp":
            found.clamp = values[0].lower() == "on"
        elif option == "-imfchan":
            found.channel = values[0].lower()
        elif option == "-bm":
            found.strength = float(values[0])
        elif option in ("-s", "-o"):
            missing = 1.0 if option == "-s" else 0.0
            pair = tuple([*map(float, values[:2]), missing][:2])
            found.scale, found.offset = (pair, found.offset) if option == "-s" else (found.scale, pair)
    found.name = " ".join(parts)
    return found
