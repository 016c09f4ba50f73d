"""What pictures show where no surface is: the environment, nothing, or a colour."""

from __future__ import annotations

import re

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._core import Behind
from ..camera import Camera
from ..io import auto_exposure
from ..light.environment import Environment
from ..mistakes import instead_of
from ..transport.transport import Transport
from .catcher import Catcher

__all__ = ["Backdrop", "checked_backdrop"]


def checked_backdrop(word: str) -> str:
    """The word itself; ValueError where it says no background."""
    if word not in ("env", "none") and not (isinstance(word, str) and re.fullmatch(r"#[0-9a-fA-F]{6}", word)):
        raise ValueError(f"expected a background of env, none or #rrggbb, got {word!r}")
    return word


class Backdrop:
    """Pictures of a transport, cut out or before a background.

    Parameters
    ----------
    transport : Transport
        Of pixels, or of vertices.
    word
        ``"env"``, the light; ``"none"``, nothing; or a colour as displays show it, ``"#rrggbb"``.
    camera : Camera, optional
        Of vertices; otherwise that of the transport.
    catcher
        Of the scene's ground nothing is shown but the shadow on it, as `Scene.with_ground` lays it: what stands behind
        is seen through it, by the share of the light that arrives there of what would arrive without the scene.

    Raises
    ------
    TypeError
        If it is no transport.
    ValueError
        If the word says no background, or there is no level ground to catch shadows.
    """

    def __init__(
        self, transport: Transport, word: str = "none", camera: Camera | None = None, *, catcher: bool = False
    ) -> None:
        if not isinstance(transport, Transport):
            raise instead_of("Transport", transport)
        self._transport, self._camera, self._word = transport, camera, checked_backdrop(word)
        self._catcher = Catcher(transport) if catcher else None

    def __repr__(self) -> str:
        catching = ", which catches shadows" if self._catcher else ""
        return f"<Backdrop {self._word!r} of {self._transport!r}{catching}>"

    def picture(
        self, B: ArrayLike, env: Environment, exposure: float = 0.0, V: NDArray[np.float64] | None = None
    ) -> NDArray[np.float32]:
        """The picture of a response.

        Parameters
        ----------
        B : (rows, 3) real
            A product.
        env : Environment
            The light of it.
        exposure
            Stops, after which a colour is what it is.
        V : (columns, 3) float64, optional
            What B is the product of, where that is not all of the light (`Relighter.values`).

        Returns
        -------
        (height, width, 3) float32
            Linear radiance, row 0 at the top. Of ``"none"`` it has a fourth channel: how much of a pixel is covered,
            which colours are multiplied by (associated alpha).

        Raises
        ------
        TypeError
            If an argument is something else.
        ValueError
            If the shape is wrong, or the ground is not level.
        """
        picture, bare = self._lit(B, env, V)
        if self._word == "env":
            return picture
        if self._word == "none":
            return np.concatenate([picture, 1 - bare[..., None]], axis=2)
        encoded = np.array([int(self._word[k : k + 2], 16) for k in (1, 3, 5)]) / 255.0
        linear = np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)
        return np.asarray(picture + bare[..., None] * np.float32(linear * 2.0**-exposure), np.float32)

    def exposure(self, B: ArrayLike, env: Environment) -> float:
        """The exposure that suits what is seen of the light: a colour behind it is none.

        Parameters
        ----------
        B, env
            As for `picture`.

        Returns
        -------
        float
            Stops, as of `deltalux.io.auto_exposure`.

        Raises
        ------
        TypeError, ValueError
            As `picture`.
        """
        return auto_exposure(self._lit(B, env, None)[0])

    def _lit(
        self, B: ArrayLike, env: Environment, V: NDArray[np.float64] | None
    ) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Surfaces, before the light where that is the background, and the share of each pixel that shows none."""
        if not isinstance(env, Environment):
            raise instead_of("Environment", env)
        seen = self._transport.seen(B, self._camera)
        if self._catcher is None:
            picture, bare = seen.picture(), seen.samples.background
        else:
            picture, bare = self._catcher.without(seen, self._transport.coefficients(env) if V is None else V)
        if self._word == "env":
            camera = self._camera or self._transport.camera
            env._behind(Behind(bare, camera.directions()), picture)
        return picture, bare
