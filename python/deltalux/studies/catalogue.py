"""All studies by name."""

from __future__ import annotations

from . import peaks
from .clustered import clusters
from .coherence import coverage, energy, equal_quality, equal_time, evolution, lighting_error, phase_map, reset_raster
from .factored import factors, views
from .harmonics import blocker, two_bases
from .interreflection import bounces, slides
from .reflectance import curves, families, freezing, gather
from .shape import Study

__all__ = ["STUDIES"]

STUDIES: dict[str, Study] = {
    "lighting-error": lighting_error.STUDY,
    "evolution": evolution.STUDY,
    "coverage": coverage.STUDY,
    "energy": energy.STUDY,
    "resets": reset_raster.STUDY,
    "equal-quality": equal_quality.STUDY,
    "phase-map": phase_map.STUDY,
    "equal-time": equal_time.STUDY,
    "peaks": peaks.STUDY,
    "factors": factors.STUDY,
    "views": views.STUDY,
    "clusters": clusters.STUDY,
    "harmonics": two_bases.STUDY,
    "blocker": blocker.STUDY,
    "bounces": bounces.STUDY,
    "slides": slides.STUDY,
    "curves": curves.STUDY,
    "families": families.STUDY,
    "gather": gather.STUDY,
    "freezing": freezing.STUDY,
}
"""By name, in the order of the papers."""
