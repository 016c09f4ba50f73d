"""Other views of a scene whose transport is there: what does not depend on the camera is taken over."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

from ..camera import Camera
from ..progress import Progress
from ..scene.scene import GROUND, Scene
from ..transport.makers import maker
from ..transport.transport import Transport
from .between import KnownNodes
from .planning import GLOSS
from .preparation import Request
from .room import check_folder_of
from .run import Precomputation

__all__ = ["for_camera"]


@maker("for_camera")
def for_camera(
    transport: Transport, camera: Camera, path: str | os.PathLike[str], progress: bool | Progress = True
) -> Transport:
    """What `Transport.for_camera` asks."""
    if transport.receivers.kind != "pixels":
        kind = transport.receivers.kind
        raise ValueError(f"expected a transport of pixels for another camera, but its rows are {kind}; `render` them")
    check_folder_of(Path(path))
    plan = transport.plan
    # A file keeps the name of one material alone.
    names = () if plan.ground is None else ("",) * plan.ground + (GROUND,)
    scene = replace(Scene.of_surface(transport.surface, camera, plan.scene), names=names)
    gloss = all(left_out.what != GLOSS for left_out in plan.left_out)
    request = Request(str(transport.columns), plan.quality, plan.tolerance, gloss=gloss)
    known = KnownNodes(transport) if transport.nodes else None
    return Precomputation(scene, request, known, progress).run(path)
