"""Files of strangers, read whole: plain ones only, as a pipe or a device may never end, and none beyond a size."""

from __future__ import annotations

import os
import stat
from typing import BinaryIO

from ._core import FileError

__all__ = ["MOST_TEXT", "open_plain", "read_plain"]

MOST_TEXT = 16 << 20
"""Bytes of a manifest or another text that people could read."""
# Opening a pipe would wait for whoever writes to it.
_FLAGS = os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0)


def open_plain(path: str | os.PathLike[str]) -> BinaryIO:
    """A plain file, open for reading; FileError of a pipe or a device, OSError of what cannot be read."""
    file = open(path, "rb", opener=lambda name, _: os.open(name, _FLAGS))  # noqa: SIM115, the caller closes it
    if not stat.S_ISREG(os.fstat(file.fileno()).st_mode):
        file.close()
        raise FileError(f"{os.fspath(path)}: expected a plain file, found a pipe or a device")
    return file


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
    with open_plain(name) as file:
        seen = os.fstat(file.fileno())
        # Room is made for what is asked for; more than was seen means that it grows.
        data = file.read(seen.st_size + 1) if seen.st_size <= most else b""
    if seen.st_size > most or len(data) > seen.st_size:
        raise FileError(f"{name}: expected at most {min(most, seen.st_size):,} bytes, found more")
    return data
