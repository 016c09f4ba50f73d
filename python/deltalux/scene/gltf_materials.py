"""Materials of glTF: base colours and their pictures, pictures of normals, opacity, emission.

Source: Khronos, glTF 2.0, section 3.9, and the extensions KHR_texture_transform, EXT_texture_webp and
KHR_materials_pbrSpecularGlossiness, of which the diffuse colour is taken.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..surface.cutout import Cutout
from ..surface.texture import Sampler
from .content import DEFAULT_ALBEDO, Content
from .gltf_data import Data, item
from .texture import Picture, decoded

__all__ = ["Materials", "Placing"]

_WRAPS = {33071: "clamp", 33648: "mirror", 10497: "repeat"}
_NEAREST = 9728


@dataclass(frozen=True)
class Placing:
    """Which texture coordinates a material's pictures take, and how they are moved."""

    channel: int = 0
    offset: tuple[float, float] = (0.0, 0.0)
    rotation: float = 0.0
    scale: tuple[float, float] = (1.0, 1.0)

    def of(self, uv: np.ndarray) -> np.ndarray:
        """Coordinates of the file as surfaces have them: moved, and v upwards."""
        sine, cosine = np.sin(self.rotation), np.cos(self.rotation)
        u, v = (uv * self.scale).T
        moved = np.stack([cosine * u + sine * v, cosine * v - sine * u], -1) + self.offset
        return np.asarray(moved * (1.0, -1.0) + (0.0, 1.0))


class Materials:
    """The materials of a file, each added to the content when it is first met."""

    def __init__(self, content: Content, data: Data) -> None:
        self.content, self.data, self.tree = content, data, data.tree
        self.pictures: dict[int, Picture | None] = {}
        self.numbers: dict[int | None, tuple[int, Placing]] = {}

    def number(self, index: int | None) -> tuple[int, Placing]:
        """The material's place in the content, and what its pictures are placed by."""
        if index is None:
            self.content.counts["meshes without material"] += 1
        if index not in self.numbers:
            self.numbers[index] = (
                (self.content.add_material(DEFAULT_ALBEDO), Placing()) if index is None else self._added(index)
            )
        return self.numbers[index]

    def _added(self, index: int) -> tuple[int, Placing]:
        stated = item(self.tree.get("materials", []), index, "material")
        factor, base = self._base(stated)
        bump = stated.get("normalTexture", {})
        placing = self._placing(base if "index" in base else bump)
        if "index" in bump and self._placing(bump) != placing:
            self.content.leave_out("pictures of normals", "those placed otherwise than the base colour are not shown")
            bump = {}
        picture, normals = self._picture(base), self._picture(bump)
        # Of one file the decoded values are shared, so that they are stored once.
        relief = None if normals is None else normals.normals(float(bump.get("scale", 1.0)))
        return self.content.add_material(
            factor,
            None if picture is None else picture.linear,
            self._emission(stated),
            str(stated.get("name", "")),
            sampler=self._sampler(base if "index" in base else bump),
            relief=relief,
            cutout=_cutout(stated, float(factor[3]) if len(factor) > 3 else 1.0, picture),
        ), placing

    def _base(self, stated: dict[str, Any]) -> tuple[Any, dict[str, Any]]:
        """The base colour, and the reference to its picture, empty where there is none."""
        glossy = stated.get("extensions", {}).get("KHR_materials_pbrSpecularGlossiness")
        if glossy is not None:
            return glossy.get("diffuseFactor", (1.0,) * 4), glossy.get("diffuseTexture", {})
        rough = stated.get("pbrMetallicRoughness", {})
        return rough.get("baseColorFactor", (1.0,) * 4), rough.get("baseColorTexture", {})

    def _emission(self, stated: dict[str, Any]) -> tuple[float, ...]:
        """The radiance that a material gives off; of what a picture modulates, nothing."""
        factor = stated.get("emissiveFactor", (0.0, 0.0, 0.0))
        strength = stated.get("extensions", {}).get("KHR_materials_emissive_strength", {}).get("emissiveStrength", 1.0)
        if any(factor) and "emissiveTexture" in stated:
            self.content.leave_out("emissive textures", "what they give off is left out")
            return 0.0, 0.0, 0.0
        return tuple(float(value) * float(strength) for value in factor)

    def _placing(self, reference: dict[str, Any]) -> Placing:
        moved = reference.get("extensions", {}).get("KHR_texture_transform", {})
        return Placing(
            moved.get("texCoord", reference.get("texCoord", 0)),
            _pair(moved.get("offset", (0.0, 0.0))),
            float(moved.get("rotation", 0.0)),
            _pair(moved.get("scale", (1.0, 1.0))),
        )

    def _sampler(self, reference: dict[str, Any]) -> Sampler:
        if "index" not in reference:
            return Sampler()
        number = item(self.tree.get("textures", []), reference["index"], "texture").get("sampler")
        own = {} if number is None else item(self.tree.get("samplers", []), number, "sampler")
        wrap = [_WRAPS.get(own.get(axis, 10497), "repeat") for axis in ("wrapS", "wrapT")]
        return Sampler((wrap[0], wrap[1]), own.get("magFilter") == _NEAREST)

    def _picture(self, reference: dict[str, Any]) -> Picture | None:
        """A texture's picture; of what cannot be read the reason is noted, and the colour alone is used."""
        if "index" not in reference:
            return None
        texture = item(self.tree.get("textures", []), reference["index"], "texture")
        webp = texture.get("extensions", {}).get("EXT_texture_webp", {})
        source = webp.get("source", texture.get("source"))
        if source is None:
            self.content.leave_out("textures ignored", "their format is an extension")
            return None
        if source not in self.pictures:
            self.pictures[source] = self._decoded(item(self.tree.get("images", []), source, "image"))
        return self.pictures[source]

    def _decoded(self, image: dict[str, Any]) -> Picture | None:
        # A path that leads elsewhere is an attack, not a missing picture.
        if "uri" in image and not image["uri"].startswith("data:"):
            self.data.check_path(image["uri"])
        try:
            return decoded(
                self.data.view(image["bufferView"])[0] if "bufferView" in image else self.data.uri(image["uri"])
            )
        except (OSError, ValueError) as error:
            self.content.leave_out("textures ignored", str(error))
            return None


def _pair(values: Any) -> tuple[float, float]:
    first, second = (float(value) for value in values)
    return first, second


def _cutout(stated: dict[str, Any], alpha: float, picture: Picture | None) -> Cutout | None:
    """How much of a material is there: by its mode, its factor and its picture's alpha."""
    mode = stated.get("alphaMode", "OPAQUE")
    if mode not in ("MASK", "BLEND"):
        return None
    cutoff = float(stated.get("alphaCutoff", 0.5)) if mode == "MASK" else None
    return Cutout(alpha, cutoff, None if picture is None else picture.alpha)
