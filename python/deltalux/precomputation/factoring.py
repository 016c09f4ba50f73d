"""Lobes that are seen from anywhere: a sum of products of a function of the light and one of the eye.

    f(wi, wo) cos theta_i = sum_k g_k(wi) h_k(wo)        (Overbeck 2006, eq. 7.1)

The h_k are orthonormal over the hemisphere, and the best for light with the spectrum of natural scenes (power
1 / (l (l + 1)) a harmonic): those in which the lobe, multiplied by such light, is largest. A measured lobe has three
colours: its g_k serve all of them, and its h_k have one more axis.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.polynomial.legendre import legval
from numpy.typing import NDArray

from ..brdf import Measured, Model
from ..surface.material import Lobe

__all__ = ["MOST", "Factored", "factored"]

MOST = 24
"""Factors of a lobe, where their number is not asked for."""
_ENOUGH = 0.10
"""What they may leave then."""
_RINGS = 16
_FINEST = 64
"""Rings of the grid: for lobes of 15 degrees and more, and for the narrowest; columns are three times as many."""
_DENSE = 24
"""Rings at most where azimuths of light and eye do not only count by their difference."""


@dataclass(frozen=True)
class Factored:
    """Factors of one lobe.

    Attributes
    ----------
    light, eye
        (factors, rings, columns) float32: g_k and h_k at the middles of cells of equal angles, in the frame of the
        surface; of a measured lobe h_k has a last axis of three colours.
    left
        Of all numbers of factors from 0 on: the share of the lobe's light that they leave, relative L2 in the mean over
        natural light and all eyes.
    """

    light: NDArray[np.float32]
    eye: NDArray[np.float32]
    left: NDArray[np.float64]

    @property
    def count(self) -> int:
        """How many there are."""
        return len(self.light)


def factored(model: Lobe, factors: int | str) -> Factored:
    """Factors of a lobe.

    Parameters
    ----------
    model
        The lobe. Of a measured one what differs between left and right is taken for noise, and its mean.
    factors
        "auto": as few as leave a tenth, at most `MOST`; or how many.

    Returns
    -------
    Factored

    Raises
    ------
    ValueError
        If a measured lobe is anisotropic.
    """
    half_width = _half_width(model)
    rings = int(np.clip(np.ceil(np.pi / half_width), _RINGS, _FINEST))
    if _turns(model):
        energies, light, eye = _by_frequency(model, rings)
    elif isinstance(model, Measured):
        raise ValueError(
            "expected an isotropic measured material for vertices, but this one differs as it turns: take pixels"
        )
    else:
        energies, light, eye = _dense(model, min(rings, _DENSE))
    order = np.argsort(-energies, kind="stable")
    total = energies.sum()
    left = np.sqrt(np.clip(1 - np.concatenate([[0.0], np.cumsum(energies[order])]) / total, 0, 1))
    if factors == "auto":
        count = min(int(np.argmax(left <= _ENOUGH)) or MOST, MOST)
    else:
        count = min(int(factors), len(order))
    chosen = order[:count]
    g, h = light(chosen), eye(chosen)
    flat = h.reshape(count, -1)
    sign = np.sign(flat[np.arange(count), np.abs(flat).argmax(axis=1)])
    g, h = ((sign * table.T).T.astype(np.float32, order="C") for table in (g, h))
    return Factored(g, h if isinstance(model, Measured) else h[..., 0], left)


def _values(model: Lobe, wi: NDArray[np.float64], wo: NDArray[np.float64]) -> NDArray[np.float64]:
    """f cos, with a last axis of colours: three of a measured lobe, else one."""
    f = model.evaluate(wi, wo)
    return (f if isinstance(model, Measured) else f[..., None]) * wi[..., 2:]


def _directions(theta: NDArray[np.float64], phi: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.stack(np.broadcast_arrays(np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)), -1)


def _half_width(model: Lobe) -> float:
    """Of the lobe at 30 degrees, in its plane of incidence."""
    off = np.linspace(0, np.pi / 3, 2000)
    wi = _directions(np.radians(30.0) - off, np.array(np.pi))
    values = _values(model, wi, _directions(np.radians(30.0), np.array(0.0))).mean(axis=-1) / wi[:, 2]
    below = np.flatnonzero(values < 0.5 * values[0])
    return float(off[below[0]]) if len(below) else np.pi / 3


def _turns(model: Lobe) -> bool:
    """Whether only the difference of azimuths counts."""
    rng = np.random.default_rng(1)
    theta, phi, turn = np.arccos(rng.random((2, 200))), rng.random((2, 200)) * 2 * np.pi, rng.random(200) * 2 * np.pi
    plain = _values(model, *(_directions(theta[k], phi[k]) for k in (0, 1)))
    turned = _values(model, *(_directions(theta[k], phi[k] + turn) for k in (0, 1)))
    return bool(np.allclose(plain, turned, rtol=1e-6, atol=1e-9 * plain.max()))


def _grid(rings: int) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Middles of rings and columns, and the solid angle of a cell of each ring."""
    edges = np.linspace(0, np.pi / 2, rings + 1)
    columns = 3 * rings
    solid = (np.cos(edges[:-1]) - np.cos(edges[1:])) * 2 * np.pi / columns
    return 0.5 * (edges[:-1] + edges[1:]), 2 * np.pi * (np.arange(columns) + 0.5) / columns, solid


