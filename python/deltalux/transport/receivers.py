"""What the rows of M are: pixels of a camera, vertices of a mesh, or samples of surfaces."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._core import ReceiverTable

__all__ = ["GatherSamples", "Pixels", "Receivers", "Vertices", "of_table"]


class _Points:
    """What all receivers have in common: a surface point a row."""

    kind: str
    """What errors call them."""

    def __init__(self, core: ReceiverTable) -> None:
        self._core = core

    def __len__(self) -> int:
        return len(self._core)

    def __repr__(self) -> str:
        return f"<{type(self).__name__}, {len(self):,} rows>"

    @property
    def nbytes(self) -> int:
        """Bytes of all that is kept of them."""
        return self._core.nbytes

    @cached_property
    def position(self) -> NDArray[np.float32]:
        """World coordinates, (rows, 3), in scene units."""
        return self._core.position

    @cached_property
    def normal(self) -> NDArray[np.float32]:
        """Unit normals, (rows, 3)."""
        return self._core.normal

    @cached_property
    def albedo(self) -> NDArray[np.float32]:
        """Diffuse reflectance, linear RGB, (rows, 3)."""
        return self._core.albedo

    @cached_property
    def material(self) -> NDArray[np.uint16] | None:
        """The number of each row's material, (rows,), or None where the file does not say."""
        return self._core.material


class Pixels(_Points):
    """Samples of a camera's pixels: each surface that a pixel shows is a row."""

    kind = "pixels"

    @property
    def image_shape(self) -> tuple[int, int]:
        """(height, width) of the image that they resolve into."""
        return self._core.image_shape

    @cached_property
    def pixel(self) -> NDArray[np.uint32]:
        """The pixel that each row adds to, row-major, (rows,)."""
        return self._core.pixel

    @cached_property
    def weight(self) -> NDArray[np.float32]:
        """The share of its pixel that each row stands for, (rows,)."""
        return self._core.weight

    @cached_property
    def background(self) -> NDArray[np.float32]:
        """The share of each pixel that sees no surface, (height, width)."""
        return self._core.background

    def resolve(self, B: ArrayLike) -> NDArray[np.float32]:
        """The picture of a response on black.

        Parameters
        ----------
        B
            (rows, 3) float32: a product.

        Returns
        -------
        (height, width, 3) float32
            Linear radiance, row 0 at the top.
        """
        return self._core.resolve(np.ascontiguousarray(B, np.float32))

    def shown(self, colours: ArrayLike) -> NDArray[np.float32]:
        """The picture of colours as they are, without the albedos that a response gets, on black.

        Parameters
        ----------
        colours
            (rows, 3)

        Returns
        -------
        (height, width, 3) float32
            Row 0 at the top.
        """
        height, width = self.image_shape
        of = np.asarray(colours).T
        planes = [np.bincount(self.pixel, self.weight * own, height * width) for own in of]
        return np.stack(planes, -1).reshape(height, width, 3).astype(np.float32)


class Vertices(_Points):
    """Vertices of a mesh."""

    kind = "vertices"

    @cached_property
    def vertex(self) -> NDArray[np.uint32]:
        """The number of each row's vertex, (rows,)."""
        return self._core.vertex

    @cached_property
    def buried(self) -> NDArray[np.bool_]:
        """Whether a vertex lies inside something and sees nothing, (rows,)."""
        return self._core.buried.astype(bool)


class GatherSamples(_Points):
    """Samples of surfaces whose light is transferred, in the order of their tree (Nguyen 2010)."""

    kind = "gather samples"

    @cached_property
    def area(self) -> NDArray[np.float32]:
        """The area that each stands for, in scene units squared, (rows,)."""
        return self._core.area


Receivers = Pixels | Vertices | GatherSamples
_CLASSES: dict[str, Any] = {"pixels": Pixels, "vertices": Vertices, "gather": GatherSamples}


def of_table(core: ReceiverTable) -> Receivers:
    """The receivers of a file by their kind."""
    found: Receivers = _CLASSES[core.kind](core)
    return found
