"""The plane under a scene as a shadow catcher: it shows nothing but the light that the scene keeps from it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..columns.haar import Haar
from ..light.environment import Environment
from ..transport.seen import Seen
from ..transport.transport import Transport

__all__ = ["Catcher"]

_LUMINANCE = np.array([0.2126, 0.7152, 0.0722])
_ROWS = 1024
"""Of the map of the plane's cosine: its error in a product is below 1e-5."""
_LEVEL = 1e-3


class Catcher:
    """What a level plane without the scene would receive is known of any light: a plane has one row of M.

    So the share of light that is kept from a sample of it follows from the response there, without a second transport.

    Parameters
    ----------
    transport
        Of a scene with a material called "ground", as `Scene.with_ground` makes it.

    Raises
    ------
    ValueError
        If there is none, or it is not level.
    """

    def __init__(self, transport: Transport) -> None:
        self._transport, self._ground = transport, transport.plan.ground
        if self._ground is None:
            raise ValueError(
                "expected a transport of a scene on a ground to catch shadows, but nothing of this one is called so: "
                "`deltalux precompute --ground` and Scene.with_ground lay one"
            )
        self._rows: dict[float, NDArray[np.float64]] = {}

    def without(self, seen: Seen, V: NDArray[np.float64]) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """What is seen besides the ground, (height, width, 3), and the share of each pixel that is open: it shows no
        surface, or ground, as far as that is lit.

        Parameters
        ----------
        seen
            Of this transport.
        V
            (columns, 3): the light of it, as it was multiplied.
        """
        samples = seen.samples
        ground = np.zeros(len(samples), bool) if samples.material is None else samples.material == self._ground
        up = samples.normal[ground, 1]
        if len(up) and np.abs(up - np.sign(up[0])).max() > _LEVEL:
            raise ValueError("expected a level ground to catch shadows, but that of this scene is not")
        side = float(np.sign(up[0])) if len(up) else 1.0
        # Light that comes back from the scene can outshine its shadow: that shows nothing.
        whole = float(_LUMINANCE @ self._open(side, V))
        lit = (seen.values[ground] @ _LUMINANCE / whole).clip(0.0, 1.0) if whole > 0 else np.ones(len(up))
        height, width = samples.image_shape
        shares = np.bincount(samples.pixel[ground], samples.weight[ground] * lit, height * width)
        values = np.where(ground[:, None], np.float32(0), seen.values)
        return seen.picture(values), (samples.background + shares.reshape(height, width)).astype(np.float32).clip(0, 1)

    def _open(self, side: float, V: NDArray[np.float64]) -> NDArray[np.float64]:
        """What arrives at a plane that nothing stands on, (3,): M has its albedo 1, as of all rows."""
        columns = self._transport.columns
        if side not in self._rows:
            height = side * np.cos(np.pi * (np.arange(_ROWS) + 0.5) / _ROWS)
            cosine = np.broadcast_to((height.clip(0.0) / np.pi)[:, None, None], (_ROWS, 8, 3))
            lobe = columns.coefficients(Environment.from_latlong(cosine, rows="centre"))
            self._rows[side] = self._in_wavelets(lobe)[:, 0]
        return np.asarray(self._rows[side] @ self._in_wavelets(V))

    def _in_wavelets(self, V: NDArray[np.float64]) -> NDArray[np.float64]:
        """Texels among the columns overlap the others: without them all are orthonormal."""
        columns = self._transport.columns
        return columns.without_texels(V) if isinstance(columns, Haar) else V
