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
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from ..camera import Camera
from ..checks import real_array
from ..surface.material import Material
from ..surface.surface import Surface, of_materials
from . import files
from .builtin import catalogue
from .checked import (
    check_corners,
    checked_albedo,
    checked_emission,
    checked_materials,
    checked_normals,
    checked_triangles,
    checked_vertices,
    first_equal_row,
    frozen,
    has_area,
)
from .content import Content, Piece


@dataclass(frozen=True, eq=False, kw_only=True)
class Scene(Surface):
    """Triangles with their materials, and a camera. Made by `load`, `builtin` or `from_arrays`, not by hand.

    Attributes
    ----------
    vertices, triangles, material, albedo, textures, uv, normals, models, specular, emission, names
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

    @classmethod
    def load(cls, path: str | os.PathLike[str], camera: Camera | None = None) -> Scene:
        """Read a .glb, .gltf, .obj, .ply or .stl file.

        Parameters
        ----------
        path : path
        camera : Camera, optional
            Otherwise the file's own (glTF), or one that frames everything.

        Returns
        -------
        Scene
            What was put right is in its counts, what was left out in its warnings.

        Raises
        ------
        FileNotFoundError, OSError
            If the file cannot be read.
        FileError
            A `ValueError`: the file is broken, of an unknown kind, or has no triangles.
        """
        content = files.read(path)
        with files.blaming(path):
            return cls.from_content(content, camera)

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
    def from_content(cls, content: Content, camera: Camera | None = None) -> Scene:
        """What a source handed over, as one list of triangles.

        Parameters
        ----------
        content : Content
            Pieces, materials, perhaps a camera.
        camera : Camera, optional
            Otherwise the content's own, or one that frames everything.

        Returns
        -------
        Scene
            Texture coordinates that are not finite are 0, albedos are clipped to [0, 1]; both are counted.

        Raises
        ------
        ValueError
            If the content has no triangles with an area, vertices that are not finite, or corners out of range.
        """
        pieces = content.pieces
        offsets = np.cumsum([0] + [len(piece.vertices) for piece in pieces])
        uv = np.concatenate([np.zeros((len(piece.vertices), 2)) if piece.uv is None else piece.uv for piece in pieces])
        albedo = np.array(content.albedo)
        mended = Counter(
            {
                "texture coordinates not finite": int(np.count_nonzero(~np.isfinite(uv))),
                "albedos clipped to [0, 1]": int(np.count_nonzero((albedo < 0.0) | (albedo > 1.0))),
            }
        )
        corners = [_own_corners(piece) + start for piece, start in zip(pieces, offsets, strict=False)]
        emission = checked_emission(content.emission)
        found = _assemble(
            np.concatenate([piece.vertices for piece in pieces]),
            np.concatenate(corners),
            np.repeat([piece.material for piece in pieces], [len(own) for own in corners]),
            albedo.clip(0.0, 1.0),
            textures=content.textures,
            uv=np.where(np.isfinite(uv), uv, 0.0),
            camera=camera or content.camera,
            name=content.name,
            # A sum of counters leaves out what was not found.
            counts=content.counts + mended,
            warnings=content.warnings,
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
            Of the surface that the triangles stand for, of any length above 0: receivers at vertices face along them.
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
        if materials is not None:
            names = tuple(materials) if isinstance(materials, Mapping) else ()
            materials = list(materials.values()) if isinstance(materials, Mapping) else materials
            numbers = checked_materials(materials, material, len(corners))
            found = _assemble(
                vertices, corners, numbers, np.zeros((len(materials), 3)), normals=shading, camera=camera, name=name
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
        return _assemble(vertices, corners, of_triangle, rows[distinct], normals=shading, camera=camera, name=name)

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
        """
        return replace(self, camera=camera)

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

    if camera is None:
        camera = Camera.framing(points[np.unique(corners[kept])])
    pictures = tuple(None if texture is None else frozen(texture, np.float32) for texture in textures)
    return Scene(
        vertices=frozen(points, np.float64),
        triangles=frozen(corners[kept], np.uint32),
        material=frozen(np.asarray(material)[kept], np.uint32),
        albedo=frozen(colours, np.float32),
        camera=camera,
        textures=pictures or (None,) * len(colours),
        uv=None if uv is None or not any(t is not None for t in pictures) else frozen(uv, np.float32),
        normals=None if normals is None else frozen(normals, np.float32),
        name=name,
        counts=found,
        warnings=tuple(warnings),
    )


def _own_corners(piece: Piece) -> np.ndarray:
    """The piece's own corners, before an offset could hide that they are out of range."""
    corners = np.asarray(piece.triangles, dtype=np.int64)
    bad = np.flatnonzero(((corners < 0) | (corners >= len(piece.vertices))).any(axis=1))
    if len(bad):
        own = len(piece.vertices)
        raise ValueError(f"corners must be in [0, {own}), but a triangle has {corners[bad[0]].tolist()}")
    return corners
