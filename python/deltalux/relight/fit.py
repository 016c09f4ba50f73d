"""Light from pictures: which light, nowhere negative, makes the scene look as it is asked."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._core import haar_inverse, haar_without_texels
from ..camera import Camera
from ..checks import amount, count, real_array
from ..columns.haar import Haar
from ..columns.lamps import Lamps
from ..light.environment import Environment
from ..mistakes import instead_of
from ..progress import Progress, reporter
from ..transport.seen import Shares
from ..transport.transport import Transport
from .nonnegative import Problem, convex_shortfall, curvature, solve, tolled_shortfall

__all__ = ["LightFit", "fit_light"]

_Array = NDArray[np.float64]
_STRENGTHS = {"smooth": 1e-3, "lamps": 1e-2}


@dataclass(frozen=True, eq=False)
class LightFit:
    """A light that was fitted to a picture, and how sure it is that there is none better.

    Attributes
    ----------
    values
        (columns, 3) float64: V, for `Transport.multiply` and `Relighter.step`.
    objective
        Half the weighted square of what the picture is missed by, and what the prior charges.
    bound
        No light has a smaller objective.
    gap
        objective - bound, as a share of the objective of darkness without a prior: the certificate. It is as exact as
        sums in 64 bits of products on their grids: about 1e-9.
    residual
        What the picture is missed by: weighted relative L2.
    iterations
        Products with M and its transpose, one each.
    converged
        Whether the gap asked for was reached.
    picture
        (height, width, 3) float64: what the light gives, on black.
    """

    values: NDArray[np.float64]
    objective: float
    bound: float
    gap: float
    residual: float
    iterations: int
    converged: bool
    picture: NDArray[np.float64] = field(repr=False)
    _texels: NDArray[np.float32] | None = field(repr=False)

    @cached_property
    def environment(self) -> Environment:
        """The light as an environment, texel by texel of the columns' cubemap; ValueError where columns are lamps."""
        if self._texels is None:
            raise ValueError("expected a fit over columns of an environment, but these are lamps: take its values")
        return Environment.from_cubemap(self._texels)


def fit_light(
    transport: Transport,
    picture: ArrayLike,
    *,
    prior: str | Environment = "smooth",
    strength: float | None = None,
    mask: ArrayLike | None = None,
    weights: ArrayLike | None = None,
    start: LightFit | Environment | ArrayLike | None = None,
    camera: Camera | None = None,
    gap: float = 1e-4,
    iterations: int = 1000,
    progress: bool | Progress = True,
) -> LightFit:
    """The light under which a scene looks as a picture does: non-negative least squares, with a certificate.

    A photograph gives the light that it was taken under; a wish, such as a spot that is to be brighter and counts for
    more in `weights`, gives the light that comes closest to it. An interrupt (Ctrl-C) ends with the best light so far.

    Parameters
    ----------
    transport
        M, of pixels or of vertices, over Haar columns or lamps.
    picture
        (height, width, 3): linear radiance, as `Transport.image` gives it. Pixels that show something behind the scene
        do not count.
    prior
        Which of the many lights that look alike is meant. ``"smooth"``: detail costs, by the areas of wavelets, as
        truncation takes light to be. ``"lamps"``: flux costs, which leaves few texels lit, each a little too dark. An
        `Environment`: what differs from it costs as under ``"smooth"``.
    strength
        What the prior weighs: of ``"lamps"`` as a share of the least that leaves all dark, 0.01; of the others as a
        share of the picture's own largest curvature, 0.001.
    mask
        (height, width): where False or 0, pixels do not count.
    weights
        (height, width): by how much the squares of pixels count, not negative.
    start
        Where to begin: another fit, a light, or V. A fit of nearly the same picture saves most iterations.
    camera
        Of vertices; None: that of the transport.
    gap
        Ends where the objective is proved to be within this share of that of darkness.
    iterations
        Ends there at the latest.
    progress
        True: a bar on standard error. A callable: progress(done, total).

    Returns
    -------
    LightFit

    Raises
    ------
    TypeError
        If an argument is something else.
    ValueError
        If a shape or a number cannot be used, the columns are neither Haar nor lamps, or B takes a mix.
    """
    if not isinstance(transport, Transport):
        raise instead_of("Transport", transport)
    charged = _strength(prior, strength)
    light, shares = _domain(transport), transport.shares(camera)
    seen = _Seen(transport, light, shares, _counting(shares, mask, weights))
    asked = _picture(picture, shares) - _standing(transport, camera)
    pulled, energy = seen.back(asked), float((seen.counts * asked**2).sum())
    if energy == 0:
        raise ValueError("expected a picture with some light where pixels count, got a dark one")
    iterations, tell = count("iterations", iterations), reporter(progress, "fitting light")
    steepest = curvature(seen.normal, pulled)
    problem = _problem(seen, pulled, energy, steepest, prior, charged)
    scale, begin = 0.5 * energy, light.start(start)
    found = solve(problem, begin, steepest, amount("gap", gap) * scale, iterations, lambda done: tell(done, iterations))
    given = shares.picture(transport.multiply(light.values(found.x), dtype=np.float64))
    missed = float((seen.counts * (given - asked) ** 2).sum())
    left = max(found.objective - found.bound, 0.0) / scale
    # Of what was interrupted no bar says that it is done.
    if left <= gap or found.iterations >= iterations:
        tell(iterations, iterations)
    return LightFit(
        values=light.values(found.x),
        objective=found.objective,
        bound=found.bound,
        gap=left,
        residual=float(np.sqrt(missed / energy)),
        iterations=found.iterations,
        converged=left <= gap,
        picture=given,
        _texels=light.texels(found.x),
    )


