"""The studio: lamps that move and materials that are edited, under global illumination (Nguyen 2010).

I = direct + k_d D L + k_s sum_k c_k(gamma) T_k L          (section 6)

a lamp moves    what it sees is traced, L_d follows, L = L_d + rho M_s L_d + .., then D L and T L
gamma moves     T_k L of the material that is edited stand; they are mixed anew, which is exact
"""

from __future__ import annotations

import time
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._core import Behind, Sights
from .._core import Lamp as CoreLamp
from .._core import Transport as CoreTransport
from ..checks import Vector, as_vector
from ..light.environment import Environment
from ..light.lamps import Lamp, far_lamps
from ..relight.relighter import Frame, Relighter
from ..transport.studio import EACH, StudioPart, StudioTransport
from ..transport.transport import Transport
from ..update.methods import Full, Method

__all__ = ["Memory", "Studio", "StudioFrame"]

_DIRECTIONS = 256
"""That an environment is taken apart into."""
_SHINE = 0.3
"""k_s at the start."""
Colours = NDArray[np.float64]


class Memory(NamedTuple):
    """Bytes of matrices that a studio works with (table 5 of Nguyen 2010)."""

    live: int
    """T_k of the segment that is edited; 0 in lighting mode."""
    frozen: int
    """Of all other materials."""
    diffuse: int
    """D."""
    bounces: int
    """M_s."""

    @property
    def total(self) -> int:
        """All of them."""
        return sum(self)


@dataclass(frozen=True)
class Look:
    """How a material looks."""

    k_d: Vector
    colour: Vector | None
    """In the place of its diffuse albedo."""
    k_s: Vector
    gamma: float | None


@dataclass(frozen=True, eq=False)
class StudioFrame:
    """One frame of a studio.

    Attributes
    ----------
    values : (rows, 3) float32
        What each row of the view sends to the eye: direct light, and that of other surfaces.
    seconds
        What the frame took; the picture is put together when it is asked for.
    traced, solved, sent
        Parts of it: what lamps see, light of the samples, and the products behind them.
    bound
        No value is further off than this from what untruncated matrices give for the light as it has been traced: by
        light that is not sent yet, by truncation, and by rounding. What gather samples and families are off by
        themselves is no part of it.
    residual
        How far the family of the material that is edited is off its model at this gamma, relative to the lobe's peak.
    converged
        Whether all lamps have been traced in full, and all light has been sent.
    """

    values: NDArray[np.float32]
    seconds: float
    traced: float
    solved: float
    sent: float
    bound: float
    residual: float
    converged: bool
    _transport: StudioTransport = field(repr=False)
    _env: Environment | None = field(repr=False)

    @cached_property
    def image(self) -> NDArray[np.float32]:
        """(height, width, 3) float32 linear radiance; the environment behind the scene where there is one."""
        pixels = self._transport.diffuse.pixels
        picture = pixels.shown(self.values)
        if self._env is not None:
            self._env._behind(Behind(pixels.background, self._transport.camera.directions()), picture)
        return picture


@dataclass(eq=False)
class _Lit:
    """A part of a lamp as it has been traced."""

    lamp: CoreLamp
    sights: Sights
    view: Colours
    """Irradiance over pi of the rows of the view."""
    samples: Colours
    """The same of the samples."""
    reflected: dict[str, tuple[float, Colours]] = field(default_factory=dict)
    """Of each material its gamma, and what its rows send on of this part."""


_Sources = list[tuple[tuple[CoreLamp, ...], list[_Lit]]]
"""The parts of every lamp, and what of them has been traced."""


class _Follower:
    """One matrix and its follower; the frame that it is at."""

    def __init__(self, transport: Transport, method: Method, mix: NDArray[np.float64] | None = None) -> None:
        rows = transport.shape[0]
        self.transport, self._mix = transport, mix
        weights = None if mix is None else np.tile(mix, (rows, 1))
        self._relighter = Relighter(transport, method, mix=weights, steady=True)
        self.frame: Frame | None = None
        self._light: Colours | None = None

    def follow(self, light: Colours) -> None:
        """Towards the light; what has arrived costs nothing."""
        if self.frame is None or not self.frame.converged or self._light is not light:
            self.frame, self._light = self._relighter.step(light), light

    def mix(self, numbers: NDArray[np.float64]) -> None:
        """Another mix of the same responses."""
        if self._mix is not None and not np.array_equal(numbers, self._mix):
            self._mix = numbers
            self.frame = self._relighter.mix(np.tile(numbers, (self.transport.shape[0], 1)))


