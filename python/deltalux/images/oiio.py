"""The only module that imports OpenImageIO (when it is first needed).

OpenImageIO reports failure by return values that look like data (None, zeros, empty arrays), so every return is checked
by those who call it, and its reason asked for.
"""

from __future__ import annotations

from types import ModuleType

MAX_MEGABYTES = 4096
"""The largest image that is read, decoded."""


def library() -> ModuleType:
    """OpenImageIO, told what is too large, and to start no threads."""
    import OpenImageIO

    # Headers are hostile: the library's own limit grows with the machine's memory.
    OpenImageIO.attribute("limits:imagesize_MB", MAX_MEGABYTES)
    # Threads of its EXR library do not survive `fork`: a child waited for them for ever. Without them a picture of
    # 1024 x 1024 takes 322 ms to write instead of 302, and as long to read; films have threads of their own.
    OpenImageIO.attribute("exr_threads", -1)
    return OpenImageIO


def reason(error: str) -> str:
    """One line of the library's account of an error."""
    return " ".join(error.split()) or "unknown reason"
