"""The editor: materials whose curves move, followed within a budget a frame."""

from __future__ import annotations

import time
import warnings
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..brdf.curves import ANGLES
from ..light.environment import Environment
from ..precomputation.curves import light_digest, made_again
from ..relight.relighter import Frame, Relighter
from ..transport.curves import CurveTransport
from ..update.methods import Full, Incremental, Method
from .lobe import Lobe, NeedsPrecompute, sampled_curve, sampled_reflectance

if TYPE_CHECKING:
    from ..scene.scene import Scene

__all__ = ["BrdfEditor", "EditedFrame", "NeedsPrecompute", "StaleTransport"]

# T' of so many bytes is multiplied whole in about three milliseconds.
_WHOLE = 24e6
_TERMS = 30


class StaleTransport(ValueError):
    """Another light than the one that T' holds, with the seconds that its own would take."""


@dataclass(frozen=True, eq=False)
class EditedFrame:
    """One frame of an editor.

    Attributes
    ----------
    values : mapping of str to (rows, 3) float32
        What each material that is edited shows, its colour included.
    seconds
        Of choosing and multiplying; the picture is put together when it is asked for.
    converged
        Whether all edits have been applied in full.
    residual
        How far a reflectance is off the functions that it is a sum of, at most, up to 85 degrees; it is in the bound.
    columns
        How many columns were sent, over all materials.
    """

    values: Mapping[str, NDArray[np.float32]]
    seconds: float
    converged: bool
    residual: float
    columns: int
    _transport: CurveTransport = field(repr=False)
    _frames: Mapping[str, Frame] = field(repr=False)
    _lobes: Mapping[str, Lobe] = field(repr=False)

    @cached_property
    def image(self) -> NDArray[np.float32]:
        """(height, width, 3) float32 linear radiance: all that is edited, on all that is not."""
        picture = self._transport.base.copy()
        for name, values in self.values.items():
            picture += self._transport.parts[name].transport.image(values)
        return picture

    @cached_property
    def bound(self) -> float:
        """No pixel's red, green or blue is further off from the product with the curves asked for: what is not yet
        applied, what truncation took, rounding, and what a reflectance is off its basis up to 85 degrees."""
        return max(frame.bound + _residual_bound(self._lobes[name]) for name, frame in self._frames.items())


def _residual_bound(lobe: Lobe) -> float:
    """What a reflectance off its basis may change in a row: as much of what a mirror's lobe of 1 would show."""
    if lobe.residual == 0:
        return 0.0
    one, off = lobe.part.reflectances.weights(np.ones(lobe.part.reflectances.functions.shape[1]))
    whole = lobe.part.transport.multiply(replace(lobe, weights=np.repeat(one[:, None], 3, axis=1)).V())
    return float(lobe.residual * np.abs(whole).max() / (1.0 - off))


