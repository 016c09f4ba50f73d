"""Triangles with their materials, without a camera: what a scene is looked at for, and what its transport keeps."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np
import numpy.typing as npt

from .._core import Scene as CoreScene
from ..brdf import Measured, Model
from .material import Lobe, Material, decoded, encoded, mean_albedo
from .texture import bilinear

__all__ = ["Surface", "of_materials"]

_NO_PICTURE = np.iinfo(np.uint32).max
_WHITEST = 0.999


@dataclass(frozen=True, eq=False, kw_only=True)
class Surface:
    """Triangles with their materials.

    Attributes
    ----------
    vertices : (v, 3) float64
    triangles : (t, 3) uint32
        Corners; every triangle has an area and occurs once.
    material : (t,) uint32
        For each triangle its row of `albedo`.
    albedo : (m, 3) float32
        Linear diffuse reflectance, in [0, 1].
    textures : m entries, each (h, w, 3) float32 or None
        Linear factor of the material's albedo; row 0 is the top. A scene without textures has None in all places.
    uv : (v, 2) float32 or None
        Texture coordinates, origin at the lower left, repeating.
    normals : (v, 3) float32 or None
        Of the surface that the triangles stand for, to its front; of length 0 where a vertex has none.
    models : m entries, each a model of `deltalux.brdf` or None
        Of the glossy lobes; empty where all materials are diffuse.
    specular : (m, 3) float32 or None
        What the lobes are multiplied by; None where there are none.
    emission : (m, 3) float32 or None
        Linear radiance that materials give off, to both sides; None where none does.
    names : m texts, or none
        What the scene calls its materials, "" where it does not; a transport's file does not keep them.
    """

    vertices: np.ndarray
    triangles: np.ndarray
    material: np.ndarray
    albedo: np.ndarray
    textures: tuple[np.ndarray | None, ...] = ()
    uv: np.ndarray | None = None
    normals: np.ndarray | None = None
    models: tuple[Lobe | None, ...] = ()
    specular: np.ndarray | None = None
    emission: np.ndarray | None = None
    names: tuple[str, ...] = ()

    @property
    def materials(self) -> tuple[Material, ...]:
        """All materials; textures are not in them."""
        models = self.models or (None,) * len(self.albedo)
        none = np.zeros_like(self.albedo)
        specular, emission = (none if own is None else own for own in (self.specular, self.emission))
        all_ = zip(self.albedo.tolist(), specular.tolist(), models, emission.tolist(), strict=True)
        return tuple(Material(albedo, shine if model else None, model, own) for albedo, shine, model, own in all_)

    def with_material(self, which: int | str, material: Material) -> Self:
        """The same with another material in the place of one.

        Parameters
        ----------
        which : int or str
            Its row of `albedo`, or its name.
        material : Material
            The other one; the texture of the first stays.

        Returns
        -------
        The same kind
            A new one, which shares the arrays.

        Raises
        ------
        ValueError
            If there is no such material.
        """
        number = self.numbered(which)
        if not isinstance(material, Material):
            raise ValueError(f"expected a dl.Material, got {material!r:.80}")
        all_ = list(self.materials)
        all_[number] = material
        return replace(self, **of_materials(all_))

    def numbered(self, which: int | str) -> int:
        """The number of a material.

        Parameters
        ----------
        which : int or str
            Its number, or its name.

        Returns
        -------
        int
            Its row of `albedo`.

        Raises
        ------
        ValueError
            If there is no such material, or several go by the name.
        """
        own = [number for number, name in enumerate(self.names) if name == which]
        if len(own) > 1:
            raise ValueError(f"expected a number, as {len(own)} materials are called {which!r}")
        if isinstance(which, (int, np.integer)) and not isinstance(which, bool) and 0 <= which < len(self.albedo):
            own = [int(which)]
        if not own:
            known = ", ".join(repr(name) for name in self.names if name) or "none has a name"
            last = len(self.albedo) - 1
            raise ValueError(f"expected a material from 0 to {last}, or the name of one ({known}), got {which!r}")
        return own[0]

    def traced(self) -> CoreScene:
        """The surfaces ready for rays: this builds the trees over them.

        Returns
        -------
        CoreScene
            As passes take it.
        """
        return CoreScene(self.vertices, self.triangles, self.material)

    def digest(self, more: str = "") -> str:
        """A digest of all arrays and of a text.

        Parameters
        ----------
        more : str
            What belongs to it besides.

        Returns
        -------
        str
            64 hexadecimal digits (BLAKE2b).
        """
        digest = hashlib.blake2b(digest_size=32)
        arrays = [self.vertices, self.triangles, self.material, self.albedo, self.uv, *self.textures]
        # What came later: scenes without any of it have the digest that they had.
        later = [self.normals, self.specular, *_fingerprints(self.models), self.emission]
        for array in arrays + [array for array in later if array is not None]:
            digest.update(b"none;" if array is None else f"{array.dtype.str}{array.shape};".encode())
            if array is not None:
                digest.update(np.ascontiguousarray(array).data)
        digest.update(more.encode())
        return digest.hexdigest()

    def albedo_at(self, triangles: npt.ArrayLike, barycentrics: npt.ArrayLike) -> np.ndarray:
        """Linear albedo at surface points, textures included (bilinear, repeating).

        Parameters
        ----------
        triangles : (k,) integer
        barycentrics : (k, 2) real
            Weights (b1, b2) of the second and third corner: the point is (1 - b1 - b2) p0 + b1 p1 + b2 p2.

        Returns
        -------
        (k, 3) float32
            In [0, 1].
        """
        triangles = np.asarray(triangles)
        material = self.material[triangles]
        albedo: np.ndarray = self.albedo[material]
        for index, texture in enumerate(self.textures):
            here = np.flatnonzero(material == index) if texture is not None and self.uv is not None else ()
            if texture is None or self.uv is None or len(here) == 0:
                continue
            b1, b2 = np.asarray(barycentrics, dtype=np.float64)[here].T[:, :, None]
            uv0, uv1, uv2 = self.uv[self.triangles[triangles[here]]].astype(np.float64).transpose(1, 0, 2)
            albedo[here] *= bilinear(texture, (1.0 - b1 - b2) * uv0 + b1 * uv1 + b2 * uv2)
        return albedo

    def reflectance_at(self, triangles: npt.ArrayLike, barycentrics: npt.ArrayLike) -> np.ndarray:
        """All that surface points reflect, diffusely and in lobes, as light between surfaces takes it: as if diffuse.

        Parameters
        ----------
        triangles, barycentrics
            As for `albedo_at`.

        Returns
        -------
        (k, 3) float32
            Below 1: no series of bounces is endless.
        """
        whole = self.albedo_at(triangles, barycentrics)
        material = self.material[np.asarray(triangles)]
        for number, model in enumerate(self.models):
            if model is not None and self.specular is not None:
                here = material == number
                lobe = self.specular[number] * mean_albedo(model)
                whole[here] = lobe if isinstance(model, Measured) else whole[here] + lobe
        return np.minimum(whole, np.float32(_WHITEST)) if self.models else whole

    def arrays(self) -> dict[str, np.ndarray]:
        """All of it as named arrays, which `restored` reads.

        Returns
        -------
        dict of str to array
            Of float64, float32 and uint32. Pictures that several materials share are there once. Empty where a
            material is measured: its tables are not ours to copy.
        """
        models = [model for model in self.models if not isinstance(model, Measured)]
        if len(models) < len(self.models):
            return {}
        names = ("vertices", "triangles", "material", "albedo", "uv", "normals", "specular", "emission")
        found = {name: getattr(self, name) for name in names if getattr(self, name) is not None}
        pictures: dict[int, np.ndarray] = {id(texture): texture for texture in self.textures if texture is not None}
        if pictures:
            numbers = {key: number for number, key in enumerate(pictures)}
            of_material = [_NO_PICTURE if texture is None else numbers[id(texture)] for texture in self.textures]
            found["pictures"] = np.array(of_material, np.uint32)
            found |= {f"picture.{number:05}": picture for number, picture in enumerate(pictures.values())}
        return found | encoded(models) if models else found

    @staticmethod
    def restored(arrays: Mapping[str, np.ndarray]) -> Surface:
        """A surface from its arrays, whoever wrote them.

        Parameters
        ----------
        arrays : mapping of str to array
            What `arrays` gave.

        Returns
        -------
        Surface

        Raises
        ------
        ValueError
            If an array is missing, of another shape or type, or names what is not there.
        """
        vertices = _checked(arrays, "vertices", np.float64, (None, 3))
        albedo = _checked(arrays, "albedo", np.float32, (None, 3))
        triangles = _checked(arrays, "triangles", np.uint32, (None, 3), below=len(vertices))
        material = _checked(arrays, "material", np.uint32, (len(triangles),), below=len(albedo))
        optional: dict[str, Any] = {
            name: _checked(arrays, name, np.float32, (len(vertices), width))
            for name, width in (("uv", 2), ("normals", 3))
            if name in arrays
        }
        if "emission" in arrays:
            optional["emission"] = _checked(arrays, "emission", np.float32, (len(albedo), 3))
        if "models" in arrays:
            kinds = _checked(arrays, "models", np.uint32, (len(albedo),))
            optional["models"] = decoded(kinds, _checked(arrays, "parameters", np.float64, (len(albedo), None)))
            optional["specular"] = _checked(arrays, "specular", np.float32, (len(albedo), 3))
        textures: tuple[np.ndarray | None, ...] = (None,) * len(albedo)
        if "pictures" in arrays:
            numbers = _checked(arrays, "pictures", np.uint32, (len(albedo),))
            pictures = {
                number: _checked(arrays, f"picture.{number:05}", np.float32, (None, None, 3))
                for number in np.unique(numbers[numbers != _NO_PICTURE]).tolist()
            }
            textures = tuple(pictures.get(number) for number in numbers.tolist())
        return Surface(
            vertices=vertices, triangles=triangles, material=material, albedo=albedo, textures=textures, **optional
        )


def of_materials(materials: Sequence[Material]) -> dict[str, Any]:
    """The fields of a surface that hold its materials."""
    models = tuple(material.model for material in materials)
    glossy = any(model is not None for model in models)
    emission = _frozen([material.emission for material in materials])
    return {
        "albedo": _frozen([material.albedo for material in materials]),
        "models": models if glossy else (),
        "specular": _frozen([material.specular for material in materials]) if glossy else None,
        "emission": emission if emission.any() else None,
    }


def _frozen(colours: list[Any]) -> np.ndarray:
    array = np.array(colours, np.float32)
    array.flags.writeable = False
    return array


def _fingerprints(models: Sequence[Lobe | None]) -> list[np.ndarray]:
    """What tells models apart, as arrays."""
    if not models:
        return []
    plain = [model if isinstance(model, Model) else None for model in models]
    digests = (model.digest for model in models if isinstance(model, Measured))
    tables = [np.frombuffer(bytes.fromhex(digest), np.uint8) for digest in digests]
    return [*encoded(plain).values(), *tables]


def _checked(
    arrays: Mapping[str, np.ndarray],
    name: str,
    dtype: type[np.generic],
    shape: tuple[int | None, ...],
    below: int | None = None,
) -> np.ndarray:
    """An array of a file, of which nothing is known; None is any length above 0."""
    array = arrays.get(name)
    fits = array is not None and array.dtype == dtype and array.ndim == len(shape)
    if (
        array is None
        or not fits
        or any(
            size == 0 or (wanted is not None and size != wanted)
            for size, wanted in zip(array.shape, shape, strict=True)
        )
    ):
        found = "none" if array is None else f"{array.dtype} of shape {array.shape}"
        wanted = ", ".join("n" if size is None else str(size) for size in shape)
        raise ValueError(f"expected {name} of {np.dtype(dtype)} and shape ({wanted}), found {found}")
    if below is not None and array.max() >= below:
        raise ValueError(f"expected {name} below {below}, found {array.max()}")
    if array.dtype.kind == "f" and not np.isfinite(array).all():
        raise ValueError(f"expected finite {name}")
    array.flags.writeable = False
    return array
