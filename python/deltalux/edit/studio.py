"""The studio: lamps that move and materials that are edited, under global illumination (Nguyen 2010).

I = direct + k_d D L + k_s sum_k c_k(gamma) T_k L          (section 6)

a lamp moves    what it sees is traced, L_d follows, L = L_d + rho M_s L_d + .., then D L and T L
gamma moves     T_k L of the material that is edited stand; they are mixed anew, which is exact
"""

from __future__ import annotations

import os
import time
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._core import Behind, add_lobe
from ..light.environment import Environment
from ..light.lamps import Lamp
from ..relight.relighter import Frame
from ..transport.studio import StudioPart, StudioTransport
from ..transport.transport import Transport
from ..update.methods import Full, Method
from .carrying import Carried, bound_of, carrier
from .follower import Follower
from .laid import Laid, Share, at, largest, share_of
from .lighting import Colours, Kept, Lighting, Sources

__all__ = ["Memory", "Studio", "StudioFrame"]

_ALL, _SHINE = (1.0, 1.0, 1.0), (0.3, 0.3, 0.3)
"""k_d and k_s at the start."""
_ROUNDED = 2.0**-22
"""What is rounded to f32 while a picture is put together, relative to it."""


class Memory(NamedTuple):
    """Bytes of matrices that a studio works with (table 5 of Nguyen 2010)."""

    live: int
    """T_k of the segment that is edited; 0 in lighting mode."""
    frozen: int
    """Of all other materials."""
    diffuse: int
    """What the view takes diffuse light by: weights of nodes, or D."""
    bounces: int
    """What surfaces do: form factors and the weights of samples, or M_s."""

    @property
    def total(self) -> int:
        """All of them."""
        return sum(self)


