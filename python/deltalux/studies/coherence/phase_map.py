"""Which method wins at which speed of the light and which budget: a map that no paper has."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...light.environment import Environment
from ...pages.plotting import FAMILIES
from ...pages.verdict import Verdict
from ...progress import Progress
from ...relight.entrants import Entrant
from ..case import Case, follow, light_errors
from ..shape import Study
from ..sheet import Sheet
from .plane import MAKERS, Point, best_within, candidates, measure

__all__ = ["STUDY"]

_SPEEDS = (0.05, 0.1, 0.25, 0.5, 1.0, 2.5, 5.0, 10.0, 30.0)
"""Degrees a frame, at an even pace."""
_TERMS = (10, 30, 100, 300, 1000, 3000)
_SCENE_TERMS = (10, 30, 100, 300, 1000)
_WARM_UP, _COUNTED = 45, 15
_TIMES = 12
"""Budgets in milliseconds, from the fastest frame of all to the exact product's."""
_NEAR = 1.02
"""Errors this near to the least are as good."""


@dataclass(frozen=True)
class Cell:
    """The winner of one speed and budget, its error, and by how much it is better than something else."""

    family: str
    label: str
    error: float
    gain: float


Map = list[list[Cell]]
"""Budgets down, speeds across."""


def run(case: Case, sheet: Sheet, progress: Progress) -> None:
    """The light against budgets in terms; with a scene, the picture against budgets in milliseconds."""
    total = len(_SPEEDS) * (1 if case.transport is None else 2)
    errors = []
    for k, speed in enumerate(_SPEEDS):
        progress(k, total)
        errors.append(_light(case, speed))
    cells = [[_winner({f: each[f, terms] for f in MAKERS}) for each in errors] for terms in _TERMS]
    caption = (
        "Light: which method is nearest. Area-weighted L1 error in percent, and how many times less than NWA's; the "
        "light turns at an even pace, and every method has had time to settle."
    )
    _draw(sheet, "light-map.png", caption, cells, [f"{terms:,}" for terms in _TERMS], "Terms a frame")
    lines = [
        {"speed": speed, "terms": terms, "method": family, "light_l1": f"{error:.6g}"}
        for speed, each in zip(_SPEEDS, errors, strict=True)
        for (family, terms), error in each.items()
    ]
    sheet.csv("light-map.csv", lines)
    claims = _claims(errors)
    if case.transport is not None:
        claims += _picture(case, sheet, lambda done: progress(len(_SPEEDS) + done, total))
    progress(1, 1)
    sheet.claims(claims)


def _turning(case: Case, speed: float) -> list[Environment]:
    return [case.env.rotated(speed * k, case.motion.axis) for k in range(_WARM_UP + _COUNTED)]


def _light(case: Case, speed: float) -> dict[tuple[str, int], float]:
    """The mean settled error of each method and budget."""
    frames = [case.columns.coefficients(env) for env in _turning(case, speed)]
    found = {}
    for family, make in MAKERS.items():
        for terms in _TERMS:
            row = Entrant(family, family, make(terms), initial=None if family == "NWA" else "full")
            moments = zip(follow(case.columns, row, frames), frames, strict=True)
            late = [light_errors(case.columns, moment.values, light)[0] for moment, light in moments][_WARM_UP:]
            found[family, terms] = float(np.mean(late))
    return found


def _winner(errors: dict[str, float]) -> Cell:
    family = min(errors, key=lambda name: errors[name])
    least = errors[family]
    return Cell(family, family, least, errors["NWA"] / least if least > 0 else np.inf)


def _picture(case: Case, sheet: Sheet, tell: Any) -> list[Verdict]:
    """Every method, weight and number of terms, by the time it takes."""
    assert case.transport is not None
    asked, measured = candidates(_SCENE_TERMS), []
    for k, speed in enumerate(_SPEEDS):
        tell(k)
        measured.append(measure(case.transport, _turning(case, speed), asked, _WARM_UP, lambda done, total: None))
    fastest = min(point.milliseconds for points in measured for point in points)
    exact = max(point.milliseconds for points in measured for point in points if point.candidate.terms is None)
    budgets = np.geomspace(1.02 * fastest, 1.02 * exact, _TIMES)
    cells = [[_in_time(points, budget) for points in measured] for budget in budgets]
    caption = (
        "Picture: which method and weight is nearest within the time. Relative L2 error in percent, and how many times "
        "less than the best with the papers' area weights; times are medians of whole frames."
    )
    _draw(sheet, "image-map.png", caption, cells, [f"{budget:.2f}" for budget in budgets], "Budget (ms a frame)")
    sheet.csv(
        "image-map.csv",
        [
            {
                "speed": speed,
                "method": str(point.candidate),
                "image_l2": f"{point.error:.6g}",
                "p50_ms": f"{point.milliseconds:.4f}",
                "p95_ms": f"{point.p95:.4f}",
            }
            for speed, points in zip(_SPEEDS, measured, strict=True)
            for point in points
        ],
    )
    return [_weights_claim(cells)]


