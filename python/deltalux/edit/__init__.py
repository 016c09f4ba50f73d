"""Editing reflectance: V is a BRDF curve, and the light stands still; or a family's gamma, under lamps that move."""

from .editor import BrdfEditor, EditedFrame, NeedsPrecompute, StaleTransport
from .studio import Memory, Studio, StudioFrame

__all__ = ["BrdfEditor", "EditedFrame", "Memory", "NeedsPrecompute", "StaleTransport", "Studio", "StudioFrame"]
