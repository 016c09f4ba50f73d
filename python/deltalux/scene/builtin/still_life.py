"""The built-in scene "still-life": things of everyday on a round table."""

from __future__ import annotations

import numpy as np

from ...camera import Camera
from ..content import Content
from .shapes import Model, Shape, box, join, moved, revolved, sphere, surface, tube, unit

PALETTE = {
    "wood": (0.36, 0.20, 0.10),
    "cloth": (0.72, 0.68, 0.60),
    "vase": (0.55, 0.60, 0.58),
    "twig": (0.16, 0.10, 0.06),
    "berry": (0.56, 0.09, 0.06),
    "china": (0.80, 0.78, 0.74),
    "coffee": (0.10, 0.05, 0.025),
    "red book": (0.33, 0.07, 0.07),
    "page": (0.74, 0.69, 0.58),
    "blue book": (0.07, 0.14, 0.26),
    "yellow book": (0.48, 0.36, 0.14),
    "green book": (0.10, 0.22, 0.15),
    "ball": (0.62, 0.55, 0.20),
    "red apple": (0.55, 0.06, 0.05),
    "stalk": (0.14, 0.09, 0.05),
    "green apple": (0.42, 0.45, 0.08),
    "dark apple": (0.50, 0.10, 0.06),
    "orange": (0.75, 0.32, 0.04),
    "knot": (0.10, 0.30, 0.42),
}


def still_life() -> Content:
    """A round table with a vase and twigs, a cup, books, fruit and a torus knot."""
    model = Model("still-life", PALETTE)
    model.add("wood", revolved([(0.0, 0.0), (3.0, 0.0), (3.06, -0.04), (3.06, -0.14), (3.0, -0.18), (0.0, -0.18)], 128))
    model.add("wood", revolved([(0.22, -0.18), (0.16, -1.2), (0.2, -2.6), (0.9, -2.9), (0.9, -3.0)], 48))
    model.add("cloth", _cloth())
    _vase(model)
    _cup(model)
    _books(model)
    _fruit(model)
    model.add("knot", _torus_knot((0.95, 0.66, 0.75), 0.42, 0.115))
    return model.content(Camera((0.8, 2.9, 7.0), (-0.12, 0.66, 0.0), vertical_fov=35.0))


def _cloth() -> Shape:
    """A runner across the table with soft ripples, rising just clear of the wood."""
    x, z = np.meshgrid(np.linspace(-2.1, 2.1, 85), np.linspace(-0.75, 1.55, 47), indexing="ij")
    y = 0.03 + 0.012 * np.sin(5.0 * x + 1.3 * np.sin(3.0 * z)) + 0.008 * np.sin(9.0 * z + 2.0 * x)
    fringe = 0.03 * np.sin(11.0 * x) * (np.abs(z - 0.4) > 1.1)
    return surface(np.stack([x, y, z + fringe], axis=-1))


def _vase(model: Model) -> None:
    """A glazed vase, open at the top, with bare twigs that carry berries."""
    height = np.linspace(0.0, 1.35, 40)
    belly = 0.20 + 0.30 * np.exp(-(((height - 0.48) / 0.36) ** 2)) + 0.10 * (height / 1.35) ** 6
    outside = [(0.0, 0.0)] + list(zip(belly, height, strict=True))
    inside = [(radius - 0.025, y) for radius, y in reversed(outside[20:])]
    at = np.array([-0.95, 0.05, -0.45])
    model.add("vase", moved(revolved(outside + inside, 72), at))

    random = np.random.RandomState(5)
    s = np.linspace(0.0, 1.0, 24)[:, None]
    for twig in range(11):
        heading, lean, length = 2.39996 * twig, random.uniform(0.15, 0.75), random.uniform(1.3, 2.0)
        out = np.array([np.cos(heading), 0.0, np.sin(heading)])
        wobble = 0.03 * np.sin(s * random.uniform(8, 16) + random.uniform(0, 6)) * np.cross(out, (0, 1, 0))
        path = at + (0.0, 0.35, 0.0) + length * (s * (0.0, 1.0, 0.0) + 0.9 * lean * s**2 * out) + wobble
        model.add("twig", tube(path, 0.014 * (1.15 - s[:, 0]), 7))
        for berry in range(10, 24, 2):
            offset = unit(random.uniform(-1.0, 1.0, 3)) * 0.045
            model.add("berry", sphere(path[berry] + offset, random.uniform(0.025, 0.042), 14))


