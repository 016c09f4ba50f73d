"""The built-in scenes "studio-...": rooms for lamps that move and materials that are edited, after Nguyen (2010)."""

from __future__ import annotations

import numpy as np

from ...camera import Camera
from ..content import Content
from .shapes import Model, Shape, box, join, moved, quad, revolved, sphere, tube


def studio_box() -> Content:
    """The Cornell box, closed but for its front, with a floor and two boxes of materials of their own."""
    palette = {
        "floor": (0.60, 0.58, 0.55),
        "white": (0.73, 0.71, 0.68),
        "red": (0.57, 0.04, 0.04),
        "green": (0.12, 0.42, 0.09),
        "tall box": (0.55, 0.53, 0.50),
        "short box": (0.40, 0.42, 0.55),
    }
    model = Model("studio-box", palette, laid={"floor": 1.0})
    model.add("floor", quad((-1, 0, -1), (0, 0, 2), (2, 0, 0)))
    model.add("white", quad((-1, 0, -1), (2, 0, 0), (0, 2, 0)), quad((-1, 2, -1), (2, 0, 0), (0, 0, 2)))
    model.add("red", quad((-1, 0, -1), (0, 2, 0), (0, 0, 2)))
    model.add("green", quad((1, 0, -1), (0, 0, 2), (0, 2, 0)))
    model.add("tall box", moved(box((-0.3, 0.0, -0.3), (0.3, 1.2, 0.3)), (-0.33, 0.0, -0.30), 18.0))
    model.add("short box", moved(box((-0.3, 0.0, -0.3), (0.3, 0.6, 0.3)), (0.36, 0.0, 0.33), -17.0))
    return model.content(Camera((0.0, 1.0, 4.7), (0.0, 1.0, 0.0), vertical_fov=34.0))


def studio_figures() -> Content:
    """A hare and a dragon on a floor before a wall."""
    palette = {
        "floor": (0.45, 0.45, 0.47),
        "wall": (0.65, 0.62, 0.56),
        "hare": (0.62, 0.50, 0.38),
        "dragon": (0.20, 0.42, 0.30),
    }
    model = Model("studio-figures", palette, laid={"floor": 1.0})
    model.add("floor", quad((-3, 0, -2), (0, 0, 4), (6, 0, 0)))
    model.add("wall", quad((-3, 0, -2), (6, 0, 0), (0, 3, 0)))
    model.add("hare", moved(_hare(), (-0.95, 0.0, 0.2), 30.0))
    model.add("dragon", moved(_dragon(), (0.85, 0.0, -0.2), -15.0))
    return model.content(Camera((0.0, 1.7, 5.2), (0.0, 0.6, 0.0), vertical_fov=34.0))


def studio_still_life() -> Content:
    """Five things on a table top, each of a material of its own."""
    palette = {
        "table": (0.35, 0.22, 0.13),
        "wall": (0.60, 0.60, 0.62),
        "vase": (0.30, 0.36, 0.50),
        "ball": (0.55, 0.10, 0.08),
        "ring": (0.55, 0.42, 0.15),
        "cup": (0.70, 0.68, 0.64),
    }
    model = Model("studio-still-life", palette, laid={"table": 1.2})
    model.add("table", quad((-2.4, 0, -1.6), (0, 0, 3.2), (4.8, 0, 0)))
    model.add("wall", quad((-2.4, 0, -1.6), (4.8, 0, 0), (0, 2.6, 0)))
    height = np.linspace(0.0, 1.2, 32)
    belly = 0.20 + 0.26 * np.exp(-(((height - 0.42) / 0.3) ** 2)) + 0.08 * (height / 1.2) ** 5
    profile = [(0.0, 0.0), *zip(belly, height, strict=True)]
    model.add("vase", moved(revolved([*profile, *((r - 0.03, y) for r, y in profile[:8:-1])], 56), (-1.0, 0.0, -0.3)))
    model.add("ball", sphere((0.05, 0.38, -0.35), 0.38, 48))
    angle = np.linspace(0.0, 2.0 * np.pi, 65)
    angle[-1] = 0.0
    circle = 0.34 * np.stack([np.cos(angle), np.zeros_like(angle), np.sin(angle)], axis=1)
    model.add("ring", moved(tube(circle, 0.09, 20), (0.35, 0.091, 0.75)))
    outer = [(0.0, 0.0), (0.2, 0.0), (0.26, 0.12), (0.30, 0.42)]
    inner = [(0.27, 0.42), (0.23, 0.13), (0.0, 0.06)]
    model.add("cup", moved(revolved(outer + inner, 56), (1.15, 0.0, 0.15)))
    return model.content(Camera((0.3, 1.7, 4.6), (0.1, 0.42, 0.0), vertical_fov=33.0))


