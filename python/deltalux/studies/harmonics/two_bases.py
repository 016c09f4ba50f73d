"""Spherical harmonics against wavelets under a moving light (Overbeck 2006, chapter 8, Figs. 8.1 to 8.3).

Both bases see one M: `projection` makes the harmonics' transport of the wavelets', so that what differs between two
pictures is the basis. Exact is the product of the whole light with M in wavelets.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...columns import Columns
from ...light.motion import Motion
from ...progress import Progress
from ...relight.entrants import EXACT, NWA_100, PBI_100, Entrant
from ...transport.transport import Transport
from ...update.approximation import Approximation
from ...update.methods import Nonlinear
from ..case import Case, Light, Moment, follow, lights
from ..shape import Study
from ..sheet import Sheet
from .entrants import BI_25, NWA_25, PBI_25, PBI_25_ON_SH, PBI_SH_25, SH_ORDER_5, SH_ORDER_10, SH_ORDER_20
from .flicker import Track, turning
from .harmonic_claims import CURVES, Arrival, Findings, claims
from .harmonic_pictures import Pictures, bases_strip, frames_plot, moments_strip, terms_plot
from .projection import HarmonicView

__all__ = ["STUDY"]

_ORDER = 20
_HARMONIC = (SH_ORDER_5, SH_ORDER_10, SH_ORDER_20, PBI_SH_25, PBI_25_ON_SH)
_HAAR = (NWA_25, NWA_100, BI_25, PBI_25, PBI_100)
_SHOWN = (
    *(EXACT.name, SH_ORDER_5.name, SH_ORDER_10.name, SH_ORDER_20.name, PBI_SH_25.name),
    *(NWA_25.name, NWA_100.name, PBI_25.name, PBI_100.name),
)
_ARRIVING = (PBI_SH_25.name, PBI_25_ON_SH.name, PBI_100.name)

_ORDERS = (2, 3, 4, 5, 6, 8, 10, 12, 14, 16, 18, 20)
_SAMPLES = 8
"""Turning frames over which errors against terms are averaged."""


def run(case: Case, sheet: Sheet, progress: Progress) -> None:
    """All methods side by side; then what follows the stop, and error against terms."""
    transport, motion = _transport(case), case.motion
    view, frames = HarmonicView.of(transport, _ORDER), lights(case.env, motion, case.columns)
    followers = _followers(case, view, frames)
    found, pictures = _replay(transport, motion, followers, progress)
    found.curves = _curves(transport, view, frames[turning(motion)])
    progress(1, 1)

    (_, _), (fast, _), (_, _), (last, _) = motion.moments
    bases_strip(sheet, transport, view, frames[fast], {name: pictures[name, fast] for name, _ in pictures})
    shown = {fast: "turning fastest", last: "held still"}
    moments_strip(sheet, pictures, {name: found.tracks[name] for name in _SHOWN}, shown)
    frames_plot(sheet, found.tracks, [follower.row for follower in followers], motion)
    terms_plot(sheet, found.curves, transport.plan.tolerance)
    sheet.heading("Means while the light turns, and the end of the hold")
    sheet.text(_MEASURES.format(100 * transport.plan.tolerance))
    sheet.table(*_table(found, motion))
    sheet.csv("frames.csv", _frame_rows(found.tracks))
    sheet.csv("terms.csv", _term_rows(found.curves))
    sheet.claims(claims(found, motion))


_MEASURES = (
    "In percent of the norm of the exact picture. Edges: the error of differences between neighbouring pixels. "
    "Flicker: what the error image changes by from frame to frame; a basis without sharp shadows lacks others in every "
    "frame, and that is in it as well. Unrest: the second difference in time of the pictures shown; the exact ones "
    "have it as well, and what exceeds theirs is jumping. M is truncated to {:.2g} % image error: both bases see the "
    "same M, and errors far below that are of this M rather than of the scene."
)


def _transport(case: Case) -> Transport:
    assert case.transport is not None
    return case.transport


@dataclass(frozen=True)
class _Follower:
    """A method, in its own basis."""

    row: Entrant
    columns: Columns
    frames: list[Light]
    multiply: Callable[[Light], NDArray[np.float32]]

    def moments(self) -> Iterable[Moment]:
        return follow(self.columns, self.row, self.frames)


def _followers(case: Case, view: HarmonicView, frames: list[Light]) -> list[_Follower]:
    """The exact method first. Frames that stand still share their light in both bases."""
    spectra: list[Light] = []
    for k, V in enumerate(frames):
        spectra.append(spectra[-1] if k and V is frames[k - 1] else view.light(V))
    haar = [_Follower(row, case.columns, frames, _transport(case).multiply) for row in (EXACT, *_HAAR)]
    harmonic = [_Follower(row, view.columns, spectra, view.multiply) for row in _HARMONIC]
    return [haar[0], *harmonic, *haar[1:]]


def _replay(
    transport: Transport, motion: Motion, followers: list[_Follower], progress: Progress
) -> tuple[Findings, Pictures]:
    """Every method behind one light, frame by frame, and then on until it has all of it."""
    found = Findings({follower.row.name: Track() for follower in followers})
    pictures: Pictures = {}
    kept = {frame for frame, _ in motion.moments}
    for k, moments in enumerate(zip(*(follower.moments() for follower in followers), strict=True)):
        progress(k, len(motion.angles) + _SAMPLES)
        shown: dict[str, NDArray[np.float32]] = {}
        for follower, moment in zip(followers, moments, strict=True):
            name, light = follower.row.name, follower.frames[k]
            shown[name] = transport.image(follower.multiply(moment.values))
            found.tracks[name].add(shown[name], shown[EXACT.name])
            if k in kept:
                pictures[name, k] = shown[name]
            if name == _ARRIVING[0]:
                found.keep(follower.columns.bands, moment, light)
            if name in _ARRIVING and k >= motion.stop and name not in found.arrivals:
                if np.array_equal(moment.values, light):
                    found.arrivals[name] = Arrival(k - motion.stop, found.tracks[name].errors[k])
                elif k == len(motion.angles) - 1:
                    found.arrivals[name] = _arrive(transport, motion, follower, moment.values, shown[EXACT.name])
    return found, pictures


def _arrive(
    transport: Transport, motion: Motion, follower: _Follower, values: Light, exact: NDArray[np.float32]
) -> Arrival:
    """Holds the last light until a method has all of it."""
    light = follower.frames[-1]
    approximation, frames = Approximation(follower.columns, follower.row.method, values), motion.hold
    while not approximation.is_converged(light):
        approximation.step(light)
        frames += 1
    track = Track()
    track.add(transport.image(follower.multiply(approximation.values)), exact)
    return Arrival(frames, track.errors[0])


def _curves(transport: Transport, view: HarmonicView, frames: list[Light]) -> dict[str, dict[int, float]]:
    """Mean error of a picture with 4 to 400 terms of each basis, over some of these frames."""
    tracks = {name: {order**2: Track() for order in _ORDERS} for name in CURVES}
    for V in frames[:: -(-len(frames) // _SAMPLES)]:
        exact, c = transport.image(transport.multiply(V)), view.light(V)
        for terms in tracks["SH"]:
            tracks["SH"][terms].add(transport.image(view.multiply(c[:terms])), exact)
            for name, weight in (("NWA by area", "area"), ("NWA by transport", "transport")):
                chosen = Approximation(
                    transport.columns, Nonlinear(terms, weight=weight), column_norms=transport.column_norms
                )
                chosen.step(V)
                tracks[name][terms].add(transport.image(transport.multiply(chosen.values)), exact)
    return {name: {terms: float(np.mean(track.errors)) for terms, track in of.items()} for name, of in tracks.items()}


def _table(found: Findings, motion: Motion) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    frames = turning(motion)
    lines = []
    for name, track in found.tracks.items():
        worst = 100 * float(np.percentile(track.flicker[frames], 95))
        means = [track.mean(what, frames) for what in ("errors", "edges", "flicker", "unrest")]
        means.insert(3, worst)
        lines.append((name, *(f"{value:.3g} %" for value in (*means, 100 * track.errors[-1]))))
    headings = ("Method", "Error", "Edges", "Flicker", "Flicker, 95th percentile", "Unrest", "Error at the end")
    return headings, lines


def _frame_rows(tracks: dict[str, Track]) -> list[dict[str, Any]]:
    measures = ("errors", "edges", "flicker", "unrest")
    return [
        {"method": name, "frame": k} | {what: f"{getattr(track, what)[k]:.6g}" for what in measures}
        for name, track in tracks.items()
        for k in range(len(track.errors))
    ]


def _term_rows(curves: dict[str, dict[int, float]]) -> list[dict[str, Any]]:
    return [
        {"basis": name, "terms": terms, "image_l2": f"{error:.6g}"}
        for name, of in curves.items()
        for terms, error in of.items()
    ]


STUDY = Study(
    title="Spherical harmonics against wavelets",
    intro="One transport in two bases, under a light that turns and stops: linear harmonics of order 5, 10 and 20, PBI "
    "for harmonics with 25 terms a frame on order 20, and wavelets with 25 and 100 terms a frame. The harmonics' "
    "transport is the wavelets' own, projected: the same rays, and errors of the basis alone.",
    run=run,
    scene_files=("bases.png", "moments.png", "frames.png", "terms.png", "frames.csv", "terms.csv"),
    needs_scene=True,
)
