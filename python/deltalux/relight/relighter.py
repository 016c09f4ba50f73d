"""Relighting: one viewer's state over a transport, following a moving light within a budget."""

from __future__ import annotations

import threading
import time
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._core import Settings, Updater
from ..camera import Camera
from ..images.encoded import encoded
from ..io import auto_exposure, to_display
from ..light.environment import Environment
from ..light.skies import BUILTIN
from ..mistakes import described, instead_of
from ..transport.transport import Transport
from ..update.choice import State
from ..update.methods import Full, Incremental, Method
from ..update.settings import asked, settings, weights_of
from .bound import Bound, Doubt
from .peak_split import PeakSplit

__all__ = ["Frame", "Relighter"]

# What the core says of a frame: B; columns, changes and resets; its number; and what `Frame` says in these words.
_Stepped = tuple[
    NDArray[np.float32],
    tuple[NDArray[np.uint32], NDArray[np.float64], list[int]],
    int,
    tuple[tuple[float, float, float], tuple[float, float, float], list[tuple[float, float, float]]],
    bool,
    float,
    float,
]

# What is done with a frame after its product takes this much less than all of a budget in time.
_ON_TIME = 0.98


@dataclass(frozen=True, eq=False)
class Frame:
    """One relit frame.

    Attributes
    ----------
    values
        (rows, 3) float32: B, the response of every receiver before the albedo. Exactly what a fresh product of the
        light as applied so far gives; of two stages, once `converged`.
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
        asked for: what is not yet applied, what truncation took, and rounding (Cauchy-Schwarz in every band). A number
        that knows its parts, ``bound.pending`` and ``bound.truncation``, both relative to the picture,
        ``bound.relative``, and how large the error probably is, ``bound.estimate``. Infinite where B is beyond float32.
    converged
        Whether the light has been applied in full, with all of its suns and lamps in texel columns where there are any:
        rounded to the grid of the relighter, which leaves room for it to grow, and is coarser after a brighter one.
        `multiply` of the light itself rounds finer: it may be off from such a frame by what `bound` says.
    """

    values: NDArray[np.float32]
    columns: NDArray[np.uint32]
    resets: tuple[int, ...]
    seconds: float
    choosing: float
    multiplying: float
    bound: Bound
    converged: bool
    _transport: Transport = field(repr=False)
    _env: Environment | None = field(repr=False)
    _number: int = field(repr=False)

    def __repr__(self) -> str:
        sent, state = len(self.columns), "converged" if self.converged else "moving"
        return f"<Frame of {len(self.values):,} rows, {state}: {sent:,} columns sent, bound {self.bound:.3g}>"

    def _repr_png_(self) -> bytes | None:
        if self._transport.receivers.kind != "pixels":
            return None
        return encoded(to_display(self.image, auto_exposure(self.image)))

    @cached_property
    def image(self) -> NDArray[np.float32]:
        """(height, width, 3) float32 linear radiance; the environment behind the scene where one was given."""
        return self._transport.image(self.values, self._env)

    @cached_property
    def colours(self) -> NDArray[np.float32]:
        """(rows, 3) float32 linear radiance of vertices; ValueError where the rows are something else."""
        return self._transport.colours(self.values)

    def render(self, camera: Camera) -> NDArray[np.float32]:
        """The frame of vertices as a camera sees it.

        Parameters
        ----------
        camera
            Any.

        Returns
        -------
        (height, width, 3) float32
            Linear radiance; the environment behind the scene where one was given.

        Raises
        ------
        ValueError
            If the rows are no vertices.
        """
        return self._transport.render(camera, self.values, self._env)


