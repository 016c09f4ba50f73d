"""Models of reflectance, and measured ones.

f(wi, wo) is the radiance reflected to ``wo`` over the irradiance from ``wi``, 1 / sr. Directions are in the local frame
of the surface: z is the normal, x the tangent of anisotropic models; both point away from the surface, ``wi`` to the
light and ``wo`` to the eye. They may have any length and broadcast. Where one is not above the horizon, all is 0.

What each does with energy and reciprocity, over the range of its parameters and with F = 1, as
`tests/python/test_brdf.py` measures it (and holds this table to it): the largest directional albedo of angles up to 89
and up to 75 degrees, and the largest difference of f(wi, wo) and f(wo, wi) over their mean. Only `WardDuer` reflects
more light than there is, near the horizon.

================  ==============  ==============  =========
model             largest albedo  up to 75 deg    asymmetry
================  ==============  ==============  =========
Lambert           1.000           1.000           rounding
Phong             1.000           1.000           rounding
BlinnPhong        1.000           1.000           rounding
Lafortune         1.000           1.000           rounding
Ward              1.000           1.000           rounding
WardDuer          6.443           1.000           rounding
CookTorrance      1.000           1.000           rounding
Beckmann          1.000           1.000           rounding
GGX               1.000           1.000           rounding
AshikhminShirley  1.000           1.000           rounding
================  ==============  ==============  =========
"""

from .measured import Measured
from .microfacet import GGX, Beckmann, CookTorrance
from .model import Model
from .phenomenological import AshikhminShirley, BlinnPhong, Lafortune, Lambert, Phong, Ward, WardDuer

__all__ = [
    "AshikhminShirley",
    "Beckmann",
    "BlinnPhong",
    "CookTorrance",
    "GGX",
    "Lafortune",
    "Lambert",
    "Measured",
    "Model",
    "Phong",
    "Ward",
    "WardDuer",
]
