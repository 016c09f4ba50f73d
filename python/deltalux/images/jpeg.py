"""A picture as the bytes of a JPEG, for a link that is too slow for numbers."""

from __future__ import annotations

import io

import numpy as np
from numpy.typing import NDArray

__all__ = ["encoded_jpeg"]


def encoded_jpeg(picture: NDArray[np.uint8], quality: int) -> bytes:
    """(h, w, 3) of 8-bit sRGB as a JPEG."""
    from PIL import Image

    data = io.BytesIO()
    Image.fromarray(picture).save(data, "jpeg", quality=quality)
    return data.getvalue()
