"""Gather samples: what their cells are worth where a lobe is narrow (Nguyen 2010, Fig. 2 and 3, section 3.2)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...io import auto_exposure
from ...pages.plotting import FAMILIES
from ...pages.verdict import Verdict
from ...progress import Progress
from ..case import Case
from ..pictures import show, window
from ..shape import Study
from ..sheet import Sheet
from .gathering import LAMPS, Stage, Way, off

__all__ = ["STUDY"]

_COUNTS = (4096, 16384)
_GAMMAS = (30.0, 300.0)
_PIXELS = 60
_SIDE = 64
_SHOWN, _SHOWN_SIDE = 4096, 24
"""Samples, and rays along a side, of the pictures."""
_WAYS = (
    Way("none (centre)", "centre", 1),
    Way("disc, 16", "disc", 16),
    Way("cell, 4", "cell", 4),
    Way("cell, 16", "cell", 16),
    Way("cell, 16, L mean of the cell", "cell", 16, mean=True),
    Way("cell, 64, L mean", "cell", 64, mean=True),
    Way("rays near by, cells beyond, L mean", "angle", 64, mean=True),
)
_NONE, _DISC, _CELL, _STUDIO = _WAYS[0], _WAYS[1], _WAYS[5], _WAYS[6]
"""The last one is what studios do."""
_WITHIN, _TIMES = 0.02, 4.0

Errors = dict[tuple[Way, int, str, float], float]


def run(case: Case, sheet: Sheet, progress: Progress) -> None:
    """The table at some pixels, then pictures of all."""
    assert case.scene is not None
    stage = Stage(case.scene)
    numbers = stage.table[0]
    some = numbers[np.linspace(0, len(numbers) - 1, min(_PIXELS, len(numbers))).astype(int)]
    total, done = len(_COUNTS) * len(LAMPS) * len(_GAMMAS) + 1, 0
    errors: Errors = {}
    wanted = {(lamp, g): stage.reference(some, g, lamp, _SIDE) for lamp in LAMPS for g in _GAMMAS}
    for count in _COUNTS:
        samples = stage.samples(count)
        for (lamp, gamma), exact in wanted.items():
            for way in _WAYS:
                errors[way, count, lamp, gamma] = off(stage.gathered(samples, some, gamma, lamp, way), exact)
            done += 1
            progress(done, total)
    _tell(sheet, errors)
    _draw_floor(sheet, stage)
    _draw_samples(sheet, stage)
    progress(total, total)
    sheet.csv("gather.csv", _table(errors))
    sheet.claims(_claims(errors))


def _tell(sheet: Sheet, errors: Errors) -> None:
    sheet.heading("L1 error of what the floor reflects, by the points that stand for a sample")
    sheet.text(
        f"Light of a lamp that has bounced once, seen in a floor of Blinn and Phong's model, against {_SIDE**2:,} rays "
        "of the lobe at each of some pixels. First under a lamp that shines evenly, then under one with a sharp cone."
    )
    columns = [(count, gamma) for count in _COUNTS for gamma in _GAMMAS]
    headings = ["Points", *(f"{count:,} samples, gamma {gamma:g}" for count, gamma in columns)]
    lines = [
        (way.name, *(" / ".join(f"{100 * errors[way, c, lamp, g]:.2g}" for lamp in LAMPS) + " %" for c, g in columns))
        for way in _WAYS
    ]
    sheet.table(headings, lines)


def _draw_floor(sheet: Sheet, stage: Stage) -> None:
    numbers, (gamma, lamp) = stage.table[0], (_GAMMAS[-1], LAMPS[-1])
    samples = stage.samples(_SHOWN)
    ways = [stage.picture(stage.gathered(samples, numbers, gamma, lamp, way)) for way in (_NONE, _DISC, _CELL, _STUDIO)]
    exact = stage.picture(stage.reference(numbers, gamma, lamp, _SHOWN_SIDE))
    stops = auto_exposure(exact)
    worst, side = np.abs(ways[0] - exact), max(min(exact.shape[:2]) // 4, 1)
    caption = (
        f"Sub-area points. What a floor of gamma {gamma:g} reflects of light that has bounced once, by {_SHOWN:,} "
        "samples: each by its centre, by 16 points of a disc, 64 of its cell, as studios do; and by rays alone. Below, "
        "enlarged where the centre is worst (Fig. 2)."
    )
    with sheet.plot("floor.png", caption, 2, 5, (13.0, 5.6)) as (_, axes):
        titles = ("none", "disc", "cell", "studio", "rays")
        for title, picture, line in zip(titles, [*ways, exact], axes.T, strict=True):
            line[0].set_title(title, fontsize=9)
            show(line[0], picture, stops, f"{100 * off(picture, exact):.2g} %" if title != "rays" else None)
            show(line[1], window(picture, worst, side), stops)


def _draw_samples(sheet: Sheet, stage: Stage) -> None:
    samples = stage.samples(_SHOWN)
    seen = stage.seen(stage.eye, samples.position, samples.normal)
    at, camera = stage.projected(samples.position), stage.scene.camera
    places, normals, _ = samples.cell_points()
    own = np.repeat(np.arange(len(samples)), np.diff(samples.cell_starts).astype(np.intp))
    open_ = stage.seen(stage.eye, places, normals)
    colours = np.random.default_rng(0).random((len(samples), 3))
    caption = (
        "Gather samples, as the camera sees them. Where glossy paths end, where diffuse ones do, all of them; and "
        "the cells that they stand for, each in a colour of its own (Fig. 3)."
    )
    with sheet.plot("samples.png", caption, 1, 4, (11.0, 3.2)) as (_, axes):
        chosen = {"glossy": seen & samples.glossy, "diffuse": seen & ~samples.glossy, "all": seen}
        for panel, (title, which) in zip(axes, chosen.items(), strict=False):
            panel.scatter(*at[which].T, s=2, color=FAMILIES["PBI"], linewidths=0)
            panel.set_title(f"{title}: {int(which.sum()):,} seen", fontsize=9)
        axes[-1].scatter(*stage.projected(places[open_]).T, s=1, c=colours[own[open_]], linewidths=0)
        axes[-1].set_title("cells", fontsize=9)
        for panel in axes:
            panel.set(xlim=(0, camera.width), ylim=(camera.height, 0), aspect="equal", xticks=[], yticks=[])
            panel.grid(False)


def _table(errors: Errors) -> list[dict[str, str]]:
    return [
        {"points": way.name, "samples": str(count), "lamp": lamp, "gamma": f"{gamma:g}", "error": f"{error:.5g}"}
        for (way, count, lamp, gamma), error in errors.items()
    ]


def _claims(errors: Errors) -> Sequence[Verdict]:
    at = (_COUNTS[-1], LAMPS[0], _GAMMAS[-1])
    none, disc, cell, studio = (errors[way, *at] for way in (_NONE, _DISC, _CELL, _STUDIO))
    fewer = [errors[way, _COUNTS[0], *at[1:]] for way in (_NONE, _DISC)]
    figures = f"none {100 * none:.2g}, discs {100 * disc:.2g}, cells {100 * cell:.2g}, studios {100 * studio:.2g} %"
    left = "What is left is the sample's own: its light, and the noise of rays."
    return [
        Verdict(
            "Sub-area points on discs enhance a narrow reflection (3.2, Fig. 2).",
            disc < 0.9 * none,
            figures,
            ""
            if disc < 0.9 * none
            else f"With {_COUNTS[0]:,} samples it is {_percents(fewer)}: dense samples need few.",
        ),
        Verdict(
            f"What studios do is within {100 * _WITHIN:g} % under an even lamp at the narrowest lobe (our own aim).",
            studio <= _WITHIN,
            figures,
            "" if studio <= _WITHIN else left,
        ),
        Verdict(
            "Discs are off by four times as much (our own aim).",
            disc >= _TIMES * studio,
            f"{disc / studio:.2g} times" if studio > 0 else figures,
            "" if disc >= _TIMES * studio else left,
        ),
    ]


def _percents(values: Sequence[float]) -> str:
    return " and ".join(f"{100 * value:.2g}" for value in values) + " %"


STUDY = Study(
    title="Gather samples: points that stand for their surface",
    intro="Light that surfaces send to a glossy floor is gathered from samples of them. A narrow lobe falls between "
    "samples, so each is looked at by several points: of a disc of its area, as the paper does, or of its cell, the "
    "part of the surface that is nearer to it than to any other. Where a cell is not small beside the lobe, studios "
    "take rays of the lobe, and look in which cells they end. Held against rays alone, in the same light.",
    run=run,
    scene_files=("floor.png", "samples.png", "gather.csv"),
    traces="cornell",
)
