"""A picture as the bytes of a file: for a notebook, a page, or a link."""

from __future__ import annotations

import io
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["encoded"]


def encoded(picture: NDArray[np.uint8], kind: str = "png", **options: Any) -> bytes:
    """(h, w, 3) of 8-bit sRGB as a file of a kind that Pillow writes, with its options."""
    from PIL import Image

    data = io.BytesIO()
    Image.fromarray(picture).save(data, kind, **options)
    return data.getvalue()