class Relighter:
    """Follows a moving light over one transport.

    Where M has texel columns, a frame under an `Environment` sends as many of its suns and lamps through them as its
    budget follows (an eighth of its terms), and all of them once the light stands still; V itself is taken as it is.

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
        (rows, factors): by which weights the responses of several factors are added; needed where there are several.
        See `Relighter.mix`.
    steady
        Whether no light that came before leaves a trace: what a light gives once it has been applied in full is then
        what it gives a new relighter, bit for bit. Otherwise a much brighter light may leave the 2^-20th part of
        itself, until the light has faded far below it; in return a light that grows or fades 16-fold costs no product.

    Raises
    ------
    TypeError
        If the first argument is no transport.
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
        steady: bool = False,
    ) -> None:
        if initial not in ("full", "nonlinear", None):
            raise ValueError(f'expected initial="full", "nonlinear" or None, got {initial!r}')
        if not isinstance(transport, Transport):
            raise instead_of("Transport", transport)
        if not isinstance(method, Method):
            raise ValueError(f"expected an update method such as PerBand(terms=30), got {described(method)}")
        self.transport = transport
        self.method = method
        mix = None if mix is None else np.array(mix, np.float32)
        self._asked = (initial, second, mix)
        self._stepped = False
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
        self._split, self._whole = PeakSplit(transport.columns, method), True
        self._core = Updater(
            core, chosen, _second(transport, second), mix=weights, initial=initial, steady=bool(steady)
        )
        self._weights = weights_of(method, areas, norms, costs) if method.is_own else None
        # What a method of one's own is shown, and the frame that follows its choice, are one step for all threads.
        self._asking = threading.RLock()

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
            V, whole = self._split.coefficients(env)
        else:
            whole = True
            try:
                V = np.ascontiguousarray(() if light is None else light, np.float64)
            except (TypeError, ValueError):
                raise instead_of("Environment", light) from None
        if V.shape != (self.transport.shape[1], 3):
            raise ValueError(f"expected a light of shape ({self.transport.shape[1]}, 3), got {V.shape}")
        if self._weights is None:
            return self._step(V, started, None, env, whole)
        V = V.copy()  # Looked at twice: what another thread writes meanwhile is in neither look or in both.
        with self._asking:
            return self._step(V, started, self._ask(V, self._weights), env, whole)

    def _step(
        self,
        V: NDArray[np.float64],
        started: float,
        given: tuple[list[int], NDArray[np.uint32]] | None,
        env: Environment | None,
        whole: bool,
    ) -> Frame:
        projected = time.perf_counter() - started
        left = None if self._seconds is None else self._seconds - projected
        stepped = self._core.step(V, left, given)
        self._whole, self._stepped = whole, True
        frame = self._frame(stepped, started, projected, env, whole)
        if env is not None:
            self._split.note(len(frame.columns), stepped[4])
        return frame

    def _ask(self, V: NDArray[np.float64], weights: NDArray[np.float64]) -> tuple[list[int], NDArray[np.uint32]] | None:
        """What a method of one's own says of a frame; None where it is settled what the first frame takes."""
        values = self._core.prepare(V)
        if values is None:
            return None
        columns = self.transport.columns
        return asked(self.method, State(V, values, columns.bands, columns.areas, weights))

    def _frame(
        self, stepped: _Stepped, started: float, projected: float, env: Environment | None, whole: bool
    ) -> Frame:
        values, (columns, _, resets), number, parts, converged, choosing, multiplying = stepped
        bound, truncation, remaining = parts
        # Of a light that has been applied in full nothing is pending but what was rounded.
        arrived = converged and whole
        taken = bound if arrived else truncation
        return Frame(
            values=values,
            columns=columns,
            resets=tuple(resets),
            seconds=time.perf_counter() - started,
            choosing=projected + choosing,
            multiplying=multiplying,
            bound=Bound(max(bound), max(taken), Doubt(values, remaining, self.transport, _pessimism)),
            converged=arrived,
            _transport=self.transport,
            _env=env,
            _number=number,
        )

    def mix(self, weights: ArrayLike) -> Frame:
        """Mixes the factors' responses of the last frame anew: another view of a glossy scene, another BRDF.

        Nothing of the light is sent for it: it is the frame that `step` would have made with this mix, without the
        environment behind it. A budget in error holds for the new mix from the next frame on.

        Parameters
        ----------
        weights
            (rows, factors): from now on the responses are added by these.

        Returns
        -------
        Frame
            With a bound of its own.

        Raises
        ------
        ValueError
            If the shape is wrong, a weight is not finite, or there was no frame yet.
        """
        started = time.perf_counter()
        return self._frame(self._core.remix(self.transport.mixed(weights)), started, 0.0, None, self._whole)

    def bounds(self, frame: Frame) -> NDArray[np.float32]:
        """The bound of every receiver by itself; `Frame.bound` is the largest of them.

        Parameters
        ----------
        frame
            The last one, of `step` or `mix`.

        Returns
        -------
        (rows, 3) float32
            In the unit of `Frame.values`.

        Raises
        ------
        ValueError
            If the frame is not the last.
        """
        return self._core.bounds(frame._number, frame.values)

    def __reduce__(self) -> tuple[Any, ...]:
        # What was applied is sent whole to the copy, which then stands where this one does.
        return _restored, (self.transport, self.method, *self._asked, self.values if self._stepped else None)

    def __repr__(self) -> str:
        return f"<Relighter by {self.method!r} over {self.transport!r}>"

    @property
    def values(self) -> NDArray[np.float64]:
        """V as applied so far, (columns, 3) float64: `transport.multiply` of it is the last frame, bit for bit.

        Of two stages this is the first's V; their frame is the product once it is converged.
        """
        return self._core.values()

    @property
    def nbytes(self) -> int:
        """Bytes beyond M that this relighter holds."""
        return self._core.nbytes


