"""Harm, in small doses: to bytes, to JSON by its structure, and to safetensors files whose frame stays right.

Nothing here knows a key of any format: what is changed is found by walking. Every choice comes from the random numbers
that are handed in, so the same numbers do the same harm.
"""

from __future__ import annotations

import json
import struct
from copy import deepcopy
from random import Random
from typing import Any

import xxhash


class Object(list):
    """A JSON object as [key, value] pairs: a key may occur twice."""


class Raw(str):
    """Text that goes into the JSON as it stands."""


# What numbers are replaced by: the edges of every type that a reader may put them in, and what is no number at all.
NUMBERS = (
    *("0", "-1", "1", "2", "15", "16", "255", "65535", "65536", "100000001", "2147483647", "2147483648", "4294967295"),
    *("4294967296", "9007199254740993", "9223372036854775807", "18446744073709551615", "18446744073709551616"),
    *("-2147483649", "-9223372036854775809", "1e308", "-1e308", "1e999", "5e-324", "0.5", "-0.0", "1e30", "3.5e38"),
    *("NaN", "Infinity", "-Infinity", "9" * 400),
)
VALUES = (
    *("null", "true", "false", "[]", "{}", '""', '"\\u0000"', '"\\ud800"', "[[]]", "[0]", '{"0":0}'),
    *('"../../../etc/passwd"', '"/dev/zero"', '"http://localhost/"', '"data:;base64,AAAA"', '"%2e%2e/x"', '"CON"'),
    *('"' + "a" * 1000 + '"', "[" * 3000 + "]" * 3000, '{"a":' * 300 + "0" + "}" * 300),
)
# Little-endian patterns: zeros, ones, the largest and smallest integers, infinity and NaN in three sizes of floats.
PATTERNS = tuple(
    bytes.fromhex(text)
    for text in (
        *("00", "ff", "7f", "80", "01", "0000", "ffff", "ff7f", "0080", "807f", "c07f", "0100", "00000000", "ffffffff"),
        *("ffffff7f", "00000080", "0000807f", "0000c07f", "000080ff", "01000000", "ffff7f7f", "0000000000000000"),
        *("ffffffffffffffff", "ffffffffffffff7f", "000000000000f07f"),
    )
)


def parse(text: bytes | str) -> Any:
    return json.loads(text, object_pairs_hook=lambda pairs: Object([list(pair) for pair in pairs]))


def write(node: Any) -> str:
    if isinstance(node, Raw):
        return str(node)
    if isinstance(node, Object):
        return "{" + ",".join(f"{json.dumps(key)}:{write(value)}" for key, value in node) + "}"
    if isinstance(node, list):
        return "[" + ",".join(map(write, node)) + "]"
    return json.dumps(node)


def places(node: Any) -> list[tuple[list[Any], int]]:
    """Every value below a node: the list that holds it (of an object's member, the pair) and where."""
    found: list[tuple[list[Any], int]] = []
    for k, item in enumerate(node) if isinstance(node, list) else ():
        holder, at = (item, 1) if isinstance(node, Object) else (node, k)
        found.append((holder, at))
        found += places(holder[at])
    return found


def containers(node: Any) -> list[list[Any]]:
    """Every object and array that is not empty, the node itself included."""
    inside = [holder[at] for holder, at in places(node)]
    return [value for value in [node, *inside] if isinstance(value, list) and value]


def harm_tree(tree: Any, rng: Random) -> Any:
    """One to three changes of a JSON tree, in place where that can be done."""
    for _ in range(rng.choice((1, 1, 1, 2, 3))):
        found = places(tree)
        if not found:
            return Raw(rng.choice(VALUES))
        holder, at = rng.choice(found)
        value = holder[at]
        kind = rng.choice(("number", "number", "number", "value", "drop", "again", "copy", "swap"))
        if kind == "number" and isinstance(value, (int, float)):
            holder[at] = rng.choice([*near(value), *map(Raw, NUMBERS)])
        elif kind in ("number", "value"):
            holder[at] = Raw(rng.choice(NUMBERS + VALUES))
        elif kind == "drop":
            chosen = rng.choice(containers(tree))
            del chosen[rng.randrange(len(chosen))]
        elif kind == "again":
            # Of an object, a key that is there twice.
            chosen = rng.choice(containers(tree))
            chosen.insert(rng.randrange(len(chosen) + 1), deepcopy(rng.choice(chosen)))
        else:
            other, there = rng.choice(found)
            holder[at], value = deepcopy(other[there]), deepcopy(value)
            if kind == "swap":
                other[there] = value
    return tree


