"""Plain numpy oracles that share no code with the package: cubemap directions, solid angles, form factors, meshes."""

from __future__ import annotations

import itertools

import numpy as np

# (s, t) of a face to a direction, the OpenGL table: faces +X, -X, +Y, -Y, +Z, -Z, with s to the right and t down.
_FACES = (
    lambda s, t: (1, -t, -s),
    lambda s, t: (-1, -t, s),
    lambda s, t: (s, 1, t),
    lambda s, t: (s, -1, -t),
    lambda s, t: (s, -t, 1),
    lambda s, t: (-s, -t, -1),
)


def points(size: int, samples: int = 1) -> np.ndarray:
    """Points on the cube, (6, size samples, size samples, 3): texel centres, or samples x samples inside each."""
    centre = (2 * np.arange(size * samples) + 1) / (size * samples) - 1
    t, s = np.meshgrid(centre, centre, indexing="ij")
    return np.stack([np.stack(np.broadcast_arrays(*face(s, t)), axis=-1) for face in _FACES]).astype(np.float64)


def directions(size: int, samples: int = 1) -> np.ndarray:
    cube = points(size, samples)
    return cube / np.linalg.norm(cube, axis=-1, keepdims=True)


def solid_angles(size: int) -> np.ndarray:
    """Steradians of the texels of a face, (size, size).

    The rectangle from (0, 0) to (s, t) on the plane at distance 1 has atan(s t / sqrt(1 + s^2 + t^2)).
    """
    edge = 2 * np.arange(size + 1) / size - 1
    s, t = np.meshgrid(edge, edge)
    corner = np.arctan(s * t / np.sqrt(1 + s * s + t * t))
    return corner[1:, 1:] - corner[1:, :-1] - corner[:-1, 1:] + corner[:-1, :-1]


def texel_of(direction: np.ndarray, size: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(face, row, column) of the texel that directions (..., 3) fall into."""
    x, y, z = np.moveaxis(np.asarray(direction, np.float64), -1, 0)
    axis = np.argmax(np.abs(direction), axis=-1)
    largest = np.choose(axis, (x, y, z))
    face = 2 * axis + (largest < 0)
    # The table of `_FACES`, solved for s and t.
    s = np.choose(face, (-z, z, x, x, x, -x)) / np.abs(largest)
    t = np.choose(face, (-y, -y, z, -z, -y, -y)) / np.abs(largest)
    place = lambda at: np.clip(((at + 1) / 2 * size).astype(int), 0, size - 1)  # noqa: E731
    return face, place(t), place(s)


def look_up(cubemap: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """Piecewise constant radiance from directions (..., 3)."""
    return cubemap[texel_of(direction, cubemap.shape[1])]


def irradiance(cubemap: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """B of an unoccluded receiver, texel centres: sum_p L_p max(0, n . d_p) dw_p / pi, (3,)."""
    size = cubemap.shape[1]
    cosine = np.maximum(directions(size) @ normal, 0)
    return np.einsum("fij,fijc->c", cosine * solid_angles(size), np.asarray(cubemap, np.float64)) / np.pi


def rotations() -> list[np.ndarray]:
    """The 24 rotations of the cube: signed permutations of the axes with determinant 1."""
    found = []
    for order in itertools.permutations(range(3)):
        for signs in itertools.product((1.0, -1.0), repeat=3):
            matrix = np.zeros((3, 3))
            matrix[range(3), order] = signs
            if np.linalg.det(matrix) > 0:
                found.append(matrix)
    return found


def rotated(cubemap: np.ndarray, turn: np.ndarray) -> np.ndarray:
    """L'(d) = L(R^-1 d) at texel centres; a rotation of the cube only moves texels."""
    return look_up(cubemap, points(cubemap.shape[1]) @ turn)


def rectangle_form_factor(position: np.ndarray, low: tuple, high: tuple, height: float) -> np.ndarray:
    """Share of the cosine hemisphere that a rectangle parallel to the receiver's plane covers.

    Receivers at (x, z) of `position` (k, 2), the rectangle from `low` to `high` at `height` above. With a corner right
    above, F = (X / sqrt(1 + X^2) atan(Y / sqrt(1 + X^2)) + Y / sqrt(1 + Y^2) atan(X / sqrt(1 + Y^2))) / 2 pi (Howell, A
    catalog of radiation configuration factors, B-3); any other is four of these, signed.
    """

    def corner(at: np.ndarray) -> np.ndarray:
        x, y = at[:, 0] / height, at[:, 1] / height
        u, v = np.sqrt(1 + x * x), np.sqrt(1 + y * y)
        return (x / u * np.arctan(y / u) + y / v * np.arctan(x / v)) / (2 * np.pi)

    (x0, z0), (x1, z1) = low, high
    return (
        corner(np.subtract((x1, z1), position)) - corner(np.subtract((x0, z1), position))
        - corner(np.subtract((x1, z0), position)) + corner(np.subtract((x0, z0), position))
    )  # fmt: skip


def quad(corner, edge1, edge2, cells: int = 1) -> tuple[np.ndarray, np.ndarray]:
    """A parallelogram of cells x cells x 2 triangles: (vertices, triangles)."""
    corner, edge1, edge2 = (np.asarray(v, np.float64) for v in (corner, edge1, edge2))
    steps = np.arange(cells + 1) / cells
    vertices = (corner + steps[:, None, None] * edge1 + steps[None, :, None] * edge2).reshape(-1, 3)
    at = np.arange((cells + 1) ** 2).reshape(cells + 1, cells + 1)
    a, b, c, d = at[:-1, :-1], at[1:, :-1], at[1:, 1:], at[:-1, 1:]
    triangles = np.concatenate([np.stack([a, b, c], -1), np.stack([a, c, d], -1)]).reshape(-1, 3)
    return vertices, triangles


def box(low, high, cells: int = 1, *, without: str = "") -> tuple[np.ndarray, np.ndarray]:
    """The sides of a box, without those named ("x-", "x+", ...)."""
    low, size = np.asarray(low, np.float64), np.subtract(high, low)
    x, y, z = np.diag(size)
    sides = {
        "x-": (low, y, z), "x+": (low + x, y, z), "y-": (low, x, z),
        "y+": (low + y, x, z), "z-": (low, x, y), "z+": (low + z, x, y),
    }  # fmt: skip
    return merged(*(quad(*side, cells) for name, side in sides.items() if name not in without.split()))


def merged(*parts: tuple[np.ndarray, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    starts = np.cumsum([0, *(len(vertices) for vertices, _ in parts)])
    triangles = [part + start for (_, part), start in zip(parts, starts, strict=False)]
    return np.concatenate([vertices for vertices, _ in parts]), np.concatenate(triangles)
