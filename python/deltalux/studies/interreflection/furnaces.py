"""Rooms that light hardly leaves: what the solver's certificate says there beside the true error.

A room of one albedo rho, white sky through its opening, all bounces. Two rooms are for the solver: how many products
with the form factors a cube and a corridor of 1:16 take, and how far the proved error lies above the true one, which a
solution ten thousand times as exact tells. The third is an integrating sphere, whose answer is known on paper. Seen
from any point of a sphere's wall, equal areas of it fill equal shares of the view: if the opening is a share h of the
whole sphere, every point sees h of the sky and 1 - h of a wall that glows evenly,

    E = h + (1 - h) rho E,    E = h / (1 - (1 - h) rho).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ...camera import Camera
from ...columns import Haar
from ...light.environment import Environment
from ...scene.builtin.shapes import Model, Shape, quad, sphere
from ...scene.scene import Scene
from ...transport.plan import Solve
from ...transport.transport import Transport
from .tracing import Tracing

__all__ = ["ALBEDOS", "FINE", "RESIDUAL", "ROOMS", "RUNS", "STRONG", "Ball", "Furnace", "measure", "measure_ball"]

ALBEDOS = (0.5, 0.9, 0.99, 0.999)
_BALL_ALBEDOS = (0.5, 0.99)
RESIDUAL, FINE = 1e-3, 1e-7
_NODES = 300
_PICTURE = (16, 16)
_ROOM_COLUMNS, _BALL_COLUMNS = Haar(2), Haar(8)
STRONG = 0.1
"""Columns that bring less than this share of the strongest are left out: in 16 bits they are known less well."""


class Furnace(NamedTuple):
    """One room of one albedo."""

    room: str
    albedo: float
    solve: Solve
    error: float
    """The largest of any receiver in any strong column, relative to the column's largest value."""

    @property
    def ratio(self) -> float:
        """How many times the true error what was proved is; nan where there is no error."""
        return self.solve.residual / self.error if self.error > 0 else float("nan")


class Ball(NamedTuple):
    """The integrating sphere: what every point of its wall receives from a white sky."""

    albedo: float
    found: float
    known: float

    @property
    def error(self) -> float:
        """Relative to what is known."""
        return abs(self.found / self.known - 1)


def measure(traced: Tracing, room: str) -> list[Furnace]:
    """A room in all albedos."""
    found = []
    for albedo in ALBEDOS:
        scene = _painted(_MAKERS[room](), albedo)
        options = {"columns": _ROOM_COLUMNS, "quality": "lossless", "tolerance": None, "nodes": _NODES}
        rough, fine = (
            traced(scene, bounces="all", residual=residual, **options).transport for residual in (RESIDUAL, FINE)
        )
        assert rough.solve is not None
        found.append(Furnace(room, albedo, rough.solve, _off(rough, fine)))
    return found


def measure_ball(traced: Tracing) -> list[Ball]:
    """The integrating sphere in some albedos."""
    shell, opening = _shell()
    white = Environment.from_cubemap(np.ones((6, 1, 1, 3), np.float32))
    found = []
    for albedo in _BALL_ALBEDOS:
        transport = traced(
            _painted(shell, albedo),
            columns=_BALL_COLUMNS,
            quality="publication",
            tolerance=0.0,
            bounces="all",
            residual=RESIDUAL,
            nodes=_NODES,
        ).transport
        B = transport.multiply(transport.coefficients(white))
        found.append(Ball(albedo, float(B.mean()), opening / (1 - (1 - opening) * albedo)))
    return found


def _off(rough: Transport, fine: Transport) -> float:
    """The largest error of a strong column, relative to its largest value."""
    exact = fine.matmat(np.eye(fine.shape[1]))
    largest = np.abs(exact).max(axis=0)
    error = np.abs(rough.matmat(np.eye(fine.shape[1])) - exact).max(axis=0)
    strong = largest >= STRONG * largest.max()
    return float((error[strong] / largest[strong]).max())


def _painted(scene: Scene, albedo: float) -> Scene:
    return replace(scene, albedo=np.full_like(scene.albedo, albedo))


def _cube() -> Scene:
    """Closed but for a window of a half by a half in its roof."""
    frame = ((0, 0, 1, 0.25), (0, 0.75, 1, 0.25), (0, 0.25, 0.25, 0.5), (0.75, 0.25, 0.25, 0.5))
    roof = [quad((x, 1, z), (width, 0, 0), (0, 0, depth)) for x, z, width, depth in frame]
    return _scene([*_tunnel(1), quad((0, 0, 1), (1, 0, 0), (0, 1, 0)), *roof], (0.5, 0.95, 0.95), (0.5, 0.2, 0.2))


def _corridor() -> Scene:
    """Sixteen times as long as wide and high, open at one end, before which the camera stands."""
    return _scene([*_tunnel(16), quad((0, 1, 0), (1, 0, 0), (0, 0, 16))], (0.5, 0.5, 17.2), (0.5, 0.45, 0.0))


def _tunnel(length: float) -> list[Shape]:
    """A floor, two sides and a back."""
    up, along = (0, 1, 0), (0, 0, length)
    sides = [quad((x, 0, 0), up, along) for x in (0, 1)]
    return [quad((0, 0, 0), (1, 0, 0), along), *sides, quad((0, 0, 0), (1, 0, 0), up)]


def _shell() -> tuple[Scene, float]:
    """A sphere without its cap, and the cap's share of the whole."""
    vertices, triangles = sphere((0, 0, 0), 1.0, 48)
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    areas = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    wall = (a + b + c)[:, 1] / 3 < 0.9
    scene = _scene([(vertices, triangles[wall])], (0, 0.5, 0.7), (0, -0.4, -0.6))
    return scene, float(1 - areas[wall].sum() / areas.sum())


def _scene(shapes: Sequence[Shape], eye: tuple[float, float, float], target: tuple[float, float, float]) -> Scene:
    model = Model("furnace", {"grey": (0.5, 0.5, 0.5)})
    model.add("grey", *shapes)
    width, height = _PICTURE
    return Scene.from_content(model.content(Camera(eye, target, vertical_fov=90.0, width=width, height=height)))


_MAKERS = {"cube": _cube, "corridor 1:16": _corridor}
ROOMS = tuple(_MAKERS)
"""What `measure` takes."""
RUNS = 2 * len(ROOMS) * len(ALBEDOS) + len(_BALL_ALBEDOS)
"""Of `precompute`: two for every albedo of a room, one of the ball."""
