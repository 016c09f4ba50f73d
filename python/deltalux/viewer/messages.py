"""Messages between view and page: how binary ones are packed, how what comes in is checked (PROTOCOL.md)."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..checks import Vector, as_vector

__all__ = ["MOST_BYTES", "checked_keys", "number", "packed", "parsed", "text", "vector"]

MOST_BYTES = 256 * 1024
"""Of a message that comes in."""
_DEEPEST = 12

Part = tuple[Mapping[str, Any], NDArray[Any] | bytes]
"""What is said of a payload, and the payload."""


def packed(header: Mapping[str, Any], parts: Sequence[Part]) -> bytes:
    """A binary message: the length of the JSON, the JSON, zeros up to a multiple of 8, and the payloads."""
    payloads = [part if isinstance(part, bytes) else np.ascontiguousarray(part).tobytes() for _, part in parts]
    described, offset = [], 0
    for (words, _), payload in zip(parts, payloads, strict=True):
        described.append({**words, "offset": offset, "bytes": len(payload)})
        # Typed arrays of the page begin where their elements may.
        offset += len(payload) + -len(payload) % 8
    head = text({**header, "parts": described}).encode()
    padded = [payload + bytes(-len(payload) % 8) for payload in payloads]
    return b"".join([len(head).to_bytes(4, "little"), head, bytes(-(4 + len(head)) % 8), *padded])


def text(words: Mapping[str, Any]) -> str:
    """Words as JSON; what is no finite number is null."""
    return json.dumps(_finite(words), separators=(",", ":"), allow_nan=False)


def _finite(value: Any) -> Any:
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {key: _finite(own) for key, own in value.items()}
    return [_finite(own) for own in value] if isinstance(value, (list, tuple)) else value


def parsed(message: str | bytes) -> dict[str, Any]:
    """The object that a client sent; ValueError where it is none."""
    if isinstance(message, bytes):
        raise ValueError("expected a message in words, got a binary one")
    try:
        found = json.loads(message)
    except (ValueError, RecursionError):
        raise ValueError("expected a message in JSON") from None
    if not isinstance(found, dict) or len(found) == 0:
        raise ValueError("expected a message that says what it wants")
    _check_depth(found, _DEEPEST)
    return found


def _check_depth(value: Any, left: int) -> None:
    if left == 0:
        raise ValueError("expected a message of fewer levels")
    for own in value.values() if isinstance(value, dict) else value if isinstance(value, list) else ():
        _check_depth(own, left - 1)


def checked_keys(what: str, value: Any, keys: Sequence[str]) -> dict[str, Any]:
    """An object with no other keys than these."""
    if not isinstance(value, dict) or not value.keys() <= set(keys):
        raise ValueError(f"expected {what} as an object of {', '.join(keys)}, got {str(value)[:80]}")
    return value


def number(what: str, value: Any, low: float, high: float) -> float:
    """A number within bounds."""
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not low <= value <= high:
        raise ValueError(f"expected {what} from {low:g} to {high:g}, got {str(value)[:40]}")
    return float(value)


def vector(what: str, value: Any, low: float, high: float) -> Vector:
    """Three numbers within bounds."""
    if not isinstance(value, list) or len(value) != 3:
        raise ValueError(f"expected {what} as three numbers, got {str(value)[:40]}")
    return as_vector(np.array([number(what, own, low, high) for own in value]))
