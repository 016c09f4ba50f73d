"""Models that describe the shape of a highlight: Lambert, Phong, Blinn-Phong, Lafortune, Ward, Ashikhmin-Shirley."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .._core import Brdf
from .model import Model, or_same


@dataclass(frozen=True)
class Lambert(Model):
    """The same from everywhere: f = 1 / pi. Reciprocal; all light is reflected (a colour is a factor outside).

    Sampled as the cosine.
    """

    def __post_init__(self) -> None:
        """It has no parameters to be checked."""

    def core(self) -> Brdf:
        return Brdf.lambert()


@dataclass(frozen=True)
class Phong(Model):
    """A power of the cosine to the mirror direction r: f = (n + 2) / 2 pi max(0, r . wi)^n.

    Reciprocal and energy-conserving. (Phong 1975, normalised as in Lafortune and Willems 1994, eq. 9.) Sampled as the
    power.

    Parameters
    ----------
    exponent
        n, from 0 to 125000 (as narrow as a roughness of 0.002).

    Raises
    ------
    ValueError
        If it is out of this range.
    """

    exponent: float

    def core(self) -> Brdf:
        return Brdf.phong(self.exponent)


@dataclass(frozen=True)
class BlinnPhong(Model):
    """A power of the cosine between the normal and the half vector h.

    f = (n + 2) (n + 4) / (8 pi (2^(-n / 2) + n)) (n . h)^n: all light is reflected at normal incidence, less elsewhere.
    Reciprocal and energy-conserving; the constant (n + 2) / 2 pi that is often printed reflects up to four times the
    light. (Blinn 1977; the constant by integration at normal incidence.) Sampled as the power, over half vectors.

    Parameters
    ----------
    exponent
        n, from 0 to 500000 (as narrow as a roughness of 0.002).

    Raises
    ------
    ValueError
        If it is out of this range.
    """

    exponent: float

    def core(self) -> Brdf:
        return Brdf.blinn_phong(self.exponent)


@dataclass(frozen=True)
class Lafortune(Model):
    """A generalised cosine lobe: f = (n + 2) / 2 pi max(0, Cx wix wox + Cy wiy woy + Cz wiz woz)^n / max|C|^n.

    Coefficients (-1, -1, 1) are Phong's, (1, 1, 1) reflect back, a smaller Cz is off-specular. Reciprocal and
    energy-conserving. (Lafortune et al. 1997, eq. 6; the base is clamped at 0, and the lobe divided by its largest
    value.) Sampled as a power of the cosine to (Cx wox, Cy woy, Cz woz).

    Parameters
    ----------
    exponent
        n, from 0 to 125000 (as narrow as a roughness of 0.002).
    coefficients : (3,) real
        Cx, Cy and Cz, not all 0; their scale does not matter.

    Raises
    ------
    ValueError
        If the exponent is out of this range, or the coefficients are not three such numbers.
    """

    exponent: float
    coefficients: tuple[float, float, float] = (-1.0, -1.0, 1.0)

    def __post_init__(self) -> None:
        if np.shape(self.coefficients) != (3,):
            raise ValueError(f"expected coefficients to be three numbers, got {self.coefficients!r}")
        super().__post_init__()

    def core(self) -> Brdf:
        return Brdf.lafortune(self.exponent, self.coefficients)


@dataclass(frozen=True)
class Ward(Model):
    """Ward's elliptic Gaussian of the half vector's slopes.

    f = exp(-tan^2 theta_h (cos^2 phi_h / a^2 + sin^2 phi_h / b^2)) / (4 pi a b sqrt(n.wi n.wo)). Reciprocal and
    energy-conserving; it loses most of its light at grazing angles. (Ward 1992, eq. 5; the constant and the sampling
    over half vectors as in Walter 2005.)

    Parameters
    ----------
    alpha
        a, the roughness along x, from 0.002 to 10.
    alpha_v
        b, that along y; by default alpha.

    Raises
    ------
    ValueError
        If one is out of this range.
    """

    alpha: float
    alpha_v: float | None = None

    def core(self) -> Brdf:
        return Brdf.ward(self.alpha, or_same(self.alpha_v, self.alpha))


@dataclass(frozen=True)
class WardDuer(Model):
    """Ward's lobe with n.wi n.wo instead of its root below the line, as bright at grazing angles as at others.

    Reciprocal, but not energy-conserving: wide lobes reflect several times the light at grazing angles. (Dür 2006,
    eq. 7.) Sampled as `Ward`.

    Parameters
    ----------
    alpha
        The roughness along x, from 0.002 to 10.
    alpha_v
        That along y; by default alpha.

    Raises
    ------
    ValueError
        If one is out of this range.
    """

    alpha: float
    alpha_v: float | None = None

    def core(self) -> Brdf:
        return Brdf.ward_duer(self.alpha, or_same(self.alpha_v, self.alpha))


@dataclass(frozen=True)
class AshikhminShirley(Model):
    """An elliptic power of the cosine to the half vector h, with Fresnel's rise at grazing angles.

    f = sqrt((eu + 1) (ev + 1)) / 8 pi (n.h)^(eu cos^2 phi_h + ev sin^2 phi_h) F(h.wo) / (h.wo max(n.wi, n.wo)).
    Reciprocal and energy-conserving. (Ashikhmin and Shirley 2000, eq. 3 without the coupled diffuse term; sampled by
    their eq. 9 and 10.)

    Parameters
    ----------
    exponent
        eu, along x, from 0 to 500000 (as narrow as a roughness of 0.002).
    exponent_v
        ev, along y; by default exponent.
    f0
        The reflectance at normal incidence, 0 to 1, of Schlick's approximation of F.
    n, k
        The index of refraction n - ik for Fresnel's equations: n from 0.01 to 100, k from 0 to 100. F is 1 without f0
        and n.

    Raises
    ------
    ValueError
        If one is out of its range, or f0 and n are both given.
    """

    exponent: float
    exponent_v: float | None = None
    f0: float | None = None
    n: float | None = None
    k: float | None = None

    def core(self) -> Brdf:
        return Brdf.ashikhmin_shirley(self.exponent, or_same(self.exponent_v, self.exponent), self.n, self.k, self.f0)
