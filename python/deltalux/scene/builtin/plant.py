"""The built-in scene "plant": a palm with feathered fronds above grassy blades, in a clay pot on the ground.

Made for shadows: some eighty thousand triangles, nearly all of them in leaves a few thousandths of the scene wide.
"""

from __future__ import annotations

import numpy as np

from ...camera import Camera
from ..content import Content
from .shapes import Model, Shape, arch, join, leaves, moved, revolved, sphere, surface, tube, unit

PALETTE = {
    "ground": (0.58, 0.54, 0.48),
    "clay": (0.52, 0.22, 0.12),
    "soil": (0.09, 0.06, 0.04),
    "pebble": (0.36, 0.34, 0.31),
    "stalk": (0.24, 0.33, 0.08),
    "dark palm": (0.07, 0.22, 0.04),
    "palm": (0.10, 0.28, 0.05),
    "light palm": (0.15, 0.34, 0.07),
    "light grass": (0.22, 0.42, 0.10),
    "grass": (0.12, 0.32, 0.08),
    "broad leaf": (0.05, 0.17, 0.07),
    "petal": (0.80, 0.36, 0.42),
    "pale petal": (0.85, 0.66, 0.60),
    "pollen": (0.85, 0.60, 0.10),
}

SOIL_HEIGHT = 0.98


def plant() -> Content:
    """Build the model; RandomState because numpy promises that its numbers never change."""
    random = np.random.RandomState(20)
    model = Model("plant", PALETTE)
    model.add("ground", revolved([(0.0, 0.0), (3.0, 0.0), (12.0, 0.0), (48.0, 0.0)], 64))
    _pot(model, random)
    _fronds(model, random)
    _grass(model, random)
    _broad_leaves(model, random)
    _flowers(model, random)
    return model.content(Camera((2.7, 2.9, 5.6), (0.05, 1.36, 0.0), vertical_fov=36.0))


def _pot(model: Model, random: np.random.RandomState) -> None:
    """A turned clay pot with a saucer, a rounded rim, soil and pebbles."""
    outer = [(0.0, 0.06), (0.46, 0.06), (0.49, 0.09), (0.66, 0.84), (0.67, 0.86), (0.74, 0.87), (0.76, 0.89)]
    rim = [(0.78, 1.04), (0.775, 1.07), (0.75, 1.085), (0.72, 1.075), (0.705, 1.05), (0.67, 0.90), (0.66, 0.80)]
    saucer = [(0.0, 0.02), (0.62, 0.02), (0.70, 0.10), (0.73, 0.105), (0.735, 0.09), (0.66, 0.0)]
    model.add("clay", revolved(outer + rim, 96), revolved(saucer, 96))

    # Soil: a disc with a rough, slightly heaped surface.
    radius, angle = np.meshgrid(np.linspace(0.0, 0.70, 15), np.linspace(0.0, 2.0 * np.pi, 57), indexing="ij")
    height = SOIL_HEIGHT + 0.05 * (1.0 - (radius / 0.7) ** 2) + 0.02 * random.uniform(-1.0, 1.0, radius.shape)
    height[0], height[:, -1] = height[0, 0], height[:, 0]
    angle[:, -1] = 0.0
    model.add("soil", surface(np.stack([radius * np.cos(angle), height, radius * np.sin(angle)], axis=-1)))
    for _ in range(40):
        at, size, turn = 0.63 * np.sqrt(random.uniform()), random.uniform(0.015, 0.035), random.uniform(0.0, 360.0)
        pebble, corners = sphere((0.0, 0.0, 0.0), size, 10)
        squashed = pebble * (1.0, 0.6, 0.75)
        model.add("pebble", moved((squashed + (at, SOIL_HEIGHT + 0.045, 0.0), corners), (0.0, 0.0, 0.0), turn))


def _fronds(model: Model, random: np.random.RandomState) -> None:
    """Arching palm fronds: a stalk with two rows of leaflets, longest in its middle."""
    count, pairs = 26, 30
    # The golden angle spreads fronds evenly; the outer ones are shorter and bend more.
    order = (np.arange(count) + 0.5) / count
    heading = np.arange(count) * 2.39996 + random.uniform(-0.2, 0.2, count)
    rise = 1.52 - 0.50 * order + random.uniform(-0.06, 0.06, count)
    bend = 1.0 + 1.15 * order + random.uniform(-0.15, 0.15, count)
    length = 2.55 - 0.75 * order + random.uniform(-0.15, 0.15, count)
    base = _on_soil(heading, 0.04 + 0.14 * order)
    stalks = arch(base, heading, rise, bend, length, 48)
    model.add("stalk", tube(stalks[:, ::2], np.linspace(0.022, 0.004, 25), 7))

    # Leaflets grow from the outer three quarters of the stalk, forwards and to either side.
    where = np.linspace(12, 47, pairs)
    foot = _along(stalks, where)
    forward = unit(_along(stalks, where + 0.5) - _along(stalks, where - 0.5))
    side = unit(np.cross(forward, (0.0, 1.0, 0.0)))
    s = np.linspace(0.0, 1.0, pairs)
    reach = (0.62 * np.sin(np.pi * (0.12 + 0.82 * s)) ** 0.8 * length[:, None] / 2.2)[..., None]
    for sign in (-1.0, 1.0):
        jitter = random.uniform(-0.10, 0.10, (count, pairs, 3))
        lean = 0.55 + 0.75 * s[:, None]
        direction = unit(lean * forward + sign * side + (0.0, 0.28, 0.0) + jitter)
        t = np.linspace(0.0, 1.0, 8)[:, None]
        droop = random.uniform(0.25, 0.5, (count, pairs, 1, 1)) * t**2 * np.array([0.0, -1.0, 0.0])
        centre = foot[:, :, None] + reach[..., None] * (t * direction[:, :, None] + droop)
        width = 0.020 * (reach / 0.62) ** 0.5 * _taper(t[:, 0], 0.3)
        for shade, palm in enumerate(("dark palm", "palm", "light palm")):
            model.add(palm, leaves(centre[shade::3], width[shade::3], 0.35))


