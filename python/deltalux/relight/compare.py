"""A few methods side by side over one moving light: errors and times as rows, without pages or pictures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .._core import threads as used_threads
from ..light.environment import Environment
from ..light.motion import Motion
from ..mistakes import instead_of
from ..progress import Progress, reporter
from ..transport.transport import Transport
from ..update.methods import Method
from .entrants import EXACT, Entrant, own
from .replay import Replay, replay, time_frames

__all__ = ["Comparison", "compare"]

_MEANS = ("light_l1", "light_l2", "image_l1", "image_l2", "columns", "streamed_bytes")


@dataclass(frozen=True)
class Comparison:
    """One method over one moving light. Errors are means over the turning frames, relative to the exact product.

    Attributes
    ----------
    method
        Its settings, as text.
    light_l1, light_l2
        Of the light applied: area-weighted L1, and L2.
    image_l1, image_l2
        Of the picture, surfaces only.
    image_worst
        The largest error of a pixel in any frame, over the root mean square of the picture.
    within_bound
        Whether every receiver of every frame was within its bound.
    milliseconds, p95_milliseconds
        Of whole frames: the median, and the 95th percentile.
    columns
        Sent a frame, in the mean.
    streamed_bytes
        Of M, a frame, in the mean.
    state_bytes
        What the follower holds beyond M.
    """

    method: str
    light_l1: float
    light_l2: float
    image_l1: float
    image_l2: float
    image_worst: float
    within_bound: bool
    milliseconds: float
    p95_milliseconds: float
    columns: float
    streamed_bytes: float
    state_bytes: int


def compare(
    transport: Transport,
    env: Environment,
    methods: Sequence[Method],
    *,
    motion: Motion | None = None,
    progress: bool | Progress = False,
) -> list[Comparison]:
    """Measures methods side by side over one turning light.

    Parameters
    ----------
    transport
        M, of pixels.
    env
        The light.
    methods
        What is compared: `PerBand(terms=30)`, a `Method` of one's own, ...
    motion
        How the light turns; by default 45 degrees in 100 frames, then 25 still.
    progress
        True: bars on standard error. A callable: progress(done, total), for errors and times each.

    Returns
    -------
    list of Comparison
        One for every method, in their order.

    Raises
    ------
    ValueError
        If there is nothing to compare, or an argument cannot be used.
    """
    if not isinstance(transport, Transport):
        raise instead_of("Transport", transport)
    if not isinstance(env, Environment):
        raise instead_of("Environment", env)
    if isinstance(methods, (str, Method)) or not methods:
        raise ValueError("expected a list of at least one update method such as [PerBand(terms=30)]")
    motion = motion or Motion()
    rows = [EXACT, *own(methods)]
    found = replay(
        transport, env, motion, rows, show=lambda *_: None, progress=reporter(progress, f"{env.name}: errors")
    )
    seconds, _ = time_frames(
        transport, env, motion, rows, threads=used_threads(), progress=reporter(progress, f"{env.name}: times")
    )
    return [_row(entrant, found, seconds[entrant.name], motion) for entrant in rows[1:]]


def _row(entrant: Entrant, found: Replay, seconds: NDArray[np.float64], motion: Motion) -> Comparison:
    name = entrant.name
    turning = slice(1, motion.stop + 1)
    mean = {what: float(found.column(name, what)[turning].mean()) for what in _MEANS}
    median, p95 = 1e3 * np.percentile(seconds[turning, 0], (50, 95))
    records = found.records[name]
    return Comparison(
        method=repr(entrant.method),
        light_l1=mean["light_l1"],
        light_l2=mean["light_l2"],
        image_l1=mean["image_l1"],
        image_l2=mean["image_l2"],
        image_worst=max(record.image_worst for record in records),
        within_bound=all(record.within_bound for record in records),
        milliseconds=float(median),
        p95_milliseconds=float(p95),
        columns=mean["columns"],
        streamed_bytes=mean["streamed_bytes"],
        state_bytes=found.relighter_bytes[name],
    )
