"""What pictures show where no surface is: the environment, nothing, or a colour."""

from __future__ import annotations

import re

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..camera import Camera
from ..light.environment import Environment
from ..transport.transport import Transport

__all__ = ["Backdrop", "checked_backdrop"]


def checked_backdrop(word: str) -> str:
    """The word itself; ValueError where it says no background."""
    if word not in ("env", "none") and not re.fullmatch(r"#[0-9a-fA-F]{6}", word):
        raise ValueError(f"expected a background of env, none or #rrggbb, got {word!r}")
    return word


class Backdrop:
    """The background of a transport's pictures.

    Parameters
    ----------
    transport
        Of pixels, or of vertices.
    word
        "env", "none" (black), or a colour as displays show it, "#rrggbb".
    camera
        Of vertices; None: that of the transport.

    Raises
    ------
    ValueError
        If the word says no background.
    """

    def __init__(self, transport: Transport, word: str = "env", camera: Camera | None = None) -> None:
        self._transport, self._camera, self._word = transport, camera, checked_backdrop(word)
        self._open: NDArray[np.float32] | None = None
        if word.startswith("#"):
            # What even light behind the scene adds to a picture is the share of each pixel that shows nothing else.
            dark, even = np.zeros((transport.shape[0], 3), np.float32), np.ones((2, 4, 3), np.float32)
            self._open = self._picture(dark, Environment.from_latlong(even)) - self._picture(dark, None)

    def picture(self, B: ArrayLike, env: Environment, exposure: float = 0.0) -> NDArray[np.float32]:
        """The picture of a response, (height, width, 3); a colour is what it is after `exposure` stops."""
        if self._open is None:
            return self._picture(B, env if self._word == "env" else None)
        encoded = np.array([int(self._word[k : k + 2], 16) for k in (1, 3, 5)]) / 255.0
        linear = np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)
        colour = np.asarray(linear * 2.0**-exposure, np.float32)
        return np.asarray(self._picture(B, None) + self._open * colour, np.float32)

    def _picture(self, B: ArrayLike, env: Environment | None) -> NDArray[np.float32]:
        if self._camera is None:
            return self._transport.image(B, env)
        return self._transport.render(self._camera, np.asarray(B, np.float32), env)
