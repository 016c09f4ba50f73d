"""Relighting: one viewer's state over a transport, following a moving light within a budget."""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._core import Settings, Updater
from ..light.environment import Environment
from ..transport.transport import Transport
from ..update.choice import State
from ..update.methods import Incremental, Method
from ..update.settings import asked, settings, weights_of

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
        How coefficients are chosen: `PerBand(terms=30)`, `Nonlinear`, `Incremental`, `Full`, or a `Method` of
        one's own. Under a budget in
        ``milliseconds`` a frame sends what lets it end in time, resets included, as far as the frames before tell;
        where not even its fixed part (light, choosing, writing the picture) fits, it sends the first column only. The
        first frame under ``initial="full"`` takes as long as the whole product takes.
    initial
        What the first frame applies: "full", the whole light; "nonlinear", its largest terms within the method's
        budget, whatever the method; None, the method's own first choice from black.
    second
        How the second stage of a transport of two is followed; by default the largest changes of a quarter of its
        columns.
    mix
        (rows, factors): by which weights the responses of several factors are added; see `Relighter.mix`.

    Raises
    ------
    ValueError
        If an argument cannot be used.
    """

    def __init__(
        self,
        transport: Transport,
        method: Method,
        initial: str | None = "full",
        *,
        second: Method | None = None,
        mix: ArrayLike | None = None,
    ) -> None:
        if initial not in ("full", "nonlinear", None):
            raise ValueError(f'expected initial="full", "nonlinear" or None, got {initial!r}')
        if not isinstance(method, Method):
            raise ValueError(f"expected an update method such as PerBand(terms=30), got {method!r}")
        self.transport = transport
        self.method = method
        core, weights = transport._core, None if mix is None else transport.mixed(mix)
        timed = method.milliseconds is not None
        self._seconds = None if method.milliseconds is None else _ON_TIME * method.milliseconds / 1000
        norms = transport.column_norms if method.weight in ("transport", "cost") else None
        costs = transport.column_costs if method.weight == "cost" or timed else None
        areas = transport.columns.areas
        chosen = settings(
            method,
            areas,
            column_norms=norms,
            column_costs=costs,
            band_norms=core.error_factors(weights) if method.error is not None else None,
            timed=timed,
        )
        self._core = Updater(core, chosen, _second(transport, second), initial=initial)
        self._weights = weights_of(method, areas, norms, costs) if method.is_own else None
        if weights is not None:
            self._core.set_mix(weights)

    def step(self, light: Environment | ArrayLike) -> Frame:
        """One frame towards a light.

        Parameters
        ----------
        light
            An `Environment`, or V itself, (columns, 3).

        Returns
        -------
        Frame
            The response under the light as applied now, and how far it is from the exact one at most.

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
        given = None if self._weights is None else self._ask(V, self._weights)
        projected = time.perf_counter() - started
        left = None if self._seconds is None else self._seconds - projected
        values, (columns, _, resets), bound, converged, choosing, multiplying = self._core.step(V, left, given)
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

    def _ask(self, V: NDArray[np.float64], weights: NDArray[np.float64]) -> tuple[list[int], NDArray[np.uint32]] | None:
        """What a method of one's own says of a frame; None where it is settled what the first frame takes."""
        prepared = self._core.prepare(V)
        if prepared is None:
            return None
        columns = self.transport.columns
        return asked(self.method, State(*prepared, columns.bands, columns.areas, weights))

    def mix(self, weights: ArrayLike) -> NDArray[np.float32]:
        """Mixes the factors' responses anew: another view of a glossy scene, another BRDF of a family.

        Nothing of the light is sent for it, and the result is exact: it is what `Transport.multiply` of `values` gives
        with this mix.

        Parameters
        ----------
        weights
            (rows, factors): from now on the responses are added by these.

        Returns
        -------
        (rows, 3) float32
            B under the light as applied so far.

        Raises
        ------
        ValueError
            If the shape is wrong or a weight is not finite.
        """
        self._core.set_mix(self.transport.mixed(weights))
        return self._core.write()

    def bounds(self, frame: Frame) -> NDArray[np.float32]:
        """The bound of every receiver by itself; `Frame.bound` is the largest of them.

        Parameters
        ----------
        frame
            What the last step gave.

        Returns
        -------
        (rows, 3) float32
            In the unit of `Frame.values`.
        """
        return self._core.bounds(frame.values)

    @property
    def values(self) -> NDArray[np.float64]:
        """V as applied so far, (columns, 3) float64: `transport.multiply` of it is the last frame, bit for bit."""
        return self._core.values()

    @property
    def nbytes(self) -> int:
        """Bytes beyond M that this relighter holds."""
        return self._core.nbytes


def _second(transport: Transport, method: Method | None) -> Settings | None:
    """How the second stage is followed: by the changes that matter most to its rows."""
    columns = transport.second_columns
    if columns is None:
        if method is not None:
            raise ValueError("expected second= with a transport of two stages only, but this one has one")
        return None
    if method is None:
        method = Incremental(terms=-(-columns.columns // 4), weight="transport")
    if method.milliseconds is not None or method.error is not None or method.is_own:
        raise ValueError(
            f"expected a budget in terms, and a method of the package, for the second stage, got {method!r}"
        )
    return settings(method, columns.areas, column_norms=transport._core.second_column_norms())