class _Texels:
    """x is the light's texels, each times the root of its solid angle; V is their wavelets."""

    def __init__(self, columns: Haar) -> None:
        self._columns, self.count = columns, columns.wavelets
        self._roots = np.sqrt(columns.solid_angles)[:, None]
        self.detail = 4.0 / columns.areas[: self.count, None]
        self.sizes = self._roots

    def values(self, x: _Array) -> _Array:
        """V, with nothing in texel columns."""
        V = self.wavelets(x)
        return np.concatenate([V, np.zeros_like(V)]) if self._columns.texels else V

    def wavelets(self, x: _Array) -> _Array:
        return haar_without_texels(self._columns.size, np.concatenate([np.zeros_like(x), x]))

    def back(self, wavelets: _Array) -> _Array:
        """The transpose of `wavelets`, which is its inverse."""
        texels = haar_inverse(self._columns.size, np.ascontiguousarray(wavelets[: self.count]))
        return np.asarray(texels.reshape(-1, 3) * self._roots)

    def of(self, env: Environment) -> _Array:
        return np.asarray(env.cubemap(self._columns.size).reshape(-1, 3) * self._roots, np.float64)

    def start(self, start: LightFit | Environment | ArrayLike | None) -> _Array:
        if isinstance(start, Environment):
            return self.of(start)
        if start is None:
            return np.zeros((self.count, 3))
        return self.back(self._columns.without_texels(_of_fit(start, self._columns.columns)))

    def texels(self, x: _Array) -> NDArray[np.float32] | None:
        size = self._columns.size
        return (x / self._roots).reshape(6, size, size, 3).astype(np.float32)


class _Lamps:
    """x is V itself."""

    def __init__(self, columns: Lamps) -> None:
        self._columns, self.count = columns, columns.columns
        self.detail = self.sizes = np.ones((self.count, 1))

    def values(self, x: _Array) -> _Array:
        return x

    wavelets = back = values

    def of(self, env: Environment) -> _Array:
        return self._columns.coefficients(env)

    def start(self, start: LightFit | Environment | ArrayLike | None) -> _Array:
        if isinstance(start, Environment):
            return self.of(start)
        return np.zeros((self.count, 3)) if start is None else _of_fit(start, self.count)

    def texels(self, x: _Array) -> None:
        return None


def _of_fit(start: LightFit | ArrayLike, columns: int) -> _Array:
    V = np.ascontiguousarray(start.values if isinstance(start, LightFit) else start, np.float64)
    if V.shape != (columns, 3):
        raise ValueError(f"expected a light of shape ({columns}, 3) to begin with, got {V.shape}")
    return V


