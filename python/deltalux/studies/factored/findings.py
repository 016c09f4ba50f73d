"""How far sums of factors are from the highlights of lobes, under one light and with nothing in its way."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ... import brdf
from ...brdf import Model
from ...light.environment import Environment
from ...precomputation.factoring import MOST, Factored, factored
from ...sphere import face_directions
from ...transport.gloss import looked_up

__all__ = ["COUNTS", "LOBES", "PAPERS", "Ball", "Found", "ball", "find"]

LOBES: dict[str, Model] = {
    "Phong 20": brdf.Phong(20),
    "Phong 100": brdf.Phong(100),
    "Blinn-Phong 100": brdf.BlinnPhong(100),
    "GGX 0.5": brdf.GGX(0.5),
    "GGX 0.3": brdf.GGX(0.3),
    "Ward 0.3": brdf.Ward(0.3),
}
"""From broad to narrow, as the papers call materials diffuse, fairly shiny and shiny."""
COUNTS = (1, 2, 3, 4, 6, 8, 10, 13, 16, 20, 24)
PAPERS = 4
"""Factors that the papers show."""
_FRAMES, _EYES = 24, 96
_SIDE = 48
"""Pixels of a ball along a side."""


@dataclass(frozen=True)
class Found:
    """One lobe.

    Attributes
    ----------
    name
        As in `LOBES`.
    off
        For each of `COUNTS` the error of its highlights: relative L2 over eyes and frames of the surface.
    said
        For each of them what precomputation says that they leave.
    auto
        How many factors precomputation takes by itself.
    """

    name: str
    off: NDArray[np.float64]
    said: NDArray[np.float64]
    auto: int


@dataclass(frozen=True)
class Ball:
    """Highlights on a ball under the light, (side, side, 3) each: by the lobe, and by so many factors."""

    name: str
    exact: NDArray[np.float64]
    few: dict[int, NDArray[np.float64]]


@dataclass(frozen=True)
class _Light:
    """Light as points: unit directions, and radiance times solid angle."""

    direction: NDArray[np.float64]
    flux: NDArray[np.float64]

    @staticmethod
    def of(env: Environment, face: int) -> _Light:
        direction = face_directions(face).reshape(-1, 3)
        # Of a texel of a cube with sides of 2, by the middle of it.
        solid = (2 / face) ** 2 * np.abs(direction).max(axis=1) ** 3
        return _Light(direction, env.cubemap(face).reshape(-1, 3) * solid[:, None])

    def seen(self, frame: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """What is above the horizon of a frame (3, 3), in it."""
        local = self.direction @ frame.T
        above = local[:, 2] > 0
        return local[above], self.flux[above]


def find(name: str, env: Environment, face: int) -> Found:
    """One lobe under one light: frames and eyes are the same in every run."""
    model, rng = LOBES[name], np.random.default_rng(7)
    factors, light = factored(model, MOST), _Light.of(env, face)
    # Over all frames together: some may see next to no light.
    off, light_seen = np.zeros(len(COUNTS)), 0.0
    for _ in range(_FRAMES):
        wi, flux = light.seen(_frame(rng.normal(size=3)))
        eyes = _hemisphere(rng.random((2, _EYES)))
        exact = _highlights(model, wi, flux, eyes)
        parts = _parts(factors, wi, flux, eyes)
        sums = np.cumsum(parts, axis=0)[np.array(COUNTS) - 1]
        off += np.square(sums - exact).sum(axis=(1, 2))
        light_seen += float(np.square(exact).sum())
    return Found(
        name,
        np.sqrt(off / light_seen) if light_seen else off,
        factors.left[list(COUNTS)],
        factored(model, "auto").count,
    )


def ball(name: str, env: Environment, face: int, counts: tuple[int, ...]) -> Ball:
    """A ball of one lobe, seen from the front from afar."""
    model, light = LOBES[name], _Light.of(env, face)
    factors = factored(model, max(counts))
    at = (np.arange(_SIDE) + 0.5) / _SIDE * 2 - 1
    exact, few = np.zeros((_SIDE, _SIDE, 3)), {count: np.zeros((_SIDE, _SIDE, 3)) for count in counts}
    for row, y in enumerate(-at):
        for column, x in enumerate(at):
            if x * x + y * y < 0.99:
                normal = np.array([x, y, np.sqrt(1 - x * x - y * y)])
                frame = _frame(normal)
                wi, flux = light.seen(frame)
                eye = frame[None, :, 2]
                exact[row, column] = _highlights(model, wi, flux, eye)[0]
                sums = np.cumsum(_parts(factors, wi, flux, eye)[:, 0], axis=0)
                for count, picture in few.items():
                    picture[row, column] = sums[count - 1]
    return Ball(name, exact, few)


def _highlights(
    model: Model, wi: NDArray[np.float64], flux: NDArray[np.float64], eyes: NDArray[np.float64]
) -> NDArray[np.float64]:
    """The lobe's own: (eyes, 3)."""
    values = model.evaluate(wi[None, :, :], eyes[:, None, :]) * wi[:, 2]
    return np.asarray(values @ flux)


def _parts(
    factors: Factored, wi: NDArray[np.float64], flux: NDArray[np.float64], eyes: NDArray[np.float64]
) -> NDArray[np.float64]:
    """What each factor adds: (factors, eyes, 3)."""
    parts = []
    for k in range(factors.count):
        lit = looked_up(factors.light, np.full(len(wi), k), wi) @ flux
        parts.append(looked_up(factors.eye, np.full(len(eyes), k), eyes)[:, None] * lit)
    return np.stack(parts)


def _frame(normal: NDArray[np.float64]) -> NDArray[np.float64]:
    """Tangent, bitangent and normal, as rows."""
    z = normal / np.linalg.norm(normal)
    x = np.asarray(np.cross(z, np.eye(3)[np.abs(z).argmin()]), np.float64)
    x /= np.linalg.norm(x)
    return np.stack([x, np.asarray(np.cross(z, x), np.float64), z])


def _hemisphere(u: NDArray[np.float64]) -> NDArray[np.float64]:
    """Even over solid angle."""
    z, turn = u[0], 2 * np.pi * u[1]
    r = np.sqrt(1 - z * z)
    return np.stack([r * np.cos(turn), r * np.sin(turn), z], -1)
