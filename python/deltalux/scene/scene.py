"""What is looked at, and from where: triangles, materials and a camera, all immutable.

A `Scene` is made by `Scene.load`, `Scene.builtin` or `Scene.from_arrays`, which validate: what cannot be right is
refused with a `ValueError`; what is merely untidy (triangles without area, the same triangle twice) is put right and
counted in `Scene.counts`, so that the plan can report it. Surfaces are two-sided: the winding does not matter.

Right-handed, +Y up, lengths in any unit; albedos are linear, in [0, 1].
"""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from ..camera import Camera
from ..checks import as_vector, one_of, real_array
from ..mistakes import checked_path, instead_of, near, refuse_kind
from ..surface.material import Material
from ..surface.surface import Surface, of_materials
from ..surface.texture import Sampler
from . import files
from .builtin import catalogue
from .checked import (
    check_corners,
    checked_albedo,
    checked_emission,
    checked_materials,
    checked_normals,
    checked_tangents,
    checked_triangles,
    checked_vertices,
    first_equal_row,
    frozen,
    has_area,
)
from .content import Content, Piece

GROUND = "ground"
"""What the material of the plane under a scene is called."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Scene(Surface):
    """Triangles with their materials, and a camera. Made by `load`, `builtin` or `from_arrays`, not by hand.

    Attributes
    ----------
    vertices, triangles, material, albedo, textures, samplers, uv, colours, normals, tangents, reliefs, cutouts, opacity
        As of a `Surface`.
    models, specular, emission, names
        As of a `Surface`.
    camera : Camera
    name : str
    counts : mapping of str to int
        What was found and put right: degenerate and duplicate triangles, textures ignored and so on.
    warnings : tuple of str
        A sentence for everything that a file asked for and the scene leaves out.
    """

    camera: Camera
    name: str = "scene"
    counts: Mapping[str, int] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()

    def __repr__(self) -> str:
        seen = f"{self.camera.width} x {self.camera.height} pixels"
        return f"<Scene {self.name!r}, {len(self.triangles):,} triangles, {len(self.albedo)} materials, {seen}>"

    @classmethod
    def load(
        cls,
        path: str | os.PathLike[str],
        camera: Camera | str | None = None,
        *,
        up: str = "y",
        scene: int | str | None = None,
    ) -> Scene:
        """Read a .glb, .gltf, .obj, .ply or .stl file.

        Parameters
        ----------
        path : path
        camera : Camera or str, optional
            Otherwise the file's first (glTF), or one that frames everything; a name is that of one of the file's.
        up : str
            The axis that points upwards in the file, "y" or "z", as in CAD, GIS and scanners: it is turned to be +Y.
        scene : int or str, optional
            Of a file with several (glTF): its name or its number, from 0; otherwise the one that the file names.

        Returns
        -------
        Scene
            What was put right is in its counts, what was left out in its warnings.

        Raises
        ------
        FileNotFoundError, OSError
            If the file cannot be read.
        FileError
            A `ValueError`: the file is broken, of an unknown kind, has no triangles, or nothing of that name.
        """
        checked_path(path, "the path of a scene")
        one_of("up", up, ("y", "z"))
        if os.fspath(path) in catalogue.SCENES and not os.path.exists(path):
            raise FileNotFoundError(f"{path}: there is no such file; dl.Scene.builtin({path!r}) is a scene")
        refuse_kind(path, "a scene")
        content = files.read(path, scene)
        with files.blaming(path):
            return cls.from_content(content, camera, up)

    @classmethod
    def builtin(cls, name: str, camera: Camera | None = None) -> Scene:
        """One of the built-in scenes.

        Parameters
        ----------
        name
            ``"plant"``, ``"cornell"``, ``"still-life"`` or ``"street"``; for `precompute_studio` ``"studio-box"``,
            ``"studio-figures"``, ``"studio-still-life"`` or ``"studio-room"``.
        camera : Camera, optional
            Otherwise the scene's own.

        Returns
        -------
        Scene
            The same triangles in every run and on every machine.

        Raises
        ------
        ValueError
            If there is no such scene.
        """
        return cls.from_content(catalogue.build(name), camera)

    @classmethod
    def from_content(cls, content: Content, camera: Camera | str | None = None, up: str = "y") -> Scene:
        """What a source handed over, as one list of triangles.

        Parameters
        ----------
        content : Content
            Pieces, materials, perhaps a camera.
        camera : Camera or str, optional
            Otherwise the first of the content's own, or one that frames everything; a name is that of one of them.
        up : str
            The axis that points upwards in the content, "y" or "z".

        Returns
        -------
        Scene
            Texture coordinates that are not finite are 0, albedos are clipped to [0, 1]; both are counted.

        Raises
        ------
        ValueError
            If the content has no triangles with an area, vertices that are not finite, corners out of range, or no
            camera of that name.
        """
        pieces = [piece.placed(_UPRIGHT) for piece in content.pieces] if up == "z" else content.pieces
        offsets = np.cumsum([0] + [len(piece.vertices) for piece in pieces])
        uv = _joined(pieces, "uv", (0.0, 0.0))
        albedo, emission = np.array(content.albedo), checked_emission(content.emission)
        corners = [_own_corners(piece) + start for piece, start in zip(pieces, offsets, strict=False)]
        normals, tangents = (
            _joined(pieces, name, missing) for name, missing in (("normals", _NONE), ("tangents", (*_NONE, 1.0)))
        )
        mended = Counter(
            {
                "texture coordinates not finite": 0 if uv is None else int(np.count_nonzero(~np.isfinite(uv))),
                "albedos clipped to [0, 1]": int(np.count_nonzero((albedo < 0.0) | (albedo > 1.0))),
                "normals not finite": 0
                if normals is None
                else int(np.count_nonzero(~np.isfinite(normals).all(axis=1))),
            }
        )
        found = _assemble(
            np.concatenate([piece.vertices for piece in pieces]),
            np.concatenate(corners),
            np.repeat([piece.material for piece in pieces], [len(own) for own in corners]),
            albedo.clip(0.0, 1.0),
            textures=content.textures,
            uv=None if uv is None else np.where(np.isfinite(uv), uv, 0.0),
            normals=None if normals is None else _unit_or_none(normals),
            camera=_camera_of(content, camera, up),
            name=content.name,
            # A sum of counters leaves out what was not found.
            counts=content.counts + mended,
            warnings=content.warnings,
            looks=_looks(content, pieces, tangents),
        )
        return replace(found, emission=emission if emission.any() else None, names=tuple(content.names))

    @classmethod
    def from_arrays(
        cls,
        vertices: npt.ArrayLike,
        triangles: npt.ArrayLike,
        albedo: npt.ArrayLike = (0.5, 0.5, 0.5),
        camera: Camera | None = None,
        *,
        normals: npt.ArrayLike | None = None,
        tangents: npt.ArrayLike | None = None,
        materials: Sequence[Material] | Mapping[str, Material] | None = None,
        material: npt.ArrayLike | None = None,
        name: str = "arrays",
    ) -> Scene:
        """A scene from plain arrays.

        Parameters
        ----------
        vertices : (v, 3) real
        triangles : (t, 3) integer
            Corners, counted from 0; either winding.
        albedo : (3,) or (t, 3) real
            Linear reflectance in [0, 1], for the whole scene or for each triangle.
        camera : Camera, optional
            Otherwise one that frames everything.
        normals : (v, 3) real, optional
            Of the surface that the triangles stand for, of any length above 0: cosines are taken to them.
        tangents : (v, 3) or (v, 4) real, optional
            What anisotropic lobes lie along, of any length above 0; a fourth number below 0 turns the bitangent round.
        materials : sequence of Material, or mapping of str to Material, optional
            Instead of `albedo`: of the whole scene, if there is one, or of what `material` says; a mapping names them.
        material : (t,) integer, optional
            For each triangle its place in `materials`.
        name : str
            For titles and reports.

        Returns
        -------
        Scene
            It holds copies.

        Raises
        ------
        ValueError
            For arrays of a wrong shape or kind, no triangles, values that are not finite, or corners or albedos out
            of range.
        """
        corners = checked_triangles(triangles)
        shading = None if normals is None else checked_normals(normals, np.shape(vertices))
        along = None if tangents is None else frozen(checked_tangents(tangents, len(np.asarray(vertices))), np.float32)
        looks = {} if along is None else {"tangents": along}
        if materials is not None:
            names = tuple(materials) if isinstance(materials, Mapping) else ()
            materials = list(materials.values()) if isinstance(materials, Mapping) else materials
            numbers = checked_materials(materials, material, len(corners))
            found = _assemble(
                vertices,
                corners,
                numbers,
                np.zeros((len(materials), 3)),
                normals=shading,
                camera=camera,
                name=name,
                looks=looks,
            )
            return replace(found, names=names, **of_materials(materials))
        if material is not None:
            raise ValueError("expected materials beside material, which says which of them a triangle has")
        colours = real_array("albedo", albedo, np.float64)
        if colours.shape not in ((3,), corners.shape):
            raise ValueError(f"albedo must have shape (3,) or {corners.shape}, one per triangle, got {colours.shape}")
        # Equal albedos are one material, so that a pixel that shows many triangles of a colour is one receiver.
        rows = np.broadcast_to(colours.astype(np.float32), (1, 3) if colours.ndim == 1 else corners.shape)
        first = first_equal_row(rows)
        distinct, of_row = np.unique(first, return_inverse=True)
        of_triangle = np.broadcast_to(of_row, len(corners))
        return _assemble(
            vertices, corners, of_triangle, rows[distinct], normals=shading, camera=camera, name=name, looks=looks
        )

    @classmethod
    def of_surface(cls, surface: Surface, camera: Camera, name: str) -> Scene:
        """A surface, such as a transport keeps, seen by a camera.

        Parameters
        ----------
        surface : Surface
        camera : Camera
        name : str

        Returns
        -------
        Scene
            Of the same arrays.
        """
        return cls(**{own.name: getattr(surface, own.name) for own in fields(Surface)}, camera=camera, name=name)

    def with_camera(self, camera: Camera) -> Scene:
        """The same scene seen by another camera.

        Parameters
        ----------
        camera : Camera
            The other one.

        Returns
        -------
        Scene
            A new one, which shares the arrays.

        Raises
        ------
        TypeError
            If it is no camera.
        """
        if not isinstance(camera, Camera):
            raise instead_of("Camera", camera)
        return replace(self, camera=camera)

    def with_ground(self, albedo: npt.ArrayLike = (0.5, 0.5, 0.5)) -> Scene:
        """The same scene on a square plane: under its lowest point, ten times as wide as it is, at least as its height.

        Parameters
        ----------
        albedo : (3,) real
            Linear reflectance of the plane, in [0, 1]; its material is called "ground".

        Returns
        -------
        Scene
            A new one, seen by the same camera.

        Raises
        ------
        ValueError
            If the albedo is out of range.
        """
        points = self.vertices[np.unique(self.triangles)]
        low, high = points.min(axis=0), points.max(axis=0)
        middle, half = 0.5 * (low + high), 5.0 * (high - low).max()
        # Not in the plane of what stands on it.
        height = low[1] - 1e-4 * half
        square = [(middle[0] + half * x, height, middle[2] + half * z) for x, z in ((-1, 1), (1, 1), (1, -1), (-1, -1))]
        return self._joined_by(
            np.array(square),
            np.array([(0, 1, 2), (0, 2, 3)]),
            GROUND,
            checked_albedo(np.broadcast_to(real_array("albedo", albedo, np.float64), (1, 3))),
        )

    def _joined_by(self, vertices: np.ndarray, triangles: np.ndarray, name: str, albedo: np.ndarray) -> Scene:
        """With some more triangles, of a diffuse material of their own."""
        materials, count = len(self.albedo), len(self.vertices)

        def more(array: np.ndarray | None, missing: tuple[float, ...]) -> np.ndarray | None:
            if array is None:
                return None
            rows = np.reshape(np.tile(missing, len(vertices)), (len(vertices), *array.shape[1:]))
            return frozen(np.concatenate([array, rows]), array.dtype)

        def one(items: tuple[Any, ...], missing: Any) -> tuple[Any, ...]:
            return (*items, missing) if items else items

        dark = (0.0, 0.0, 0.0)
        return replace(
            self,
            vertices=frozen(np.concatenate([self.vertices, vertices]), np.float64),
            triangles=frozen(np.concatenate([self.triangles, triangles + count]), np.uint32),
            material=frozen(np.concatenate([self.material, np.full(len(triangles), materials)]), np.uint32),
            albedo=frozen(np.concatenate([self.albedo, albedo]), np.float32),
            textures=(*self.textures, None),
            uv=more(self.uv, (0.0, 0.0)),
            normals=more(self.normals, dark),
            tangents=more(self.tangents, (*dark, 1.0)),
            colours=more(self.colours, (1.0, 1.0, 1.0)),
            opacity=more(self.opacity, (1.0,)),
            models=one(self.models, None),
            specular=None if self.specular is None else frozen(np.vstack([self.specular, dark]), np.float32),
            emission=None if self.emission is None else frozen(np.vstack([self.emission, dark]), np.float32),
            names=(*(self.names or ("",) * materials), name),
            samplers=one(self.samplers, Sampler()),
            reliefs=one(self.reliefs, None),
            cutouts=one(self.cutouts, None),
        )

    def content_hash(self) -> str:
        """A digest of all that transport depends on: geometry, materials and camera.

        Returns
        -------
        str
            64 hexadecimal digits (BLAKE2b).
        """
        return self.digest(repr(self.camera))


def _assemble(
    vertices: npt.ArrayLike,
    triangles: npt.ArrayLike,
    material: npt.ArrayLike,
    albedo: npt.ArrayLike,
    *,
    textures: Sequence[np.ndarray | None] = (),
    uv: npt.ArrayLike | None = None,
    normals: npt.ArrayLike | None = None,
    camera: Camera | None = None,
    name: str = "scene",
    counts: Mapping[str, int] | None = None,
    warnings: Sequence[str] = (),
    looks: Mapping[str, Any] | None = None,
) -> Scene:
    """Validate, drop what has no area or occurs twice, and make the scene; the one way in for all sources."""
    points = checked_vertices(vertices)
    corners = checked_triangles(triangles)
    check_corners(corners, len(points))
    colours = checked_albedo(albedo)

    # Triangles without area are hit by no ray; of equal ones (in any winding) the first stays.
    solid = has_area(points, corners)
    kept = np.flatnonzero(solid)
    if len(kept) == 0:
        raise ValueError(f"the scene has no triangles: all {len(corners)} have no area")
    welded = np.sort(first_equal_row(points)[corners[kept]], axis=1)
    unique = first_equal_row(welded) == np.arange(len(kept))
    found = {
        **(counts or {}),
        "degenerate triangles": int(len(corners) - len(kept)),
        "duplicate triangles": int(len(kept) - np.count_nonzero(unique)),
    }
    kept = kept[unique]

    sentences = list(warnings)
    if camera is None:
        near = _bulk(points[corners[kept]].mean(axis=1))
        camera = Camera.framing(points[np.unique(corners[kept][near])])
        if not near.all():
            sentences.append(f"framing: {np.count_nonzero(~near)} triangles far beyond the rest are not looked for")
    pictures = tuple(None if texture is None else frozen(texture, np.float32) for texture in textures)
    looks = dict(looks or {})
    return Scene(
        vertices=frozen(points, np.float64),
        triangles=frozen(corners[kept], np.uint32),
        material=frozen(np.asarray(material)[kept], np.uint32),
        albedo=frozen(colours, np.float32),
        camera=camera,
        textures=pictures or (None,) * len(colours),
        uv=None if uv is None else frozen(uv, np.float32),
        normals=None if normals is None else frozen(normals, np.float32),
        name=name,
        counts=found,
        warnings=tuple(sentences),
        **looks,
    )


def _own_corners(piece: Piece) -> np.ndarray:
    """The piece's own corners, before an offset could hide that they are out of range."""
    corners = np.asarray(piece.triangles, dtype=np.int64)
    bad = np.flatnonzero(((corners < 0) | (corners >= len(piece.vertices))).any(axis=1))
    if len(bad):
        own = len(piece.vertices)
        raise ValueError(f"corners must be in [0, {own}), but a triangle has {corners[bad[0]].tolist()}")
    return corners


