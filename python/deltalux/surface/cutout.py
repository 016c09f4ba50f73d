"""Opacity of materials: what of a surface is cut out, and what lets a share of all rays through."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

__all__ = ["Cutout"]


@dataclass(frozen=True, eq=False)
class Cutout:
    """How much of a material is there: a factor, times a picture, times what vertices say.

    Parameters
    ----------
    opacity
        The factor, in [0, 1].
    cutoff
        Where less is there nothing is, and all where it is as much; None: rays go through by chance, as many as are
        to, and each finds the same again.
    picture
        (h, w) float32 in [0, 1], row 0 at the top; with the sampler and the coordinates of the material's texture.
    """

    opacity: float = 1.0
    cutoff: float | None = None
    picture: np.ndarray | None = None
