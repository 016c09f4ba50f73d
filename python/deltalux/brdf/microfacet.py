"""Models of rough surfaces made of mirror facets: f = F D G / (4 n.wi n.wo) (Walter et al. 2007, eq. 20).

D is the distribution of the facets' normals, whose projected area is 1 (1 / pi is inside); G is the share that is
neither in shadow nor hidden; F is Fresnel's reflectance for the index n - ik, or 1 where none is given, so that a
specular colour is a factor outside. Energy is lost where light would be reflected more than once.
"""

from __future__ import annotations

from dataclasses import dataclass

from .._core import Brdf
from .model import Model, or_same


@dataclass(frozen=True)
class CookTorrance(Model):
    """Beckmann's D with the masking of V-shaped grooves, G = min(1, 2 n.h n.wo / h.wo, 2 n.h n.wi / h.wo).

    D = exp(-tan^2 theta_h / s^2) / (pi s^2 cos^4 theta_h). Reciprocal and energy-conserving. (Cook and Torrance 1982;
    the 1 / 4 of Walter et al. 2007, where 1 / pi is often printed.) Sampled as all facets, D n.h.

    Parameters
    ----------
    sigma
        s, the root mean square slope times the root of 2, from 0.002 to 10.
    n, k
        The index of refraction n - ik: n from 0.01 to 100, k from 0 to 100 (by default 0, a dielectric).

    Raises
    ------
    ValueError
        If one is out of its range, or k is given without n.
    """

    sigma: float
    n: float | None = None
    k: float | None = None

    def core(self) -> Brdf:
        return Brdf.cook_torrance(self.sigma, self.n, self.k)


@dataclass(frozen=True)
class Beckmann(Model):
    """Beckmann's D with Smith's masking, G = G1(wi) G1(wo).

    D as of `CookTorrance`, elliptic in general; G1 is the rational function of Walter et al. 2007 (eq. 27), within
    0.35 % of Smith's. Reciprocal and energy-conserving. (Walter et al. 2007, eq. 20, 23 and 25.) Sampled as all facets,
    D n.h, not only those that are seen: to sample those an error function must be inverted, and only wide lobes at
    grazing angles would gain.

    Parameters
    ----------
    alpha
        The roughness along x, from 0.002 to 10.
    alpha_v
        That along y; by default alpha.
    n, k
        The index of refraction n - ik: n from 0.01 to 100, k from 0 to 100 (by default 0, a dielectric).

    Raises
    ------
    ValueError
        If one is out of its range, or k is given without n.
    """

    alpha: float
    alpha_v: float | None = None
    n: float | None = None
    k: float | None = None

    def core(self) -> Brdf:
        return Brdf.beckmann(self.alpha, or_same(self.alpha_v, self.alpha), self.n, self.k)


@dataclass(frozen=True)
class GGX(Model):
    """The normals of an ellipsoid, with Smith's masking, G = G1(wi) G1(wo): a lobe with a long tail.

    D = 1 / (pi a b cos^4 theta_h (1 + tan^2 theta_h (cos^2 phi_h / a^2 + sin^2 phi_h / b^2))^2). Reciprocal and
    energy-conserving. (Trowbridge and Reitz 1975; Walter et al. 2007, eq. 20, 23, 33 and 34.) Sampled by the facets
    that are seen (Dupuy and Benyoub 2023), which loses little: f n.wi / pdf is F G1(wi), never above 1.

    Parameters
    ----------
    alpha
        a, the roughness along x, from 0.002 to 10.
    alpha_v
        b, that along y; by default alpha.
    n, k
        The index of refraction n - ik: n from 0.01 to 100, k from 0 to 100 (by default 0, a dielectric).

    Raises
    ------
    ValueError
        If one is out of its range, or k is given without n.
    """

    alpha: float
    alpha_v: float | None = None
    n: float | None = None
    k: float | None = None

    def core(self) -> Brdf:
        return Brdf.ggx(self.alpha, or_same(self.alpha_v, self.alpha), self.n, self.k)
