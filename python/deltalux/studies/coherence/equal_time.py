"""The least error of the picture in the time of the papers' recipe: PBI with 30 terms, weighted by area."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...pages.plotting import FAMILIES, logarithmic
from ...pages.verdict import Verdict
from ...progress import Progress
from ...relight.entrants import PBI_30
from ..case import Case
from ..shape import Study
from ..sheet import Sheet
from .plane import WEIGHTS, Candidate, Point, best_within, candidates, measure

__all__ = ["STUDY"]

_TERMS = (10, 20, 30, 45, 60, 80, 100, 150, 200, 300, 600, 1000)
_BASE = Candidate("PBI", "area", 30)
_WARM_UP = 0.2
"""The share of the turning frames that is not counted: followers start from an exact product."""
_AIM = 3.0
_STYLES = {"area": ("o", "-"), "transport": ("^", "--"), "cost": ("s", ":")}


def run(case: Case, sheet: Sheet, progress: Progress) -> None:
    """All methods, weights and budgets over the turning frames."""
    assert case.transport is not None
    frames = [case.motion.light(case.env, k) for k in range(case.motion.stop + 1)]
    skip = round(_WARM_UP * len(frames))
    own = [Candidate("own", entrant.method.weight, entrant.method.terms, entrant) for entrant in case.own]
    points = measure(case.transport, frames, [*candidates(_TERMS), *own], skip, progress)
    progress(1, 1)

    base = next(point for point in points if point.candidate == _BASE)
    _draw(case, sheet, points, base)
    sheet.heading("The least error in the time of the papers' recipe")
    others = [("Any", points)] + [
        (f"Weight {weight}", [p for p in points if p.candidate.weight == weight]) for weight in WEIGHTS
    ]
    lines = [(f"{_BASE}, the recipe", *_line(base, base))]
    lines += [(what, *_line(best, base)) for what, some in others if (best := best_within(some, base.milliseconds))]
    sheet.table(("Among", "Best", "Image L2 error", "Median ms", "p95 ms", "Error of the recipe over its"), lines)
    sheet.csv(
        "equal-time.csv",
        [
            {
                "method": str(point.candidate),
                "image_l2": f"{point.error:.6g}",
                "p50_ms": f"{point.milliseconds:.4f}",
                "p95_ms": f"{point.p95:.4f}",
            }
            for point in points
        ],
    )
    sheet.claims([_claim(points, base)])


def _line(point: Point, base: Point) -> tuple[str, ...]:
    gain = base.error / point.error if point.error > 0 else np.inf
    error, p50, p95 = f"{100 * point.error:.3g} %", f"{point.milliseconds:.2f}", f"{point.p95:.2f}"
    return str(point.candidate), error, p50, p95, f"{gain:.2g}"


def _draw(case: Case, sheet: Sheet, points: Sequence[Point], base: Point) -> None:
    caption = (
        "Error of the picture against the time of a frame. Every method and weight at its budgets in terms, which grow "
        "to the right; the lines cross at the papers' recipe, and below and left of the crossing is what beats it."
    )
    with sheet.plot("equal-time.png", caption, 1, 1, (9.4, 5.2)) as (figure, axes):
        for family in ("NWA", "BI", "PBI"):
            for weight, (marker, style) in _STYLES.items():
                of = [p for p in points if (p.candidate.family, p.candidate.weight) == (family, weight) and p.error > 0]
                x, y = [p.milliseconds for p in of], [100 * p.error for p in of]
                look = {"color": FAMILIES[family], "marker": marker, "linestyle": style, "markersize": 4.5}
                axes.plot(x, y, label=f"{family}, {weight}", linewidth=1.2, **look)
        for point in points:
            if point.candidate.own is not None:
                look = {"color": FAMILIES["own"], "marker": "X", "linestyle": "none"}
                axes.plot(point.milliseconds, 100 * point.error, label=str(point.candidate), **look)
        axes.axvline(base.milliseconds, color="#555555", linewidth=1)
        axes.axhline(100 * base.error, color="#555555", linewidth=1)
        axes.set(xlabel="Median frame (ms)", ylabel="Image: L2 error (%)")
        logarithmic(axes, "xy")
        axes.set_ylim(max(axes.get_ylim()[0], 1e-3), None)
        figure.suptitle(f"{case.name}: {case.motion.rotate:g} degrees in {case.motion.frames} frames", fontsize=11)
        figure.legend(loc="outside right center")


def _claim(points: Sequence[Point], base: Point) -> Verdict:
    best = best_within(points, base.milliseconds) or base
    gain = base.error / best.error if best.error > 0 else float("inf")
    return Verdict(
        f"Our own aim: in the same time a third of the image error of the papers' recipe ({PBI_30}, area weights).",
        gain >= _AIM,
        f"{best.candidate}: {100 * best.error:.3g} % in {best.milliseconds:.2f} ms against {100 * base.error:.3g} % in "
        f"{base.milliseconds:.2f} ms, a factor of {gain:.2g}",
        "What the picture gains by a column, over the bytes that it takes, chooses better than the column's area."
        if gain >= _AIM
        else "The part of a frame that does not depend on the terms (the light's own transform, the pass over the "
        "receivers) leaves too little time to be spent better, or area already chooses well here.",
    )


STUDY = Study(
    title="The least error in equal time",
    intro="The papers send thirty terms a frame, weighted by area. Here every method, weight and budget is measured "
    "side by side, and what matters is the error of the picture against the time of whole frames.",
    run=run,
    scene_files=("equal-time.png", "equal-time.csv"),
    needs_scene=True,
    takes_methods=True,
)
