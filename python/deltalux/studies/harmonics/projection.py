"""One transport in two bases: M in spherical harmonics, made of M in wavelets.

M's rows are functions of direction, constant over each texel, T_p = sum_j M_pj psi_j. Their harmonics are
integral T_p y_k = sum_j M_pj S_jk with S_jk = integral psi_j y_k: the Haar coefficients of y_k averaged over texels. So
T_sh = M S, and c = S^T V is the light: the same rays and the same texels in both bases, and what differs between two
pictures is the basis alone. (A transport traced in harmonics is the same up to M's truncation, but its light is the
original's coefficients turned, and that of `Haar` a map turned and resampled; with bright lamps of a few texels this
alone is more than order 20 leaves out.)
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..._core import haar_coefficients
from ...columns import Haar, SphericalHarmonics
from ...sphere import face_points
from ...transport.transport import Transport
from ..case import Light

__all__ = ["HarmonicView", "harmonics_in_haar"]

_FINE = 128
"""Points along a face, at least, at which harmonics are averaged over texels."""
_TOGETHER = 30
"""Functions that go through M in one product."""


@dataclass(frozen=True)
class HarmonicView:
    """A transport as spherical harmonics see it: dense, and never exact."""

    columns: SphericalHarmonics
    basis: NDArray[np.float64]
    """S: (Haar columns, order^2)."""
    rows: NDArray[np.float32]
    """T_sh: (rows, order^2)."""

    @classmethod
    def of(cls, transport: Transport, order: int) -> HarmonicView:
        """M S, some functions at a time."""
        assert isinstance(transport.columns, Haar)
        basis = harmonics_in_haar(transport.columns, order)
        rows = np.empty((transport.shape[0], order**2), np.float32)
        for k in range(0, order**2, _TOGETHER):
            rows[:, k : k + _TOGETHER] = transport.matmat(basis[:, k : k + _TOGETHER])
        return cls(SphericalHarmonics(order), basis, rows)

    def light(self, V: Light) -> Light:
        """c = S^T V, the harmonics of a light given in wavelets."""
        return np.ascontiguousarray(self.basis.T @ V)

    def wavelets(self, c: Light) -> Light:
        """S c: what these harmonics look like, in wavelets."""
        return np.ascontiguousarray(self.basis @ c)

    def multiply(self, c: Light) -> NDArray[np.float32]:
        """B = T_sh c, of the first functions if c has fewer."""
        product: NDArray[np.float32] = self.rows[:, : len(c)] @ c.astype(np.float32)
        return product


def harmonics_in_haar(columns: Haar, order: int) -> NDArray[np.float64]:
    """S: the integral over the sphere of every wavelet times every harmonic, (Haar columns, order^2)."""
    averages = _texel_averages(columns.size, order)
    S = np.empty((columns.columns, order**2))
    for k in range(0, order**2, 3):
        three = averages[..., k : k + 3]
        cubemap = np.zeros((*three.shape[:3], 3), np.float32)
        cubemap[..., : three.shape[3]] = three
        S[:, k : k + 3] = haar_coefficients(columns.size, cubemap)[:, : three.shape[3]]
    return S


def _texel_averages(size: int, order: int) -> NDArray[np.float32]:
    """Every harmonic averaged over every texel by solid angle: (6, size, size, order^2)."""
    columns, within = SphericalHarmonics(order), max(_FINE // size, 2)
    averages = np.empty((6, size, size, order**2), np.float32)
    blocks = (size, within, size, within)
    for face, directions in zip(averages, face_points(size * within), strict=True):
        # A point of a face of the cube [-1, 1]^3 stands for a solid angle of 1 / distance^3.
        angle = np.square(directions).sum(axis=-1) ** -1.5
        weighed = (columns.evaluate(directions) * angle[..., None]).reshape(*blocks, -1)
        face[...] = weighed.sum(axis=(1, 3)) / angle.reshape(blocks).sum(axis=(1, 3))[..., None]
    return averages
