"""Texture coordinates of all that a studio's diffuse light is made of: a picture that is laid over a material later is
looked up there."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..surface.texture import bilinear, filtered
from .folder import array

__all__ = ["Coordinates"]

_NAMES = ("uv_view", "uv_steps", "uv_cells", "uv_starts", "uv_nodes")


@dataclass(frozen=True, eq=False)
class Coordinates:
    """Where each row of the view, gather sample and node lies in a picture.

    Attributes
    ----------
    view : (rows, 2) float32
        The middle of what a row shows.
    steps : (rows, 2, 2) float32
        How far a step to the next pixel leads, to the right and upwards: textures are filtered over it.
    cells : (places, 2) float32
        Places in the cells of gather samples, one sample after the other.
    starts : (samples + 1,) uint32
        Where the places of each sample begin.
    nodes : (nodes, places, 2) float32
        The same of nodes; of none where a studio has none.
    """

    view: NDArray[np.float32]
    steps: NDArray[np.float32]
    cells: NDArray[np.float32]
    starts: NDArray[np.uint32]
    nodes: NDArray[np.float32]

    def colours(self, picture: NDArray[np.float32], of: str) -> NDArray[np.float64]:
        """What a picture shows of each row of the "view", or of "samples" or "nodes" in the mean of their cells.

        Parameters
        ----------
        picture : (h, w, 3) float32
            Row 0 is the top; it repeats.
        of
            As above.

        Returns
        -------
        (k, 3) float64
        """
        if of == "view":
            return np.asarray(filtered(picture, self.view, self.steps), np.float64)
        if of == "nodes":
            each = bilinear(picture, self.nodes.reshape(-1, 2)).reshape(*self.nodes.shape[:2], 3)
            return np.asarray(each.mean(axis=1), np.float64)
        starts = self.starts.astype(np.intp)
        return np.add.reduceat(bilinear(picture, self.cells), starts[:-1]) / np.diff(starts)[:, None]

    def arrays(self) -> dict[str, NDArray[Any]]:
        """All of it by name, for a file."""
        return dict(zip(_NAMES, (self.view, self.steps, self.cells, self.starts, self.nodes), strict=True))

    @staticmethod
    def of_arrays(stored: Mapping[str, NDArray[Any]], rows: int, samples: int, nodes: int) -> Coordinates | None:
        """From the arrays of a file, whoever wrote it; None where it has none.

        Raises
        ------
        ValueError
            If they are of other rows, samples or nodes.
        """
        if not any(name in stored for name in _NAMES):
            return None
        places, each = len(stored["uv_cells"]), stored["uv_nodes"].shape[1]
        shapes = ((rows, 2), (rows, 2, 2), (places, 2), (samples + 1,), (nodes, each, 2))
        kinds = (np.float32, np.float32, np.float32, np.uint32, np.float32)
        found = [array(stored, *own) for own in zip(_NAMES, kinds, shapes, strict=True)]
        starts = found[3].astype(np.int64)
        if starts[0] != 0 or starts[-1] != places or (np.diff(starts) < 1).any() or (nodes and each < 1):
            raise ValueError("expected places in the cell of each sample and node")
        return Coordinates(*found)