def _grass(model: Model, random: np.random.RandomState) -> None:
    """Thin blades that fall over the rim."""
    count = 170
    heading = random.uniform(0.0, 2.0 * np.pi, count)
    base = _on_soil(heading + random.uniform(-0.5, 0.5, count), random.uniform(0.30, 0.60, count))
    length = random.uniform(0.9, 1.6, count)
    path = arch(base, heading, random.uniform(0.9, 1.3, count), random.uniform(1.6, 2.8, count), length, 20)
    width = random.uniform(0.011, 0.021, count)[:, None] * _taper(np.linspace(0.0, 1.0, 21), 0.15)
    for shade, grass in enumerate(("light grass", "grass")):
        model.add(grass, leaves(path[shade::2], width[shade::2], 0.25))


def _broad_leaves(model: Model, random: np.random.RandomState) -> None:
    """A few broad, dark leaves low in the pot, each on a stem, with waving edges."""
    count = 11
    heading = np.arange(count) * 2.39996 + 0.7
    stem = arch(
        _on_soil(heading, np.full(count, 0.35)), heading, random.uniform(0.9, 1.25, count),
        np.full(count, 0.5), random.uniform(0.30, 0.55, count), 10,
    )  # fmt: skip
    model.add("stalk", tube(stem, 0.010, 6))
    blade = arch(
        stem[:, -1], heading, random.uniform(0.35, 0.6, count), random.uniform(0.9, 1.4, count),
        random.uniform(0.42, 0.6, count), 18,
    )  # fmt: skip

    # Seven points across: folded along the midrib, curling down again towards a wavy edge.
    s = np.linspace(0.0, 1.0, 19)
    tangent = unit(np.gradient(blade, axis=1))
    side = unit(np.cross(tangent, (0.0, 1.0, 0.0)))
    normal = np.cross(side, tangent)
    across = np.linspace(-1.0, 1.0, 7)[None, None, :, None]
    half = (0.13 * np.sin(np.pi * s**0.75) ** 0.9)[None, :, None, None]
    wave = 0.10 * np.sin(22.0 * s)[None, :, None, None] * across**2
    lift = 0.45 * np.abs(across) - 0.40 * across**2 + wave
    model.add("broad leaf", surface(blade[:, :, None] + half * (across * side[:, :, None] + lift * normal[:, :, None])))


def _flowers(model: Model, random: np.random.RandomState) -> None:
    """Small flowers of six petals on thin stems, facing outwards and up."""
    count = 13
    heading = np.arange(count) * 2.39996 + 1.9
    stem = arch(
        _on_soil(heading, np.full(count, 0.25)), heading, random.uniform(1.0, 1.3, count),
        random.uniform(0.3, 0.8, count), random.uniform(1.0, 1.6, count), 20,
    )  # fmt: skip
    model.add("stalk", tube(stem, 0.006, 6))
    for flower, path in enumerate(stem):
        facing = unit(path[-1] - path[-3] + (0.0, 0.01, 0.0))
        model.add("petal" if flower % 3 else "pale petal", _petals(path[-1], facing))
        model.add("pollen", sphere(path[-1] + 0.012 * facing, 0.024, 12))


def _petals(centre: np.ndarray, facing: np.ndarray) -> Shape:
    """Six cupped petals round an axis."""
    first = unit(np.cross(facing, (0.3, 0.2, 1.0)))
    second = np.cross(facing, first)
    t = np.linspace(0.0, 1.0, 8)[:, None]
    petals = []
    for angle in np.arange(6) * np.pi / 3.0:
        outward = first * np.cos(angle) + second * np.sin(angle)
        path = centre + 0.13 * (t * outward + 0.35 * np.sin(2.2 * t) * facing)
        petals.append(leaves(path, 0.050 * _taper(t[:, 0] ** 1.6, 0.2), 0.2, facing))
    return join(*petals)


def _on_soil(heading: np.ndarray, radius: np.ndarray) -> np.ndarray:
    """Points just below the soil, so that nothing floats."""
    return np.stack([radius * np.cos(heading), np.full(len(heading), SOIL_HEIGHT - 0.02), radius * np.sin(heading)], -1)


def _along(paths: np.ndarray, where: np.ndarray) -> np.ndarray:
    """Points of paths (n, m, 3) at fractional steps (k,): (n, k, 3)."""
    whole = np.floor(where).astype(np.int64).clip(0, paths.shape[1] - 2)
    part = (where - whole)[:, None]
    return np.asarray(paths[:, whole] * (1.0 - part) + paths[:, whole + 1] * part)


def _taper(s: np.ndarray, base: float) -> np.ndarray:
    """The width of a blade along it: `base` at its foot, 1 at its widest, pointed at its tip."""
    rising = np.minimum(base + (1.0 - base) * np.sin(np.pi * np.minimum(s, 0.4) / 0.8), 1.0)
    return np.asarray(rising * (1.0 - s**3))
