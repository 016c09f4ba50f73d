"""Arrays of a scene, checked: each is refused with what was expected and what was found, or comes back clean."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from ..camera import LARGEST_COORDINATE
from ..checks import as_vector, real_array
from ..surface.material import BRIGHTEST, Material
from .content import MOST_TRIANGLES


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


def has_area(points: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Which triangles have an area beyond the rounding of their own edges, (t,) bool."""
    p0 = points[corners[:, 0]]
    edge1, edge2 = points[corners[:, 1]] - p0, points[corners[:, 2]] - p0
    # Scaled to edges of at most 1, so that the products of tiny edges do not underflow.
    longest = np.maximum(np.abs(edge1).max(axis=1), np.abs(edge2).max(axis=1))
    scale = np.where(longest > 0.0, longest, 1.0)[:, None]
    doubled_area = np.abs(np.cross(edge1 / scale, edge2 / scale)).max(axis=1)
    return np.asarray(doubled_area > 8.0 * np.finfo(np.float64).eps)


def checked_vertices(vertices: npt.ArrayLike) -> np.ndarray:
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


def checked_triangles(triangles: npt.ArrayLike) -> np.ndarray:
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


def check_corners(corners: np.ndarray, vertices: int) -> None:
    bad = np.flatnonzero(((corners < 0) | (corners >= vertices)).any(axis=1))
    if len(bad):
        from_one = "; are they counted from 1?" if corners.min() == 1 and corners.max() == vertices else ""
        raise ValueError(
            f"corners must be in [0, {vertices}), but {len(bad)} of {len(corners)} triangles point elsewhere; "
            f"the first is triangle {bad[0]} = {tuple(corners[bad[0]].tolist())}{from_one}"
        )


def checked_normals(normals: npt.ArrayLike, vertices: tuple[int, ...], name: str = "normals") -> np.ndarray:
    """Unit vectors, one for each vertex."""
    vectors = real_array(name, normals, np.float64)
    if vectors.shape != vertices:
        raise ValueError(f"{name} must have shape {vertices}, one per vertex, got {vectors.shape}")
    lengths = np.linalg.norm(vectors, axis=1)
    bad = np.flatnonzero(~(np.isfinite(lengths) & (lengths > 0)))
    if len(bad):
        raise ValueError(
            f"{name} must be finite and longer than 0, but {len(bad)} of {len(vectors)} are not; "
            f"the first is that of vertex {bad[0]}"
        )
    return np.asarray(vectors / lengths[:, None])


def checked_tangents(tangents: npt.ArrayLike, vertices: int) -> np.ndarray:
    """Unit vectors, one for each vertex, and the sense of its bitangent."""
    vectors = real_array("tangents", tangents, np.float64)
    if vectors.ndim != 2 or len(vectors) != vertices or vectors.shape[1] not in (3, 4):
        raise ValueError(f"tangents must have shape ({vertices}, 3) or ({vertices}, 4), got {vectors.shape}")
    along = checked_normals(vectors[:, :3], (vertices, 3), "tangents")
    sense = np.ones((vertices, 1))
    sense[(vectors[:, 3:] < 0.0).any(axis=1)] = -1.0
    return np.concatenate([along, sense], axis=1)


def checked_materials(materials: Sequence[Material], numbers: npt.ArrayLike | None, triangles: int) -> np.ndarray:
    """For each triangle the number of its material."""
    if isinstance(materials, Material):
        raise TypeError("expected a list of materials, got one; [material] is a list of it")
    if len(materials) == 0 or any(not isinstance(material, Material) for material in materials):
        raise ValueError(f"materials must be a list of dl.Material, got {materials!r:.80}")
    if numbers is None:
        if len(materials) > 1:
            raise ValueError(f"material must say which of {len(materials)} materials each triangle has")
        return np.zeros(triangles, np.int64)
    found = np.asarray(numbers)
    if found.shape != (triangles,) or found.dtype.kind not in "iu":
        raise ValueError(f"material must be ({triangles},) integers, one per triangle, got {found.dtype} {found.shape}")
    if found.min() < 0 or found.max() >= len(materials):
        raise ValueError(f"material must be in [0, {len(materials)}), but the largest is {found.max()}")
    return found


def checked_albedo(albedo: npt.ArrayLike) -> np.ndarray:
    colours = real_array("albedo", albedo, np.float32)
    bad = np.argwhere(~((colours >= 0.0) & (colours <= 1.0)))
    if len(bad):
        first = colours[tuple(bad[0])]
        raise ValueError(f"albedo must be in [0, 1], but {len(bad)} values are not; the first is {first}")
    return colours


def checked_emission(emission: npt.ArrayLike) -> np.ndarray:
    """Radiance that materials give off: (m, 3) float32."""
    colours = real_array("emission", emission, np.float64)
    if colours.ndim != 2 or colours.shape[1] != 3 or not ((colours >= 0.0) & (colours <= BRIGHTEST)).all():
        raise ValueError(f"emission must be three numbers from 0 to {BRIGHTEST:g}, got {colours.tolist()!r:.80}")
    return frozen(colours, np.float32)


def frozen(values: npt.ArrayLike, dtype: npt.DTypeLike) -> np.ndarray:
    """A contiguous copy that nobody can change afterwards."""
    array = np.array(values, dtype=dtype, order="C")
    array.flags.writeable = False
    return array
