"""The lights that a transport is measured under: a preset's number is the worst error of the picture among them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from ..columns.haar import PEAKS, Haar
from ..columns.parse import Columns
from ..light.environment import Environment
from ..light.skies import BUILTIN

__all__ = ["Light", "lights"]

_TURNS = (0.0, 140.0)
"""Degrees about y: a light is not kinder to a scene from one side."""
_FEW = 16
"""Peaks of a light that has more lamps than are taken out: as if the rest of them stayed in the wavelets."""


@dataclass(frozen=True)
class Light:
    """A light that truncation is measured under.

    Attributes
    ----------
    name
        "sky", "studio", "hall", or "sun": one texel of the sky.
    peaks
        How many peaks go through texels; None where there are no texels.
    decides
        Whether the threshold is chosen by it.
    truncated
        Its coefficients in the columns that are truncated: (columns, 3) float64.
    whole
        All of it in the same columns.
    """

    name: str
    peaks: int | None
    decides: bool
    truncated: NDArray[np.float64]
    whole: NDArray[np.float64]


@lru_cache(maxsize=2)
def lights(columns: Columns) -> tuple[Light, ...]:
    """What transports in these columns are measured under.

    Where there are texels the threshold is chosen by them: under the sky, the studio, the hall and a sun, with as many
    peaks as are taken out of any map, and of the two with many lamps with few as well. Without texels, where a sun
    leaves a coherent error that no threshold within reason mends, they only tell.

    Parameters
    ----------
    columns
        Of the transport.

    Returns
    -------
    tuple of Light
    """
    every = [(name, Environment.builtin(name)) for name in BUILTIN] + [("sun", _sun(columns))]
    if not (isinstance(columns, Haar) and columns.texels):
        told = ((name, columns.coefficients(env)) for name, env in every)
        return tuple(Light(name, None, False, V, V) for name, V in told)
    found = []
    for name, env in every:
        for degrees in _TURNS if name != "sun" else _TURNS[:1]:
            turned = env.rotated(degrees)
            whole = _stored(columns, turned, 0)
            several = name in ("studio", "hall")
            found += [
                Light(name, peaks, peaks > 0, _stored(columns, turned, peaks), whole)
                for peaks in ((PEAKS, _FEW) if several else (PEAKS,)) + ((0,) if degrees == 0 else ())
            ]
    return tuple(found)


def _stored(columns: Haar, env: Environment, peaks: int) -> NDArray[np.float64]:
    return columns.coefficients(env, peaks)[: columns.wavelets]


def _sun(columns: Columns) -> Environment:
    """One texel of the cubemap, in the upper half of a side."""
    n = columns.face
    texels = np.zeros((6, n, n, 3), np.float32)
    texels[0, n // 4, n // 3] = 1.0
    return Environment.from_cubemap(texels)
