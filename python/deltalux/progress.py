"""A progress bar for work that takes longer than a second, and the one signature that all progress has."""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Callable, Sequence
from itertools import accumulate
from typing import TextIO

__all__ = ["SILENT", "Progress", "Reporter", "reporter", "steps"]

Progress = Callable[[int, int], None]
"""Called with (done, total); whatever it raises stops the work."""


# The share of the work after which its own speed is all that counts.
_TRUSTED = 0.1


class Reporter:
    """What long work tells: how far it is, and now and then a line. This one is silent."""

    def __call__(self, done: int, total: int) -> None:
        """So much is done."""

    def after(self, before: int, total: int) -> Callable[[int], None]:
        """What part of the work tells that comes after so much of all."""
        return lambda done: self(min(before + done, total), total)

    def step(self, name: str) -> None:
        """What is being done now."""

    def begin(self, name: str) -> None:
        """What is being done now, and takes its time before it tells of any progress."""

    def say(self, text: str) -> None:
        """A line of its own."""

    def expect(self, seconds: float) -> None:
        """So many seconds are to go, as is known by now."""

    def clear(self) -> None:
        """Somebody else writes a line now."""


SILENT = Reporter()
"""Nobody listens."""


def steps(progress: bool | Progress, what: str, lengths: int | Sequence[float]) -> Callable[[str], Reporter]:
    """Reporters for the steps of one piece of work, each by its name: a bar shows them as one.

    `lengths` is how many there are, or how long each is beside the others. A callable is told of each step by itself,
    as if it were all; the steps of a step share its part of the bar.
    """
    whole = reporter(progress, what)
    if whole is SILENT or isinstance(whole, _Callback):
        return lambda _: whole
    each = [1.0] * lengths if isinstance(lengths, int) else list(lengths)
    ends = [end / sum(each) for end in accumulate(each)]
    spans = iter(zip([0.0, *ends], ends, strict=False))
    return lambda name: _Step(whole, name, *next(spans, (1.0, 1.0)))


def reporter(progress: bool | Progress, what: str, expected: float | None = None) -> Reporter:
    """The user's callback, a bar on standard error, or silence; a bar may be told how many seconds to expect."""
    if isinstance(progress, Reporter):
        return progress
    if callable(progress):
        return _Callback(progress)
    return _Bar(what, sys.stderr, expected) if progress else SILENT


class _Callback(Reporter):
    """Somebody else's bar."""

    def __init__(self, progress: Progress) -> None:
        self._progress = progress

    def __call__(self, done: int, total: int) -> None:
        self._progress(done, total)


class _Step(Reporter):
    """One of several steps of some work, from one share of it to another."""

    def __init__(self, whole: Reporter, name: str, first: float, last: float) -> None:
        self._whole, self._first, self._last = whole, first, last
        self._name = name
        self(0, 1)

    def __call__(self, done: int, total: int) -> None:
        self._whole.step(self._name)
        # In millionths, as steps are of different lengths, and have steps of their own.
        share = min(done / total, 1.0) if total else 1.0
        self._whole(round(1e6 * (self._first + share * (self._last - self._first))), 1_000_000)

    def step(self, name: str) -> None:
        self._name = name

    def begin(self, name: str) -> None:
        self._name = name
        self._whole.begin(name)

    def say(self, text: str) -> None:
        self._whole.say(text)

    def clear(self) -> None:
        self._whole.clear()


class _Bar(Reporter):
    """One line that is drawn over; nothing is drawn before the first second."""

    def __init__(self, what: str, stream: TextIO, expected: float | None = None) -> None:
        self._what, self._stream, self._expected = what, stream, expected
        self._started = self._drawn = self._began = time.monotonic()
        self._open = False
        self._step, self._share = "", 0.0

    def __call__(self, done: int, total: int) -> None:
        before, self._share = self._share, done / total if total else 1.0
        # The end is told once, however often it comes.
        if before < 1 or self._share < 1:
            self._draw(last=done >= total)

    def _draw(self, last: bool = False) -> None:
        now = time.monotonic()
        elapsed = now - self._started
        # What comes before the first share says nothing of how long the others take.
        if self._share == 0:
            self._began = now
        # A pipe or a log gets a line every ten seconds instead of a moving bar.
        pause = 0.1 if self._stream.isatty() else 10.0
        if elapsed < 1.0 or (now - self._drawn < pause and not (last and self._open)):
            return
        self._drawn = now
        share, left = self._share, self._left(self._share, elapsed, now - self._began)
        bar = "#" * round(24 * share)
        what = f"{self._what}, {self._step}" if self._step else self._what
        text = f"{what} [{bar:<24}] {100 * share:3.0f} %  {elapsed:4.0f} s"
        # Before the first of it is done nobody knows.
        text += (f", {left:.0f} s left" if math.isfinite(left) else "") if share < 1 else ", done"
        self._open = not last
        end = "" if self._stream.isatty() and not last else "\n"
        start = "\r" if self._stream.isatty() else ""
        self._stream.write(f"{start}{text:<78}{end}")
        self._stream.flush()

    def step(self, name: str) -> None:
        self._step = name

    def begin(self, name: str) -> None:
        self._step = name
        self._draw()

    def say(self, text: str) -> None:
        if time.monotonic() - self._started < 1.0:
            return
        # Over the bar, if it stands there.
        start = "\r" if self._open and self._stream.isatty() else ""
        self._stream.write(f"{start}{text:<78}\n")
        self._stream.flush()

    def clear(self) -> None:
        if self._open and self._stream.isatty():
            self._stream.write(f"\r{'':<78}\r")
            self._stream.flush()
        self._open = False

    def expect(self, seconds: float) -> None:
        self._expected = time.monotonic() - self._started + seconds

    def _left(self, share: float, elapsed: float, working: float) -> float:
        """Seconds to go: what was expected before anything was done, and by and by what the work itself tells."""
        told = working / share - working if share > 0 else float("nan")
        if self._expected is None:
            return told
        expected, trust = max(self._expected - elapsed, 0.0), min(share / _TRUSTED, 1.0)
        return trust * told + (1 - trust) * expected if share > 0 else expected
