"""The demo of editing, after Ben-Artzi et al. (2006, Fig. 2): pearl earrings with posts on a cloth over a pedestal."""

from __future__ import annotations

import numpy as np

from .. import brdf
from ..brdf import Model
from ..brdf.curves import ANGLES, curve_of
from ..camera import Camera
from ..scene.builtin.shapes import join, quad, revolved, sphere, tube
from ..scene.scene import Scene
from ..surface.material import Material
from .session import Edit

__all__ = ["FRESNEL", "MATERIALS", "edits", "jewels"]

_SHARP, _WIDE = 0.04, 0.25
# A share of the highlight's peak: twice the light of the highlight itself, over forty times its solid angle.
_HAZE = 0.05

MATERIALS: dict[str, Model] = {
    "pearl": brdf.CookTorrance(sigma=0.15, n=1.5),
    "posts": brdf.CookTorrance(sigma=0.12, n=1.5),
    "cloth": brdf.GGX(alpha=0.55),
}
"""As the session begins."""
FRESNEL = {"posts": "metal"}
"""The posts become gold."""


def jewels(size: tuple[int, int]) -> Scene:
    """The scene, seen in so many pixels."""
    pearls = [sphere((x, 1.42, 0.1), 0.4, 192) for x in (-0.55, 0.55)]
    bend = np.linspace(0.0, 0.75 * np.pi, 24)
    hook = np.stack([0.0 * bend, 0.25 * np.sin(bend), -0.2 + 0.2 * np.cos(bend)], axis=1)
    posts = [tube(hook + (x, 1.8, 0.1), 0.045, 24) for x in (-0.55, 0.55)]
    profile = [(0.0, 1.0), (1.35, 1.0), (1.45, 0.95), (1.5, 0.85), (1.52, 0.0)]
    cloth = join(revolved(profile, 96), quad((-6, 0, -6), (0, 0, 12), (12, 0, 0)))
    shapes = [join(*pearls), join(*posts), cloth]
    vertices, triangles = join(*shapes)
    camera = Camera((0.0, 2.7, 4.2), (0.0, 1.35, 0.0), vertical_fov=32.0, width=size[0], height=size[1])
    return Scene.from_arrays(
        vertices,
        triangles,
        camera=camera,
        materials={
            "pearl": Material((0.55, 0.5, 0.44)),
            "posts": Material((0.02, 0.02, 0.02)),
            "cloth": Material((0.012, 0.01, 0.012), (0.8, 0.08, 0.1), brdf.GGX(alpha=0.55)),
        },
        material=np.repeat([0, 1, 2], [len(corners) for _, corners in shapes]),
        name="jewels",
    )


def edits() -> list[Edit]:
    """The session of the figure: sharpen, add haze, red cloth to blue, posts to gold."""
    sharp, wide = (curve_of(brdf.CookTorrance(sigma=sigma)) for sigma in (_SHARP, _WIDE))
    hazy = sharp + _HAZE * sharp[0] * wide / wide[0]
    return [
        Edit("sharper reflections", "pearl", {"sigma": _SHARP}),
        Edit("a second, hazy reflection", "pearl", curve=(ANGLES, hazy)),
        Edit("red cloth to blue", "cloth", {"colour": (0.1, 0.12, 0.8)}),
        Edit("posts to gold", "posts", {"n": (0.18, 0.42, 1.37), "k": (3.42, 2.35, 1.77)}),
    ]
