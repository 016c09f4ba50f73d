"""What is looked at, and from where: triangles, diffuse materials and a camera, all immutable.

A `Scene` is made by `Scene.load`, `Scene.builtin` or `Scene.from_arrays`, which validate: what cannot be right is
refused with a `ValueError`; what is merely untidy (triangles without area, the same triangle twice) is put right and
counted in `Scene.counts`, so that the plan can report it. Surfaces are two-sided: the winding does not matter.

Right-handed, +Y up, lengths in any unit; albedos are linear, in [0, 1].
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from .camera import LARGEST_COORDINATE, Camera, as_vector, real_array

MOST_TRIANGLES = 100_000_000


@dataclass(frozen=True, eq=False)
class Scene:
    """Triangles with diffuse materials, and a camera. Made by `load`, `builtin` or `from_arrays`, not by hand.

    Attributes
    ----------
    vertices : (v, 3) float64
    triangles : (t, 3) uint32
        Corners; every triangle has an area and occurs once.
    material : (t,) uint32
        For each triangle its row of `albedo`.
    albedo : (m, 3) float32
        Linear diffuse reflectance, in [0, 1].
    camera : Camera
    textures : m entries, each (h, w, 3) float32 or None
        Linear factor of the material's albedo; row 0 is the top. A scene without textures has None in all places.
    uv : (v, 2) float32 or None
        Texture coordinates, origin at the lower left, repeating.
    name : str
    counts : mapping of str to int
        What was found and put right: degenerate and duplicate triangles, textures ignored and so on.
    warnings : tuple of str
        A sentence for everything that a file asked for and the scene leaves out.
    """

    vertices: np.ndarray
    triangles: np.ndarray
    material: np.ndarray
    albedo: np.ndarray
    camera: Camera
    textures: tuple[np.ndarray | None, ...] = ()
    uv: np.ndarray | None = None
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

        Raises
        ------
        FileNotFoundError, OSError
            If the file cannot be read.
        FileError
            A `ValueError`: the file is broken, of an unknown kind, or has no triangles.
        """
        from . import scene_io

        return scene_io.load(path, camera)

    @classmethod
    def builtin(cls, name: str, camera: Camera | None = None) -> Scene:
        """One of the built-in scenes: "plant", "cornell", "still-life" or "street"; ValueError for another name."""
        from . import scenes

        return scenes.build(name, camera)

    @classmethod
    def from_arrays(
        cls,
        vertices: npt.ArrayLike,
        triangles: npt.ArrayLike,
        albedo: npt.ArrayLike = (0.5, 0.5, 0.5),
        camera: Camera | None = None,
        *,
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

        Raises
        ------
        ValueError
            For arrays of a wrong shape or kind, no triangles, values that are not finite, or corners or albedos out
            of range.
        """
        corners = _triangles(triangles)
        colours = real_array("albedo", albedo, np.float64)
        if colours.shape not in ((3,), corners.shape):
            raise ValueError(f"albedo must have shape (3,) or {corners.shape}, one per triangle, got {colours.shape}")
        # Equal albedos are one material, so that a pixel that shows many triangles of a colour is one receiver.
        rows = np.broadcast_to(colours.astype(np.float32), (1, 3) if colours.ndim == 1 else corners.shape)
        first = first_equal_row(rows)
        distinct, of_row = np.unique(first, return_inverse=True)
        material = np.broadcast_to(of_row, len(corners))
        return assemble(vertices, corners, material, rows[distinct], camera=camera, name=name)

    def with_camera(self, camera: Camera) -> Scene:
        """The same scene seen by another camera; arrays are shared."""
        return replace(self, camera=camera)

    def content_hash(self) -> str:
        """A digest (64 hexadecimal digits) of all that transport depends on: geometry, materials and camera."""
        digest = hashlib.blake2b(digest_size=32)
        arrays = [self.vertices, self.triangles, self.material, self.albedo, self.uv, *self.textures]
        for array in arrays:
            digest.update(b"none;" if array is None else f"{array.dtype.str}{array.shape};".encode())
            if array is not None:
                digest.update(np.ascontiguousarray(array).data)
        digest.update(repr(self.camera).encode())
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
        """
        triangles = np.asarray(triangles)
        material = self.material[triangles]
        albedo = self.albedo[material]
        for index, texture in enumerate(self.textures):
            here = np.flatnonzero(material == index) if texture is not None and self.uv is not None else ()
            if texture is None or self.uv is None or len(here) == 0:
                continue
            b1, b2 = np.asarray(barycentrics, dtype=np.float64)[here].T[:, :, None]
            uv0, uv1, uv2 = self.uv[self.triangles[triangles[here]]].astype(np.float64).transpose(1, 0, 2)
            albedo[here] *= _bilinear(texture, (1.0 - b1 - b2) * uv0 + b1 * uv1 + b2 * uv2)
        return albedo


def assemble(
    vertices: npt.ArrayLike,
    triangles: npt.ArrayLike,
    material: npt.ArrayLike,
    albedo: npt.ArrayLike,
    *,
    textures: Sequence[np.ndarray | None] = (),
    uv: npt.ArrayLike | None = None,
    camera: Camera | None = None,
    name: str = "scene",
    counts: Mapping[str, int] | None = None,
    warnings: Sequence[str] = (),
) -> Scene:
    """Validate, drop what has no area or occurs twice, and make the scene; the one way in for all sources."""
    points = _vertices(vertices)
    corners = _triangles(triangles)
    _check_corners(corners, len(points))
    colours = _albedo(albedo)

    # Triangles without area are hit by no ray; of equal ones (in any winding) the first stays.
    solid = _has_area(points, corners)
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
    pictures = tuple(None if texture is None else _frozen(texture, np.float32) for texture in textures)
    return Scene(
        vertices=_frozen(points, np.float64),
        triangles=_frozen(corners[kept], np.uint32),
        material=_frozen(np.asarray(material)[kept], np.uint32),
        albedo=_frozen(colours, np.float32),
        camera=camera,
        textures=pictures or (None,) * len(colours),
        uv=None if uv is None or not any(t is not None for t in pictures) else _frozen(uv, np.float32),
        name=name,
        counts=found,
        warnings=tuple(warnings),
    )


def first_equal_row(rows: np.ndarray) -> np.ndarray:
    """For each row of a (n, 3) array the index of the first row with the same three values, (n,) int64.

    Sorting rows is slow, so their 64-bit hashes are sorted; a collision of hashes, if ever, falls back on the rows.
    """
    # Adding zero makes -0.0 and 0.0, which are equal, also equal in their bits.
    bits = np.ascontiguousarray(rows + np.zeros(1, rows.dtype))
    words = bits.view(f"u{bits.itemsize}").astype(np.uint64)
    hashes = np.zeros(len(words), dtype=np.uint64)
    for column in words.T:
        hashes = (hashes ^ column) * np.uint64(0x9E3779B97F4A7C15)
        hashes ^= hashes >> np.uint64(29)
    _, first, inverse = np.unique(hashes, return_index=True, return_inverse=True)
    nearest = first[inverse]
    if np.array_equal(bits[nearest], bits):
        return nearest
    _, first, inverse = np.unique(bits, axis=0, return_index=True, return_inverse=True)
    return first[inverse.reshape(-1)]


def _has_area(points: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Which triangles have an area beyond the rounding of their own edges, (t,) bool."""
    p0 = points[corners[:, 0]]
    edge1, edge2 = points[corners[:, 1]] - p0, points[corners[:, 2]] - p0
    # Scaled to edges of at most 1, so that the products of tiny edges do not underflow.
    longest = np.maximum(np.abs(edge1).max(axis=1), np.abs(edge2).max(axis=1))
    scale = np.where(longest > 0.0, longest, 1.0)[:, None]
    doubled_area = np.abs(np.cross(edge1 / scale, edge2 / scale)).max(axis=1)
    return doubled_area > 8.0 * np.finfo(np.float64).eps


def _bilinear(texture: np.ndarray, uv: np.ndarray) -> np.ndarray:
    """Texture values at (k, 2) coordinates with the origin at the lower left, repeating; (k, 3)."""
    height, width = texture.shape[:2]
    x = (uv[:, 0] % 1.0) * width - 0.5
    y = ((1.0 - uv[:, 1]) % 1.0) * height - 0.5
    column, row = np.floor(x).astype(np.int64), np.floor(y).astype(np.int64)
    fx, fy = (x - column)[:, None], (y - row)[:, None]
    left, right = column % width, (column + 1) % width
    above, below = row % height, (row + 1) % height
    upper = (1.0 - fx) * texture[above, left] + fx * texture[above, right]
    lower = (1.0 - fx) * texture[below, left] + fx * texture[below, right]
    return (1.0 - fy) * upper + fy * lower


def _vertices(vertices: npt.ArrayLike) -> np.ndarray:
    points = real_array("vertices", vertices, np.float64)
    if points.ndim != 2 or points.shape[1] != 3:
        raise ValueError(f"vertices must have shape (v, 3), got {points.shape}")
    bad = np.flatnonzero(~np.isfinite(points).all(axis=1))
    if len(bad):
        raise ValueError(
            f"vertices must be finite, but {len(bad)} of {len(points)} are not; "
            f"the first is vertex {bad[0]} = {as_vector(points[bad[0]])}"
        )
    far = np.flatnonzero(np.abs(points).max(axis=1, initial=0.0) > LARGEST_COORDINATE)
    if len(far):
        raise ValueError(
            f"coordinates must be within +-{LARGEST_COORDINATE:g}, but vertex {far[0]} is {as_vector(points[far[0]])}"
        )
    return points


def _triangles(triangles: npt.ArrayLike) -> np.ndarray:
    corners = np.asarray(triangles)
    if corners.size == 0:
        raise ValueError("the scene has no triangles")
    if corners.ndim != 2 or corners.shape[1] != 3:
        raise ValueError(f"triangles must have shape (t, 3), got {corners.shape}")
    if corners.dtype.kind not in "iu":
        raise ValueError(f"triangles must be integers, got dtype {corners.dtype}")
    if len(corners) > MOST_TRIANGLES:
        raise ValueError(f"at most {MOST_TRIANGLES} triangles are supported, got {len(corners)}")
    return corners


def _check_corners(corners: np.ndarray, vertices: int) -> None:
    bad = np.flatnonzero(((corners < 0) | (corners >= vertices)).any(axis=1))
    if len(bad):
        raise ValueError(
            f"corners must be in [0, {vertices}), but {len(bad)} of {len(corners)} triangles point elsewhere; "
            f"the first is triangle {bad[0]} = {tuple(corners[bad[0]].tolist())}"
        )


def _albedo(albedo: npt.ArrayLike) -> np.ndarray:
    colours = real_array("albedo", albedo, np.float32)
    bad = np.argwhere(~((colours >= 0.0) & (colours <= 1.0)))
    if len(bad):
        first = colours[tuple(bad[0])]
        raise ValueError(f"albedo must be in [0, 1], but {len(bad)} values are not; the first is {first}")
    return colours


def _frozen(values: npt.ArrayLike, dtype: npt.DTypeLike) -> np.ndarray:
    """A contiguous copy that nobody can change afterwards."""
    array = np.array(values, dtype=dtype, order="C")
    array.flags.writeable = False
    return array
