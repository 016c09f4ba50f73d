"""The scene that a transport keeps, looked at again: pictures of vertices from any camera."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._core import Behind, ReceiverTable
from .._core import Receivers as Rows
from .._core import Scene as CoreScene
from ..camera import Camera
from ..surface.surface import Surface
from .gloss import Gloss
from .receivers import Pixels, Vertices
from .seen import Seen, Shares

__all__ = ["Views"]

_KEPT = 4
"""Cameras that are remembered: their first rays take longer than all the rest."""


_NO_ROW = np.iinfo(np.uint32).max


@dataclass(frozen=True)
class _View:
    """What a camera's pixels show of the surfaces."""

    rows: Rows
    samples: Pixels
    behind: Behind
    shine: ReceiverTable | None
    """The same with the colours of lobes; None where there are none."""
    mix: NDArray[np.float32]
    """What the eye makes of the response of each row of a factor."""
    glow: NDArray[np.float32] | None
    """The picture of what surfaces give off by themselves; None where none does."""


class Views:
    """Vertices of a scene as cameras see them.

    Values are mixed between vertices, and only then multiplied by the albedo of the point: textures stay sharp.

    Parameters
    ----------
    surface
        The scene.
    corners
        (t, 6) uint32: the rows of each triangle's corners in front, and behind.
    shown
        (vertices,) uint32: the row whose light each vertex shows.
    gloss
        Rows of factors; None where all are diffuse.
    """

    def __init__(
        self, surface: Surface, corners: NDArray[np.uint32], shown: NDArray[np.uint32], gloss: Gloss | None
    ) -> None:
        self._surface, self._corners, self.shown, self._gloss = surface, corners, shown, gloss
        self._views: dict[Camera, _View] = {}

    @staticmethod
    def of(surface: Surface, arrays: Mapping[str, NDArray[Any]], receivers: Vertices) -> Views:
        """From what lies beside a transport of vertices.

        Raises
        ------
        ValueError
            If an array is missing or names rows that are not there.
        """
        gloss = Gloss.of(arrays, receivers) if "base" in arrays else None
        rows = len(receivers) if gloss is None else gloss.first
        shape = {"corners": (len(surface.triangles), 6), "shown": (rows,)}
        for name, expected in shape.items():
            found = arrays.get(name)
            if found is None or found.dtype != np.uint32 or found.shape != expected:
                raise ValueError(f"expected {name} of uint32 and shape {expected}")
        corners, shown = arrays["corners"], arrays["shown"]
        there = corners != _NO_ROW
        if shown.max() >= rows or corners[there].max(initial=0) >= rows:
            raise ValueError(f"expected the corners of triangles to be rows below {rows}")
        return Views(surface, corners, shown, gloss)

    @cached_property
    def _traced(self) -> CoreScene:
        return self._surface.traced()

    @property
    def triangles(self) -> NDArray[np.uint32]:
        """The rows at the corners of all sides that lie open, each wound as it is seen from there: (n, 3) uint32."""
        sides = np.concatenate([self._corners[:, :3], self._corners[:, :2:-1]])
        return np.asarray(sides[(sides != _NO_ROW).all(axis=1)])

    @cached_property
    def _shows(self) -> NDArray[np.uint32]:
        """The rows whose light all sides show; of a side without any, the inside of what is closed, a dark one."""
        there = self._corners != _NO_ROW
        shows = np.full_like(self._corners, len(self.shown))
        shows[there] = self.shown[self._corners[there]]
        return shows

    def _view(self, camera: Camera) -> _View:
        found = self._views.get(camera)
        if found is None:
            rows = self._traced.receivers(camera.rays(), edges=True)
            material = self._surface.material[rows.triangle]
            table = rows.table(
                self._surface.albedo_at(rows.triangle, rows.barycentric, camera), material.astype(np.uint16)
            )
            shine, mix = None, np.zeros((0, 3), np.float32)
            if self._gloss is not None and self._surface.specular is not None:
                shine = rows.table(self._surface.specular[material], material.astype(np.uint16))
                mix = self._gloss.mix(camera)
            emission = self._surface.emission
            samples = Pixels(table)
            glow = None if emission is None else samples.shown(emission[material])
            found = _View(rows, samples, Behind(table.background, camera.directions()), shine, mix, glow)
            while len(self._views) >= _KEPT:
                self._views.pop(next(iter(self._views)), None)
            self._views[camera] = found
        return found

    def seen(self, camera: Camera, B: NDArray[np.float32]) -> Seen:
        """What a camera shows of a response at vertices."""
        view = self._view(camera)
        values = view.rows.interpolated(self._shows, _with_dark(B[: len(self.shown)]))
        besides = view.glow
        if view.shine is not None and self._gloss is not None:
            glossy = _with_dark(self._gloss.seen(B, view.mix))
            shine = view.shine.resolve(view.rows.interpolated(self._shows, glossy))
            besides = shine if besides is None else shine + besides
        return Seen(view.samples, values, besides)

    def shares(self, camera: Camera, rows: int) -> Shares:
        """What a camera's pixels show of each vertex; ValueError where lobes depend on the eye."""
        if self._gloss is not None:
            raise ValueError("expected vertices that look alike from everywhere, but these have factors of lobes")
        view = self._view(camera)
        side = self._shows[view.rows.triangle].reshape(-1, 2, 3)
        corners = side[np.arange(len(side)), view.rows.back.astype(int)].astype(np.intp)
        second, third = view.rows.barycentric.astype(np.float64).T
        # The inside of what is closed has no row, and is dark.
        lit = corners < len(self.shown)
        weights = np.where(lit, np.stack([1 - second - third, second, third], -1), 0.0)
        return Shares(view.samples.image_shape, rows, view.samples, np.where(lit, corners, 0), weights)

    def behind(self, camera: Camera) -> Behind:
        """What puts an environment behind the scene."""
        return self._view(camera).behind


def _with_dark(values: NDArray[np.float32]) -> NDArray[np.float32]:
    return np.concatenate([values, np.zeros((1, 3), np.float32)])
