"""The image of a scene under one basis function: a column of M, which takes a renderer with negative lights."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..._core import haar_inverse
from ...columns import Haar
from ...relight.errors import relative_errors
from ...sphere import face_directions
from ...transport.transport import Transport
from ..case import Light
from ..harmonics.projection import HarmonicView

__all__ = ["BasisImage", "error_of_sum", "haar_images", "harmonic_images"]

_DEGREES = 4
_FACES = 3
"""Of the cube, of which each band shows a wavelet."""
_TEXELS = 32
"""Along a face, where a harmonic is drawn."""


class BasisImage(NamedTuple):
    """A function as a cubemap (6, n, n), and the scene in its light (height, width), NaN where there is no surface."""

    column: int
    name: str
    function: NDArray[np.floating]
    picture: NDArray[np.float64]


def harmonic_images(transport: Transport, view: HarmonicView) -> list[list[BasisImage]]:
    """The first degrees, each in the order of m."""
    functions = view.columns.evaluate(face_directions(_TEXELS))
    return [
        [
            BasisImage(column, f"l = {degree}, m = {m}", functions[..., column], _lit(transport, view.rows[:, column]))
            for m, column in zip(range(-degree, degree + 1), range(degree**2, (degree + 1) ** 2), strict=True)
        ]
        for degree in range(_DEGREES)
    ]


def haar_images(transport: Transport) -> list[list[BasisImage]]:
    """Band by band the wavelets that reach the scene most, of several faces; of band 0, its scaling functions."""
    columns, norms = transport.columns, transport.column_norms
    assert isinstance(columns, Haar)
    bands = []
    for band, name in enumerate(columns.band_names):
        own = np.flatnonzero(columns.bands == band)
        # Columns of a band are numbered face by face.
        faces = own[:6, None] if band == 0 else own.reshape(6, -1)
        strongest = faces[np.arange(6), norms[faces].argmax(axis=1)]
        chosen = strongest[np.argsort(-norms[strongest], kind="stable")[:_FACES]]
        alone = np.zeros((columns.columns, _FACES))
        alone[chosen, np.arange(_FACES)] = 1.0
        functions, rows = haar_inverse(columns.size, alone), transport.matmat(alone)
        bands.append(
            [
                BasisImage(int(column), f"{name} texels", functions[..., k], _lit(transport, rows[:, k]))
                for k, column in enumerate(chosen)
            ]
        )
    return bands


def error_of_sum(transport: Transport, V: Light, images: Sequence[BasisImage]) -> float:
    """How far the sum of these images, each times its coefficient of the light, is from the picture of their light."""
    columns = [image.column for image in images]
    weights = V[columns].mean(axis=1)
    light = np.zeros(len(V))
    light[columns] = weights
    summed = sum(weight * image.picture for weight, image in zip(weights, images, strict=True))
    return relative_errors(np.nan_to_num(summed), np.nan_to_num(_lit(transport, transport.matmat(light))))[1]


def _lit(transport: Transport, values: NDArray[np.floating]) -> NDArray[np.float64]:
    """The picture of a signed response, the mean of its colours."""
    picture = transport.image(np.repeat(values[:, None], 3, axis=1)).mean(axis=2, dtype=np.float64)
    return np.where(transport.pixels.background < 1, picture, np.nan)
