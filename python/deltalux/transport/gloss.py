"""Glossy vertices seen from anywhere: what an eye makes of the responses of a lobe's factors.

B(v, wo) = sum_k h_k(wo) B_k(v)        (Overbeck 2006, eq. 7.2)

Of a measured lobe h_k has three colours.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..camera import Camera
from .receivers import Vertices

__all__ = ["Gloss", "looked_up"]


@dataclass(frozen=True)
class Gloss:
    """Rows of factors, behind those of vertices.

    Attributes
    ----------
    base
        (factor rows,) the vertex of each.
    factor
        (factor rows,) which of its material's factors.
    material
        (factor rows,) its material.
    eyes
        By material: (factors, rings, columns) float32, h_k at the middles of cells of equal angles; of measured ones
        with a last axis of three colours.
    position, normal
        (factor rows, 3) of the vertices.
    """

    base: NDArray[np.intp]
    factor: NDArray[np.intp]
    material: NDArray[np.intp]
    eyes: Mapping[int, NDArray[np.float32]]
    position: NDArray[np.float32]
    normal: NDArray[np.float32]
    first: int
    """How many rows of vertices there are before."""
    turn: NDArray[np.float32] | None = None
    """(factor rows, 2): cosine and sine of what the tangent is turned by, out of the frame of the normal."""

    @staticmethod
    def of(arrays: Mapping[str, NDArray[Any]], receivers: Vertices) -> Gloss:
        """From what lies beside a transport.

        Raises
        ------
        ValueError
            If an array is missing or does not fit.
        """
        rows, material = len(receivers), receivers.material
        base, factor = arrays["base"], arrays.get("factor")
        whole = factor is not None and all(x.dtype == np.uint32 and x.shape == (rows,) for x in (base, factor))
        if not whole or factor is None or material is None:
            raise ValueError(f"expected base and factor of uint32 and shape ({rows},)")
        turn = arrays.get("turn")
        if turn is not None and (turn.dtype != np.float32 or turn.shape != (rows, 2) or not np.isfinite(turn).all()):
            raise ValueError(f"expected turn of float32, finite, and shape ({rows}, 2)")
        first = int(np.count_nonzero(base == np.arange(rows)))
        behind = slice(first, rows)
        eyes = {
            int(name[4:]): table for name, table in arrays.items() if name.startswith("eye.") and name[4:].isdecimal()
        }
        for table in eyes.values():
            whole = table.dtype == np.float32 and table.size > 0 and bool(np.isfinite(table).all())
            if not whole or (table.ndim != 3 and table.shape[3:] != (3,)):
                raise ValueError("expected eyes of float32, finite, with three axes, or one more of three colours")
        own, numbers = factor[behind].astype(np.intp), material[behind].astype(np.intp)
        counts = np.array([len(eyes.get(number, ())) for number in range(int(numbers.max(initial=0)) + 1)])
        if base[behind].max(initial=0) >= max(first, 1) or (own >= counts[numbers]).any():
            raise ValueError("expected factors of vertices and of materials that are there")
        return Gloss(
            base[behind].astype(np.intp),
            own,
            numbers,
            eyes,
            receivers.position[behind],
            receivers.normal[behind],
            first,
            None if turn is None else turn[behind],
        )

    def mix(self, camera: Camera) -> NDArray[np.float32]:
        """h_k towards a camera, for every row of a factor and colour: (factor rows, 3); 0 from behind."""
        way = np.asarray(camera.position) - self.position.astype(np.float64)
        way /= np.maximum(np.linalg.norm(way, axis=1, keepdims=True), 1e-300)
        local = _local(way, self.normal.astype(np.float64))
        if self.turn is not None:
            (x, y), (cosine, sine) = local.T[:2], self.turn.T
            local[:, :2] = np.stack([cosine * x + sine * y, cosine * y - sine * x], -1)
        mix = np.zeros((len(self.base), 3), np.float32)
        for number, tables in self.eyes.items():
            own = np.flatnonzero((self.material == number) & (local[:, 2] > 0))
            seen = looked_up(tables, self.factor[own], local[own])
            mix[own] = seen if tables.ndim == 4 else seen[:, None]
        return mix

    def seen(self, B: NDArray[np.float32], mix: NDArray[np.float32]) -> NDArray[np.float32]:
        """The glossy light of all vertices: (vertices, 3)."""
        lit = mix * B[self.first :]
        return np.stack([np.bincount(self.base, lit[:, k], self.first) for k in range(3)], -1).astype(np.float32)


def _local(way: NDArray[np.float64], normal: NDArray[np.float64]) -> NDArray[np.float64]:
    """Directions in the frames that the core gives to normals (Duff et al. 2017)."""
    x, y, z = normal.T
    sign = np.where(np.signbit(z), -1.0, 1.0)
    a = -1 / (sign + z)
    b = x * y * a
    tangent = np.stack([1 + sign * x * x * a, sign * b, -sign * x], -1)
    bitangent = np.stack([b, sign + y * y * a, -y], -1)
    return np.stack([(way * axis).sum(axis=1) for axis in (tangent, bitangent, normal)], -1)


def looked_up(
    tables: NDArray[np.float32], which: NDArray[np.intp], directions: NDArray[np.float64]
) -> NDArray[np.float32]:
    """Tables of factors, (factors, rings, columns) or with colours behind, at directions of the surface's frame, linear
    between the middles of their cells; `which`: the factor of each direction."""
    rings, columns = tables.shape[1:3]
    ring = np.clip(np.arccos(np.clip(directions[:, 2], 0, 1)) / (np.pi / 2) * rings - 0.5, 0, rings - 1)
    turn = np.arctan2(directions[:, 1], directions[:, 0]) % (2 * np.pi) / (2 * np.pi) * columns - 0.5
    low, left = np.floor(ring).astype(np.intp), np.floor(turn).astype(np.intp)
    down, right = (part.reshape(-1, *[1] * (tables.ndim - 3)) for part in (ring - low, turn - left))
    high = np.minimum(low + 1, rings - 1)

    def row(at: NDArray[np.intp]) -> NDArray[np.float64]:
        near, far = (tables[which, at, column % columns] for column in (left, left + 1))
        return np.asarray((1 - right) * near + right * far)

    return np.asarray((1 - down) * row(low) + down * row(high), np.float32)
