"""The built-in scene "cornell": the box of Goral et al. (1984), open to the sky."""

from __future__ import annotations

from ...camera import Camera
from ..content import Content
from .shapes import Model, box, moved, quad


def cornell() -> Content:
    """The Cornell box (Goral et al. 1984), 2 units wide, open at the front and with a skylight in its ceiling."""
    model = Model("cornell", {"white": (0.73, 0.71, 0.68), "red": (0.57, 0.04, 0.04), "green": (0.12, 0.42, 0.09)})
    model.add("white", quad((-1, 0, -1), (2, 0, 0), (0, 0, 2)), quad((-1, 0, -1), (2, 0, 0), (0, 2, 0)))
    model.add("red", quad((-1, 0, -1), (0, 0, 2), (0, 2, 0)))
    model.add("green", quad((1, 0, -1), (0, 0, 2), (0, 2, 0)))
    # The ceiling is a frame of four pieces round a square opening.
    for x, z, width, depth in ((-1, -1, 2, 0.5), (-1, 0.5, 2, 0.5), (-1, -0.5, 0.5, 1), (0.5, -0.5, 0.5, 1)):
        model.add("white", quad((x, 2, z), (width, 0, 0), (0, 0, depth)))
    tall, short = box((-0.3, 0.0, -0.3), (0.3, 1.2, 0.3)), box((-0.3, 0.0, -0.3), (0.3, 0.6, 0.3))
    model.add("white", moved(tall, (-0.33, 0.0, -0.30), 18.0), moved(short, (0.36, 0.0, 0.33), -17.0))
    return model.content(Camera((0.0, 1.0, 4.7), (0.0, 1.0, 0.0), vertical_fov=34.0))
