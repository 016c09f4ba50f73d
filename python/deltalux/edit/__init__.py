"""Editing reflectance: V is a BRDF curve, and the light stands still."""

from .editor import BrdfEditor, EditedFrame, NeedsPrecompute, StaleTransport

__all__ = ["BrdfEditor", "EditedFrame", "NeedsPrecompute", "StaleTransport"]
