"""Content: what a source hands over, as it was read; only `Scene` checks it and puts it together."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..camera import Camera

MOST_TRIANGLES = 100_000_000
# Of all textures together, 3 GB as linear floats: a picture of one colour takes next to nothing in a file.
MOST_TEXELS = 1 << 28
# Surfaces of which the source does not say the colour are middle grey.
DEFAULT_ALBEDO = (0.5, 0.5, 0.5)


@dataclass(frozen=True)
class Piece:
    """Some triangles of one material, in world space."""

    vertices: np.ndarray
    triangles: np.ndarray
    uv: np.ndarray | None
    material: int


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
    camera: Camera | None = None
    counts: Counter[str] = field(default_factory=Counter)
    warnings: list[str] = field(default_factory=list)

    def add_material(
        self, albedo: Any, texture: np.ndarray | None = None, emission: Any = (0.0, 0.0, 0.0), name: str = ""
    ) -> int:
        """Append a material and return its index."""
        if texture is not None and id(texture) not in self.counted:
            self.counted.add(id(texture))
            self.texels += texture.shape[0] * texture.shape[1]
            if self.texels > MOST_TEXELS:
                raise ValueError(f"the textures have more than {MOST_TEXELS} pixels together")
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
