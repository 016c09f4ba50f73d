"""Tensor files: named arrays in one binary file, the container of EPFL's measured materials.

All numbers are little-endian: ``tensor_file`` and a zero byte; the version 1, 0; the number of fields (uint32); for
each field the length of its name (uint16), the name, its dimensions (uint16), its type (uint8), where its data begins
(uint64) and its shape (uint64 each); then the data.
"""

from __future__ import annotations

import math
import struct

import numpy as np

MAGIC = b"tensor_file\0"
# Types by their number.
_TYPES = {1: "u1", 2: "i1", 3: "<u2", 4: "<i2", 5: "<u4", 6: "<i4", 7: "<u8", 8: "<i8", 9: "<f2", 10: "<f4", 11: "<f8"}
_MOST_DIMENSIONS = 16


def read(content: bytes) -> dict[str, np.ndarray]:
    """The fields by their names; a ValueError says what a damaged file lacks."""
    reader = _Reader(content)
    version, fields = reader.take("<2B"), reader.take("<I")[0]
    if version != (1, 0):
        raise ValueError(f"expected version 1.0 of tensor files, got {version[0]}.{version[1]}")
    return dict(reader.field() for _ in range(fields))


class _Reader:
    """A place in a file that is nowhere trusted."""

    def __init__(self, content: bytes) -> None:
        self.content, self.at = content, len(MAGIC)

    def take(self, form: str) -> tuple[int, ...]:
        """Numbers at the place, which moves behind them."""
        try:
            found = struct.unpack_from(form, self.content, self.at)
        except struct.error:
            raise ValueError(f"truncated in its header, at byte {self.at}") from None
        self.at += struct.calcsize(form)
        return found

    def field(self) -> tuple[str, np.ndarray]:
        """A name and its array, which must lie inside the file."""
        length = self.take("<H")[0]
        name = bytes(self.take(f"<{length}B")).decode("utf-8", "replace")
        dimensions, kind, begins = self.take("<HBQ")
        if dimensions > _MOST_DIMENSIONS or kind not in _TYPES:
            raise ValueError(f"expected field {name!r} of a known type, got type {kind} of {dimensions} dimensions")
        shape = self.take(f"<{dimensions}Q")
        dtype, count = np.dtype(_TYPES[kind]), math.prod(shape)
        # An axis can be longer than the file where another is 0, and longer than numpy counts.
        if begins + count * dtype.itemsize > len(self.content) or max(shape, default=0) > len(self.content):
            raise ValueError(f"truncated: field {name!r} of shape {shape} ends behind the file")
        return name, np.frombuffer(self.content, dtype, count, begins).reshape(shape)