def near(value: float) -> list[float]:
    """Numbers beside a number."""
    flipped = [value ^ 1 << bit for bit in (0, 4, 16, 31)] if type(value) is int else [value / 3]
    return [value + 1, value - 1, 2 * value, value // 2, -value, value + 16, *flipped]


def harm_bytes(data: bytes, rng: Random, unit: int = 1) -> bytes:
    """One to four changes of bytes, at multiples of `unit`; most keep the length."""
    harmed = bytearray(data)
    for _ in range(rng.choice((1, 1, 2, 4))):
        size = len(harmed)
        if size == 0:
            return bytes(rng.randrange(256) for _ in range(rng.randrange(20)))
        at = rng.randrange(-(-size // unit)) * unit
        kind = rng.randrange(10)
        if kind <= 3:
            harmed[min(at + rng.randrange(unit), size - 1)] ^= 1 << rng.randrange(8)
        elif kind <= 6:
            pattern = rng.choice(PATTERNS)[: size - at]
            harmed[at : at + len(pattern)] = pattern
        elif kind == 7:
            # A piece of the file over another piece of it.
            start, length = rng.randrange(size), rng.randrange(1, 65)
            piece = bytes(harmed[start : start + length])[: size - at]
            harmed[at : at + len(piece)] = piece
        elif kind == 8:
            del harmed[at : at + rng.randrange(1, 33)]
        else:
            del harmed[at:]
    return bytes(harmed)


def split_safetensors(data: bytes) -> tuple[Any, bytes]:
    """Header and arrays: eight bytes of the header's length, the header, the arrays."""
    (length,) = struct.unpack_from("<Q", data)
    return parse(data[8 : 8 + length]), data[8 + length :]


def join_safetensors(header: Any, arrays: bytes) -> bytes:
    text = write(header).encode()
    # The format wants the arrays to begin at a multiple of eight.
    text += b" " * (-len(text) % 8)
    return struct.pack("<Q", len(text)) + text + arrays


def spans(header: Any) -> list[tuple[int, int]]:
    """Where each array lies: every pair of whole numbers in a header that could be one."""
    pairs = [holder[at] for holder, at in places(header)]
    lists = [pair for pair in pairs if isinstance(pair, list) and not isinstance(pair, Object) and len(pair) == 2]
    return [(a, b) for a, b in lists if isinstance(a, int) and isinstance(b, int) and a < b]


def harm_safetensors(data: bytes, rng: Random) -> bytes:
    """Harm to the header, to one array, or to the bytes as they lie."""
    header, arrays = split_safetensors(data)
    kind = rng.randrange(10)
    if kind <= 2:
        return join_safetensors(harm_tree(header, rng), arrays)
    if kind <= 7:
        start, end = rng.choice(spans(header))
        harmed = harm_bytes(arrays[start:end], rng, rng.choice((1, 2, 4)))
        # Of the same length, so that the frame stays right and the contents are looked at.
        return join_safetensors(header, arrays[:start] + harmed.ljust(end - start, b"\0")[: end - start] + arrays[end:])
    return harm_bytes(data, rng)


def put_right(tree: Any, name: str, before: bytes, after: bytes) -> None:
    """Wherever a JSON object names this file, its old size and checksum become the new ones."""
    old = {len(before): len(after), checksum(before): checksum(after)}
    for node in containers(tree):
        if isinstance(node, Object) and any(value == name for _, value in node):
            for pair in node:
                if isinstance(pair[1], (int, str)) and pair[1] in old:
                    pair[1] = old[pair[1]]


def sealed(text: bytes) -> bytes:
    """A manifest whose digest, the last of its keys, is that of what stands before it."""
    before, key, _ = text.rpartition(b'"digest"')
    return b'%s%s:"%s"}' % (before, key, checksum(before).encode()) if key else text


def checksum(data: bytes) -> str:
    return xxhash.xxh3_64_hexdigest(data)
