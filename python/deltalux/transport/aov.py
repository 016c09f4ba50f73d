"""What the pixels of a transport show, besides light: layers for denoisers, compositors and data sets."""

from __future__ import annotations

from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from ..camera import Camera
from ..checks import one_of
from .receivers import Pixels

Number = TypeVar("Number", np.float32, np.int32)

AOVS = ("albedo", "normal", "depth", "position", "material", "mask")


def aov(pixels: Pixels, camera: Camera | None, name: str) -> NDArray[np.float32] | NDArray[np.int32]:
    """One layer; `Transport.aov` says what is in it."""
    one_of("an aov", name, AOVS)
    if name == "albedo":
        return pixels.shown(pixels.albedo)
    if name == "mask":
        return 1 - pixels.background
    if name == "normal":
        return _of_largest(pixels, pixels.normal, np.float32(0))
    if name == "position":
        return _of_largest(pixels, pixels.position, np.float32(np.nan))
    if name == "depth":
        if camera is None:
            raise ValueError("expected a transport with a camera for depth, but its file names none")
        distance = np.linalg.norm(pixels.position - np.asarray(camera.position), axis=1)
        return _of_largest(pixels, distance.astype(np.float32), np.float32(np.inf))
    if pixels.material is None:
        raise ValueError("expected a transport that knows its materials, but its file was made before it kept them")
    return _of_largest(pixels, pixels.material.astype(np.int32), np.int32(-1))


def _of_largest(pixels: Pixels, values: NDArray[Number], empty: Number) -> NDArray[Number]:
    """Of each pixel what its largest surface has: means of two surfaces lie on neither."""
    height, width = pixels.image_shape
    # The last row that is written stays: the largest.
    order = np.argsort(pixels.weight, kind="stable")
    layer = np.full((height * width, *values.shape[1:]), empty, values.dtype)
    layer[pixels.pixel[order]] = values[order]
    return layer.reshape(height, width, *values.shape[1:])
