"""AgX: a tone curve that keeps suns and lamps from turning into flat patches of pure colour.

Source: Troy Sobotka's AgX (github.com/sobotka/AgX) in the polynomial fit of Benjamin Wrensch, "Minimal AgX
implementation" (iolite-engine.com/blog_posts/minimal_agx_implementation): colours are drawn together, their logarithms
between two exposures go through a sigmoid, and are drawn apart again.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

_INSET = np.array(
    [
        [0.842479062253094, 0.0784335999999992, 0.0792237451477643],
        [0.0423282422610123, 0.878468636469772, 0.0791661274605434],
        [0.0423756549057051, 0.0784336, 0.879142973793104],
    ]
)
_OUTSET = np.array(
    [
        [1.19687900512017, -0.0980208811401368, -0.0990297440797205],
        [-0.0528968517574562, 1.15190312990417, -0.0989611768448433],
        [-0.0529716355144438, -0.0980434501171241, 1.15107367264116],
    ]
)
_STOPS = (-12.47393, 4.026069)
_SIGMOID = (15.5, -40.14, 31.96, -6.868, 0.4298, 0.1191, -0.00232)


def agx(linear: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Linear radiance (..., 3) as 8 bits for an sRGB display; NaN is black."""
    colours = np.maximum(np.nan_to_num(linear, nan=0.0, posinf=2.0**17), 0) @ _INSET.T
    low, high = _STOPS
    stops = np.log2(np.maximum(colours, 2.0**low)).clip(low, high)
    shown = np.polyval(_SIGMOID, (stops - low) / (high - low)) @ _OUTSET.T
    return np.asarray(np.round(255 * shown.clip(0, 1)), np.uint8)
