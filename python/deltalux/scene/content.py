"""Content: what a source hands over, as it was read; only `Scene` checks it and puts it together."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from ..camera import Camera
from ..plain import read_plain
from ..surface.cutout import Cutout
from ..surface.texture import Sampler

MOST_TRIANGLES = 100_000_000
# Of the scene's file and all that it names: more than 100 million triangles take.
MOST_BYTES = 4 << 30
# Of all textures together, 3 GB as linear floats: a picture of one colour takes next to nothing in a file.
MOST_TEXELS = 1 << 28
# Surfaces of which the source does not say the colour are middle grey.
DEFAULT_ALBEDO = (0.5, 0.5, 0.5)
_PLAIN = Sampler()


@dataclass(frozen=True)
class Piece:
    """Some triangles of one material, in world space."""

    vertices: np.ndarray
    triangles: np.ndarray
    uv: np.ndarray | None
    material: int
    normals: np.ndarray | None = None
    """Of vertices, of any length; 0 where one has none."""
    tangents: np.ndarray | None = None
    """(v, 4): along u, and the sense of the bitangent."""
    colours: np.ndarray | None = None
    """Linear factors of the albedo."""
    opacity: np.ndarray | None = None
    """Factors of the opacity."""

    def placed(self, matrix: np.ndarray) -> Piece:
        """The same, moved by a 4 x 4 matrix; normals stay across the surface."""
        linear = matrix[:3, :3]
        # The cofactors: the inverse's transpose as far as directions go, and there for flattened meshes too.
        across = np.stack([np.cross(linear[(k + 1) % 3], linear[(k + 2) % 3]) for k in range(3)])
        normals = None if self.normals is None else self.normals @ across.T
        tangents = self.tangents
        if tangents is not None:
            sense = np.where(np.linalg.det(linear) < 0.0, -1.0, 1.0) * tangents[:, 3:]
            tangents = np.concatenate([tangents[:, :3] @ linear.T, sense], axis=1)
        points = self.vertices @ linear.T + matrix[:3, 3]
        return replace(self, vertices=points, normals=normals, tangents=tangents)


@dataclass
class Content:
    """What a file or a built-in model holds: pieces, materials, perhaps a camera, and what was left out."""

    name: str
    pieces: list[Piece] = field(default_factory=list)
    triangles: int = 0
    vertices: int = 0
    albedo: list[tuple[float, ...]] = field(default_factory=list)
    emission: list[tuple[float, ...]] = field(default_factory=list)
    names: list[str] = field(default_factory=list)
    textures: list[np.ndarray | None] = field(default_factory=list)
    texels: int = 0
    counted: set[int] = field(default_factory=set)
    """Identities of the textures whose texels are in the sum: materials share them."""
    samplers: list[Sampler] = field(default_factory=list)
    reliefs: list[np.ndarray | None] = field(default_factory=list)
    cutouts: list[Cutout | None] = field(default_factory=list)
    cameras: dict[str, Camera] = field(default_factory=dict)
    """By name; the first is the one that the content is seen by unless another is asked for."""
    wanted: int | str | None = None
    """Which of a file's scenes, by its number or its name."""
    bytes_read: int = 0
    """Of all files so far."""
    counts: Counter[str] = field(default_factory=Counter)
    warnings: list[str] = field(default_factory=list)

    def read(self, path: Path) -> bytes:
        """The bytes of a plain file, as long as all files together stay of a size."""
        data = read_plain(path, MOST_BYTES - self.bytes_read)
        self.bytes_read += len(data)
        return data

    def add_material(
        self,
        albedo: Any,
        texture: np.ndarray | None = None,
        emission: Any = (0.0, 0.0, 0.0),
        name: str = "",
        *,
        sampler: Sampler = _PLAIN,
        relief: np.ndarray | None = None,
        cutout: Cutout | None = None,
    ) -> int:
        """Append a material and return its index."""
        for picture in (texture, relief, None if cutout is None else cutout.picture):
            if picture is not None and id(picture) not in self.counted:
                self.counted.add(id(picture))
                self.texels += picture.shape[0] * picture.shape[1]
                if self.texels > MOST_TEXELS:
                    raise ValueError(f"the textures have more than {MOST_TEXELS} pixels together")
        self.samplers.append(sampler)
        self.reliefs.append(relief)
        self.cutouts.append(cutout)
        self.albedo.append(tuple(float(value) for value in albedo[:3]))
        self.emission.append(tuple(float(value) for value in emission[:3]))
        self.names.append(name)
        self.textures.append(texture)
        return len(self.albedo) - 1

    def add_piece(self, piece: Piece) -> None:
        """Append a piece, as long as the whole stays of a size that can be traced."""
        self.triangles += len(piece.triangles)
        self.vertices += len(piece.vertices)
        if self.triangles > MOST_TRIANGLES or self.vertices > 3 * MOST_TRIANGLES:
            raise ValueError(f"more than {MOST_TRIANGLES} triangles, or {3 * MOST_TRIANGLES} vertices")
        self.pieces.append(piece)

    def leave_out(self, what: str, why: str) -> None:
        """Count something that the scene leaves out, and say so once."""
        self.counts[what] += 1
        sentence = f"{what}: {why}"
        if sentence not in self.warnings:
            self.warnings.append(sentence)
