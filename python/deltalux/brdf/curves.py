"""A lobe as a curve of 256 nodes: its abscissa, Fresnel's reflectance as a sum of few functions, measured materials.

rho = c(u) F(theta_d) q, with u = (1 - cos theta_h)^(1/4): ``rust/brdf/curve.rs`` says why.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._core import CURVE, fresnel
from ..checks import read_only
from .measured import Measured
from .model import Model

__all__ = [
    "ANGLES",
    "COSINES",
    "KINDS",
    "NODES",
    "Reflectances",
    "curve_of",
    "kind_of",
    "physical",
    "reflectance_of",
    "reflectance_of_model",
    "reflectances",
    "separated",
]

NODES = read_only(np.arange(CURVE) / (CURVE - 1))
"""The abscissas of a curve's nodes."""
ANGLES = read_only(2.0 * np.arcsin(NODES**2 / np.sqrt(2.0)))
"""The same as angles between the normal and the half vector, in radians."""
COSINES = read_only(np.linspace(0.0, 1.0, 512))
"""At which Fresnel's reflectance is kept; it is linear between."""

# Fresnel's reflectance by what of it may be edited: how many functions it is a sum of.
KINDS = {"none": 1, "fixed": 1, "schlick": 2, "dielectric": 3, "metal": 5}
# Of the curves that bases are made of: indices, and extinctions.
_DIELECTRICS, _METALS = (1.2, 2.6), ((0.15, 4.0), (1.0, 8.0))
# Beyond 85 degrees all reflectances go to 1, and what is off there is seen by nobody.
_SEEN = np.cos(np.radians(85.0))


def curve_of(model: Model) -> NDArray[np.float64]:
    """A model's lobe at all nodes, (256,); ValueError of a model without one."""
    return model.core().curve(NODES)


def kind_of(model: Model) -> str:
    """What of a model's reflectance at a facet may be edited: a word of `KINDS`."""
    if getattr(model, "f0", None) is not None:
        return "schlick"
    if getattr(model, "n", None) is None:
        return "none"
    return "metal" if getattr(model, "k", None) else "dielectric"


@dataclass(frozen=True, eq=False)
class Reflectances:
    """Functions that Fresnel's reflectance is a sum of.

    Attributes
    ----------
    functions
        (r, 512) at `COSINES`.
    """

    functions: NDArray[np.float64]

    def beside(self, drawn: NDArray[np.float64]) -> Reflectances:
        """The same functions, and what they lack of each curve, (m, 512) at `COSINES`."""
        functions = self.functions
        for curve in drawn:
            left = curve - np.linalg.lstsq(functions.T, curve, rcond=None)[0] @ functions
            if np.abs(left).max() > 1e-9 * np.abs(curve).max():
                functions = np.concatenate([functions, left[None]])
        return Reflectances(read_only(functions))

    def weights(self, reflectance: ArrayLike) -> tuple[NDArray[np.float64], float]:
        """The sum that is nearest to a reflectance, and how far it is off.

        Parameters
        ----------
        reflectance
            (512,) at `COSINES`.

        Returns
        -------
        weights, residual
            (r,) and the largest difference at angles up to 85 degrees.
        """
        wanted = np.asarray(reflectance, np.float64)
        weights = np.linalg.lstsq(self.functions.T, wanted, rcond=None)[0].astype(np.float64)
        off = np.abs(weights @ self.functions - wanted)[COSINES >= _SEEN]
        return weights, float(off.max())


def reflectance_of(n: float | None, k: float | None, f0: float | None) -> NDArray[np.float64]:
    """Fresnel's reflectance at `COSINES`, by whatever it is given by; 1 where by nothing."""
    if f0 is not None:
        return f0 + (1.0 - f0) * (1.0 - COSINES) ** 5
    return np.ones_like(COSINES) if n is None else fresnel(n, k or 0.0, COSINES)


def reflectance_of_model(model: Model) -> NDArray[np.float64]:
    """The reflectance of a model's facets at `COSINES`."""
    return reflectance_of(*(getattr(model, name, None) for name in ("n", "k", "f0")))