def studio_room() -> Content:
    """A room with a window in its left wall, a table and two stools."""
    palette = {
        "floor": (0.34, 0.22, 0.14),
        "plaster": (0.74, 0.72, 0.67),
        "far wall": (0.45, 0.55, 0.60),
        "table": (0.42, 0.30, 0.18),
        "stool": (0.50, 0.14, 0.10),
    }
    model = Model("studio-room", palette)
    model.add("floor", quad((-2.5, 0, -2), (0, 0, 5), (5, 0, 0)))
    model.add("plaster", quad((-2.5, 2.6, -2), (5, 0, 0), (0, 0, 5)))
    model.add("far wall", quad((-2.5, 0, -2), (5, 0, 0), (0, 2.6, 0)))
    model.add("plaster", quad((2.5, 0, -2), (0, 0, 5), (0, 2.6, 0)), quad((-2.5, 0, 3), (0, 2.6, 0), (5, 0, 0)))
    # The wall around the window, which is 1.6 wide and 1.2 high.
    for y, z, up, along in ((0, -2, 0.9, 5), (2.1, -2, 0.5, 5), (0.9, -2, 1.2, 1.2), (0.9, 0.8, 1.2, 2.2)):
        model.add("plaster", quad((-2.5, y, z), (0, up, 0), (0, 0, along)))
    top = box((-0.8, 0.72, -0.45), (0.8, 0.78, 0.45))
    legs = [box((x, 0.0, z), (x + 0.07, 0.72, z + 0.07)) for x in (-0.75, 0.68) for z in (-0.4, 0.33)]
    model.add("table", *(moved(piece, (0.5, 0.0, -0.5), 12.0) for piece in (top, *legs)))
    seat = join(
        revolved([(0.0, 0.46), (0.2, 0.46), (0.2, 0.5), (0.0, 0.5)], 32), revolved([(0.05, 0.0), (0.05, 0.46)], 16)
    )
    model.add("stool", moved(seat, (-0.5, 0.0, 0.5)), moved(seat, (1.2, 0.0, 0.5)))
    return model.content(Camera((1.4, 1.5, 2.9), (-0.5, 0.9, -1.0), vertical_fov=58.0))


def _hare() -> Shape:
    """A hare that sits: a body, a head with two ears, paws and a tail."""

    def ball(centre: tuple[float, float, float], radii: tuple[float, float, float]) -> Shape:
        vertices, triangles = sphere((0.0, 0.0, 0.0), 1.0, 40)
        return vertices * radii + centre, triangles

    s = np.linspace(0.0, 1.0, 17)[:, None]
    ears = [
        tube((0.30, 0.98, side) + s * (-0.16, 0.46, 0.35 * side), 0.085 * np.sin(np.pi * (0.12 + 0.86 * s[:, 0])), 14)
        for side in (-0.11, 0.11)
    ]
    return join(
        ball((0.0, 0.42, 0.0), (0.46, 0.42, 0.36)),
        ball((0.32, 0.86, 0.0), (0.25, 0.22, 0.20)),
        ball((0.30, 0.13, 0.18), (0.22, 0.11, 0.10)),
        ball((0.30, 0.13, -0.18), (0.22, 0.11, 0.10)),
        ball((-0.46, 0.26, 0.0), (0.12, 0.12, 0.12)),
        *ears,
    )


def _dragon() -> Shape:
    """A dragon that winds itself over the ground in three bows, with a comb along its back."""
    t = np.linspace(0.0, 1.0, 161)
    turn = 2.6 * 2.0 * np.pi * t
    along = np.stack([1.5 * (t - 0.5), 0.16 + 0.22 * (1.0 - np.cos(turn)) + 0.3 * t**4, 0.3 * np.sin(turn)], axis=1)
    thick = 0.15 * np.sin(np.pi * np.clip(0.08 + 0.95 * t, 0.0, 1.0)) ** 0.5 * (0.35 + 0.65 * t) + 0.012
    comb = []
    for k in range(14, 150, 8):
        size, at = thick[k], along[k] + (0.0, 0.9 * thick[k], 0.0)
        comb.append(moved(revolved([(0.45 * size, 0.0), (0.0, 0.8 * size)], 12), at))
    head = along[-1] + np.array([[0.0, 0.0, 0.0], [0.1, 0.02, 0.0], [0.26, -0.03, 0.0], [0.34, -0.06, 0.0]])
    return join(tube(along, thick, 28), tube(head, np.array([0.05, 0.13, 0.08, 0.02]), 24), *comb)
