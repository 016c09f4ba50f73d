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
from ..camera import Camera
from ..checks import Vector
from .cutout import Cutout
from .material import Lobe, Material, decoded, encoded, is_anisotropic, mean_albedo
from .shading import footprints, frame_turns, mixed, shading_normals, tangents_at
from .texture import WRAPS, Sampler, bilinear, filtered

__all__ = ["Surface", "of_materials"]

_NO_PICTURE = np.iinfo(np.uint32).max
_WHITEST = 0.999
# Rows of cutouts in a file: opacity and cutoff.
_NOTHING = -1.0
_SOLID = [_NOTHING, _NOTHING]


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
    samplers : m entries of `Sampler`, or none
        How the pictures of each material are looked up; none: repeating, and linear between texels.
    uv : (v, 2) float32 or None
        Texture coordinates, origin at the lower left.
    colours : (v, 3) float32 or None
        Linear factor of the albedo at vertices, in [0, 1].
    normals : (v, 3) float32 or None
        Of the surface that the triangles stand for, to its front; of length 0 where a vertex has none.
    tangents : (v, 4) float32 or None
        Along u, and 1 or -1: the sense of the bitangent, across normal and tangent; 0 where a vertex has none.
    reliefs : m entries, each (h, w, 3) float32 or None; or none
        Normals in the frame of tangent, bitangent and normal, of any length.
    cutouts : m entries, each a `Cutout` or None; or none
        How much of each material is there.
    opacity : (v,) float32 or None
        Factor of the opacity at vertices, in [0, 1].
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
    samplers: tuple[Sampler, ...] = ()
    colours: np.ndarray | None = None
    tangents: np.ndarray | None = None
    reliefs: tuple[np.ndarray | None, ...] = ()
    cutouts: tuple[Cutout | None, ...] = ()
    opacity: np.ndarray | None = None

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

    def traced(self, eye: Vector | None = None) -> CoreScene:
        """The surfaces ready for rays: this builds the trees over them.

        Parameters
        ----------
        eye : three floats, optional
            Near it coordinates are the most precise, where a scene reaches very far.

        Returns
        -------
        CoreScene
            As passes take it.
        """
        holes = None
        if any(cutout is not None for cutout in self.cutouts):
            count = len(self.vertices)
            uv = np.zeros((count, 2), np.float32) if self.uv is None else self.uv
            own = np.ones(count, np.float32) if self.opacity is None else self.opacity
            holes = ([self._opacity(number) for number in range(len(self.albedo))], uv, own)
        return CoreScene(self.vertices, self.triangles, self.material, eye=eye, holes=holes)

    def _opacity(self, number: int) -> Any:
        """How much of a material is there, as the core takes it."""
        cutout, sampler = self.cutouts[number], self.sampler(number)
        if cutout is None:
            return None
        return cutout.opacity, cutout.cutoff, cutout.picture, list(sampler.wrap), sampler.nearest

    def sampler(self, number: int) -> Sampler:
        """How the pictures of a material are looked up.

        Parameters
        ----------
        number : int
            Its row of `albedo`.

        Returns
        -------
        Sampler
        """
        return self.samplers[number] if self.samplers else Sampler()

    def shading_normals(
        self, triangles: npt.ArrayLike, barycentrics: npt.ArrayLike, seen: npt.ArrayLike, camera: Camera
    ) -> np.ndarray | None:
        """The normals that points in a camera's pixels take their cosines to.

        Parameters
        ----------
        triangles, barycentrics
            As for `albedo_at`.
        seen : (k, 3) real
            Unit normals of the triangles, to the side that is seen.
        camera : Camera

        Returns
        -------
        (k, 3) float32 or None
            Unit vectors to the side that is seen; None where the scene has neither normals nor pictures of them.
        """
        if self.normals is None and not any(relief is not None for relief in self.reliefs):
            return None
        return shading_normals(self, np.asarray(triangles), np.asarray(barycentrics), np.asarray(seen), camera)

    @property
    def turned(self) -> bool:
        """Whether lobes that are not alike along all directions lie along tangents of the mesh."""
        along = self.tangents is not None or self.uv is not None
        return along and any(is_anisotropic(model) for model in self.models)

    def turns(self, triangles: npt.ArrayLike, barycentrics: npt.ArrayLike, normals: npt.ArrayLike) -> np.ndarray | None:
        """How lobes that are not alike along all directions lie at points.

        Parameters
        ----------
        triangles, barycentrics
            As for `albedo_at`.
        normals : (k, 3) real
            Unit normals there.

        Returns
        -------
        (k, 2) float32 or None
            Cosine and sine of the angle between the tangent of Duff et al. (2017) and that of the mesh; None where no
            material has such a lobe, or the mesh has no tangents.
        """
        if not self.turned:
            return None
        tangent, _ = tangents_at(self, np.asarray(triangles), np.asarray(barycentrics))
        return frame_turns(np.asarray(normals), tangent)

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
        arrays = [self.vertices, self.triangles, self.material, self.albedo, self._looked_up, *self.textures]
        # What came later: scenes without any of it have the digest that they had.
        later = [self.normals, self.specular, *_fingerprints(self.models), self.emission]
        latest = {name: array for name, array in self._latest().items() if array is not None}
        for array in arrays + [array for array in later if array is not None]:
            digest.update(b"none;" if array is None else f"{array.dtype.str}{array.shape};".encode())
            if array is not None:
                digest.update(np.ascontiguousarray(array).data)
        for name, array in latest.items():
            digest.update(f"{name};{array.dtype.str}{array.shape};".encode())
            digest.update(np.ascontiguousarray(array).data)
        digest.update(more.encode())
        return digest.hexdigest()

    def albedo_at(
        self, triangles: npt.ArrayLike, barycentrics: npt.ArrayLike, camera: Camera | None = None
    ) -> np.ndarray:
        """Linear albedo at surface points, textures and colours of vertices included.

        Parameters
        ----------
        triangles : (k,) integer
        barycentrics : (k, 2) real
            Weights (b1, b2) of the second and third corner: the point is (1 - b1 - b2) p0 + b1 p1 + b2 p2.
        camera : Camera, optional
            Textures are means over what its pixels cover of them; without it they are values at the points.

        Returns
        -------
        (k, 3) float32
            In [0, 1].
        """
        triangles, barycentrics = np.asarray(triangles), np.asarray(barycentrics, np.float64)
        material = self.material[triangles]
        albedo: np.ndarray = self.albedo[material]
        for index, texture in enumerate(self.textures):
            here = np.flatnonzero(material == index) if texture is not None and self.uv is not None else ()
            if texture is None or self.uv is None or len(here) == 0:
                continue
            own, uv = (triangles[here], barycentrics[here]), self.uv[self.triangles[triangles[here]]]
            if camera is None:
                albedo[here] *= bilinear(texture, mixed(uv, own[1]), self.sampler(index))
            else:
                steps = footprints(self, *own, camera)
                albedo[here] *= filtered(texture, mixed(uv, own[1]), steps, self.sampler(index))
        if self.colours is not None and len(triangles):
            albedo *= mixed(self.colours[self.triangles[triangles]], barycentrics).clip(0.0, 1.0)
        return albedo

    def uv_at(self, triangles: npt.ArrayLike, barycentrics: npt.ArrayLike) -> np.ndarray:
        """Texture coordinates of surface points.

        Parameters
        ----------
        triangles, barycentrics
            As for `albedo_at`.

        Returns
        -------
        (k, 2) float32
            All 0 where there are none.
        """
        if self.uv is None:
            return np.zeros((len(np.asarray(triangles)), 2), np.float32)
        corners = self.uv[self.triangles[np.asarray(triangles)]]
        return mixed(corners, np.asarray(barycentrics, np.float64)).astype(np.float32)

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
        names = ("vertices", "triangles", "material", "albedo", "normals", "specular", "emission")
        found = {name: getattr(self, name) for name in names if getattr(self, name) is not None}
        found |= {} if self._looked_up is None else {"uv": self._looked_up}
        pictures: dict[int, np.ndarray] = {id(texture): texture for texture in self.textures if texture is not None}
        if pictures:
            numbers = {key: number for number, key in enumerate(pictures)}
            of_material = [_NO_PICTURE if texture is None else numbers[id(texture)] for texture in self.textures]
            found["pictures"] = np.array(of_material, np.uint32)
            found |= {f"picture.{number:05}": picture for number, picture in enumerate(pictures.values())}
        found |= {name: array for name, array in self._latest().items() if array is not None}
        return found | encoded(models) if models else found

    @property
    def _looked_up(self) -> np.ndarray | None:
        """Texture coordinates, where a material has a picture to look up by them."""
        holes = [cutout.picture for cutout in self.cutouts if cutout is not None]
        used = any(picture is not None for picture in (*self.textures, *self.reliefs, *holes))
        return self.uv if used else None

    def _latest(self) -> dict[str, np.ndarray | None]:
        """What came with 0.7, as named arrays."""
        named: dict[str, np.ndarray | None] = {
            "colours": self.colours, "tangents": self.tangents, "opacity": self.opacity,
        }  # fmt: skip
        if any(sampler != Sampler() for sampler in self.samplers):
            words = [[*map(WRAPS.index, own.wrap), int(own.nearest)] for own in self.samplers]
            named["samplers"] = np.array(words, np.uint32)
        for number, relief in enumerate(self.reliefs):
            named[f"relief.{number:05}"] = relief
        if any(cutout is not None for cutout in self.cutouts):
            rows = [
                _SOLID if own is None else [own.opacity, _NOTHING if own.cutoff is None else own.cutoff]
                for own in self.cutouts
            ]
            named["cutouts"] = np.array(rows, np.float64)
            for number, own in enumerate(self.cutouts):
                named[f"cutout.{number:05}"] = None if own is None else own.picture
        return named

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
            for name, width in (("uv", 2), ("normals", 3), ("colours", 3), ("tangents", 4))
            if name in arrays
        }
        optional |= _restored_looks(arrays, len(vertices), len(albedo))
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


