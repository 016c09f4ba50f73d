"""Quality: how closely M is computed, in presets named by outcome."""

from __future__ import annotations

from dataclasses import dataclass, replace


@dataclass(frozen=True)
class Quality:
    """How closely M is computed and how much of it is kept.

    Attributes
    ----------
    edges
        Whether pixels that show several surfaces become several receivers.
    edge_side
        A texel that an edge runs through takes edge_side x edge_side rays; 0 lets its centre speak for it.
    tolerance
        Relative L2 error of the image that truncation may cause. Where columns have texels: the worst, measured under
        the built-in lights and a sun (`lights.py`); else expected, under light with the spectrum of natural scenes.
    width
        Integers of 8 or 16 bits.
    spacing
        Of nodes between which light bounces: this share of the distance to other surfaces.
    node_rays
        Rays of a node, along each side of their stratification.
    audit
        A receiver gathers from what its own rays meet where the mean albedo that its nodes see is off by more.
    emission_rays
        Rays of a row to what gives off light, and as many of its lobe, along each side of their stratification.
    """

    edges: bool
    edge_side: int
    tolerance: float
    width: str
    spacing: float
    node_rays: int
    audit: float
    emission_rays: int


_PUBLICATION = Quality(
    edges=True,
    edge_side=3,
    tolerance=0.01,
    width="i8",
    spacing=0.16,
    node_rays=32,
    audit=0.05,
    emission_rays=16,
)
QUALITIES = {
    "preview": replace(
        _PUBLICATION, edges=False, edge_side=0, tolerance=0.03, spacing=0.2, node_rays=16, emission_rays=8
    ),
    "publication": _PUBLICATION,
    "lossless": replace(_PUBLICATION, edge_side=4, tolerance=0.0, width="i16"),
}
"""Presets by outcome; `lossless` keeps every coefficient above 2^-24."""