class Studio:
    """Relights and edits a studio's transport.

    A studio begins in lighting mode: every material's transport is frozen at its gamma into one matrix, and lamps move
    freely. `edit` makes the transport of one material live, so that its gamma moves; what all others show stands.

    Parameters
    ----------
    transport
        Of `precompute_studio`, or opened by `StudioTransport.open`; shared, never changed.
    method
        How light at the samples is sent through D and T when lamps move, as for `Relighter`; None: all of it, in every
        frame.

    Raises
    ------
    ValueError
        If an argument cannot be used.

    Examples
    --------
    >>> studio = Studio(transport)  # doctest: +SKIP
    >>> studio.set_lights([Spot((0, 2, 0), (0, 0, 0), 30.0)])  # doctest: +SKIP
    >>> studio.edit("floor")  # doctest: +SKIP
    >>> studio.set("floor", gamma=100)  # doctest: +SKIP
    >>> studio.step().image  # doctest: +SKIP
    """

    def __init__(self, transport: StudioTransport, method: Method | None = None) -> None:
        if not isinstance(transport, StudioTransport):
            raise ValueError(f"expected a transport of dl.precompute_studio, got {transport!r}")
        if method is not None and not isinstance(method, Method):
            raise ValueError(f"expected an update method such as Incremental(terms=300), got {method!r}")
        self.transport, self.method = transport, Full() if method is None else method
        self._looks = {number: Look((1.0,) * 3, None, (0.0,) * 3, None) for number in self._numbers}
        for part in transport.parts.values():
            self._looks[part.number] = Look((1.0,) * 3, None, (_SHINE,) * 3, part.family.range[0])
        self._live: str | None = None
        self._lamps: list[Lamp] = []
        self._env: Environment | None = None
        self._lit: dict[Any, list[_Lit]] = {}
        self._frozen: dict[str, tuple[float, Transport]] = {}
        self._followers: dict[str, tuple[Any, _Follower]] = {}
        self._diffuse = _Follower(transport.diffuse, self.method)
        self._light: tuple[Any, Colours, float] | None = None
        self.freeze_seconds = 0.0
        """That the last freezing took."""

    @property
    def _numbers(self) -> range:
        materials = [self.transport.material, self.transport.diffuse.receivers.material]
        return range(max(int(own.max()) + 1 for own in materials if own is not None and own.size))

    def _part(self, name: str) -> StudioPart:
        parts = self.transport.parts
        if name not in parts:
            raise ValueError(f"expected a material of {', '.join(parts) or 'none'}, got {name!r}")
        return parts[name]

    def edit(self, name: str) -> None:
        """Makes the transport of one material live, and freezes the one that was.

        Parameters
        ----------
        name
            Of the material.

        Raises
        ------
        ValueError
            If there is no such material of a family.
        """
        self._part(name)
        self._live = name

    def light_mode(self) -> None:
        """Freezes the material that is edited: from now on lamps move, with the least work."""
        self._live = None

    def set(
        self,
        name: str,
        *,
        gamma: float | None = None,
        k_s: ArrayLike | None = None,
        k_d: ArrayLike | None = None,
        colour: ArrayLike | None = None,
    ) -> None:
        """Another look of a material of a family, from the next frame on.

        Parameters
        ----------
        name
            Of the material.
        gamma
            Of its lobe, within the range of its family; of the material that is edited only.
        k_s, k_d
            What its lobe and its diffuse reflectance are multiplied by: red, green and blue, or one number.
        colour
            Its diffuse reflectance, in the place of the scene's albedo.

        Raises
        ------
        ValueError
            If there is no such material, gamma is another material's than the edited one's, or a number is out of its
            range; nothing is changed then.
        """
        part, numbers = self._part(name), {"k_s": k_s, "k_d": k_d, "colour": colour}
        given: dict[str, Any] = {key: _colour(key, value) for key, value in numbers.items() if value is not None}
        if gamma is not None:
            low, high = part.family.range
            if not low <= float(gamma) <= high:
                raise ValueError(f"expected gamma of {name} from {low:g} to {high:g}, got {gamma}")
            if self._live != name:
                raise ValueError(f"expected {name} to be edited when its gamma moves: call edit({name!r}) first")
            given["gamma"] = float(gamma)
        look = replace(self._looks[part.number], **given)
        albedo = self.transport.albedo[self.transport.material == part.number].max(axis=0, initial=0.0)
        diffuse = np.asarray(look.k_d) * (albedo if look.colour is None else look.colour)
        if (diffuse + look.k_s).max() > 1.0 + 1e-6:
            warnings.warn(f"{name} may reflect more light than it receives: k_d + k_s is above 1", stacklevel=2)
        self._looks[part.number] = look

    def set_lights(self, lamps: Sequence[Lamp], env: Environment | None = None) -> None:
        """Other lamps, from the next frame on; those that stand where they stood are not traced again.

        Parameters
        ----------
        lamps
            `PointLight`, `Spot` and `AreaLight`. What an area light's places see is traced in four frames.
        env
            An environment around the scene, taken apart into 256 directions; None: black.

        Raises
        ------
        ValueError
            If one is no lamp.
        """
        wrong = [lamp for lamp in lamps if not isinstance(lamp, Lamp)]
        if wrong:
            raise ValueError(f"expected lamps such as dl.PointLight((0, 2, 0), 30), got {wrong[0]!r}")
        if env is not None and not isinstance(env, Environment):
            raise ValueError(f"expected the environment as a dl.Environment, got {env!r}")
        self._lamps, self._env = list(lamps), env

    def step(self) -> StudioFrame:
        """One frame of the studio as it has been set.

        Returns
        -------
        StudioFrame
            The first one traces a part of every lamp and sends all light.

        Raises
        ------
        ValueError
            If the lamps together are brighter than numbers can hold.
        """
        began = time.perf_counter()
        sources = self._traced()
        traced = time.perf_counter()
        light, unsure = self._light_of_samples(sources)
        solved = time.perf_counter()
        values, bound, followed = self._shown(sources, light, unsure)
        done = time.perf_counter()
        live = None if self._live is None else self._part(self._live)
        gamma = None if live is None else self._looks[live.number].gamma
        return StudioFrame(
            values=values,
            seconds=done - began,
            traced=traced - began,
            solved=solved - traced,
            sent=done - solved,
            bound=bound,
            residual=0.0 if live is None or gamma is None else live.family.errors_at([gamma])[0].peak,
            converged=followed and all(len(lit) == len(parts) for parts, lit in sources),
            _transport=self.transport,
            _env=self._env,
        )

    def _traced(self) -> _Sources:
        """The parts of all lamps, and what of them has been traced: one part more of each that is not done."""
        keys: list[Any] = [*self._lamps]
        parts = [lamp._parts for lamp in self._lamps]
        if self._env is not None:
            # An environment is known by itself: what is drawn from it never changes.
            keys.append(self._env)
            known = self._lit.get(self._env)
            parts.append(far_lamps(self._env, _DIRECTIONS) if known is None else tuple(own.lamp for own in known))
        self._lit = {key: self._lit.get(key, []) for key in keys}
        found = []
        for key, own in zip(keys, parts, strict=True):
            lit = self._lit[key]
            if len(lit) < len(own):
                lit.append(self._lit_by(own[len(lit)]))
            found.append((own, list(lit)))
        return found

    def _lit_by(self, lamp: CoreLamp) -> _Lit:
        view, cells = self.transport.view, self.transport.cells
        sights = view.sights(lamp)
        samples = cells.irradiance(lamp, cells.sights(lamp)).reshape(-1, EACH, 3).mean(axis=1)
        return _Lit(lamp, sights, view.irradiance(lamp, sights), samples)

    def _reflectance(self, albedo: NDArray[np.float32], material: NDArray[np.uint16]) -> Colours:
        """Diffuse reflectances under the looks of materials."""
        found = albedo.astype(np.float64)
        for part in self.transport.parts.values():
            look, own = self._looks[part.number], material == part.number
            if look.colour is not None:
                found[own] = look.colour
            found[own] *= look.k_d
        return found

    def _light_of_samples(self, sources: _Sources) -> tuple[Colours, float]:
        """L over the tree, and how far it may be from that of untruncated bounces."""
        transport = self.transport
        looks = tuple((look.k_d, look.colour) for look in self._looks.values())
        key = (tuple(id(own) for _, lit in sources for own in lit), looks)
        if self._light is not None and self._light[0] == key:
            return self._light[1], self._light[2]
        rho = self._reflectance(transport.albedo, transport.material)
        passing = rho * _sum(sources, lambda own: own.samples, rho.shape)
        whole, off, unsure = passing.copy(), np.zeros(len(rho)), np.zeros(len(rho))
        kept, lost = self._norms
        for _ in range(transport.passes):
            V = transport.tree.forward(passing)
            passing = rho * transport.bounces.multiply(V)
            # No sum of a row and light is larger than their norms make it: of what is off, and of what the row lost.
            length = np.sqrt((transport._arrays["areas"] * off**2).sum())
            off = rho.max(axis=1) * (kept * length + lost * np.sqrt((V**2).sum(axis=0).max()))
            whole, unsure = whole + passing, unsure + off
        light = transport.tree.forward(whole)
        self._light = (key, light, float(np.sqrt((transport._arrays["areas"] * unsure**2).sum())))
        return self._light[1], self._light[2]

    @cached_property
    def _norms(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Of the rows of M_s: their norms, and those of what they lost."""
        core = self.transport.bounces._core
        return tuple(np.sqrt((own.astype(np.float64) ** 2).sum(axis=1)) for own in (core.kept(), core.dropped()))

    def _shown(self, sources: _Sources, light: Colours, unsure: float) -> tuple[NDArray[np.float32], float, bool]:
        """What rows send to the eye; how far it may be off; whether all light has been sent."""
        transport = self.transport
        receivers = transport.diffuse.receivers
        assert receivers.material is not None
        rho = self._reflectance(receivers.albedo, receivers.material)
        values = self._direct(sources, rho)
        self._diffuse.follow(light)
        assert self._diffuse.frame is not None
        values += rho * self._diffuse.frame.values
        largest = _largest_row(transport.diffuse._core)
        bound = float(rho.max(initial=0.0)) * (self._diffuse.frame.bound + largest * unsure)
        converged, added = self._diffuse.frame.converged, 0.0
        for name, part in transport.parts.items():
            follower, look = self._follower(name, light), self._looks[part.number]
            assert follower.frame is not None
            values[part.rows] += np.asarray(look.k_s) * follower.frame.values
            converged &= follower.frame.converged
            added = max(added, max(look.k_s) * (follower.frame.bound + self._largest(follower) * unsure))
        return values.astype(np.float32), bound + added, converged

    def _direct(self, sources: _Sources, rho: Colours) -> Colours:
        """What lamps send rows and rows send on."""
        values = rho * _sum(sources, lambda own: own.view, rho.shape)
        for part in self.transport.parts.values():
            k_s, shape = np.asarray(self._looks[part.number].k_s), (len(part.rows), 3)
            values[part.rows] += k_s * _sum(sources, partial(self._reflected, part), shape)
        return values

    def direct(self) -> NDArray[np.float32]:
        """What rows send to the eye of the lamps' own light, as far as it has been traced.

        Returns
        -------
        (rows, 3) float32
        """
        receivers = self.transport.diffuse.receivers
        assert receivers.material is not None
        rho = self._reflectance(receivers.albedo, receivers.material)
        return self._direct(self._traced(), rho).astype(np.float32)

    def _largest(self, follower: _Follower) -> float:
        """The norm of the longest row of what a material shows of light, whatever its mix."""
        core = follower.transport._core
        if core.factors == 1:
            return _largest_row(core)
        mix = np.abs(follower._mix) if follower._mix is not None else np.ones(core.factors)
        return float(core.error_factors(np.tile(mix, (core.rows, 1)).astype(np.float32)).sum())

    def _reflected(self, part: StudioPart, own: _Lit) -> Colours:
        """What a material's rows reflect of a part of a lamp, by the model itself."""
        gamma = self._looks[part.number].gamma
        known = own.reflected.get(part.name)
        if known is None or known[0] != gamma:
            eyes = np.ascontiguousarray(self.transport.eyes[part.rows])
            view, lobe = self.transport.view, (part.family._core, float(gamma or 0.0))
            known = (float(gamma or 0.0), view.reflected(own.lamp, own.sights, part.rows, eyes, lobe))
            own.reflected[part.name] = known
        return known[1]

    def _follower(self, name: str, light: Colours) -> _Follower:
        """The follower of a material's T, live or frozen, at the light and at its gamma."""
        part = self._part(name)
        gamma = float(self._looks[part.number].gamma or 0.0)
        live = self._live == name
        key = ("live", self._segment(part, gamma)) if live else ("frozen", gamma)
        known = self._followers.get(name)
        if known is None or known[0] != key:
            if live:
                transport = part.segments[self._segment(part, gamma)]
                known = (key, _Follower(transport, self.method, part.family.coefficients(gamma)))
            else:
                known = (key, _Follower(self._freeze(part, gamma), self.method))
            self._followers[name] = known
        follower = known[1]
        follower.follow(light)
        if live:
            follower.mix(part.family.coefficients(gamma))
        return follower

    def _segment(self, part: StudioPart, gamma: float) -> int:
        return int(np.searchsorted(part.family.borders[1:], gamma))

    def _freeze(self, part: StudioPart, gamma: float) -> Transport:
        """T of a gamma as one matrix, always from T_k."""
        known = self._frozen.get(part.name)
        if known is None or known[0] != gamma:
            began = time.perf_counter()
            segment = part.segments[self._segment(part, gamma)]
            numbers = part.family.coefficients(gamma).tolist()
            core = segment._core.frozen(numbers, threshold=part.threshold, weights=self.transport.weights)
            known = (gamma, Transport(core))
            self._frozen[part.name] = known
            self.freeze_seconds = time.perf_counter() - began
        return known[1]

    @property
    def memory(self) -> Memory:
        """Bytes of the matrices that the next frame works with."""
        live = frozen = 0
        for name, part in self.transport.parts.items():
            gamma = float(self._looks[part.number].gamma or 0.0)
            if name == self._live:
                live = part.segments[self._segment(part, gamma)].nbytes
            else:
                frozen += self._freeze(part, gamma).nbytes
        return Memory(live, frozen, self.transport.diffuse.nbytes, self.transport.bounces.nbytes)

    @property
    def looks(self) -> Mapping[str, Look]:
        """How the materials of families look."""
        return {name: self._looks[part.number] for name, part in self.transport.parts.items()}


def _sum(sources: _Sources, of: Any, shape: tuple[int, ...]) -> Colours:
    """Over all lamps, in their order; what is not traced yet of one is taken to be as what is."""
    total = np.zeros(shape)
    for parts, lit in sources:
        if lit:
            total += len(parts) / len(lit) * np.add.reduce([of(own) for own in lit])
    return total


def _largest_row(core: CoreTransport) -> float:
    """The norm of the longest row."""
    return float(np.sqrt((core.kept().astype(np.float64) ** 2).sum(axis=1).max(initial=0.0)))


def _colour(name: str, value: ArrayLike) -> Vector:
    """Three finite numbers of 0 or more; one stands for all."""
    array = np.asarray(value, np.float64)
    if array.shape not in ((), (3,)) or not np.isfinite(array).all() or (array < 0).any():
        raise ValueError(f"expected {name} to be one or three finite numbers of 0 or more, got {value!r}")
    return as_vector(np.broadcast_to(array, 3))