def _domain(transport: Transport) -> _Texels | _Lamps:
    columns: Any = transport.columns
    if isinstance(columns, Haar):
        return _Texels(columns)
    if isinstance(columns, Lamps):
        return _Lamps(columns)
    raise ValueError(f"expected a transport over Haar columns or lamps to fit light to, got {columns}")


class _Seen:
    """The picture as a map of x, A, whose squares count by pixel."""

    def __init__(self, transport: Transport, light: _Texels | _Lamps, shares: Shares, counts: _Array) -> None:
        self._transport, self.light, self._shares, self.counts = transport, light, shares, counts

    def back(self, picture: _Array) -> _Array:
        """A^T of a picture, by what counts of it."""
        return self.light.back(self._wavelets(picture))

    def _wavelets(self, picture: _Array) -> _Array:
        R = self._shares.back(self.counts * picture)
        # Of texel columns, which x never uses, nothing is made anew.
        return self._transport._core.adjoint(R[None], None, False)[0, : self.light.count]

    def normal(self, x: _Array, detail: NDArray[np.float64] | float = 0.0) -> _Array:
        """A^T A x, and what detail of x costs."""
        V = self.light.values(x)
        picture = self._shares.picture(self._transport.multiply(V, dtype=np.float64))
        return self.light.back(self._wavelets(picture) + detail * V[: self.light.count])


def _problem(
    seen: _Seen, pulled: _Array, energy: float, steepest: float, prior: str | Environment, strength: float
) -> Problem:
    light, nothing = seen.light, np.zeros_like(pulled)
    if isinstance(prior, str) and prior == "lamps":
        toll = strength * float((pulled / light.sizes).max())
        if toll <= 0:
            raise ValueError("expected a picture that some light makes brighter, but none does")
        tolls = np.broadcast_to(toll * light.sizes, pulled.shape)
        return Problem(seen.normal, pulled, energy, tolls, tolled_shortfall)
    near = light.of(prior) if isinstance(prior, Environment) else nothing
    charge = strength * steepest * light.detail
    charged = light.back(charge * light.wavelets(near))
    known = energy + float(np.vdot(near, charged))
    shortfall = convex_shortfall(
        strength * steepest, lambda rest: float((np.square(light.wavelets(rest)) / charge).sum())
    )
    return Problem(lambda x: seen.normal(x, charge), pulled + charged, known, nothing, shortfall)


def _strength(prior: str | Environment, strength: float | None) -> float:
    if not (isinstance(prior, Environment) or prior in _STRENGTHS):
        raise ValueError(f'expected prior="smooth", "lamps" or an Environment, got {prior!r}')
    if strength is None:
        strength = _STRENGTHS["lamps" if isinstance(prior, str) and prior == "lamps" else "smooth"]
    if not 0 < strength < np.inf:
        raise ValueError(f"expected a strength above 0, got {strength}")
    return float(strength)


def _picture(picture: ArrayLike, shares: Shares) -> _Array:
    expected = (*shares.image_shape, 3)
    array = real_array("a picture", picture, np.float64)
    if array.shape != expected or not np.isfinite(array).all():
        raise ValueError(f"expected a finite picture of shape {expected}, got {array.shape}")
    return array


def _counting(shares: Shares, mask: ArrayLike | None, weights: ArrayLike | None) -> _Array:
    """(height, width, 1): by how much the square of each pixel counts."""
    counts = (shares.samples.background == 0).astype(np.float64)
    for name, given in (("mask", mask), ("weights", weights)):
        if given is None:
            continue
        array = np.asarray(given, np.float64)
        if array.shape != shares.image_shape or not (np.isfinite(array) & (array >= 0)).all():
            raise ValueError(f"expected {name} of shape {shares.image_shape}, finite and not negative")
        counts *= array > 0 if name == "mask" else array
    return np.asarray(counts[..., None])


def _standing(transport: Transport, camera: Camera | None) -> NDArray[np.float32]:
    """The picture without any light from outside: what surfaces give off."""
    dark = np.zeros((transport.shape[0], 3), np.float32)
    return transport.image(dark) if camera is None else transport.render(camera, dark)
