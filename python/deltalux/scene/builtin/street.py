"""The built-in scene "street": two rows of town houses, pavements, lamps and young trees under an open sky.

One unit is about two metres. The street runs along z; the camera stands on it and looks towards -z.
"""

from __future__ import annotations

import numpy as np

from ...camera import Camera
from ..content import Content
from .shapes import Model, Shape, box, join, leaves, moved, quad, revolved, sphere, tube, unit

PALETTE = {
    "road": (0.16, 0.16, 0.17),
    "line": (0.66, 0.65, 0.60),
    "pavement": (0.42, 0.41, 0.39),
    "stone": (0.62, 0.59, 0.53),
    "glass": (0.05, 0.06, 0.07),
    "roof": (0.24, 0.11, 0.08),
    "door": (0.10, 0.16, 0.13),
    "iron": (0.06, 0.07, 0.07),
    "lamp": (0.82, 0.79, 0.70),
    "bark": (0.17, 0.12, 0.08),
    "dark leaf": (0.13, 0.28, 0.05),
    "light leaf": (0.20, 0.36, 0.08),
    "ochre wall": (0.60, 0.42, 0.28),
    "cream wall": (0.67, 0.60, 0.46),
    "red wall": (0.52, 0.22, 0.15),
    "grey wall": (0.47, 0.52, 0.50),
    "orange wall": (0.70, 0.52, 0.36),
}
WALLS = ("ochre wall", "cream wall", "red wall", "grey wall", "orange wall")

# A shape and its material; None is that of the house's walls.
Painted = tuple[str | None, Shape]

KERB, FRONT, NEAR, FAR = 1.8, 3.0, 6.0, -26.0
STOREY, BAY = 1.55, 1.15


def street() -> Content:
    """Build the model."""
    random = np.random.RandomState(11)
    model = Model("street", PALETTE)
    model.add("road", quad((-KERB, 0.0, FAR), (2 * KERB, 0.0, 0.0), (0.0, 0.0, NEAR - FAR)))
    for z in np.arange(FAR + 0.5, NEAR - 1.0, 2.0):
        model.add("line", box((-0.05, 0.0, z), (0.05, 0.004, z + 1.0)))
    for side in (-1.0, 1.0):
        x0, x1 = sorted((side * KERB, side * (FRONT + 0.2)))
        model.add("pavement", box((x0, 0.0, FAR), (x1, 0.09, NEAR)))
        _row(model, side, random)
        for z in np.arange(-22.0, 4.0, 6.5):
            model.add("iron", *_lamp(side, z))
            model.add("lamp", sphere((side * 1.35, 2.86, z), 0.13, 20))
        for z in np.arange(-18.5, 4.0, 6.5):
            _tree(model, (side * 2.25, 0.09, z), random)
    return model.content(Camera((-0.9, 0.95, 5.2), (0.35, 1.85, -8.0), vertical_fov=52.0))


def _row(model: Model, side: float, random: np.random.RandomState) -> None:
    """Houses wall to wall along one side, of different widths, heights and colours."""
    z, colour = NEAR, int(random.randint(len(WALLS)))
    while z > FAR + 3.0:
        bays, storeys = int(random.randint(3, 5)), int(random.randint(2, 5))
        colour = (colour + int(random.randint(1, len(WALLS)))) % len(WALLS)
        parts = _house(bays, storeys, door=int(random.randint(bays)))
        # Built facing +z with its left corner at the origin; turned to face the street.
        start, turn = ((side * FRONT, 0.09, z), 90.0) if side < 0 else ((side * FRONT, 0.09, z - bays * BAY), -90.0)
        for paint, shape in parts:
            model.add(WALLS[colour] if paint is None else paint, moved(shape, start, turn))
        z -= bays * BAY


def _house(bays: int, storeys: int, door: int) -> list[Painted]:
    """A house as (material, shape), that of the walls left open; its front is in the plane z = 0."""
    width, height, depth = bays * BAY, storeys * STOREY + 0.25, 4.0
    parts: list[Painted] = []
    for storey in range(storeys):
        for bay in range(bays):
            low = storey * STOREY
            is_door = storey == 0 and bay == door
            sill, head = (0.0, 1.15) if is_door else (0.45, 1.25)
            parts += _opening(bay * BAY, low, sill, head, is_door)
    top = storeys * STOREY
    parts.append((None, quad((0.0, top, 0.0), (width, 0.0, 0.0), (0.0, height - top, 0.0))))
    # What ends at a neighbour stands in a little, so that no two faces coincide.
    left, right = 0.01, width - 0.01
    for x in (left, right):
        parts.append((None, quad((x, 0.0, 0.0), (0.0, height, 0.0), (0.0, 0.0, -depth))))
    parts.append((None, quad((0.0, 0.0, -depth), (width, 0.0, 0.0), (0.0, height, 0.0))))

    # A plinth course between the floors, a cornice of two steps with brackets, a pitched roof behind it.
    parts.append(("stone", box((left, STOREY - 0.05, 0.0), (right, STOREY + 0.05, 0.06))))
    parts.append(("stone", box((left, height - 0.06, -0.1), (right, height + 0.10, 0.12))))
    parts.append(("stone", box((left, height + 0.10, -0.1), (right, height + 0.18, 0.22))))
    for x in np.arange(0.16, width - 0.05, 0.31):
        parts.append(("stone", box((x, height - 0.20, 0.0), (x + 0.09, height - 0.06, 0.10))))
    ridge = 1.3
    parts.append(("roof", quad((0.0, height + 0.18, 0.0), (width, 0.0, 0.0), (0.0, ridge, -depth / 2))))
    parts.append(("roof", quad((0.0, height + 0.18, -depth), (width, 0.0, 0.0), (0.0, ridge, depth / 2))))
    for x in (left, right):
        gable = np.array([[x, height, 0.0], [x, height, -depth], [x, height + 0.18 + ridge, -depth / 2]])
        parts.append((None, (gable, np.array([[0, 1, 2]]))))
    parts.append(("stone", box((0.25, height + 0.5, -1.7), (0.65, height + 1.9, -1.3))))
    return parts


