"""A progress bar for work that takes longer than a second, and the one signature that all progress has."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from typing import TextIO

__all__ = ["Progress", "Reporter", "reporter", "steps"]

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

    def say(self, text: str) -> None:
        """A line of its own."""

    def expect(self, seconds: float) -> None:
        """So many seconds are to go, as is known by now."""


def steps(progress: bool | Progress, what: str, count: int) -> Callable[[str], Reporter]:
    """Reporters for so many steps of one piece of work, each by its name: a bar shows them as one.

    A callable is told of each step by itself, as if it were all; the steps of a step share its part of the bar.
    """
    if callable(progress) and not isinstance(progress, Reporter):
        return lambda _: _Callback(progress)
    if not progress:
        return lambda _: Reporter()
    whole = progress if isinstance(progress, Reporter) else _Bar(what, sys.stderr)
    numbers = iter(range(count))
    return lambda name: _Step(whole, name, next(numbers, count - 1), count)


def reporter(progress: bool | Progress, what: str, expected: float | None = None) -> Reporter:
    """The user's callback, a bar on standard error, or silence; a bar may be told how many seconds to expect."""
    if isinstance(progress, Reporter):
        return progress
    if callable(progress):
        return _Callback(progress)
    return _Bar(what, sys.stderr, expected) if progress else Reporter()


class _Callback(Reporter):
    """Somebody else's bar."""

    def __init__(self, progress: Progress) -> None:
        self._progress = progress

    def __call__(self, done: int, total: int) -> None:
        self._progress(done, total)


class _Step(Reporter):
    """One of several steps of some work."""

    def __init__(self, whole: Reporter, name: str, number: int, count: int) -> None:
        self._whole, self._name, self._number, self._count = whole, name, number, count
        self(0, 1)

    def __call__(self, done: int, total: int) -> None:
        self._whole.step(self._name)
        # In millionths, as steps are of different lengths, and have steps of their own.
        share = min(done / total, 1.0) if total else 1.0
        self._whole(round(1e6 * (self._number + share)), 1_000_000 * self._count)

    def step(self, name: str) -> None:
        self._name = name

    def say(self, text: str) -> None:
        self._whole.say(text)


class _Bar(Reporter):
    """One line that is drawn over; nothing is drawn before the first second."""

    def __init__(self, what: str, stream: TextIO, expected: float | None = None) -> None:
        self._what, self._stream, self._expected = what, stream, expected
        self._started = self._drawn = time.monotonic()
        self._open = False
        self._step = ""

    def __call__(self, done: int, total: int) -> None:
        now = time.monotonic()
        elapsed = now - self._started
        last = done >= total
        # A pipe or a log gets a line every ten seconds instead of a moving bar.
        pause = 0.1 if self._stream.isatty() else 10.0
        if elapsed < 1.0 or (now - self._drawn < pause and not (last and self._open)):
            return
        self._drawn = now
        share = done / total if total else 1.0
        left = self._left(share, elapsed)
        bar = "#" * round(24 * share)
        what = f"{self._what}, {self._step}" if self._step else self._what
        text = f"{what} [{bar:<24}] {100 * share:3.0f} %  {elapsed:4.0f} s"
        text += f", {left:.0f} s left" if share < 1 else ", done"
        self._open = not last
        end = "" if self._stream.isatty() and not last else "\n"
        start = "\r" if self._stream.isatty() else ""
        self._stream.write(f"{start}{text:<78}{end}")
        self._stream.flush()

    def step(self, name: str) -> None:
        self._step = name

    def say(self, text: str) -> None:
        if time.monotonic() - self._started < 1.0:
            return
        # Over the bar, if it stands there.
        start = "\r" if self._open and self._stream.isatty() else ""
        self._stream.write(f"{start}{text:<78}\n")
        self._stream.flush()

    def expect(self, seconds: float) -> None:
        self._expected = time.monotonic() - self._started + seconds

    def _left(self, share: float, elapsed: float) -> float:
        """Seconds to go: what was expected before anything was done, and by and by what the work itself tells."""
        told = elapsed / share - elapsed if share > 0 else float("nan")
        if self._expected is None:
            return told
        expected, trust = max(self._expected - elapsed, 0.0), min(share / _TRUSTED, 1.0)
        return trust * told + (1 - trust) * expected if share > 0 else expected