@dataclass(frozen=True)
class Look:
    """How a material looks."""

    k_d: Share
    colour: Share | None
    """In the place of its diffuse albedo."""
    k_s: Share
    gamma: float


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
        light that is not sent yet, by truncation, and by rounding. What nodes, gather samples and families are
        off by themselves is no part of it.
    converged
        Whether all lamps have been traced in full, and all light has been sent.
    """

    values: NDArray[np.float32]
    seconds: float
    traced: float
    solved: float
    sent: float
    bound: float
    converged: bool
    _transport: StudioTransport = field(repr=False)
    _env: Environment | None = field(repr=False)
    _live: tuple[StudioPart, float] | None = field(repr=False)

    @cached_property
    def image(self) -> NDArray[np.float32]:
        """(height, width, 3) float32 linear radiance; the environment behind the scene where there is one."""
        pixels = self._transport.pixels
        picture = pixels.shown(self.values)
        if self._env is not None:
            self._env._behind(Behind(pixels.background, self._transport.camera.directions()), picture)
        return picture

    @cached_property
    def residual(self) -> float:
        """How far the family of the material that is edited is off its model at this gamma, relative to the lobe's
        peak; 0 in lighting mode."""
        if self._live is None:
            return 0.0
        part, gamma = self._live
        return part.family.errors_at([gamma])[0].peak


class Still(NamedTuple):
    """What does not change while one material is edited."""

    values: NDArray[np.float32]
    bound: float


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
        self._looks = {name: Look(_ALL, None, _SHINE, own.family.range[0]) for name, own in transport.parts.items()}
        self._live: str | None = None
        self._lighting = Lighting(transport)
        self._frozen: dict[str, tuple[float, Transport]] = {}
        self._followers: dict[str, tuple[Any, Follower]] = {}
        self._carrier = carrier(transport, self.method)
        self._light = Kept[Carried]()
        self._rho, self._still = Kept[Colours](), Kept[Still]()
        self.freeze_seconds = 0.0
        """That the last freezing took."""

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
        k_s: ArrayLike | str | os.PathLike[str] | None = None,
        k_d: ArrayLike | str | os.PathLike[str] | None = None,
        colour: ArrayLike | str | os.PathLike[str] | None = None,
    ) -> None:
        """Another look of a material of a family, from the next frame on.

        Parameters
        ----------
        name
            Of the material.
        gamma
            Of its lobe, within the range of its family; of the material that is edited only.
        k_s, k_d
            What its lobe and its diffuse reflectance are multiplied by: red, green and blue, or one number; or a
            picture of either, (h, w) or (h, w, 3), which is laid over the material by its texture coordinates. Row 0 is
            the top, it repeats, and is filtered over pixels and the cells of samples and nodes. The path of a file
            stands for its linear values.
        colour
            Its diffuse reflectance, in the place of the scene's albedo and texture; as `k_d`.

        Raises
        ------
        ValueError
            If there is no such material, gamma is another material's than the edited one's, a number is out of its
            range, or a picture is given where the scene has no texture coordinates; nothing is changed then.
        OSError
            If a file cannot be read.
        """
        part, shares = self._part(name), {"k_s": k_s, "k_d": k_d, "colour": colour}
        coordinates = self.transport.coordinates
        given: dict[str, Any] = {
            key: share_of(key, value, coordinates) for key, value in shares.items() if value is not None
        }
        if gamma is not None:
            low, high = part.family.range
            if not low <= float(gamma) <= high:
                raise ValueError(f"expected gamma of {name} from {low:g} to {high:g}, got {gamma}")
            if self._live != name:
                raise ValueError(f"expected {name} to be edited when its gamma moves: call edit({name!r}) first")
            given["gamma"] = float(gamma)
        look = replace(self._looks[part.name], **given)
        albedo = self.transport.albedo[self.transport.material == part.number].max(axis=0, initial=0.0)
        diffuse = largest(look.k_d) * (albedo if look.colour is None else largest(look.colour))
        if (diffuse + largest(look.k_s)).max() > 1.0 + 1e-6:
            warnings.warn(f"{name} may reflect more light than it receives: k_d + k_s is above 1", stacklevel=2)
        self._looks[part.name] = look

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
        self._lighting.set(lamps, env)

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
        sources = self._lighting.traced()
        traced = time.perf_counter()
        carried = self._light_of_samples(sources)
        solved = time.perf_counter()
        values, bound, followed = self._shown(sources, carried)
        done = time.perf_counter()
        live = None if self._live is None else self._part(self._live)
        return StudioFrame(
            values=values,
            seconds=done - began,
            traced=traced - began,
            solved=solved - traced,
            sent=done - solved,
            bound=bound,
            converged=followed and sources.done,
            _transport=self.transport,
            _env=self._lighting.env,
            _live=None if live is None else (live, self._looks[live.name].gamma),
        )

    def _diffuse_looks(self) -> tuple[Any, ...]:
        return tuple((look.k_d, look.colour) for look in self._looks.values())

    def _reflectance(self, of: str) -> Colours:
        """Diffuse reflectances under the looks of materials: of the "view", of "samples" or of "nodes"."""
        albedo, material = self.transport.surfaces(of)
        found = albedo.astype(np.float64)
        for part in self.transport.parts.values():
            look, own = self._looks[part.name], material == part.number
            if look.colour is not None:
                found[own] = at(look.colour, of, own)
            found[own] *= at(look.k_d, of, own)
        return found

    def _light_of_samples(self, sources: Sources) -> Carried:
        """What lamps and surfaces together make of the light of samples."""
        make = partial(self._carrier.carried, self._lighting, sources, self._reflectance)
        return self._light.made((sources, self._diffuse_looks()), make)

    def _view_reflectance(self) -> Colours:
        return self._rho.made(self._diffuse_looks(), lambda: self._reflectance("view"))

    def _shown(self, sources: Sources, carried: Carried) -> tuple[NDArray[np.float32], float, bool]:
        """What rows send to the eye; how far it may be off; whether all light has been sent."""
        rho, received = self._view_reflectance(), self._carrier.received(carried)
        followers = {name: self._follower(name, carried.light) for name in self.transport.parts}
        still = {name: follower.frame for name, follower in followers.items() if name != self._live}
        looks = tuple(self._looks[name] for name in still)

        def all_that_stands() -> Still:
            """Diffuse light, and the lobes of all materials that are not edited."""
            values = (rho * (self._lighting.view(sources) + received.values)).astype(np.float32)
            for name, frame in still.items():
                self._add_lobe(values, sources, self._part(name), frame)
            off = _ROUNDED * float(values.max(initial=0.0)) + float(rho.max(initial=0.0)) * received.bound
            return Still(values, off)

        of = (sources, received, self._diffuse_looks(), tuple(still.values()), looks)
        stands = self._still.made(of, all_that_stands)
        values = stands.values.copy()
        if self._live is not None:
            self._add_lobe(values, sources, self._part(self._live), followers[self._live].frame)
        shine = {name: float(largest(self._looks[name].k_s).max()) for name in followers}
        bounds = [shine[name] * bound_of(follower, carried.unsure) for name, follower in followers.items()]
        followed = received.converged and all(own.frame.converged for own in followers.values())
        return values, stands.bound + max(bounds, default=0.0), followed

    def _add_lobe(self, values: NDArray[np.float32], sources: Sources, part: StudioPart, frame: Frame | None) -> None:
        """Adds what the lobe of a material sends to the eye: of lamps, and where there is a frame, of surfaces."""
        look, glints = self._looks[part.name], self._lighting.glints(sources, part)
        of_surfaces = None if frame is None else frame.values
        if not isinstance(look.k_s, Laid):
            add_lobe(values, part.rows, glints, look.gamma, look.k_s, of_surfaces)
            return
        whole = np.zeros_like(values)
        add_lobe(whole, part.rows, glints, look.gamma, _ALL, of_surfaces)
        values[part.rows] += at(look.k_s, "view", part.rows) * whole[part.rows]

    def direct(self) -> NDArray[np.float32]:
        """What rows send to the eye of the lamps' own light, as far as it has been traced.

        Returns
        -------
        (rows, 3) float32
        """
        sources = self._lighting.traced()
        values = (self._view_reflectance() * self._lighting.view(sources)).astype(np.float32)
        for part in self.transport.parts.values():
            self._add_lobe(values, sources, part, None)
        return values

    def _follower(self, name: str, light: Colours) -> Follower:
        """The follower of a material's T, live or frozen, at the light and at its gamma."""
        part = self._part(name)
        gamma, live = self._looks[part.name].gamma, self._live == name
        mix = part.family.coefficients(gamma) if live else None
        key = ("live", part.family._core.segment(gamma)) if live else ("frozen", gamma)
        known = self._followers.get(name)
        if known is None or known[0] != key:
            transport = part.segments[part.family._core.segment(gamma)] if live else self._freeze(part, gamma)
            known = self._followers[name] = (key, Follower(transport, self.method, light, mix))
        known[1].follow(light)
        if mix is not None:
            known[1].mix(mix)
        return known[1]

    def _freeze(self, part: StudioPart, gamma: float) -> Transport:
        """T of a gamma as one matrix, always from T_k."""
        known = self._frozen.get(part.name)
        if known is None or known[0] != gamma:
            began = time.perf_counter()
            segment = part.segments[part.family._core.segment(gamma)]
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
            gamma = self._looks[part.name].gamma
            if name == self._live:
                live = part.segments[part.family._core.segment(gamma)].nbytes
            else:
                frozen += self._freeze(part, gamma).nbytes
        return Memory(live, frozen, *self.transport.between.sizes)

    @property
    def looks(self) -> Mapping[str, Look]:
        """How the materials of families look."""
        return dict(self._looks)