def _opening(x: float, y: float, sill: float, head: float, is_door: bool) -> list[Painted]:
    """One bay of a storey: wall around a recessed window with bars, a sill and a lintel, or around a door."""
    left, right, depth = x + 0.28, x + BAY - 0.28, 0.16
    low, high = y + sill, y + head
    wall = [
        quad((x, y, 0.0), (left - x, 0.0, 0.0), (0.0, STOREY, 0.0)),
        quad((right, y, 0.0), (x + BAY - right, 0.0, 0.0), (0.0, STOREY, 0.0)),
        quad((left, high, 0.0), (right - left, 0.0, 0.0), (0.0, y + STOREY - high, 0.0)),
        quad((left, low, 0.0), (0.0, high - low, 0.0), (0.0, 0.0, -depth)),
        quad((right, low, 0.0), (0.0, high - low, 0.0), (0.0, 0.0, -depth)),
        quad((left, high, 0.0), (right - left, 0.0, 0.0), (0.0, 0.0, -depth)),
        quad((left, low, 0.0), (right - left, 0.0, 0.0), (0.0, 0.0, -depth)),
    ]
    if not is_door:
        wall.append(quad((left, y, 0.0), (right - left, 0.0, 0.0), (0.0, sill, 0.0)))
    pane = quad((left, low, -depth), (right - left, 0.0, 0.0), (0.0, high - low, 0.0))
    trim = [box((left - 0.06, high, 0.0), (right + 0.06, high + 0.10, 0.05))]
    if is_door:
        trim.append(box((left - 0.1, y, 0.0), (right + 0.1, y + 0.06, 0.25)))
    else:
        trim.append(box((left - 0.05, low - 0.06, 0.0), (right + 0.05, low, 0.09)))
        middle, across = 0.5 * (left + right), low + 0.62 * (high - low)
        trim.append(box((middle - 0.02, low, -depth), (middle + 0.02, high, -depth + 0.04)))
        trim.append(box((left, across - 0.02, -depth), (right, across + 0.02, -depth + 0.04)))
    return [(None, join(*wall)), ("door" if is_door else "glass", pane), ("stone", join(*trim))]


def _lamp(side: float, z: float) -> list[Shape]:
    """An iron post with a curved arm over the road."""
    x = side * 2.0
    post = revolved([(0.0, 0.0), (0.10, 0.0), (0.10, 0.18), (0.05, 0.30), (0.035, 2.5), (0.0, 2.5)], 16)
    angle = np.linspace(0.0, np.pi, 16)[:, None]
    across, up = 0.325 * side * np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.62, 0.0])
    # The arm is half an ellipse that stops a step early, above the hood.
    arm = (x - 0.325 * side, 2.5, z) + np.cos(angle) * across + np.sin(angle) ** 0.7 * up
    hood = revolved([(0.02, 0.22), (0.15, 0.10), (0.17, 0.06)], 16)
    return [moved(post, (x, 0.09, z)), tube(arm[:-1], 0.025, 7), moved(hood, (1.35 * side, 2.86, z))]


def _tree(model: Model, foot: tuple[float, float, float], random: np.random.RandomState) -> None:
    """A young tree: a trunk, boughs, and some hundreds of leaves scattered about their ends."""
    crown = np.array(foot) + (0.0, 2.0, 0.0)
    trunk = np.linspace(foot, crown, 6) + random.uniform(-0.02, 0.02, (6, 3)) * (1.0, 0.0, 1.0)
    model.add("bark", tube(trunk, np.linspace(0.06, 0.035, 6), 9))
    heading = np.arange(9) * 2.39996 + random.uniform(0.0, 6.0)
    reach = np.stack([np.cos(heading), random.uniform(0.5, 1.6, 9), np.sin(heading)], axis=-1)
    reach *= random.uniform(0.4, 0.7, (9, 1))
    s = np.linspace(0.0, 1.0, 6)[:, None]
    start = trunk[3:6][np.arange(9) % 3]
    boughs = start[:, None] + reach[:, None] * s + 0.12 * s**2 * np.array([0.0, 1.0, 0.0])
    model.add("bark", tube(boughs, np.linspace(0.024, 0.008, 6), 6))

    # Leaves round the outer part of the boughs, each a short pointed blade that hangs a little.
    at = np.repeat(boughs[:, 2:].reshape(-1, 3), 20, axis=0)
    at = at + unit(random.normal(size=at.shape)) * random.uniform(0.05, 0.36, (len(at), 1))
    out = unit(random.normal(size=at.shape) + (0.0, -0.3, 0.0))
    t = np.linspace(0.0, 1.0, 4)[:, None]
    blade = at[:, None] + 0.14 * (t * out[:, None] - 0.25 * t**2 * np.array([0.0, 1.0, 0.0]))
    width = 0.040 * np.array([0.2, 1.0, 0.8, 0.0]) * np.ones((len(at), 1))
    for shade, leaf in enumerate(("dark leaf", "light leaf")):
        model.add(leaf, leaves(blade[shade::2], width[shade::2], 0.3))