def _restored_looks(arrays: Mapping[str, np.ndarray], vertices: int, materials: int) -> dict[str, Any]:
    """Samplers, pictures of normals and opacities of materials, from the arrays of a file."""
    found: dict[str, Any] = {}
    if "opacity" in arrays:
        found["opacity"] = _checked(arrays, "opacity", np.float32, (vertices,))
    if "samplers" in arrays:
        rows = _checked(arrays, "samplers", np.uint32, (materials, 3), below=len(WRAPS))
        found["samplers"] = tuple(Sampler((WRAPS[u], WRAPS[v]), bool(nearest)) for u, v, nearest in rows.tolist())
    reliefs = _numbered(arrays, "relief", (None, None, 3), materials)
    if any(relief is not None for relief in reliefs):
        found["reliefs"] = reliefs
    if "cutouts" in arrays:
        pictures = _numbered(arrays, "cutout", (None, None), materials)
        rows = _checked(arrays, "cutouts", np.float64, (materials, 2)).tolist()
        found["cutouts"] = tuple(
            None if row == _SOLID else Cutout(row[0], None if row[1] == _NOTHING else row[1], picture)
            for row, picture in zip(rows, pictures, strict=True)
        )
    return found


def _numbered(
    arrays: Mapping[str, np.ndarray], name: str, shape: tuple[int | None, ...], materials: int
) -> tuple[np.ndarray | None, ...]:
    """A picture of each material that has one."""
    keys = [f"{name}.{number:05}" for number in range(materials)]
    return tuple(_checked(arrays, key, np.float32, shape) if key in arrays else None for key in keys)


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
