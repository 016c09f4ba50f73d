"""A picture as the bytes of a PNG, for a notebook."""

from __future__ import annotations

import io

import numpy as np
from numpy.typing import NDArray


def encoded(picture: NDArray[np.uint8]) -> bytes:
    """(h, w, 3) of 8-bit sRGB as a PNG."""
    from PIL import Image

    data = io.BytesIO()
    Image.fromarray(picture).save(data, "png")
    return data.getvalue()
