"""Pearls on a cloth, one of each model that is edited, traced for every curve that they may take."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from ...camera import Camera
from ...light.environment import Environment
from ...precomputation.curves import precompute_curves
from ...progress import Progress
from ...scene.builtin.shapes import join, quad, sphere
from ...scene.scene import Scene
from ...surface.material import Material
from ...transport.curves import CurveTransport
from .edits import MODELS

__all__ = ["traced_pearls"]

_SIZE = (168, 60)
_APART = 1.1
_PEARL, _CLOTH = (0.55, 0.5, 0.44), (0.12, 0.01, 0.015)


def _pearls() -> Scene:
    """In a line, each of a material by the name of its model."""
    places = _APART * (np.arange(len(MODELS)) - (len(MODELS) - 1) / 2)
    shapes = [*(sphere((x, 0.5, 0.0), 0.5, 96) for x in places), quad((-9, 0, -9), (0, 0, 18), (18, 0, 0))]
    vertices, triangles = join(*shapes)
    return Scene.from_arrays(
        vertices,
        triangles,
        camera=Camera((0.0, 1.3, 6.0), (0.0, 0.45, 0.0), vertical_fov=12.5, width=_SIZE[0], height=_SIZE[1]),
        materials={name: Material(_PEARL) for name in MODELS} | {"cloth": Material(_CLOTH)},
        material=np.repeat(np.arange(len(shapes)), [len(corners) for _, corners in shapes]),
        name="pearls",
    )


@contextmanager
def traced_pearls(env: Environment, progress: Progress) -> Iterator[CurveTransport]:
    """For as long as it is looked at: it lies in files. White lobes, of which the curve alone is edited."""
    materials = {name: make(0.1) for name, make in MODELS.items()}
    with TemporaryDirectory(prefix="deltalux-", ignore_cleanup_errors=True) as folder:
        path = Path(folder) / "pearls.curves"
        yield precompute_curves(_pearls(), path, env=env, materials=materials, fresnel="fixed", progress=progress)
