"""Pictures in a strip, and cubemaps as pictures: unfolded to a cross, and parts of them enlarged."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..io import to_display

__all__ = ["CORNER", "cross", "label", "show", "window"]

CORNER: dict[str, Any] = {"color": "white", "fontsize": 7, "bbox": {"color": "#202020", "pad": 1.5, "linewidth": 0}}
"""How a figure in the corner of a picture looks."""

_CROSS = {"+Y": (0, 1, 2), "-X": (1, 0, 1), "-Z": (1, 1, 5), "+X": (1, 2, 0), "+Z": (1, 3, 4), "-Y": (2, 1, 3)}
"""Where each face stands in the cross, which looks along -Z in its middle: row, column, and number of the face."""


def cross(cubemap: NDArray[Any], outside: float) -> NDArray[Any]:
    """Six faces (6, n, n, c) unfolded, with +X to the right and up above: (3 n, 4 n, c)."""
    n = cubemap.shape[1]
    unfolded = np.full((3 * n, 4 * n, cubemap.shape[3]), outside, cubemap.dtype)
    for name, (row, column, face) in _CROSS.items():
        faces = cubemap[face]
        # OpenGL's faces are seen from outside: from inside they are mirrored.
        turned = faces[::-1] if name in ("+Y", "-Y") else faces[:, ::-1]
        unfolded[row * n : (row + 1) * n, column * n : (column + 1) * n] = turned
    return unfolded


def window(picture: NDArray[Any], peak: NDArray[Any], size: int) -> NDArray[Any]:
    """The part (size, size, 3) of a picture around the largest value of another."""
    height, width = picture.shape[:2]
    row, column = np.unravel_index(int(np.argmax(peak.max(axis=2))), (height, width))
    top, left = np.clip(row - size // 2, 0, height - size), np.clip(column - size // 2, 0, width - size)
    return picture[top : top + size, left : left + size]


def show(panel: Any, picture: NDArray[np.float32], stops: float, corner: str | None = None) -> None:
    """Linear radiance at an exposure, with a text in the corner."""
    panel.imshow(to_display(picture, stops), interpolation="nearest")
    panel.set_axis_off()
    if corner:
        panel.text(0.02, 0.03, corner, transform=panel.transAxes, **CORNER)


def label(panel: Any, text: str) -> None:
    """To the left of a line of pictures."""
    panel.text(-0.03, 0.5, text, rotation=90, va="center", ha="right", transform=panel.transAxes, fontsize=9)
