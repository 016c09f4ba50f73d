"""The built-in scenes."""

from __future__ import annotations
from .plant import plant
SCENES = {"plant": plant}
def build(name, camera=None):
    return SCENES[name]()
