"""Relighting: one viewer's state over a transport, following a moving light within a budget."""

from __future__ import annotations

import time
from collections import deque
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _core
from .approximation import settings
from .environment import Environment
from .methods import Method
from .transport import Transport

__all__ = ["Frame", "Relighter"]


@dataclass(frozen=True, eq=False)
class Frame:
    """One relit frame.

    Attributes
    ----------
    values
        (rows, 3) float32: B, the response of every receiver before the albedo. Exactly what a fresh product of the
        light as applied so far gives.
    columns
        (m,) uint32: the columns that were sent, ascending.
    resets
        Bands that started anew.
    seconds
        What the frame took: light to coefficients, choosing, multiplying, and the bound.
    choosing, multiplying
        Two parts of it: coefficients, tests and selection; and the product.
    bound
        No receiver's red, green or blue in `values` is further than this from the untruncated product with the light
        asked for: what is not yet applied, what truncation took, and rounding (Cauchy-Schwarz in every band).
    converged
        Whether the light has been applied in full.
    """

    values: NDArray[np.float32]
    columns: NDArray[np.uint32]
    resets: tuple[int, ...]
    seconds: float
    choosing: float
    multiplying: float
    bound: float
    converged: bool
    _transport: Transport = field(repr=False)
    _env: Environment | None = field(repr=False)

    @cached_property
    def image(self) -> NDArray[np.float32]:
        """(height, width, 3) float32 linear radiance; the environment behind the scene where one was given."""
        return self._transport.image(self.values, self._env)


class Relighter:
    """Follows a moving light over one transport.

    Parameters
    ----------
    transport
        M; shared, never changed.
    method
        How coefficients are chosen: `PerBand(terms=30)`, `Nonlinear`, `Incremental`, `Full`.
    initial
        What the first frame applies: "full", the whole light; "nonlinear", its largest terms within the method's
        budget; None, the method's own first choice from black.

    Raises
    ------
    ValueError
        If an argument cannot be used.
    """

    def __init__(self, transport: Transport, method: Method, initial: str | None = "full") -> None:
        if initial not in ("full", "nonlinear", None):
            raise ValueError(f'expected initial="full", "nonlinear" or None, got {initial!r}')
        self.transport = transport
        self.method = method
        core = transport._core
        kept = core.kept()
        weight = getattr(method, "weight", "area")
        milliseconds = getattr(method, "milliseconds", None)
        self._deadline = None if milliseconds is None else _Deadline(milliseconds)
        chosen = settings(
            method,
            transport.columns.areas,
            transport.column_norms if weight in ("transport", "cost") else None,
            transport.column_bytes if weight == "cost" or self._deadline else None,
            kept.max(axis=0) if getattr(method, "error", None) is not None else None,
            milliseconds_cost=self._deadline.bytes if self._deadline else None,
        )
        self._core = _core.Updater(core, chosen, initial == "full")

    def step(self, light: Environment | ArrayLike) -> Frame:
        """One frame towards a light.

        Parameters
        ----------
        light
            An `Environment`, or V itself, (columns, 3).

        Raises
        ------
        ValueError
            If the light cannot be used; the state is then what it was.
        """
        started = time.perf_counter()
        env = light if isinstance(light, Environment) else None
        if env is not None:
            V = self.transport.coefficients(env)
        else:
            V = np.ascontiguousarray(light, np.float64)
        if V.shape != (self.transport.shape[1], 3):
            raise ValueError(f"expected a light of shape ({self.transport.shape[1]}, 3), got {V.shape}")
        projected = time.perf_counter() - started
        values, (columns, _, resets), bound, converged, choosing, multiplying = self._core.step(V)
        seconds = time.perf_counter() - started
        if self._deadline is not None:
            self._deadline.learn(seconds, float(self.transport.column_bytes[columns].sum()))
            self._core.set_cost(self._deadline.bytes)
        return Frame(
            values=values,
            columns=columns,
            resets=tuple(resets),
            seconds=seconds,
            choosing=projected + choosing,
            multiplying=multiplying,
            bound=max(bound),
            converged=converged,
            _transport=self.transport,
            _env=env,
        )

    def bounds(self, frame: Frame) -> NDArray[np.float32]:
        """The bound of every receiver, (rows, 3) float32, for the frame of the last step."""
        return self._core.bounds(frame.values)

    @property
    def values(self) -> NDArray[np.float64]:
        """V as applied so far, (columns, 3) float64: `transport.multiply` of it is the last frame, bit for bit."""
        return self._core.values()

    @property
    def nbytes(self) -> int:
        """Bytes beyond M that this relighter holds."""
        return self._core.nbytes


class _Deadline:
    """How many bytes of M a frame may stream to end in time, learnt from the frames before.

    A frame takes a fixed part and a part for each byte; both are held at the slow end of what the last frames showed.
    """

    def __init__(self, milliseconds: float) -> None:
        self._seconds = milliseconds / 1000
        self._fixed: deque[float] = deque(maxlen=64)
        self._rate = 2e9
        self.bytes = max(self._seconds - 5e-4, 0.0) * self._rate

    def learn(self, seconds: float, streamed: float) -> None:
        """Takes in one frame: what it took and what it streamed."""
        self._fixed.append(seconds - streamed / self._rate)
        fixed = max(float(np.quantile(self._fixed, 0.9)), 0.0)
        if streamed > 1e5 and seconds > fixed:
            # Slower at once, faster by and by.
            rate = streamed / (seconds - fixed)
            self._rate = min(rate, self._rate) if rate < self._rate else self._rate + 0.05 * (rate - self._rate)
        self.bytes = max(self._seconds - fixed, 0.0) * self._rate
