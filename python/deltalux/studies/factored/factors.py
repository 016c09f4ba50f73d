"""Factors: how many a lobe takes that is seen from anywhere (Overbeck 2006, section 7.1; Fig. 7.2's materials)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...columns import Haar
from ...pages.plotting import logarithmic
from ...pages.verdict import Verdict
from ...precomputation.factoring import MOST
from ...progress import Progress
from ..case import Case
from ..shape import Study
from ..sheet import Sheet
from .findings import COUNTS, LOBES, PAPERS, Ball, Found, ball, find

__all__ = ["STUDY"]

_SHOWN = ("Phong 20", "GGX 0.3")
_FEW = (PAPERS, 10, MOST)
_RIGHT = 0.15
"""A highlight within this relative error is taken for right."""
_COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#000000")


def run(case: Case, sheet: Sheet, progress: Progress) -> None:
    """Errors of all lobes against their factors, then two balls."""
    found, steps, face = [], len(LOBES) + len(_SHOWN), case.columns.face
    for k, name in enumerate(LOBES):
        progress(k, steps)
        found.append(find(name, case.env, face))
    _curves(sheet, found)
    _table(sheet, found)
    balls = []
    for k, name in enumerate(_SHOWN):
        progress(len(LOBES) + k, steps)
        balls.append(ball(name, case.env, face, _FEW))
    _balls(sheet, balls)
    progress(steps, steps)
    lines = [
        {"lobe": one.name, "factors": str(count), "error": f"{off:.4f}", "said": f"{said:.4f}", "auto": str(one.auto)}
        for one in found
        for count, off, said in zip(COUNTS, one.off, one.said, strict=True)
    ]
    sheet.csv("factors.csv", lines)
    sheet.claims(_claims(found))


def _curves(sheet: Sheet, found: Sequence[Found]) -> None:
    caption = (
        "Errors of highlights against factors. Solid: measured under this light, over eyes and ways that a surface "
        "faces; dashed: what the plan says that they leave under natural light."
    )
    with sheet.plot("errors.png", caption, 1, 1, (7.5, 4.5)) as (_, axes):
        for one, colour in zip(found, _COLOURS, strict=True):
            axes.plot(COUNTS, 100 * one.off, "o-", color=colour, label=one.name, markersize=4)
            axes.plot(COUNTS, 100 * one.said, "--", color=colour, linewidth=1)
        logarithmic(axes, "y")
        axes.set(xlabel="Factors", ylabel="Error of highlights (%)")
        axes.legend(fontsize=8)


def _table(sheet: Sheet, found: Sequence[Found]) -> None:
    def percent(one: Found, count: int) -> str:
        k = COUNTS.index(count)
        return f"{100 * one.off[k]:.0f} ({100 * one.said[k]:.0f})"

    headings = ("Lobe", *(f"{count} factors: off by (said), %" for count in _FEW), "Taken by itself")
    sheet.table(headings, [(one.name, *(percent(one, count) for count in _FEW), str(one.auto)) for one in found])


def _balls(sheet: Sheet, balls: Sequence[Ball]) -> None:
    caption = (
        "Balls of two lobes. The lobe itself, and sums of factors; what is below zero is black. Few factors are a blur "
        "of the highlight, not a weaker one."
    )
    columns = 1 + len(_FEW)
    with sheet.plot("balls.png", caption, len(balls), columns, (2.3 * columns, 2.5 * len(balls))) as (_, grid):
        for row, one in zip(grid, balls, strict=True):
            scale = max(float(np.quantile(one.exact.mean(axis=2), 0.97)), float(one.exact.max()) / 64, 1e-30)
            pictures = {"the lobe": one.exact, **{f"{count} factors": own for count, own in one.few.items()}}
            for axes, (title, picture) in zip(row, pictures.items(), strict=True):
                axes.imshow(np.clip(picture / scale, 0, 1) ** (1 / 2.2))
                axes.set_title(f"{one.name}, {title}", fontsize=9)
                axes.set_axis_off()


def _claims(found: Sequence[Found]) -> list[Verdict]:
    ten = COUNTS.index(10)
    shiny = {one.name: float(one.off[ten]) for one in found}
    held = [one for one in found if one.auto < MOST]
    own = {one.name: float(np.interp(one.auto, COUNTS, one.off)) for one in held}
    worst = max(own.values(), default=0.0)
    return [
        Verdict(
            claim="3 to 10 terms suffice even for fairly shiny materials (section 7.1)",
            figures=", ".join(f"{name}: {100 * off:.0f} %" for name, off in shiny.items()) + " off with ten",
            holds=max(shiny.values()) <= _RIGHT,
            why="as a blur that looks plausible they do; as highlights in their place they take more",
        ),
        Verdict(
            claim="where factors end below their cap, what is left is what the plan says (ours)",
            figures=", ".join(f"{name}: {100 * off:.0f} %" for name, off in own.items()) + " off with a tenth said",
            holds=worst <= _RIGHT,
            why="the plan's tenth is under natural light; lamps and suns are harder than it",
        ),
    ]


STUDY = Study(
    title="Factors: how many a lobe takes that is seen from anywhere",
    intro="A lobe that is seen from anywhere is a sum of products, each of a function of the light and one of the eye, "
    "and every product takes rows of its own. The papers show four. Here highlights of six lobes are held against sums "
    "of up to 24, under the light itself and with nothing in its way.",
    run=run,
    light_files=("errors.png", "balls.png", "factors.csv"),
    columns=Haar(32),
)