def _prior(cosine: NDArray[np.float64], rings: int) -> NDArray[np.float64]:
    """How light from two directions varies together, by the cosine between them."""
    degrees = np.arange(2 * rings + 1)
    power = 1 / np.maximum(degrees * (degrees + 1), 2.0)
    return np.asarray(legval(cosine, (2 * degrees + 1) / (4 * np.pi) * power), np.float64)


_Table = Callable[[NDArray[np.intp]], NDArray[np.float64]]


def _by_frequency(model: Lobe, rings: int) -> tuple[NDArray[np.float64], _Table, _Table]:
    """Each frequency of the azimuth by itself: blocks of rings x rings."""
    theta, phi, solid = _grid(rings)
    columns = len(phi)
    step = 2 * np.pi * np.arange(columns) / columns
    wi = _directions(theta[:, None, None], step[None, None, :])
    wo = _directions(theta[None, :, None], np.zeros((1, 1, columns)))
    lobe = _values(model, *np.broadcast_arrays(wi, wo))
    prior = _prior(np.clip((wi * wo).sum(-1), -1, 1), rings)
    # Even in the difference: their transforms are real.
    blocks, priors = (np.fft.rfft(kernel, axis=2).real for kernel in (lobe, prior))
    colours = lobe.shape[-1]
    # Rings and colours of the eye are one axis.
    root, whole = (np.repeat(own, colours) for own in (np.sqrt(solid), solid))
    energies, kept = [], []
    for m in range(blocks.shape[2]):
        block = blocks[:, :, m].reshape(rings, -1)
        seen = solid[:, None] * block * root
        values, vectors = np.linalg.eigh(seen.T @ priors[:, :, m] @ seen)
        alone = m == 0 or 2 * m == columns
        for value, vector in zip(values[::-1], vectors.T[::-1], strict=True):
            eta = vector / root
            gamma = block @ (whole * eta)
            for shape in (np.cos,) if alone else (np.cos, np.sin):
                wave = shape(m * phi) * np.sqrt((1 if alone else 2) / columns)
                energies.append(max(value, 0.0))
                kept.append((gamma, eta.reshape(rings, 1, colours), wave))

    def light(chosen: NDArray[np.intp]) -> NDArray[np.float64]:
        return np.stack([kept[k][0][:, None] * kept[k][2] for k in chosen])

    def eye(chosen: NDArray[np.intp]) -> NDArray[np.float64]:
        return np.stack([kept[k][1] * kept[k][2][:, None] for k in chosen])

    return np.array(energies), light, eye


def _dense(model: Model, rings: int) -> tuple[NDArray[np.float64], _Table, _Table]:
    """All pairs of directions at once."""
    theta, phi, solid = _grid(rings)
    at = _directions(theta[:, None], phi[None, :]).reshape(-1, 3)
    weights = np.repeat(solid, len(phi))
    lobe = np.stack([_values(model, at, np.broadcast_to(eye, at.shape))[:, 0] for eye in at], axis=1)
    root = np.sqrt(weights)
    seen = weights[:, None] * lobe * root
    values, vectors = np.linalg.eigh(seen.T @ _prior(np.clip(at @ at.T, -1, 1), rings) @ seen)
    eta = (vectors / root[:, None])[:, ::-1]
    shape = (-1, rings, len(phi))

    def eye(chosen: NDArray[np.intp]) -> NDArray[np.float64]:
        return np.asarray(eta[:, chosen].T.reshape(*shape, 1))

    def light(chosen: NDArray[np.intp]) -> NDArray[np.float64]:
        return np.asarray((lobe @ (weights[:, None] * eta[:, chosen])).T.reshape(shape))

    return np.maximum(values[::-1], 0.0), light, eye
