"""What chapter 8 of the thesis claims of spherical harmonics (Overbeck 2006), held against one moving light."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...light.motion import Motion
from ...pages.verdict import Verdict
from ...relight.entrants import EXACT, NWA_100, PBI_100
from ..case import Light, Moment
from ..coherence.equal_quality import terms_for
from .entrants import NWA_25, PBI_25, PBI_25_ON_SH, PBI_SH_25, SH_ORDER_5, SH_ORDER_10, SH_ORDER_20
from .flicker import Track, turning

__all__ = ["CURVES", "Arrival", "Findings", "claims"]

CURVES = ("SH", "NWA by area", "NWA by transport")

_ABOUT = 1.25
"""Errors within a quarter of each other are about the same."""


@dataclass(frozen=True)
class Arrival:
    """Frames after the stop until a method has all of the light, and its picture's relative error then."""

    frames: int
    error: float


@dataclass
class Findings:
    """All that is measured of one light on one scene."""

    tracks: dict[str, Track]
    arrivals: dict[str, Arrival] = field(default_factory=dict)
    curves: dict[str, dict[int, float]] = field(default_factory=dict)
    """For each of `CURVES` the error at numbers of terms."""
    disturbed: int = 0
    """Frames in which PBI-SH changed a band that it sent nothing to."""
    light_errors: list[float] = field(default_factory=list)
    """The relative error of PBI-SH's light, in its own columns, in every frame."""

    def keep(self, bands: NDArray[Any], moment: Moment, light: Light) -> None:
        """Looks at one frame of PBI-SH."""
        untouched = ~np.isin(bands, bands[moment.update.columns])
        self.disturbed += not np.array_equal(moment.values[untouched], moment.before[untouched])
        away, size = (np.sqrt(np.square(array).sum()) for array in (moment.values - light, light))
        self.light_errors.append(float(away / size) if away > 0 else 0.0)


def claims(found: Findings, motion: Motion) -> list[Verdict]:
    """In the order of the chapter."""
    frames = turning(motion)
    return [
        _as_order_10(found, frames),
        _minimal_flicker(found, frames),
        _smoother_but_slower(found, motion),
        _no_exact_limit(found),
        _bands_kept(found, motion),
        _little_from_25_to_100(found, frames),
        _haar_converges_faster(found),
    ]


def _as_order_10(found: Findings, frames: slice) -> Verdict:
    names = (SH_ORDER_5.name, SH_ORDER_10.name, PBI_SH_25.name)
    fifth, tenth, pbi = (found.tracks[name].mean("errors", frames) for name in names)
    curve = found.curves["SH"]
    worth = terms_for(np.array(list(curve), float), 100 * np.array(list(curve.values())), pbi)
    order = f"linear order {np.sqrt(worth):.1f}" if np.isfinite(worth) else "no order up to 20"
    return Verdict(
        f"While the light turns {PBI_SH_25} is about as good as linear order 10, within {100 * _ABOUT - 100:.0f} %.",
        pbi <= _ABOUT * tenth,
        f"mean error {pbi:.3g} %; order 5 {fifth:.3g} %, order 10 {tenth:.3g} %; it is worth {order}",
        "Low degrees turn slowly and are always up to date; the higher the degree, the longer it waits for its turn, "
        "and the faster it grows old.",
    )


def _minimal_flicker(found: Findings, frames: slice) -> Verdict:
    names = (PBI_SH_25.name, SH_ORDER_10.name, NWA_25.name, NWA_100.name, PBI_25.name, EXACT.name)
    flicker = {name: found.tracks[name].mean("flicker", frames) for name in names}
    unrest = {name: found.tracks[name].mean("unrest", frames) for name in names}
    holds = flicker[PBI_SH_25.name] <= 2 * flicker[SH_ORDER_10.name] and flicker[PBI_SH_25.name] <= flicker[NWA_25.name]
    return Verdict(
        "PBI-SH flickers little: at most twice linear order 10's flicker, and less than NWA with as many terms.",
        holds,
        "; ".join(f"{name}: flicker {flicker[name]:.2g} %, unrest {unrest[name]:.2g} %" for name in names),
        "Linear harmonics hardly jump at all: what they show is a smooth function of the light. "
        + (
            "PBI-SH adds little to that."
            if holds
            else "In PBI-SH a degree stands still until its turn comes and then jumps, which linear harmonics never do."
        ),
    )


