"""Relighting: one viewer's state over a transport, following a moving light within a budget."""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._core import Updater
from ..light.environment import Environment
from ..transport.transport import Transport
from ..update.methods import Method
from ..update.settings import settings

__all__ = ["Frame", "Relighter"]

# What is done with a frame after its product takes this much less than all of a budget in time.
_ON_TIME = 0.98


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
        How coefficients are chosen: `PerBand(terms=30)`, `Nonlinear`, `Incremental`, `Full`. Under a budget in
        ``milliseconds`` a frame sends what lets it end in time, resets included, as far as the frames before tell;
        where not even its fixed part (light, choosing, writing the picture) fits, it sends the first column only. The
        first frame under ``initial="full"`` takes as long as the whole product takes.
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
        timed = milliseconds is not None
        self._seconds = None if milliseconds is None else _ON_TIME * milliseconds / 1000
        chosen = settings(
            method,
            transport.columns.areas,
            transport.column_norms if weight in ("transport", "cost") else None,
            transport.column_costs if weight == "cost" or timed else None,
            kept.max(axis=0) if getattr(method, "error", None) is not None else None,
            # The core sets it anew in every frame.
            milliseconds_cost=0.0 if timed else None,
        )
        self._core = Updater(core, chosen, initial == "full")

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
        left = None if self._seconds is None else self._seconds - projected
        values, (columns, _, resets), bound, converged, choosing, multiplying = self._core.step(V, left)
        seconds = time.perf_counter() - started
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
