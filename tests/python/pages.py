"""What a page of the live view is, without a browser."""

from __future__ import annotations

import contextlib
import json
import time

import numpy as np
import pytest

websockets = pytest.importorskip("websockets", reason="the live view needs websockets")
from websockets.sync.client import connect  # noqa: E402


class Page:
    """What a browser would be."""

    def __init__(self, socket):
        self.socket, self.words, self.kinds, self.layers, self.stats, self.acks = socket, [], [], {}, {}, True
        self.draws = True

    def send(self, **message):
        self.socket.send(json.dumps(message))

    def read(self, until, seconds=20.0):
        """Reads until a message is the one; gives it back."""
        end = time.monotonic() + seconds
        while (left := end - time.monotonic()) > 0:
            message = self.socket.recv(timeout=left)
            header, parts = self._unpacked(message)
            if isinstance(message, bytes):
                self.kinds.append(header["kind"])
                if self.acks:
                    self.send(ack=header["n"])
                if header["kind"] == "frame":
                    if self.draws:
                        self._draw(parts)
                    self.stats = header["stats"] or self.stats
            else:
                self.words.append(header)
            if until(header):
                return header, parts
        raise AssertionError(f"nothing came of {self.kinds} and {[list(words) for words in self.words]}")

    @staticmethod
    def _unpacked(message):
        if isinstance(message, str):
            return json.loads(message), {}
        size = int.from_bytes(message[:4], "little")
        header = json.loads(message[4 : 4 + size])
        start = -(-(4 + size) // 8) * 8
        types = {"f16": np.float16, "f32": np.float32, "u32": np.uint32}
        parts = {}
        for part in header["parts"]:
            data = message[start + part["offset"] :][: part["bytes"]]
            dtype = types.get(part.get("type"))
            array = data if dtype is None else np.frombuffer(data, dtype).astype(np.float32)
            parts.setdefault(part["name"], []).append((part, array))
        return header, parts

    def _draw(self, parts):
        for name, strips in parts.items():
            for part, values in strips:
                if part["type"] == "jpeg":
                    continue
                shape = (part["height"], part["width"], 3)
                layer = self.layers.setdefault(name, np.zeros(shape, np.float32))
                layer[part["y"] : part["y"] + part["rows"]] = values.reshape(part["rows"], part["width"], 3)

    def still(self):
        """Reads until the picture stands."""
        self.read(lambda header: header.get("exact") is True)
        return self.layers["a"]


@contextlib.contextmanager
def page(view, token=None, **options):
    address, _, own = view.url.partition("/#")
    options = {"origin": address, "max_size": 2**26, "compression": None, **options}
    with connect(address.replace("http", "ws", 1) + "/live", **options) as socket:
        socket.send(json.dumps({"hello": own if token is None else token}))
        yield Page(socket)


def welcomed(page):
    return page.read(lambda header: "welcome" in header)[0]["welcome"]