def _in_time(points: Sequence[Point], milliseconds: float) -> Cell:
    """The winner, and the error of the best with area weights over its own."""
    best = best_within(points, milliseconds)
    if best is None:
        return Cell("none", "", float("nan"), float("nan"))
    area = best_within([p for p in points if p.candidate.weight in ("area", "")], milliseconds)
    gain = area.error / best.error if area and best.error > 0 else 1.0
    return Cell(best.candidate.family, f"{best.candidate.family} {best.candidate.weight}".strip(), best.error, gain)


_COLOURS = {**FAMILIES, "exact": "#777777", "none": "#ffffff"}


def _draw(sheet: Sheet, kind: str, caption: str, cells: Map, budgets: Sequence[str], label: str) -> None:
    from_colour = np.array([[_rgb(_COLOURS[cell.family]) for cell in line] for line in cells[::-1]])
    with sheet.plot(kind, caption, 1, 1, (10.6, 0.48 * len(cells) + 1.7)) as (figure, axes):
        axes.imshow(from_colour, aspect="auto")
        for row, line in enumerate(cells[::-1]):
            for column, cell in enumerate(line):
                if cell.family != "none":
                    gain = f", {cell.gain:.2g}x" if 1.005 < cell.gain < 1e4 else ""
                    text = f"{cell.label}\n{100 * cell.error:.2g}{gain}"
                    axes.text(column, row, text, ha="center", va="center", color="white", fontsize=8)
        axes.set_xticks(range(len(_SPEEDS)), [f"{speed:g}" for speed in _SPEEDS])
        axes.set_yticks(range(len(budgets)), budgets[::-1])
        axes.set(xlabel="Speed (degrees a frame)", ylabel=label)
        axes.grid(False)


def _rgb(colour: str) -> NDArray[np.float64]:
    return np.array([int(colour[k : k + 2], 16) for k in (1, 3, 5)]) / 255


def _claims(errors: Sequence[dict[tuple[str, int], float]]) -> list[Verdict]:
    """PBI against both others, cell by cell."""
    worse: dict[str, list[str]] = {"NWA": [], "BI": []}
    for speed, each in zip(_SPEEDS, errors, strict=True):
        for terms in _TERMS:
            for other, where in worse.items():
                if each["PBI", terms] > _NEAR * each[other, terms]:
                    where.append(f"{speed:g} with {terms}")
    cells = len(_SPEEDS) * len(_TERMS)
    why = {
        "NWA": "Light that turns so fast has nothing in common with the frame before: what was sent is all misplaced.",
        "BI": "A band that is started anew gets no terms in time and stays dark, where BI keeps light nearly in place.",
    }
    return [
        Verdict(
            f"PBI is at least as good as {other} with the same terms, at any speed and budget.",
            not where,
            f"in {cells - len(where)} of {cells} cells (within 2 %)"
            + (f"; worse at degrees a frame with terms: {', '.join(where)}" if where else ""),
            why[other] if where else "Each band takes the better of both ways.",
        )
        for other, where in worse.items()
    ]


def _weights_claim(cells: Map) -> Verdict:
    filled = [cell for line in cells for cell in line if cell.family not in ("none", "exact")]
    gains = np.array([cell.gain for cell in filled if np.isfinite(cell.gain)])
    other = sum(not cell.label.endswith("area") for cell in filled)
    return Verdict(
        "Our own claim: for the picture, weights by transport or cost beat area weights in the same time.",
        bool(len(filled) and other >= 0.5 * len(filled)),
        f"they win {other} of {len(filled)} cells; gain over area weights: median {np.median(gains):.2g}, "
        f"at most {gains.max():.2g}",
        "The norm of a column says what the picture gains by it; its area only what the light gains.",
    )


STUDY = Study(
    title="The map of speed and budget",
    intro="Coherence from frame to frame is worth the more, the slower the light and the smaller the budget. The map "
    "shows who wins where: in terms for the light, and in milliseconds for the picture.",
    run=run,
    light_files=("light-map.png", "light-map.csv"),
    scene_files=("image-map.png", "image-map.csv"),
)
