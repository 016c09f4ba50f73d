"""Clustered transport: how many terms its second step needs, what representatives are worth, and what it saves beside
plain sparse storage at the same error (Overbeck 2006, section 7.4 and Fig. 7.3; EGSR 2006, Fig. 12)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...io import auto_exposure, magnification, to_display
from ...pages.plotting import FAMILIES, logarithmic
from ...pages.verdict import Verdict
from ...progress import Progress
from ...relight.entrants import PBI_30, PBI_100
from ...transport.transport import Transport
from ..case import Case, lights
from ..pictures import CORNER, window
from ..shape import Study
from ..sheet import Sheet
from .measure import (
    EACH,
    EQUAL,
    QUARTER,
    SHOWN,
    Cost,
    Picture,
    Size,
    at_error,
    clustered,
    costs_of,
    error_of,
    size_of,
    step_two,
)

__all__ = ["STUDY"]

_ROWS = 40_029 / 398
"""Rows of a cluster in the thesis."""
_SWEEP = (1, 2, 4, 8, 16)
"""Representatives, besides 25."""
_STILL = 4
"""Rotations under which the error of a transport is measured."""


def run(case: Case, sheet: Sheet, progress: Progress) -> None:
    """Builds what is looked at in a folder of its own, which goes when all is measured."""
    source = case.transport
    assert source is not None
    clusters = max(round(source.shape[0] / _ROWS), 1)
    others = [*((clusters, each) for each in _SWEEP), (2 * clusters, EACH // 2), (-(-clusters // 2), 2 * EACH)]
    total = len(others) + 4
    turned = [case.env.rotated(360 * k / _STILL) for k in range(_STILL)]
    still = np.stack([source.coefficients(env) for env in turned])
    with clustered(source, clusters, EACH) as made:
        progress(1, total)
        _draw_map(sheet, made)
        frames = lights(case.env, case.motion, case.columns)[: case.motion.stop + 1]
        steps, pictures = step_two(source, made, frames)
        progress(2, total)
        _draw_steps(sheet, steps, pictures)

        sizes = [size_of(source, made, still)]
        for k, (number, each) in enumerate(others):
            with clustered(source, number, each) as other:
                sizes.append(size_of(source, other, still))
            progress(3 + k, total)
        _draw_sizes(sheet, sizes)
        plain = at_error(source, sizes[0].error, still)
        costs = costs_of(source, made, plain, frames)
    progress(total, total)
    _tell_costs(sheet, source, costs)
    sheet.csv("clusters.csv", _table(steps, sizes, costs))
    sheet.claims(_claims(steps, costs))


def _draw_map(sheet: Sheet, made: Transport) -> None:
    labels = made.cluster_map()
    caption = (
        f"The clusters. {int(labels.max()) + 1} of {len(labels):,} rows, each in a colour of its own; rows of one "
        "cluster see alike, wherever they are."
    )
    with sheet.plot("map.png", caption, 1, 1, (5.2, 5.2)) as (_, axes):
        axes.imshow(to_display(made.cluster_picture()), interpolation="nearest")
        axes.set_axis_off()


def _draw_steps(sheet: Sheet, steps: dict[int, tuple[float, float]], pictures: dict[int, Picture]) -> None:
    exact = pictures[0]
    stops = auto_exposure(exact)
    worst = np.abs(pictures[SHOWN[0]] - exact)
    side = max(min(*exact.shape[:2]) // 3, 1)
    times = magnification(np.stack([pictures[each] - exact for each in SHOWN]), stops)
    caption = (
        "Close-ups with terms in the second step. Under 300 terms of light while it turns, where 2 terms are worst; "
        f"below the difference from plain storage, {times} times, and its error in the whole picture."
    )
    with sheet.plot("close-ups.png", caption, 2, len(SHOWN) + 1, (11.0, 4.6)) as (_, axes):
        for line in axes:
            for panel in line:
                panel.set_axis_off()
        for line, each in zip(axes.T, (*SHOWN, 0), strict=True):
            line[0].imshow(to_display(window(pictures[each], worst, side), stops), interpolation="nearest")
            line[0].set_title(f"{each} terms" if each else "plain storage", fontsize=9)
            if each:
                difference = window(times * np.abs(pictures[each] - exact), worst, side)
                line[1].imshow(to_display(difference, stops), interpolation="nearest")
                error = f"{100 * error_of(pictures[each], exact):.2g} %"
                line[1].text(0.02, 0.03, error, transform=line[1].transAxes, **CORNER)

    caption = (
        "Error of the second step against its terms. While the light turns: what the step leaves of the picture that "
        f"all {EACH} terms make, and the error of the whole against plain storage under the same 300 terms of light."
    )
    with sheet.plot("terms.png", caption, 1, 1, (7.2, 4.2)) as (_, axes):
        left = [100 * error or np.nan for error, _ in steps.values()]
        axes.plot(list(steps), [100 * error for _, error in steps.values()], "o-", color=FAMILIES["PBI"], label="whole")
        axes.plot(list(steps), left, "s--", color=FAMILIES["BI"], label="left by the second step")
        axes.set(xlabel="Terms of the second step, for each cluster in the mean", ylabel="Image: L2 error (%)")
        logarithmic(axes)
        axes.legend()


def _draw_sizes(sheet: Sheet, sizes: Sequence[Size]) -> None:
    sheet.heading("Clusters and representatives: bytes and error under light that stands still")
    ordered = sorted(sizes, key=lambda size: (size.each, size.clusters))
    lines = [(f"{s.clusters} x {s.each}", f"{s.megabytes:.3g}", f"{100 * s.error:.3g} %") for s in ordered]
    sheet.table(("Clusters x representatives", "MB", "Image L2 error"), lines)
    caption = "Error against representatives of a cluster. Under light that stands still, all terms in both steps."
    with sheet.plot("representatives.png", caption, 1, 1, (7.2, 4.2)) as (_, axes):
        same = [size for size in ordered if size.each in (*_SWEEP, EACH)]
        axes.plot([s.each for s in same], [100 * s.error for s in same], "o-", color=FAMILIES["PBI"])
        axes.set(xlabel="Representatives", ylabel="Image: L2 error (%)")
        logarithmic(axes)


def _tell_costs(sheet: Sheet, source: Transport, costs: Sequence[Cost]) -> None:
    sheet.heading("Beside plain sparse storage: what a frame sends and takes while the light turns")
    sheet.text(
        f"Entries are columns of sixteen rows; of the second step ({QUARTER} terms for each cluster, and its mean) "
        "as many as its columns have in the mean. Sparse storage at equal error is truncated until its error in light "
        "that stands still is that of the clusters. Errors are against the transport as it was given."
    )
    lines = [
        (
            cost.form,
            cost.method,
            f"{cost.megabytes:.3g}",
            f"{cost.first:,.0f}",
            f"{cost.entries:,.0f}",
            f"{cost.milliseconds:.3f}",
            f"{100 * cost.error:.3g} %",
        )
        for cost in costs
    ]
    headings = ("Storage", "Method", "MB", "Entries of step one", "Of both", "Median ms", "Image L2 error")
    sheet.table(headings, lines)


def _table(steps: dict[int, tuple[float, float]], sizes: Sequence[Size], costs: Sequence[Cost]) -> list[dict[str, str]]:
    """All figures, one measurement a line."""
    found = [("left by step two", f"{each} terms", error) for each, (error, _) in steps.items()]
    found += [("whole error", f"{each} terms", error) for each, (_, error) in steps.items()]
    for size in sizes:
        what = f"{size.clusters} x {size.each}"
        found += [("megabytes", what, size.megabytes), ("still error", what, size.error)]
    for cost in costs:
        what = f"{cost.form} {cost.method}"
        found += [("megabytes", what, cost.megabytes), ("entries of step one", what, cost.first)]
        found += [("entries", what, cost.entries)]
        found += [("median ms", what, cost.milliseconds), ("error", what, cost.error)]
    return [{"measure": measure, "of": of, "value": f"{value:.6g}"} for measure, of, value in found]


def _claims(steps: dict[int, tuple[float, float]], costs: Sequence[Cost]) -> list[Verdict]:
    quarter, all_terms = steps[QUARTER][1], steps[EACH][1]
    ratio = quarter / all_terms if all_terms > 0 else 1.0
    found = [
        Verdict(
            f"A quarter of the terms of step 2, {QUARTER} of {EACH}, is within 1.1 times the error of all (7.4).",
            ratio <= 1.1,
            f"{100 * quarter:.3g} against {100 * all_terms:.3g} %, {ratio:.3g} times",
            "What clustering itself loses is more than what the step leaves."
            if ratio <= 1.1
            else "This light changes more than a quarter of the terms can follow.",
        )
    ]
    of = {(cost.form, cost.method): cost for cost in costs}
    for method in (str(PBI_30), str(PBI_100)):
        plain, clustered = of[EQUAL, method], of["clustered", method]
        first, fewer = _ratio(plain.first, clustered.first), _ratio(plain.entries, clustered.entries)
        faster = _ratio(plain.milliseconds, clustered.milliseconds)
        found += [
            Verdict(
                f"{method} sends a quarter as much in step one over clusters as over plain storage of equal error "
                "(7.4: about 4).",
                first >= 4,
                f"{clustered.first:,.0f} against {plain.first:,.0f} entries, {first:.2g} times fewer; with step two "
                f"{clustered.entries:,.0f}, {fewer:.2g} times fewer",
                "Representatives are a quarter of the rows."
                if first >= 4
                else "Representatives hold entries in more columns than rows do: sparse storage has few already.",
            ),
            Verdict(
                f"{method} takes half the time over clusters (our own aim).",
                faster >= 2,
                f"{clustered.milliseconds:.3f} against {plain.milliseconds:.3f} ms at {100 * clustered.error:.3g} and "
                f"{100 * plain.error:.3g} %, {faster:.2g} times as fast",
                ""
                if faster >= 2
                else "An entry takes a few nanoseconds: choosing among all representatives, and taking their responses "
                "to the second step, costs what is saved.",
            ),
        ]
    return found


def _ratio(a: float, b: float) -> float:
    return a / b if b > 0 else 1.0


STUDY = Study(
    title="Clusters: transport in two steps",
    intro="Rows that see alike share a mean and a few representatives: the light is multiplied by those, and what "
    "comes of it by the weights of each row. The papers follow the first step by PBI and the second by a quarter of "
    "its terms, and find both about four times as fast. Here both are held against the same rows in plain storage.",
    run=run,
    scene_files=("map.png", "close-ups.png", "terms.png", "representatives.png", "clusters.csv"),
    needs_scene=True,
    refuses_texels=True,
)
