"""Cameras of a data set: from a file, or around what one of them looks at."""

from __future__ import annotations

import json
import os
from dataclasses import asdict, replace

import numpy as np

from ..camera import Camera
from ..checks import as_vector, count
from ..mistakes import instead_of
from ..plain import MOST_TEXT, read_plain
from ..rotation import rotation_matrix

__all__ = ["read_cameras", "turntable"]


def turntable(camera: Camera, number: int) -> list[Camera]:
    """A camera, and others around what it looks at, all as far from each other.

    Parameters
    ----------
    camera
        The first.
    number
        How many in all. They go about the axis of its `up` through its target, by the right-hand rule.

    Returns
    -------
    list of Camera

    Raises
    ------
    TypeError, ValueError
        If it is no camera, or the number none of 1 or more.
    """
    if not isinstance(camera, Camera):
        raise instead_of("Camera", camera)
    if count("number", number) < 1:
        raise ValueError(f"expected at least one camera, got {number}")
    away = np.subtract(camera.position, camera.target)
    turns = (rotation_matrix(360.0 * k / number, camera.up) for k in range(number))
    return [replace(camera, position=as_vector(camera.target + turn @ away)) for turn in turns]


def read_cameras(path: str | os.PathLike[str], like: Camera) -> list[Camera]:
    """Cameras from a JSON file, a list of objects with the fields of `Camera`.

    Parameters
    ----------
    path
        Of the file.
    like
        What a camera is where it does not say: its size, its field of view, its up.

    Raises
    ------
    ValueError
        If it is no such list.
    OSError
        If it cannot be read.
    """
    name = os.fspath(path)
    usual = {k: v for k, v in asdict(like).items() if k not in ("position", "target")}
    try:
        cameras = [Camera(**(usual | fields)) for fields in json.loads(read_plain(path, MOST_TEXT))]
    except (TypeError, ValueError, RecursionError) as error:
        raise ValueError(
            f'{name}: expected cameras like [{{"position": [0, 1, 5], "target": [0, 1, 0]}}]: {error}'
        ) from None
    if not cameras:
        raise ValueError(f"{name}: expected at least one camera, found none")
    return cameras
