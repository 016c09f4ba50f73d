"""Shading normals and tangents at points of triangles, and what a camera's pixels cover of textures.

Tangents are those of the file, else of texture coordinates as MikkTSpace has them: of each corner the mean of the
triangles around its vertex by angle, in the plane of its normal, those of mirrored coordinates apart; interpolated
without taking them to length 1 again, with the bitangent across normal and tangent.
Source: Mikkelsen, Simulation of Wrinkled Surfaces Revisited (2008); Khronos, glTF 2.0, 3.7.2.1.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..camera import Camera
from .texture import filtered

if TYPE_CHECKING:
    from .surface import Surface

__all__ = ["face_normals", "footprints", "frame_turns", "shading_normals", "tangents_at"]

# Normals that face away from the eye, at outlines of coarse meshes, are turned until they face it by so much.
_LEAST_FACING = 0.01
Points = NDArray[np.float64]


def mixed(corners: np.ndarray, barycentrics: np.ndarray) -> Points:
    """Values of corners (k, 3, n) at points by the weights (k, 2) of the second and third: (k, n)."""
    b1, b2 = np.asarray(barycentrics, np.float64).T[:, :, None]
    a, b, c = corners.astype(np.float64).transpose(1, 0, 2)
    return np.asarray((1.0 - b1 - b2) * a + b1 * b + b2 * c)


def _unit(vectors: np.ndarray) -> Points:
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.asarray(vectors / np.where(length > 0.0, length, 1.0))


def face_normals(surface: Surface, triangles: np.ndarray) -> Points:
    """Unit normals of triangles by the order of their corners, (k, 3)."""
    a, b, c = surface.vertices[surface.triangles[triangles]].transpose(1, 0, 2)
    edges = _unit(b - a), _unit(c - a)
    return _unit(np.cross(*edges))


def shading_normals(
    surface: Surface, triangles: np.ndarray, barycentrics: np.ndarray, seen: np.ndarray, camera: Camera
) -> NDArray[np.float32]:
    """The normals that points take their cosines to.

    Parameters
    ----------
    surface
        With normals, or pictures of them.
    triangles, barycentrics
        As for `Surface.albedo_at`.
    seen
        (k, 3) unit normals of the triangles, to the side that is seen.
    camera
        Whose pixels they are.

    Returns
    -------
    (k, 3) float32
        Unit vectors, to the side that is seen, and none of them away from the eye.
    """
    seen = np.asarray(seen, np.float64)
    normal = _smooth(surface, triangles, barycentrics)
    for number, relief in enumerate(surface.reliefs):
        here = np.flatnonzero(surface.material[triangles] == number) if relief is not None else ()
        if relief is not None and len(here):
            at = triangles[here], barycentrics[here]
            normal[here] = _bent(surface, number, relief, *at, normal[here], camera)
    normal = _unit(normal) * np.where((normal * seen).sum(axis=1) < 0.0, -1.0, 1.0)[:, None]
    places = mixed(surface.vertices[surface.triangles[triangles]], barycentrics)
    to_eye = _unit(np.asarray(camera.position) - places)
    lacking = np.maximum(_LEAST_FACING - (normal * to_eye).sum(axis=1, keepdims=True), 0.0)
    return _unit(normal + lacking * to_eye).astype(np.float32)


def _smooth(surface: Surface, triangles: np.ndarray, barycentrics: np.ndarray) -> Points:
    """The normals of corners, mixed; those of triangles where a corner has none."""
    faces = face_normals(surface, triangles)
    if surface.normals is None:
        return faces
    corners = surface.normals[surface.triangles[triangles]]
    mean = mixed(corners, barycentrics)
    whole = (corners != 0.0).any(axis=2).all(axis=1) & (np.linalg.norm(mean, axis=1) > 1e-3)
    return np.asarray(np.where(whole[:, None], mean, faces))


def _bent(
    surface: Surface,
    number: int,
    relief: np.ndarray,
    triangles: np.ndarray,
    barycentrics: np.ndarray,
    normal: Points,
    camera: Camera,
) -> Points:
    """Normals as a picture of them says, in the frame of the tangent."""
    if surface.uv is None:
        return normal
    uv = mixed(surface.uv[surface.triangles[triangles]], barycentrics)
    steps = footprints(surface, triangles, barycentrics, camera)
    own = filtered(relief, uv, steps, surface.sampler(number))
    tangent, sign = tangents_at(surface, triangles, barycentrics)
    bitangent = sign[:, None] * np.cross(normal, tangent)
    bent = own[:, :1] * tangent + own[:, 1:2] * bitangent + own[:, 2:] * normal
    # Where texture coordinates stand still there is no frame.
    there = (np.abs(tangent).max(axis=1) > 0.0) & (np.linalg.norm(bent, axis=1) > 1e-6)
    return np.asarray(np.where(there[:, None], bent, normal))


def tangents_at(
    surface: Surface, triangles: np.ndarray, barycentrics: np.ndarray
) -> tuple[Points, NDArray[np.float64]]:
    """Tangents at points, (k, 3), 0 where there are none, and the sense of the bitangent: (k,) of 1 and -1."""
    corners = corner_tangents(surface)[triangles]
    sign = np.where(corners[:, :, 3].sum(axis=1) < 0.0, -1.0, 1.0)
    return mixed(corners[:, :, :3], barycentrics), sign


def corner_tangents(surface: Surface) -> NDArray[np.float64]:
    """Of every corner of every triangle its tangent and the sign of its bitangent: (t, 3, 4)."""
    corners = surface.triangles
    if surface.tangents is not None:
        return np.asarray(surface.tangents[corners], np.float64)
    if surface.uv is None:
        return np.zeros((*corners.shape, 4))
    p, uv = surface.vertices[corners], surface.uv[corners].astype(np.float64)
    (d1, d2), (w1, w2) = ((of[:, 1] - of[:, 0], of[:, 2] - of[:, 0]) for of in (p, uv))
    area = w1[:, 0] * w2[:, 1] - w2[:, 0] * w1[:, 1]
    sign = np.where(area < 0.0, -1.0, 1.0)
    along = _unit(sign[:, None] * (w2[:, 1:] * d1 - w1[:, 1:] * d2)) * (area != 0.0)[:, None]

    faces = np.repeat(face_normals(surface, np.arange(len(corners)))[:, None], 3, axis=1)
    normals = faces if surface.normals is None else surface.normals[corners].astype(np.float64)
    normals = np.where((normals != 0.0).any(axis=2, keepdims=True), normals, faces)
    flat = _unit(along[:, None] - (along[:, None] * normals).sum(axis=2, keepdims=True) * normals)
    ways = _unit(np.roll(p, -1, axis=1) - p), _unit(np.roll(p, 1, axis=1) - p)
    angle = np.arccos(np.clip((ways[0] * ways[1]).sum(axis=2), -1.0, 1.0))

    # Corners of one vertex and one sense share a tangent.
    key = 2 * corners.astype(np.int64) + (sign < 0.0)[:, None]
    _, group = np.unique(key, return_inverse=True)
    group = group.reshape(-1)
    weighted = (angle[:, :, None] * flat).reshape(-1, 3)
    sums = np.stack([np.bincount(group, weighted[:, k]) for k in range(3)], -1)
    tangent = _unit(sums)[group].reshape(*corners.shape, 3)
    return np.concatenate([tangent, np.broadcast_to(sign[:, None, None], (*corners.shape, 1))], axis=2)


def frame_turns(normal: np.ndarray, tangent: np.ndarray) -> NDArray[np.float32]:
    """Cosine and sine of the angles from the tangents that the core gives to normals (Duff et al. 2017) to others:
    (k, 2); of points without a tangent 1 and 0."""
    x, y, z = np.asarray(normal, np.float64).T
    sign = np.where(np.signbit(z), -1.0, 1.0)
    a = -1 / (sign + z)
    b = x * y * a
    first = np.stack([1 + sign * x * x * a, sign * b, -sign * x], -1)
    second = np.stack([b, sign + y * y * a, -y], -1)
    turn = np.stack([(tangent * axis).sum(axis=1) for axis in (first, second)], -1)
    length = np.linalg.norm(turn, axis=1, keepdims=True)
    return np.where(length > 1e-6, turn / np.maximum(length, 1e-6), (1.0, 0.0)).astype(np.float32)


def footprints(surface: Surface, triangles: np.ndarray, barycentrics: np.ndarray, camera: Camera) -> Points:
    """How far a step to the next pixel, to the right and upwards, leads in texture coordinates: (k, 2, 2)."""
    corners = surface.triangles[triangles]
    p0, p1, p2 = surface.vertices[corners].transpose(1, 0, 2)
    e1, e2 = p1 - p0, p2 - p0
    b1, b2 = np.asarray(barycentrics, np.float64).T[:, :, None]
    normal = np.cross(e1, e2)
    right, up, forward = camera.basis()
    way = p0 + b1 * e1 + b2 * e2 - np.asarray(camera.position)
    depth = np.maximum(way @ forward, 1e-300)[:, None]
    ray = way / depth
    step = 2.0 * np.tan(np.radians(camera.vertical_fov) / 2) / camera.height
    facing = (normal * ray).sum(axis=1, keepdims=True)
    # A ray along the surface meets it nowhere: seen like that it is endlessly long.
    facing = np.where(np.abs(facing) > 1e-9 * np.linalg.norm(normal, axis=1, keepdims=True), facing, np.inf)
    square = (normal * normal).sum(axis=1)
    coordinates = np.zeros((*corners.shape, 2)) if surface.uv is None else surface.uv[corners]
    uv0, uv1, uv2 = coordinates.astype(np.float64).transpose(1, 0, 2)
    steps = []
    for axis in (right, up):
        moved = depth * step * (axis - (normal @ axis)[:, None] / facing * ray)
        along1 = (np.cross(moved, e2) * normal).sum(axis=1) / square
        along2 = (np.cross(e1, moved) * normal).sum(axis=1) / square
        steps.append(along1[:, None] * (uv1 - uv0) + along2[:, None] * (uv2 - uv0))
    return np.stack(steps, axis=1)