def physical(kind: str) -> NDArray[np.float64]:
    """Reflectances that a basis is made of, (m, 512)."""
    if kind == "dielectric":
        return np.array([fresnel(n, 0.0, COSINES) for n in np.geomspace(*_DIELECTRICS, 100)])
    indices, extinctions = (np.geomspace(*ends, 30) for ends in _METALS)
    return np.array([fresnel(n, k, COSINES) for n in indices for k in extinctions])


@cache
def reflectances(kind: str) -> Reflectances:
    """The functions of an editable kind.

    Parameters
    ----------
    kind
        "none", "schlick", "dielectric" or "metal".

    Returns
    -------
    Reflectances
        Of the latter two the first right singular vectors of physical curves.
    """
    if kind == "none":
        return Reflectances(read_only(np.ones((1, len(COSINES)))))
    if kind == "schlick":
        return Reflectances(read_only(np.array([np.ones_like(COSINES), (1.0 - COSINES) ** 5])))
    return Reflectances(read_only(np.linalg.svd(physical(kind), full_matrices=False)[2][: KINDS[kind]]))


# The grid on which a measured material is looked at: abscissas, difference angles and their azimuths.
_GRID = (64, 24, 8)
# A curve is never below this share of its largest value.
_FLOOR = 1e-3


def separated(material: Measured) -> tuple[NDArray[np.float64], float]:
    """The curve of a measured material, and the share of its look that curve and Fresnel's term do not say.

    Parameters
    ----------
    material
        As it was measured.

    Returns
    -------
    curve, unexplained
        (256, 3) above 0; and the L1 difference of the material and the product of both, over its energy.

    Notes
    -----
    rho ~ c(theta_h) f(theta_d) by Kullback-Leibler's divergence, whose updates keep the energy of every angle; a fit of
    logarithms is off by 157 to 283 % on glossy vinyls.
    """
    u, wi, wo, measure = _grid()
    weight = measure * np.maximum(wi[..., 2], 0.0) * np.maximum(wo[..., 2], 0.0)
    rho = np.where((weight > 0)[..., None], material.evaluate(wi, wo), 0.0)
    # Over azimuths, which neither factor knows.
    energy, room = (weight[..., None] * rho).sum(axis=2), weight.sum(axis=2)[..., None]
    c, f = np.ones((_GRID[0], 3)), np.ones((_GRID[1], 3))
    for _ in range(50):
        c = energy.sum(axis=1) / np.maximum((room * f).sum(axis=1), 1e-300)
        f = energy.sum(axis=0) / np.maximum((room * c[:, None]).sum(axis=0), 1e-300)
    off = np.abs(rho - (c[:, None] * f)[:, :, None]) * weight[..., None]
    unexplained = float(off.sum() / max(energy.sum(), 1e-300))
    scale = np.maximum(c.max(axis=0), 1e-300)
    curve = np.stack([np.interp(NODES, u, c[:, k] / scale[k]) for k in range(3)], axis=1)
    return np.maximum(curve, _FLOOR) * scale, unexplained


def _grid() -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Abscissas (a,), pairs of directions (a, b, c, 3) and the measure of each."""
    count_u, count_d, count_phi = _GRID
    u = (np.arange(count_u) + 0.5) / count_u
    theta_d = (np.arange(count_d) + 0.5) / count_d * np.pi / 2
    phi = (np.arange(count_phi) + 0.5) / count_phi * np.pi
    # 1 - cos theta_h = u^4, so sin theta_h dtheta_h = 4 u^3 du.
    cosine = 1.0 - u[:, None, None] ** 4
    sine = np.sqrt((1.0 - cosine) * (1.0 + cosine))
    theta, azimuth = theta_d[:, None], phi[None, :]
    x, y, z = np.sin(theta) * np.cos(azimuth), np.sin(theta) * np.sin(azimuth), np.cos(theta) + 0.0 * azimuth
    # The difference vector, tilted by theta_h about y; the other direction is its mirror image about the half vector.
    wi = np.stack(np.broadcast_arrays(cosine * x + sine * z, y, cosine * z - sine * x), axis=-1)
    half = np.stack(np.broadcast_arrays(sine, 0.0, cosine), axis=-1)
    wo = 2.0 * (wi * half).sum(axis=-1, keepdims=True) * half - wi
    return u, wi, wo, np.broadcast_to(4.0 * u[:, None, None] ** 3 * (np.sin(theta) * np.cos(theta)), wi.shape[:-1])
