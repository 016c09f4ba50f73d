"""Files of strangers, read whole: plain ones only, as a pipe or a device may never end, and none beyond a size."""

from __future__ import annotations

import os
import stat

from ._core import FileError

__all__ = ["MOST_TEXT", "read_plain"]

MOST_TEXT = 16 << 20
"""Bytes of a manifest or another text that people could read."""
# Opening a pipe would wait for whoever writes to it.
_FLAGS = os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0)


def read_plain(path: str | os.PathLike[str], most: int) -> bytes:
    """The bytes of a plain file.

    Parameters
    ----------
    path
        Of the file; a link is followed.
    most
        Bytes that it may have.

    Returns
    -------
    bytes

    Raises
    ------
    FileError
        If it is no plain file, or larger.
    OSError
        If it cannot be read.
    """
    name = os.fspath(path)
    with open(name, "rb", opener=lambda name, _: os.open(name, _FLAGS)) as file:
        seen = os.fstat(file.fileno())
        if not stat.S_ISREG(seen.st_mode):
            raise FileError(f"{name}: expected a plain file, found a pipe or a device")
        # Room is made for what is asked for; more than was seen means that it grows.
        data = file.read(seen.st_size + 1) if seen.st_size <= most else b""
    if seen.st_size > most or len(data) > seen.st_size:
        raise FileError(f"{name}: expected at most {min(most, seen.st_size):,} bytes, found more")
    return data