class BrdfEditor:
    """Follows edits of materials over a transport of curves.

    Parameters
    ----------
    transport
        Of `precompute_curves`, or opened by `CurveTransport.open`; shared, never changed.
    method
        How coefficients are chosen, as for `Relighter`; for each material by itself. "auto": the whole product where T'
        of a material is below 24 MB, about three milliseconds, else `Incremental` of 30 terms.

    Raises
    ------
    ValueError
        If an argument cannot be used.

    Examples
    --------
    >>> editor = BrdfEditor(transport, Incremental(terms=30))  # doctest: +SKIP
    >>> editor.set("pearl", sigma=0.05, n=1.8)  # doctest: +SKIP
    >>> editor.step().image  # doctest: +SKIP
    """

    def __init__(self, transport: CurveTransport, method: Method | str = "auto") -> None:
        if not isinstance(transport, CurveTransport):
            raise ValueError(f"expected a transport of dl.precompute_curves, got {transport!r}")
        if method != "auto" and not isinstance(method, Method):
            raise ValueError(f'expected an update method such as Incremental(terms=30), or "auto", got {method!r}')
        self.method = method
        self._take(transport)

    def _take(self, transport: CurveTransport) -> None:
        self.transport = transport
        self._lobes = {name: Lobe.of(part) for name, part in transport.parts.items()}
        self._targets = {name: lobe.V() for name, lobe in self._lobes.items()}
        self._followers = {name: self._follower(name) for name in transport.parts}
        self._frames: dict[str, Frame] = {}
        self._shown: dict[str, NDArray[np.float64]] = {}

    def _follower(self, name: str) -> Relighter:
        transport = self.transport.parts[name].transport
        if isinstance(self.method, Method):
            return Relighter(transport, self.method)
        return Relighter(transport, Full() if transport.nbytes < _WHOLE else Incremental(terms=_TERMS))

    def _lobe(self, name: str) -> Lobe:
        if name not in self._lobes:
            raise ValueError(f"expected a material of {', '.join(self._lobes)}, got {name!r}")
        return self._lobes[name]

    def set(self, name: str, **parameters: Any) -> None:
        """Other parameters of a material, from the next frame on.

        Parameters
        ----------
        name
            Of the material.
        **parameters
            Of its model, by their names; ``n``, ``k`` and ``f0`` may be three numbers, one for each colour. ``colour``:
            what all is multiplied by. A width takes the place of a curve that was drawn.

        Raises
        ------
        ValueError
            If there is no such material or parameter, or a value is out of its range; nothing is changed then.
        NeedsPrecompute
            (a ValueError) If T' does not hold it.
        """
        self._apply(name, lambda lobe: lobe.with_parameters(parameters))

    def set_curve(
        self, name: str, theta: ArrayLike, values: ArrayLike, *, axis: str = "half", recompute: bool = False
    ) -> None:
        """A curve drawn by hand, from the next frame on.

        Parameters
        ----------
        name
            Of the material.
        theta
            (m,): angles in radians, ascending, from 0 to pi / 2.
        values
            (m,) or (m, 3): the curve there, for all colours or each; linear between, level beyond.
        axis
            "half": c over the half angle. "difference": the reflectance of facets, which is applied as what its basis
            has of it, and refused where that is more than 1 % off.
        recompute
            Whether a reflectance that is refused makes T' anew, in its place, with what its basis lacks of it: edits
            stay, and what was edited is edited as before. This process must have made it: files keep no scene.

        Raises
        ------
        ValueError
            If there is no such material, or the points are no curve; nothing is changed then.
        NeedsPrecompute
            (a ValueError) If T' does not hold it, and `recompute` is not said.
        """
        if axis == "difference":
            try:
                self._apply(name, lambda lobe: lobe.reflectance_drawn(theta, values))
            except NeedsPrecompute:
                if not recompute:
                    raise
                self._make_room(name, sampled_reflectance(theta, values))
                self._apply(name, lambda lobe: lobe.reflectance_drawn(theta, values))
        elif axis == "half":
            self._apply(name, lambda lobe: replace(lobe, curve=sampled_curve(theta, values)))
        else:
            raise ValueError(f'expected axis "half" or "difference", got {axis!r}')

    def _make_room(self, name: str, reflectance: NDArray[np.float64]) -> None:
        """T' anew, with functions that hold a reflectance too."""
        if self.transport._again is None:
            raise ValueError("expected a transport that this process made: a file keeps neither scene nor light")
        lobes = self._lobes
        self._take(self.transport._again(drawn={name: np.unique(reflectance, axis=0)}))
        self._lobes = {own: lobe.over(self.transport.parts[own]) for own, lobe in lobes.items()}
        self._targets = {own: lobe.V() for own, lobe in self._lobes.items()}

    def _apply(self, name: str, change: Any) -> None:
        try:
            lobe: Lobe = change(self._lobe(name))
        except NeedsPrecompute as error:
            seconds = self.transport.seconds
            raise NeedsPrecompute(f"{error}; another precomputation would take about {seconds:.0f} s") from None
        if lobe.albedo() > 1.0:
            warnings.warn(
                f"{name} reflects {lobe.albedo():.3g} times the light of an even sky to its normal", stacklevel=3
            )
        self._lobes[name], self._targets[name] = lobe, lobe.V()

    def curve(self, name: str) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """The curve of a material as it is asked for.

        Parameters
        ----------
        name
            Of the material.

        Returns
        -------
        theta, values
            (256,) radians of the half angle and (256, 3), 1 / sr.

        Raises
        ------
        ValueError
            If there is no such material.
        """
        return ANGLES.copy(), self._lobe(name).curve.copy()

    def step(self) -> EditedFrame:
        """One frame towards what the materials have been set to.

        Returns
        -------
        EditedFrame
            The first one applies everything.
        """
        started = time.perf_counter()
        sent = 0
        for name, follower in self._followers.items():
            # What stands still costs nothing.
            before = self._frames.get(name)
            if before is None or not before.converged or self._shown[name] is not self._targets[name]:
                self._frames[name] = follower.step(self._targets[name])
                self._shown[name] = self._targets[name]
                sent += len(self._frames[name].columns)
        return EditedFrame(
            values={name: frame.values for name, frame in self._frames.items()},
            seconds=time.perf_counter() - started,
            converged=all(frame.converged for frame in self._frames.values()),
            residual=max(lobe.residual for lobe in self._lobes.values()),
            columns=sent,
            _transport=self.transport,
            _frames=dict(self._frames),
            _lobes=dict(self._lobes),
        )

    def set_light(self, env: Environment, *, recompute: bool = False, scene: Scene | None = None) -> None:
        """Another light: T' holds the one that it was made under.

        Parameters
        ----------
        env
            The other light.
        recompute
            Whether to make T' anew, in its place. Edits start again from the materials as they were given.
        scene
            What the transport was made of, where it was opened from a file, which keeps none.

        Raises
        ------
        StaleTransport
            (a ValueError) If the light is another and `recompute` is not said, with the seconds that it would take.
        ValueError
            If the transport was opened from a file and no scene is given, or another one; or if a material of such a
            file is measured.
        """
        if not isinstance(env, Environment):
            raise ValueError(f"expected the light as a dl.Environment, got {env!r}")
        if light_digest(env) == self.transport.light:
            return
        if not recompute:
            raise StaleTransport(
                f"the transport holds another light than {env.name}; set_light(env, recompute=True) would take about "
                f"{self.transport.seconds:.0f} s"
            )
        if self.transport._again is not None:
            self._take(self.transport._again(env))
        elif scene is not None:
            self._take(made_again(self.transport, scene, env))
        else:
            raise ValueError("expected scene=: the transport was opened from a file, which keeps none")

    @property
    def nbytes(self) -> int:
        """Bytes beyond T' that this editor holds."""
        return sum(follower.nbytes for follower in self._followers.values())
