"""How far the light applied is from the light asked for, frame by frame (Overbeck 2006, Fig. 6.2; EGSR Fig. 7)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from math import copysign
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...columns import Haar
from ...light.motion import Motion
from ...pages.plotting import FAMILIES, logarithmic, mark_stop
from ...pages.verdict import Verdict
from ...progress import Progress
from ...relight.entrants import BI_30, NWA_30, NWA_60, NWA_100, NWA_300, NWA_500, PBI_30, Entrant, pbi
from ..case import Case, Light, follow, light_errors, lights
from ..shape import Study
from ..sheet import Sheet

__all__ = ["STUDY"]

_SPEEDS = (30.0, 45.0, 90.0, 180.0)

_NWA = (NWA_30, NWA_60, NWA_100, NWA_300, NWA_500)
_PBI_L2 = pbi(30, "L2", norm="l2")
_DEALER, _EXHAUSTIVE = (pbi(30, test, test=test) for test in ("dealer", "exhaustive"))
_TESTS = (PBI_30, _PBI_L2, _DEALER, _EXHAUSTIVE)
# The rejected static threshold: the two coarsest bands incremental, NWA in all others.
_FIXED = pbi(30, "fixed", test="fixed", fixed=2)
_ROWS = (*_NWA, BI_30, *_TESTS, _FIXED)

_AFTER = 25
"""Frames after the stop at which the papers compare PBI-30 with NWA-500."""

Errors = dict[str, NDArray[np.float64]]
"""For each method (frames, 2): area-weighted L1 and plain L2, both relative."""


def run(case: Case, sheet: Sheet, progress: Progress) -> None:
    """The curves at the speed asked for; the means at the papers' speeds and around."""
    asked, rows = abs(case.motion.rotate), (*_ROWS, *case.own)
    speeds = sorted({*_SPEEDS, asked})
    found: dict[float, Errors] = {degrees: {} for degrees in speeds}
    for k, degrees in enumerate(speeds):
        frames = lights(case.env, replace(case.motion, rotate=copysign(degrees, case.motion.rotate)), case.columns)
        for j, row in enumerate(rows):
            progress(k * len(rows) + j, len(speeds) * len(rows))
            found[degrees][row.name] = _errors(case.columns, row, frames)
    progress(1, 1)

    _draw(case, sheet, found[asked])
    headings, lines = ("Rotation", *(row.name for row in rows)), []
    turning = slice(1, case.motion.stop + 1)
    for degrees in speeds:
        means = (100 * found[degrees][row.name][turning, 0].mean() for row in rows)
        lines.append((f"{degrees:g} degrees", *(f"{mean:.3g} %" for mean in means)))
    sheet.heading("Mean error while turning, by speed")
    sheet.text(f"Area-weighted L1 error of the light; each rotation takes {case.motion.frames} frames.")
    sheet.table(headings, lines)
    sheet.csv("lighting-error.csv", _table(case, found))
    sheet.claims(_claims(case.motion, found, asked))


def _errors(columns: Haar, row: Entrant, frames: Sequence[Light]) -> NDArray[np.float64]:
    moments = zip(follow(columns, row, frames), frames, strict=True)
    return np.array([light_errors(columns, moment.values, light) for moment, light in moments])


def _draw(case: Case, sheet: Sheet, errors: Errors) -> None:
    styles = {
        NWA_30.name: ":",
        NWA_60.name: (0, (1, 2, 4, 2)),
        NWA_100.name: "--",
        NWA_300.name: "-.",
        NWA_500.name: "-",
    }
    caption = (
        "Error of the light against frame. Area-weighted L1, as in the papers' Fig. 6.2; below, the band tests "
        f"of {PBI_30} (the papers' inset), and the static threshold that they reject."
    )
    options = {"sharex": True, "height_ratios": (2.1, 1)}
    with sheet.plot("lighting-error.png", caption, 2, 1, (9.2, 7.0), **options) as (figure, (axes, tests)):
        for row in (*_NWA, BI_30, PBI_30, *case.own):
            width = 2.4 if row is PBI_30 else 1.5
            style = styles.get(row.name, "-")
            _line(axes, errors[row.name], row.name, color=FAMILIES[row.family], linestyle=style, linewidth=width)
        colours = ("#0072B2", "#56B4E9", "#009E73", "#E69F00", "#999999")
        for row, colour in zip((*_TESTS, _FIXED), colours, strict=True):
            _line(tests, errors[row.name], row.name, color=colour, linewidth=1.4)
        for panel, title in ((axes, "area-weighted L1 error (%)"), (tests, "band tests (%)")):
            panel.set(ylabel=f"Light: {title}")
            logarithmic(panel)
            panel.legend(loc="center left", bbox_to_anchor=(1.01, 0.5))
            panel.axvline(case.motion.stop, color="#888888", linewidth=1)
        mark_stop(axes, case.motion)
        tests.set(xlabel="Frame", xlim=(0, len(case.motion.angles) - 1))
        figure.suptitle(f"Light under {case.env.name}: {case.motion}", fontsize=11)


def _line(axes: Any, errors: NDArray[np.float64], label: str, **style: Any) -> None:
    shown = 100 * errors[:, 0]
    shown[shown <= 0] = np.nan
    axes.plot(shown, label=label, **style)


def _table(case: Case, found: dict[float, Errors]) -> list[dict[str, Any]]:
    return [
        {"degrees": degrees, "method": name, "frame": k, "light_l1": f"{l1:.6g}", "light_l2": f"{l2:.6g}"}
        for degrees, errors in found.items()
        for name, series in errors.items()
        for k, (l1, l2) in enumerate(series)
    ]