def _cup(model: Model) -> None:
    """A cup with a handle on a saucer, and what is left in it."""
    at = (-0.25, 0.05, 0.95)
    outer = [(0.0, 0.05), (0.16, 0.05), (0.18, 0.09), (0.27, 0.18), (0.33, 0.32), (0.36, 0.48), (0.37, 0.50)]
    inner = [(0.345, 0.49), (0.31, 0.33), (0.25, 0.20), (0.0, 0.12)]
    saucer = [(0.0, 0.0), (0.22, 0.0), (0.52, 0.07), (0.525, 0.085), (0.50, 0.08), (0.22, 0.03), (0.0, 0.03)]
    angle = np.linspace(-1.25, 1.35, 24)[:, None]
    handle = (0.33, 0.29, 0.0) + 0.15 * (np.cos(angle) * (1.0, 0.0, 0.0) + np.sin(angle) * (0.0, 1.0, 0.0))
    model.add("china", moved(join(revolved(outer + inner, 64), tube(handle, 0.028, 10)), at, 35.0))
    model.add("china", moved(revolved(saucer, 64), at))
    model.add("coffee", moved(revolved([(0.0, 0.36), (0.322, 0.36)], 64), at))


def _books(model: Model) -> None:
    """Four books, each with boards that stand out over a block of pages."""
    bindings = ("red book", "blue book", "yellow book", "green book")
    sizes, turns = ((1.5, 1.05, 0.20), (1.4, 1.0, 0.15), (1.2, 0.9, 0.18), (1.05, 0.75, 0.12)), (12, 19, 5, 27)
    bottom = 0.055
    for binding, (width, depth, thick), turn in zip(bindings, sizes, turns, strict=True):
        x, z, board = width / 2, depth / 2, 0.018
        covers = [box((-x, y, -z), (x, y + board, z)) for y in (0.0, thick - board)]
        spine = box((-x, board, -z), (-x + board, thick - board, z))
        pages = box((-x + board, board, -z + 0.03), (x - 0.03, thick - board, z - 0.03))
        at = (0.62, bottom, -1.05)
        model.add(binding, *(moved(piece, at, turn) for piece in (*covers, spine)))
        model.add("page", moved(pages, at, turn))
        # A hair's breadth between books: coinciding faces would be hit in turn.
        bottom += thick + 0.002
    model.add("ball", sphere((0.62, bottom + 0.24, -1.05), 0.24, 48))


def _fruit(model: Model) -> None:
    """Apples and oranges, dented at the stalk."""
    angle = np.linspace(0.0, np.pi, 25)
    dent = 1.0 - 0.35 * np.exp(-((angle / 0.42) ** 2))
    radius = np.sin(angle) * (0.9 + 0.12 * np.cos(angle))
    radius[[0, -1]] = 0.0
    apple = list(zip(radius, -dent * np.cos(angle[::-1]), strict=True))
    for kind, size, x, z in (
        ("red apple", 0.25, -1.75, 0.55),
        ("green apple", 0.23, -1.30, 0.86),
        ("dark apple", 0.22, -1.85, 1.08),
    ):
        profile = [(size * r, -size * y) for r, y in apple]
        model.add(kind, moved(revolved(profile, 40), (x, size + 0.045, z)))
        stalk = (x, 0.045, z) + np.array([[0.0, 1.6 * size, 0.0], [0.02, 1.95 * size, 0.0], [0.06, 2.3 * size, 0.0]])
        model.add("stalk", tube(stalk, 0.012, 7))
    model.add("orange", sphere((0.42, 0.27, 1.45), 0.23, 40), sphere((1.75, 0.25, 0.45), 0.22, 40))


def _torus_knot(centre: tuple[float, float, float], size: float, thickness: float) -> Shape:
    """The (2, 3) torus knot, standing on edge."""
    t = np.linspace(0.0, 2.0 * np.pi, 257)
    t[-1] = 0.0
    ring = 1.0 + 0.42 * np.cos(3.0 * t)
    path = size * np.stack([ring * np.cos(2.0 * t), ring * np.sin(2.0 * t), 0.42 * np.sin(3.0 * t)], axis=-1)

    # A closed curve: differences wrap round, and the normal towards the torus's own axis never degenerates.
    tangent = unit(np.roll(path[:-1], -1, axis=0) - np.roll(path[:-1], 1, axis=0))
    tangent = np.concatenate([tangent, tangent[:1]])
    core = size * np.stack([np.cos(2.0 * t), np.sin(2.0 * t), np.zeros_like(t)], axis=-1)
    side = unit(np.cross(tangent, path - core))
    other = np.cross(tangent, side)
    angle = np.linspace(0.0, 2.0 * np.pi, 21)
    angle[-1] = 0.0
    ring_points = side[:, None] * np.cos(angle)[:, None] + other[:, None] * np.sin(angle)[:, None]
    return moved(surface(path[:, None] + thickness * ring_points), centre, -25.0)
