"""The only module that imports OpenImageIO (when it is first needed).

OpenImageIO reports failure by return values that look like data (None, zeros, empty arrays), so every return is checked
by those who call it, and its reason asked for.
"""

from __future__ import annotations

from types import ModuleType

MAX_MEGABYTES = 4096
"""The largest image that is read, decoded."""


def library() -> ModuleType:
    """OpenImageIO, told what is too large."""
    import OpenImageIO

    # Headers are hostile: the library's own limit grows with the machine's memory.
    OpenImageIO.attribute("limits:imagesize_MB", MAX_MEGABYTES)
    return OpenImageIO


def reason(error: str) -> str:
    """One line of the library's account of an error."""
    return " ".join(error.split()) or "unknown reason"