def _claims(motion: Motion, found: dict[float, Errors], asked: float) -> list[Verdict]:
    errors = {name: series[:, 0] for name, series in found[asked].items()}
    turning = slice(1, motion.stop + 1)
    mean = {name: 100 * float(series[turning].mean()) for name, series in errors.items()}
    speeds = sorted(found)
    means = {
        degrees: {name: 100 * float(series[turning, 0].mean()) for name, series in found[degrees].items()}
        for degrees in speeds
    }
    return [
        _never_below_nwa_60(errors, turning),
        _as_nwa_100(mean, means),
        _below_nwa_500(errors, motion),
        _bi_beats_nwa(found, turning),
        _tests_agree(mean),
        _fixed_never_arrives(errors),
    ]


def _never_below_nwa_60(errors: Errors, turning: slice) -> Verdict:
    better = float(np.mean(errors[PBI_30.name][turning] <= errors[NWA_60.name][turning]))
    holds = better >= 0.95
    return Verdict(
        f"{PBI_30} is essentially always at least as good as {NWA_60}.",
        holds,
        f"in {100 * better:.0f} % of the turning frames",
        ""
        if holds
        else "Where few bright lights hold most of the energy, or the light turns fast, what was sent some frames ago "
        "is already misplaced, and a fresh start with twice the terms is nearer.",
    )


def _as_nwa_100(mean: dict[str, float], means: dict[float, dict[str, float]]) -> Verdict:
    holds = mean[PBI_30.name] <= 1.1 * mean[NWA_100.name]
    until = [degrees for degrees, each in means.items() if each[PBI_30.name] <= 1.1 * each[NWA_100.name]]
    why = f"It holds at {', '.join(f'{d:g}' for d in until)} degrees in these frames." if until else "At no speed here."
    return Verdict(
        f"While the light turns, {PBI_30} is about as good as {NWA_100}: three times the terms.",
        holds,
        f"mean {mean[PBI_30.name]:.3g} % against {mean[NWA_100.name]:.3g} %",
        f"{why} The gain is coherence from frame to frame: it shrinks with speed.",
    )


def _below_nwa_500(errors: Errors, motion: Motion) -> Verdict:
    last = min(motion.stop + _AFTER, len(errors[PBI_30.name]) - 1)
    pbi, nwa = (errors[name][motion.stop : last + 1] for name in (PBI_30.name, NWA_500.name))
    below = np.flatnonzero(pbi < nwa)
    when = f"below it {below[0]} frames after the stop" if below.size else f"not below it in {len(pbi) - 1} frames"
    return Verdict(
        f"25 frames after the stop not even {NWA_500} equals {PBI_30}.",
        bool(pbi[-1] < nwa[-1]) if last - motion.stop == _AFTER else None,
        f"{PBI_30} {100 * pbi[-1]:.3g} %, {NWA_500} {100 * nwa[-1]:.3g} %; {when}",
        "NWA stays where its terms end; PBI goes on with what is left.",
    )


def _bi_beats_nwa(found: dict[float, Errors], turning: slice) -> Verdict:
    shares, fails = [], []
    for degrees, errors in found.items():
        bi, nwa = (errors[name][turning, 0] for name in (BI_30.name, NWA_30.name))
        shares.append(f"{degrees:g} degrees: {100 * np.mean(bi <= nwa):.0f} %")
        if np.any(bi > nwa):
            fails.append(f"{degrees:g}")
    why = (
        f"It fails at {', '.join(fails)} degrees: old light that BI has not yet taken back (ghosts) outweighs what it "
        "has gained, and NWA, which forgets, is nearer."
        if fails
        else "At the speeds tried, what BI keeps is worth more than what it has misplaced."
    )
    return Verdict(
        "BI is always better than NWA with the same terms, in numbers.",
        not fails,
        f"frames in which {BI_30} is no worse than {NWA_30}: {'; '.join(shares)}",
        why,
    )


def _tests_agree(mean: dict[str, float]) -> Verdict:
    three = {name: mean[name] for name in (PBI_30.name, _DEALER.name, _EXHAUSTIVE.name)}
    least, most = min(three.values()), max(three.values())
    apart = most / least - 1 if least > 0 else 0.0
    return Verdict(
        "The simple, dealer and exhaustive band tests are nearly the same (within 5 %).",
        apart <= 0.05,
        ", ".join(
            f"{name.removeprefix(PBI_30.name).strip() or 'simple'} {value:.4g} %" for name, value in three.items()
        ),
        f"They lie within {100 * apart:.1f} % of each other; the simple test costs least."
        + (
            ""
            if apart <= 0.05
            else " It judges a band before it knows how many terms the band will get, which tells where a few lights "
            "outshine the rest."
        ),
    )


def _fixed_never_arrives(errors: Errors) -> Verdict:
    end, other = 100 * errors[_FIXED.name][-1], 100 * errors[PBI_30.name][-1]
    return Verdict(
        "A static threshold (coarse bands incremental, fine ones always anew) is worse than the tests.",
        bool(end > other),
        f"at the end of the hold: fixed {end:.3g} %, simple {other:.3g} %",
        "Bands that always start anew never converge, however long the light stands still.",
    )


STUDY = Study(
    title="Error of the light over time",
    intro="A light turns, eased in and out, and stops. Each method follows it with its budget of terms a frame; no "
    "scene is needed. Errors are relative to the light asked for, on orthonormal Haar coefficients.",
    run=run,
    light_files=("lighting-error.png", "lighting-error.csv"),
    takes_methods=True,
)