# Triangles so many times as far off as 99 in 100 are do not count for a camera that frames the rest.
_STRAY = 16.0


def _bulk(places: np.ndarray) -> np.ndarray:
    """Which places are not far beyond nearly all of the others, (n,) bool."""
    off = np.abs(places - np.median(places, axis=0)).max(axis=1)
    return np.asarray(off <= _STRAY * max(float(np.quantile(off, 0.99, method="lower")), 0.0) + 1e-300)


# From z up to y up: a quarter turn about x.
_UPRIGHT = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])
_NONE = (0.0, 0.0, 0.0)


def _joined(pieces: Sequence[Piece], name: str, missing: tuple[float, ...]) -> np.ndarray | None:
    """One array of what each vertex has, or the missing value where a piece says nothing; None where none does."""
    if all(getattr(piece, name) is None for piece in pieces):
        return None

    def own(piece: Piece) -> np.ndarray:
        array = getattr(piece, name)
        return np.tile(missing, (len(piece.vertices), 1)) if array is None else array.reshape(len(piece.vertices), -1)

    return np.concatenate([own(piece) for piece in pieces])


def _unit_or_none(vectors: np.ndarray) -> np.ndarray:
    """Of length 1, or 0 where they are of no length."""
    with np.errstate(invalid="ignore", over="ignore"):
        length = np.linalg.norm(vectors, axis=1, keepdims=True)
    usable = np.isfinite(length) & (length > 1e-30)
    return np.asarray(np.where(usable, vectors / np.where(usable, length, 1.0), 0.0))


