"""One page that watches: what it is sent, never more than two messages ahead of what it has answered."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..checks import one_of
from ..images.encoded import encoded
from ..io import TONES, to_display
from .messages import Part, checked_keys, number, packed, text
from .stage import Stage
from .subject import Layer, Shot, halves

__all__ = ["Client"]

_AHEAD = 2
"""Messages that may be unanswered; of a page that is slow to draw one, which is then never late by two."""
_LAYERS = ("b", "exact", "bound")
_QUALITIES = ("auto", "lossless", "jpeg")
_STRIP_ROWS = 32
_STILL = 0.02
"""Seconds without a change after which a picture is sent as it is."""
_SLOW = 0.045
"""Seconds for a picture in half floats, from here to the screen, beyond which JPEG is tried instead."""
_WORTH = {"f16": 1.0, "f32": 2.0, "jpeg": 1.0}
"""What a picture of numbers at rest tells of one in half floats."""
_TELLING = {"f16": 1 << 17, "f32": 1 << 18, "jpeg": 0}
"""Bytes below which a picture is but a strip, or too small to matter."""
_MAPS_EVERY = 0.1
_ASIDE = ("maps", "strip")
_JPEG_QUALITY = 85


class Client:
    """A page.

    Parameters
    ----------
    stage
        What is played.
    send
        Puts a message on the wire, and returns when it has gone.
    number
        Its own, by which others know whose changes these are.
    """

    def __init__(self, stage: Stage, send: Callable[[str | bytes], None], number: int) -> None:
        self.number = number
        self._stage, self._send = stage, send
        self._words: deque[str] = deque()
        self._answers: deque[tuple[dict[str, Any], list[Part]]] = deque()
        self._layers: frozenset[str] = frozenset()
        self._maps, self._quality, self._exposure, self._tone = False, "auto", 0.0, "srgb"
        self._next = 0
        self._ahead: dict[int, tuple[str, float]] = {}
        self._asides: deque[tuple[dict[str, Any], list[Part]]] = deque()
        self._aside: set[int] = set()
        """Unanswered messages of the light, which keep no picture waiting."""
        numbers, jpegs = deque[float](maxlen=5), deque[float](maxlen=5)
        self._took = {"f16": numbers, "f32": numbers, "jpeg": jpegs}
        """Seconds from a picture's leaving until the page had drawn it."""
        self._gone = False
        self._forget()

    def _forget(self) -> None:
        """Nothing of this subject has been sent yet."""
        self._scene = self._stage.scene
        self._had: dict[str, NDArray[Any]] = {}
        self._shot = self._off = self._exact_shot = self._still_shot = 0
        self._shot_at = self._maps_at = 0.0
        self._beside_of = (0, False)
        self._mesh_sent = False

    @property
    def ready(self) -> bool:
        """Whether the page could take another message."""
        took = [own for own in map(_median, self._took.values()) if own is not None]
        return len(self._ahead) < (1 if took and min(took) > _SLOW else _AHEAD)

    @property
    def waits(self) -> bool:
        """Whether another frame would go out at once: one that is made before would be stale by then."""
        shot = self._stage.shot
        return self.ready and (shot is None or self._shot >= shot.number)

    # What comes from other threads.

    def say(self, words: Mapping[str, Any]) -> None:
        """Sends words, before any picture."""
        with self._stage.changed:
            self._words.append(text(words))
            self._stage.changed.notify_all()

    def answer(self, header: dict[str, Any], parts: list[Part]) -> None:
        """Sends a binary message, in its turn."""
        with self._stage.changed:
            self._answers.append((header, parts))
            self._stage.changed.notify_all()

    def acknowledge(self, value: Any) -> None:
        """The page has a message."""
        with self._stage.changed:
            self._aside.discard(value)
            kind, sent = self._ahead.pop(value, ("", 0.0)) if isinstance(value, int) else ("", 0.0)
            if kind:
                self._took[kind].append((time.monotonic() - sent) / _WORTH[kind])
            self._stage.changed.notify_all()

    def want(self, value: Any) -> None:
        """What the page looks at."""
        found = checked_keys("what is wanted", value, ("layers", "maps", "quality", "exposure", "tone"))
        layers = found.get("layers", [])
        if not isinstance(layers, list) or not set(map(str, layers)) <= set(_LAYERS):
            raise ValueError(f"expected layers of {', '.join(_LAYERS)}")
        quality, tone = found.get("quality", "auto"), found.get("tone", "srgb")
        one_of("a quality", quality, _QUALITIES)
        exposure = number("an exposure", found.get("exposure", 0.0), -64.0, 64.0)
        with self._stage.changed:
            fresh = frozenset(layers) - self._layers
            self._layers, self._maps = frozenset(layers), found.get("maps") is True
            # A curve that only the page knows is shown by the page, of half floats.
            self._quality, self._tone = (quality, tone) if tone in TONES else ("lossless", "srgb")
            self._exposure = exposure
            self._stage.seen[self] = self._layers
            for name in fresh:
                self._had.pop(name, None)
            if "exact" in fresh:
                # What is known already is sent again, though nothing moves.
                self._off = 0
            if fresh & {"b", "bound"}:
                self._stage.wake()
            self._stage.changed.notify_all()

    def leave(self) -> None:
        """The page is gone."""
        with self._stage.changed:
            self._gone = True
            self._stage.seen.pop(self, None)
            self._stage.changed.notify_all()

    # The thread that sends.

    def run(self, welcome: Callable[[], Mapping[str, Any]]) -> None:
        """Sends until the page or the stage is gone."""
        stage = self._stage
        while True:
            with stage.changed:
                stage.changed.wait_for(lambda: self._gone or stage.ended or self._something(), 0.05)
                if self._gone or stage.ended:
                    return
                words = self._words.popleft() if self._words else None
                if words is None and stage.scene != self._scene:
                    self._forget()
                    words = text({"replaced": welcome()})
            if words is not None:
                self._send(words)
                continue
            message = self._message()
            if message is not None:
                header, parts = message
                self._next += 1
                data = packed({"n": self._next, **header}, parts)
                kinds = [words["type"] for words, _ in parts if words.get("name") == "a"]
                whole = header["kind"] == "frame" and len(kinds) == 1 and len(data) > _TELLING[kinds[0]]
                with stage.changed:
                    if header["kind"] in _ASIDE:
                        self._aside.add(self._next)
                    else:
                        self._ahead[self._next] = (kinds[0] if whole else "", time.monotonic())
                    stage.changed.notify_all()
                self._send(data)

    def _something(self) -> bool:
        if self._words or self._stage.scene != self._scene:
            return True
        if not self.ready:
            return bool(self._asides)
        shot, off = self._stage.shot, self._stage.off
        return (
            bool(self._answers)
            or (shot is not None and shot.number > self._shot)
            or (off is not None and off.number > self._off)
        )

    def _message(self) -> tuple[dict[str, Any], list[Part]] | None:
        """The most urgent message, or none."""
        stage = self._stage
        with stage.changed:
            if self._asides:
                return self._asides.popleft()
            if self.ready and self._answers:
                return self._answers.popleft()
            shot, off, subject = stage.shot, stage.off, stage.subject
        if not self._mesh_sent:
            self._mesh_sent = True
            mesh = subject.mesh()
            if mesh is not None:
                return {"kind": "mesh"}, [
                    ({"name": name, "type": "u32" if array.dtype == np.uint32 else "f32"}, array)
                    for name, array in mesh.items()
                ]
        if shot is None:
            return None
        now = time.monotonic()
        if self.ready and (shot.number > self._shot or (off is not None and off.number > self._off)):
            return self._frame(shot)
        if not self._aside and now - self._maps_at > _MAPS_EVERY and self._beside_of != (shot.number, self._maps):
            self._maps_at, self._beside_of = now, (shot.number, self._maps)
            self._asides.extend(self._beside(shot))
            return self._asides.popleft() if self._asides else None
        if shot.converged and now - self._shot_at > _STILL and not self._ahead:
            return self._at_rest(shot)
        return None

    def _frame(self, shot: Shot) -> tuple[dict[str, Any], list[Part]]:
        stage, off = self._stage, self._stage.off
        parts: list[Part] = []
        if shot.number > self._shot:
            self._shot, self._shot_at = shot.number, time.monotonic()
            for name in ("a", *sorted(self._layers - {"exact"})):
                if name in shot.layers:
                    parts += self._layer(name, shot.layers[name], shot.half(name))
        if off is not None and off.number > self._off:
            self._off = off.number
            if "exact" in self._layers:
                parts += self._strips("exact", halves(off.layer))
        stats = {**shot.stats, "number": shot.number, "rate": stage.rate}
        if off is not None:
            stats |= {"error": off.error, "error_b": off.error_b, "age": time.monotonic() - off.at}
        # What comes after the picture as it is, about it, leaves it as it is.
        exact = {"exact": True} if self._exact_shot == shot.number else {}
        return {"kind": "frame", "stats": stats, **exact}, parts

    def _layer(self, name: str, layer: Layer, half: NDArray[np.float16]) -> list[Part]:
        halves_took, jpegs_took = (_median(self._took[kind]) for kind in ("f16", "jpeg"))
        slow = halves_took is not None and halves_took > max(_SLOW, jpegs_took or 0.0)
        if name == "a" and layer.ndim == 3 and (self._quality == "jpeg" or (self._quality == "auto" and slow)):
            self._had.pop(name, None)
            height, width, _ = layer.shape
            words = {"name": name, "type": "jpeg", "width": width, "height": height, "y": 0, "rows": height}
            return [(words, encoded(to_display(layer, self._exposure, self._tone), "jpeg", quality=_JPEG_QUALITY))]
        return self._strips(name, half)

    def _strips(self, name: str, layer: NDArray[Any]) -> list[Part]:
        """What of a layer is not as it was sent."""
        before = self._had.get(name)
        self._had[name] = layer
        kind = "f16" if layer.dtype == np.float16 else "f32"
        if layer.ndim == 2:
            same = before is not None and _equal(before, layer)
            return [] if same else [({"name": name, "type": kind, "first": 0}, layer)]
        height, width, _ = layer.shape
        fresh = [
            y
            for y in range(0, height, _STRIP_ROWS)
            if before is None or not _equal(before[y : y + _STRIP_ROWS], layer[y : y + _STRIP_ROWS])
        ]
        parts: list[Part] = []
        while fresh:
            first = last = fresh.pop(0)
            while fresh and fresh[0] == last + _STRIP_ROWS:
                last = fresh.pop(0)
            rows = layer[first : last + _STRIP_ROWS]
            words = {"name": name, "type": kind, "width": width, "height": height, "y": first, "rows": len(rows)}
            parts.append((words, rows))
        return parts

    def _beside(self, shot: Shot) -> Iterator[tuple[dict[str, Any], list[Part]]]:
        """The light over the cubemap, and as a strip."""
        subject = self._stage.subject
        maps = subject.maps(shot) if self._maps else {}
        if maps:
            parts: list[Part] = [
                ({"name": name, "type": "f16", "size": own.shape[1]}, halves(own)) for name, own in maps.items()
            ]
            yield {"kind": "maps"}, parts
        strip = subject.strip()
        if strip is not None:
            yield {"kind": "strip"}, [({"name": "strip", "type": "f16"}, halves(strip))]

    def _at_rest(self, shot: Shot) -> tuple[dict[str, Any], list[Part]] | None:
        """The picture as it is, once nothing moves."""
        if self._exact_shot != shot.number:
            self._exact_shot = shot.number
            self._had.pop("a", None)
            return {"kind": "frame", "stats": None, "exact": True}, self._strips("a", shot.layers["a"])
        if self._still_shot != shot.number:
            self._still_shot = shot.number
            still = self._stage.subject.still(shot)
            if still is not None:
                picture, camera = still
                height, width, _ = picture.shape
                words = {"name": "still", "type": "f16", "width": width, "height": height}
                return {"kind": "still", "camera": camera}, [(words, halves(picture))]
        return None


def _median(times: deque[float]) -> float | None:
    """None of fewer than three."""
    return sorted(times)[len(times) // 2] if len(times) > 2 else None


def _equal(a: NDArray[Any], b: NDArray[Any]) -> bool:
    """Whether two have the same bits: half floats are slow to compare as numbers."""
    if a.dtype != b.dtype or a.shape != b.shape:
        return False
    bits = f"u{a.dtype.itemsize}"
    return np.array_equal(a.view(bits), b.view(bits))
