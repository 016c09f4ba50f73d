"""The measuring loop of the report: every method follows one moving light, side by side, frame by frame."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from .._core import set_threads
from .._core import threads as used_threads
from ..columns import Haar
from ..light.environment import Environment
from ..light.motion import Motion
from ..progress import Progress
from ..transport.transport import Transport
from .entrants import Entrant
from .errors import relative_errors
from .relighter import Frame, Relighter

__all__ = ["Record", "Replay", "Still", "hold_still", "replay", "time_frames"]

_NOTHING_SENT = 9
"""Frames under a light that stands still, of which the median says what a frame costs that sends nothing."""


@dataclass(frozen=True)
class Record:
    """What was measured of one method in one frame; errors are relative to the exact product (`relative_errors`)."""

    environment: str
    method: str
    frame: int
    angle: float
    light_l1: float
    light_l2: float
    image_l1: float
    image_l2: float
    image_worst: float
    bound: float
    within_bound: bool
    columns: int
    streamed_bytes: int
    resets: tuple[int, ...]
    converged: bool


@dataclass(frozen=True)
class Still:
    """What followed when the light stood still until PBI had all of it, and then moved on."""

    method: str
    threads: int
    frames: int
    most_frames: int
    exact: bool
    fixed_seconds: float
    """Of a frame that sends nothing: what no budget can shorten."""
    restart_seconds: float
    restart_resets: tuple[int, ...]
    jump_seconds: float
    jump_resets: tuple[int, ...]


@dataclass
class Replay:
    """All measurements under one environment."""

    environment: str
    records: dict[str, list[Record]] = field(default_factory=dict)
    terms: dict[str, NDArray[np.float64]] = field(default_factory=dict)
    """For each method the mean number of columns that a rotating frame sends, band by band."""
    relighter_bytes: dict[str, int] = field(default_factory=dict)
    seconds: dict[int, dict[str, NDArray[np.float64]]] = field(default_factory=dict)
    """By threads, by method: (frames, 3) seconds in all, choosing, and multiplying."""
    still: Still | None = None

    def column(self, method: str, what: str) -> NDArray[np.float64]:
        """One measurement of a method in all frames."""
        return np.array([getattr(record, what) for record in self.records[method]], np.float64)


Show = Callable[[str, int, Environment, NDArray[np.float32]], None]
"""Called with (method, frame, light, values) for every frame of every method."""


def replay(
    transport: Transport, env: Environment, motion: Motion, rows: Sequence[Entrant], *, show: Show, progress: Progress
) -> Replay:
    """Errors of all methods in all frames. The reference is a fresh product of the whole light, made in every frame.

    The first row must be the exact method: its light, on the dyadic grid of the products, is what errors of light are
    relative to, and its own error tells whether a follower that never starts anew stays exact.
    """
    result = Replay(env.name, {row.name: [] for row in rows})
    relighters = {row.name: Relighter(transport, row.method, row.initial) for row in rows}
    bands = transport.columns.bands
    chosen = {row.name: np.zeros(int(bands[-1]) + 1) for row in rows}
    for k, angle in enumerate(motion.angles):
        progress(k, len(motion.angles))
        light = env.rotated(angle, motion.axis)
        frames = {row.name: relighters[row.name].step(light) for row in rows}
        exact_light = relighters[rows[0].name].values
        reference = _Reference(transport, exact_light, transport.multiply(exact_light))
        for name, frame in frames.items():
            record = reference.compare(env.name, name, k, angle, frame, relighters[name].values)
            result.records[name].append(record)
            if 0 < k <= motion.stop:
                chosen[name] += np.bincount(bands[frame.columns], minlength=len(chosen[name]))
            show(name, k, light, frame.values)
    result.terms = {name: total / max(motion.stop, 1) for name, total in chosen.items()}
    result.relighter_bytes = {name: relighter.nbytes for name, relighter in relighters.items()}
    progress(len(motion.angles), len(motion.angles))
    return result


class _Reference:
    """What every method is held against in one frame: the light, and the exact product's response and picture."""

    def __init__(self, transport: Transport, light: NDArray[np.float64], values: NDArray[np.float32]) -> None:
        self.transport, self.light, self.values = transport, light, values
        self.picture = transport.image(values)

    def compare(
        self, environment: str, method: str, k: int, angle: float, frame: Frame, light: NDArray[np.float64]
    ) -> Record:
        of_light, exact_light = self._plain(light), self._plain(self.light)
        areas = self.transport.columns.areas[: len(of_light), None]
        image_l1, image_l2, image_worst = relative_errors(self.transport.image(frame.values), self.picture)
        return Record(
            environment=environment,
            method=method,
            frame=k,
            angle=angle,
            light_l1=relative_errors(areas * of_light, areas * exact_light)[0],
            light_l2=relative_errors(of_light, exact_light)[1],
            image_l1=image_l1,
            image_l2=image_l2,
            image_worst=image_worst,
            bound=float(frame.bound),
            within_bound=bool(np.abs(frame.values - self.values).max(initial=0.0) <= frame.bound),
            columns=len(frame.columns),
            streamed_bytes=int(self.transport.column_bytes[frame.columns].sum()),
            resets=frame.resets,
            converged=frame.converged,
        )

    def _plain(self, light: NDArray[np.float64]) -> NDArray[np.float64]:
        """The light whichever way it is split into wavelets and texels."""
        columns = self.transport.columns
        return columns.without_texels(light) if isinstance(columns, Haar) else light