def _smoother_but_slower(found: Findings, motion: Motion) -> Verdict:
    ours, plain = PBI_SH_25.name, PBI_25_ON_SH.name
    unrest = {name: found.tracks[name].mean("unrest", turning(motion)) for name in (ours, plain)}
    late = {name: found.arrivals[name].frames for name in (ours, plain)}
    # What is left of the light while it converges; one frame, if nothing follows the stop.
    still = slice(motion.stop, motion.stop + max(*late.values(), 1))
    error = {name: found.tracks[name].mean("errors", still) for name in (ours, plain)}
    smoother, slower = unrest[ours] < unrest[plain], error[ours] > error[plain] or late[ours] > late[plain]
    return Verdict(
        "Filling low bands first makes PBI on harmonics smoother, and hinders convergence somewhat.",
        smoother and slower,
        "; ".join(
            f"{name}: unrest {unrest[name]:.2g} %, mean error from the stop on {error[name]:.3g} %, order 20 after "
            f"{late[name]} still frames"
            for name in (ours, plain)
        ),
        f"It is {'' if smoother else 'not '}smoother, and {'' if slower else 'not '}slower. The degree gives the order "
        "of the updates, rather than what changed most.",
    )


def _no_exact_limit(found: Findings) -> Verdict:
    harmonic, haar = found.arrivals[PBI_SH_25.name], found.arrivals[PBI_100.name]
    limit = found.tracks[SH_ORDER_20.name].errors[-1]
    return Verdict(
        "Harmonics have no exact limit, wavelets do: PBI-SH ends at order 20's error, PBI on Haar at none.",
        abs(harmonic.error - limit) <= 1e-3 * limit and haar.error == 0.0 < limit,
        f"{PBI_SH_25} after {harmonic.frames} still frames {100 * harmonic.error:.3g} % "
        f"(order 20: {100 * limit:.3g} %); {PBI_100} after {haar.frames} still frames {100 * haar.error:g} %",
        "The harmonics' transport is dense and has to end somewhere; of the wavelets' nearly all is zero, and all the "
        "rest is kept.",
    )


def _bands_kept(found: Findings, motion: Motion) -> Verdict:
    still = found.light_errors[motion.stop :]
    rises = int(np.count_nonzero(np.diff(still) > 0))
    return Verdict(
        "A band that gets no term keeps its values, and under still light the error only falls.",
        found.disturbed == 0 and rises == 0,
        f"{found.disturbed} of {len(found.light_errors)} frames change such a band; the error of the light rises in "
        f"{rises} of {max(len(still) - 1, 0)} still frames",
        "Fig. 8.1 taken by the letter leaves such bands non-incremental, and Fig. 6.1 would then zero them. In our "
        "reading an empty list changes nothing.",
    )


def _little_from_25_to_100(found: Findings, frames: slice) -> Verdict:
    figures, gains = [], {}
    for basis, few, many in (("SH", SH_ORDER_5.name, SH_ORDER_10.name), ("NWA", NWA_25.name, NWA_100.name)):
        pairs = {what: [found.tracks[name].mean(what, frames) for name in (few, many)] for what in ("errors", "edges")}
        gains[basis] = {what: a / b if b > 0 else float("inf") for what, (a, b) in pairs.items()}
        (e0, e1), (g0, g1) = pairs["errors"], pairs["edges"]
        figures.append(f"{basis}: error {e0:.3g} % to {e1:.3g} %, edges {g0:.3g} % to {g1:.3g} %")
    holds = gains["SH"]["errors"] < gains["NWA"]["errors"]
    return Verdict(
        "From 25 to 100 terms harmonics gain little, and NWA much.",
        holds,
        f"{'; '.join(figures)}; errors divided by {gains['SH']['errors']:.2g} and {gains['NWA']['errors']:.2g}",
        "Small bright lights cast the sharp shadows that wavelets reach and low degrees do not."
        if holds
        else "Under this light most of a diffuse picture is smooth shading, which harmonics get right with 100 terms; "
        "wavelets chosen by area spend theirs on coarse bands, whose blocks shading shows. A light of few small lamps "
        "turns it round.",
    )


def _haar_converges_faster(found: Findings) -> Verdict:
    most = max(found.curves["SH"])
    gains, figures = {}, []
    for name in CURVES:
        # Less than a hundredth of a percent is nothing, however little it is.
        first, last = (max(100 * found.curves[name][terms], 0.01) for terms in (25, most))
        gains[name] = first / last
        figures.append(f"{name} {first:.3g} % to {last:.3g} %, divided by {gains[name]:.3g}")
    harmonic, wavelet = (found.curves[name] for name in CURVES[:2])
    ahead = [terms for terms in harmonic if all(wavelet[n] <= harmonic[n] for n in harmonic if n >= terms)]
    return Verdict(
        "NWA converges faster than harmonics as terms are added (after Ng et al. 2003).",
        gains["NWA by area"] > gains["SH"] and bool(ahead),
        f"from 25 to {most} terms: {'; '.join(figures)}",
        (f"NWA by area is ahead from {ahead[0]} terms on. " if ahead else "NWA by area is not ahead even at 400. ")
        + "Choosing by what M does with each wavelet brings the lead forward.",
    )
