"""The demo: a plant under a turning sky, from triangles to a page, in two minutes on two cores."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

from .environment import Environment
from .motion import Motion
from .output import nearest
from .plan import check_room
from .precompute import plan, precompute
from .progress import Progress
from .report import check_report, report
from .scene import Scene

__all__ = ["COLUMNS", "FOLDER", "SIZE", "demo"]

FOLDER = "deltalux-demo"
# As large as two cores finish in two minutes.
SIZE = (128, 128)
COLUMNS = "haar:32"
QUALITY = "publication"
_TRANSPORT = "plant.transport"


def demo(
    folder: str | os.PathLike[str] = FOLDER,
    *,
    size: tuple[int, int] = SIZE,
    columns: str = COLUMNS,
    frames: int = 100,
    hold: int = 25,
    progress: bool | Progress = True,
    say: Callable[[object], None] = print,
) -> Path:
    """Builds the plant, precomputes its transport, replays a turning sky and a turning hall, and writes the report.

    The sky has one sun, which is most of its light; the hall has many windows and lamps, as the papers' cathedral.

    Returns
    -------
    Path
        The page, index.html; the transport lies beside it.

    Raises
    ------
    ValueError, OSError
        As `precompute` and `report`.
    """
    path = Path(folder)
    motion = Motion(frames=frames, hold=hold)
    envs = [Environment.builtin("sky"), Environment.builtin("hall")]
    scene = Scene.builtin("plant")
    scene = scene.with_camera(scene.camera.resized(*size))
    drawn = plan(scene, columns=columns, quality=QUALITY)
    check_report(envs, path, motion)
    check_room(drawn, nearest(path) / _TRANSPORT)
    say(drawn)
    path.mkdir(parents=True, exist_ok=True)
    transport = precompute(scene, path / _TRANSPORT, columns=columns, quality=QUALITY, progress=progress)
    say(transport)
    return report(transport, envs, path, frames=frames, hold=hold, progress=progress)
