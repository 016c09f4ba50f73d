"""The live view: a transport in the browser, under a light or materials that are moved by hand (PROTOCOL.md)."""

from .handle import View, view

__all__ = ["View", "view"]
