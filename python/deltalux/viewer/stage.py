"""The loop: frames of a subject as fast as they are wanted, and in a second thread what they are off."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable, Mapping, Set
from typing import Any, Protocol

from .subject import Exact, Shot, Subject

__all__ = ["Stage"]

_MOST_A_SECOND = 120.0
_REST = 0.06
"""Seconds without a change after which all that is left is sent at once."""
_EXACT_EVERY = 0.1
"""Seconds between exact products at least; they never take more than a sixth of the time."""


class Watcher(Protocol):
    """Who looks at frames."""

    @property
    def waits(self) -> bool:
        """Whether another one would be taken at once."""
        ...


class Stage:
    """A subject that plays, and all who watch it.

    Parameters
    ----------
    subject
        What is shown. It may be replaced by a finer one.
    """

    def __init__(self, subject: Subject) -> None:
        self.changed = threading.Condition()
        self.subject = subject
        self.scene = 0
        """Counts subjects: a client that knows an earlier one is told of this one."""
        self.frozen = False
        self.shot: Shot | None = None
        self.off: Exact | None = None
        self.ended = False
        self.seen: dict[Watcher, Set[str]] = {}
        """What each watcher looks at."""
        self._called = 0
        self._waiting, self._steps, self._set = True, 0, time.monotonic()
        self._times: deque[float] = deque(maxlen=60)
        self._problem: Callable[[str], None] = lambda text: None
        self._threads = [threading.Thread(target=own, daemon=True) for own in (self._play, self._compare)]

    def start(self, problem: Callable[[str], None]) -> None:
        """Plays; what goes wrong in a frame is told to `problem`."""
        self._problem = problem
        self.subject.remark = problem
        for thread in self._threads:
            thread.start()

    def end(self) -> None:
        """Stops, and wakes all who wait."""
        with self.changed:
            self.ended = True
            self.changed.notify_all()
        for thread in self._threads:
            thread.join(10.0)

    def take(self, patch: Mapping[str, Any]) -> dict[str, Any]:
        """Sets parts of the state, all or none."""
        patch = dict(patch)
        frozen = patch.pop("frozen", self.frozen)
        if not isinstance(frozen, bool):
            raise ValueError("expected frozen to be true or false")
        taken = self.subject.take(patch) if patch else {}
        with self.changed:
            if frozen != self.frozen:
                self.frozen = frozen
                taken["frozen"] = frozen
            self._waiting, self._set = True, time.monotonic()
            self.changed.notify_all()
        return taken

    def state(self) -> dict[str, Any]:
        """All that is set."""
        return {**self.subject.state(), "frozen": self.frozen}

    def wake(self) -> None:
        """Another frame is due: something was set, or is looked at."""
        with self.changed:
            self._waiting, self._set = True, time.monotonic()
            self.changed.notify_all()

    def step_once(self) -> None:
        """One frame, while frozen."""
        with self.changed:
            self._steps += 1
            self.changed.notify_all()

    def replace(self, subject: Subject) -> None:
        """Shows another subject, from the next frame on."""
        with self.changed:
            subject.remark = self._problem
            self.subject, self.scene = subject, self.scene + 1
            self.shot = self.off = None
            self._waiting = True
            self.changed.notify_all()

    def fresh(self, seconds: float = 30.0) -> Shot:
        """A frame of all that is set now, or the one that is frozen; TimeoutError where there is none in time."""
        with self.changed:
            if self.frozen and self.shot is not None:
                return self.shot
            self._waiting = True
            before = self.shot
            self._called += 1
            self.changed.notify_all()
            found = self.changed.wait_for(lambda: self.ended or self.shot is not before, seconds)
            self._called -= 1
            if not found or self.shot is None:
                raise TimeoutError("expected a frame, but the view has ended or is at work on one")
            return self.shot

    @property
    def rate(self) -> float:
        """Frames a second, of late."""
        times = list(self._times)
        return (len(times) - 1) / (times[-1] - times[0]) if len(times) > 1 and times[-1] > times[0] else 0.0

    def _due(self) -> bool:
        if self.frozen:
            return self._steps > 0
        # A frame that nobody can take yet would be stale by then, and keeps a page's own machine busy.
        if self.seen and not self._called and not any(watcher.waits for watcher in self.seen):
            return False
        return self._waiting or (self.shot is not None and not self.shot.converged)

    def _play(self) -> None:
        number = 0
        while True:
            with self.changed:
                self.changed.wait_for(lambda: self.ended or self._due())
                if self.ended:
                    return
                self._waiting, self._steps = False, max(self._steps - 1, 0)
                subject, scene = self.subject, self.scene
                layers = frozenset().union(*self.seen.values())
                # A light that is watched frame by frame is left to its method.
                left = self.shot is not None and not self.shot.converged and not self.frozen
                rests = left and time.monotonic() - self._set > _REST
            began = time.monotonic()
            try:
                shot = subject.step(layers, rests)
            except Exception as error:
                # What cannot be shown is said once, and waits for something else to be set: the view goes on.
                self._problem(str(error) or type(error).__name__)
                with self.changed:
                    if self.shot is not None:
                        self.shot.converged = True
                continue
            number += 1
            shot.number = number
            self._times.append(began)
            with self.changed:
                if scene == self.scene:
                    self.shot = shot
                    self.changed.notify_all()
                self.changed.wait_for(lambda: self.ended, max(0.0, 1.0 / _MOST_A_SECOND - (time.monotonic() - began)))

    def _compare(self) -> None:
        while True:
            with self.changed:
                self.changed.wait_for(lambda: self.ended or self._unknown())
                if self.ended:
                    return
                shot, subject, scene = self.shot, self.subject, self.scene
            began = time.monotonic()
            try:
                off = None if shot is None else subject.exact(shot)
            except (ValueError, MemoryError):
                off = None  # The frame has said what there is to say.
            took = time.monotonic() - began
            with self.changed:
                if scene == self.scene and off is not None:
                    self.off = off
                    self.changed.notify_all()
                self.changed.wait_for(lambda: self.ended, max(_EXACT_EVERY, 5.0 * took) if off else 1.0)

    def _unknown(self) -> bool:
        """Whether a frame is shown whose error is not known, and somebody watches."""
        shot = self.shot
        return bool(self.seen) and shot is not None and (self.off is None or self.off.number != shot.number)