# How many times the bound of truncation is the error, where that was not measured: of the built-in scenes 16 to 230.
_PESSIMISM = 70.0
_PESSIMISMS: WeakKeyDictionary[Transport, float] = WeakKeyDictionary()


def _pessimism(transport: Transport) -> float:
    """How many times the bound of truncation is the error that was measured, under the built-in lights."""
    if transport not in _PESSIMISMS:
        ratios = []
        for name, error in _measured(transport).items():
            bound = Relighter(transport, Full()).step(Environment.builtin(name)).bound
            ratios.append(bound.relative.truncation / error)
        _PESSIMISMS[transport] = float(np.median(ratios)) if ratios else _PESSIMISM
    return _PESSIMISMS[transport]


def _measured(transport: Transport) -> dict[str, float]:
    """Errors of truncation under built-in lights; none where none were measured, or B takes a mix."""
    try:
        errors = transport.errors
    except ValueError:
        return {}  # What was made in memory has no plan.
    return (
        {name: error for name, error in errors.items() if name in BUILTIN and error > 0}
        if transport._core.factors == 1
        else {}
    )


def _restored(
    transport: Transport,
    method: Method,
    initial: str | None,
    second: Method | None,
    mix: NDArray[np.float32] | None,
    values: NDArray[np.float64] | None,
) -> Relighter:
    """A pickled relighter; of two stages, the second has followed."""
    if values is None:
        return Relighter(transport, method, initial, second=second, mix=mix)
    relighter = Relighter(transport, method, "full", second=second, mix=mix)
    relighter.step(values)
    return relighter


def _second(transport: Transport, method: Method | None) -> Settings | None:
    """How the second stage is followed: by the changes that matter most to its rows."""
    columns = transport.second_columns
    if columns is None:
        if method is not None:
            raise ValueError("expected second= with a transport of two stages only, but this one has one")
        return None
    if method is not None and not isinstance(method, Method):
        raise ValueError(f"expected an update method as second=, got {method!r}")
    if method is None:
        method = Incremental(terms=-(-columns.columns // 4), weight="transport")
    if method.milliseconds is not None or method.error is not None or method.is_own or method.weight == "cost":
        raise ValueError(
            "expected a budget in terms, a weight without costs, and a method of the package for the second stage, "
            f"got {method!r}"
        )
    return settings(method, columns.areas, column_norms=transport._core.second_column_norms())