def time_frames(
    transport: Transport, env: Environment, motion: Motion, rows: Sequence[Entrant], *, threads: int, progress: Progress
) -> tuple[dict[str, NDArray[np.float64]], dict[str, Relighter]]:
    """Seconds of every frame of every method, (frames, 3): in all, choosing, multiplying; and the followers at the end.

    Nothing is measured but time. Methods take turns frame by frame, so that what disturbs one disturbs all, and every
    frame finds the caches cold.
    """
    before = used_threads()
    set_threads(threads)
    try:
        relighters = {row.name: Relighter(transport, row.method, row.initial) for row in rows}
        seconds = {row.name: np.zeros((len(motion.angles), 3)) for row in rows}
        for k in range(len(motion.angles)):
            progress(k, len(motion.angles))
            light = motion.light(env, k)
            for row in rows:
                frame = relighters[row.name].step(light)
                seconds[row.name][k] = frame.seconds, frame.choosing, frame.multiplying
        progress(len(motion.angles), len(motion.angles))
    finally:
        set_threads(before)
    return seconds, relighters


def hold_still(
    transport: Transport,
    env: Environment,
    motion: Motion,
    row: Entrant,
    relighter: Relighter,
    records: Sequence[Record],
) -> Still:
    """Holds the light until a follower has all of it; goes on for a few frames that
    send nothing; then turns on, at the highest speed, and jumps a quarter turn.

    `relighter` has followed the whole motion, as `records` tell.
    """
    final, columns = motion.angles[-1], transport.shape[1]
    light = env.rotated(final, motion.axis)
    most = -(-columns // max(row.budget or columns, 1))
    held = [record.frame - motion.stop for record in records[motion.stop :] if record.converged]
    frames, frame = motion.hold + 1, relighter.step(light)
    while not frame.converged and frames <= most:
        frame, frames = relighter.step(light), frames + 1
    exact = frame.converged and np.array_equal(frame.values, transport.multiply(relighter.values))
    fixed = float(np.median([relighter.step(light).seconds for _ in range(_NOTHING_SENT)]))
    restarted = relighter.step(env.rotated(final + motion.degrees_a_frame, motion.axis))
    jumped = relighter.step(env.rotated(final + 90.0, motion.axis))
    return Still(
        method=row.name,
        threads=used_threads(),
        frames=min([frames, *held]),
        most_frames=most,
        exact=exact,
        fixed_seconds=fixed,
        restart_seconds=restarted.seconds,
        restart_resets=restarted.resets,
        jump_seconds=jumped.seconds,
        jump_resets=jumped.resets,
    )