def _looks(content: Content, pieces: Sequence[Piece], tangents: np.ndarray | None) -> dict[str, Any]:
    """What surfaces have besides triangles, albedos and textures, where any has it."""
    looks: dict[str, Any] = {}
    if tangents is not None:
        along = _unit_or_none(tangents[:, :3])
        looks["tangents"] = frozen(
            np.concatenate([along, np.where(tangents[:, 3:] < 0, -1.0, 1.0)], axis=1), np.float32
        )
    for name, missing in (("colours", (1.0, 1.0, 1.0)), ("opacity", (1.0,))):
        values = _joined(pieces, name, missing)
        if values is not None and not (values == 1.0).all():
            inside = np.where(np.isfinite(values), values, 1.0).clip(0.0, 1.0)
            looks[name] = frozen(inside if name == "colours" else inside[:, 0], np.float32)
    if any(sampler != Sampler() for sampler in content.samplers):
        looks["samplers"] = tuple(content.samplers)
    if any(relief is not None for relief in content.reliefs):
        looks["reliefs"] = tuple(None if relief is None else frozen(relief, np.float32) for relief in content.reliefs)
    if any(cutout is not None for cutout in content.cutouts):
        looks["cutouts"] = tuple(content.cutouts)
    return looks


def _camera_of(content: Content, camera: Camera | str | None, up: str) -> Camera | None:
    """The camera that was asked for, or the content's first, turned as the content is; None where there is none."""
    if isinstance(camera, Camera):
        return camera
    if not (camera is None or isinstance(camera, str)):
        raise instead_of("Camera", camera)
    if camera is not None and camera not in content.cameras:
        known = ", ".join(content.cameras) or "none"
        raise ValueError(f"expected the name of a camera ({known}), got {camera!r}{near(camera, content.cameras)}")
    found = content.cameras[camera] if camera is not None else next(iter(content.cameras.values()), None)
    if found is None or up == "y":
        return found
    position, target, upwards = (as_vector(_UPRIGHT[:3, :3] @ way) for way in (found.position, found.target, found.up))
    return replace(found, position=position, target=target, up=upwards)
