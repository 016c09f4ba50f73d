"""When PBI starts a band anew, over the angle of a rotating light (Overbeck 2006, Fig. 6.4; EGSR Fig. 9)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from math import copysign
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...columns import Haar
from ...pages.plotting import FAMILIES, draw_resets
from ...pages.verdict import Verdict
from ...progress import Progress
from ...relight.entrants import PBI_30, Entrant
from ..case import Case, Light, Moment, band_starts, follow, lights
from ..shape import Study
from ..sheet import Sheet

__all__ = ["STUDY", "rasters"]

_SPEEDS = (30.0, 45.0, 90.0, 180.0)

Raster = NDArray[np.bool_]
"""(frames, bands): the band starts anew."""


def run(case: Case, sheet: Sheet, progress: Progress) -> None:
    """The raster at the speed asked for, and the counts at the papers' speeds and around."""
    asked = abs(case.motion.rotate)
    speeds = sorted({*_SPEEDS, asked})
    printed, held = {}, {}
    for k, degrees in enumerate(speeds):
        progress(k, len(speeds))
        frames = lights(case.env, replace(case.motion, rotate=copysign(degrees, case.motion.rotate)), case.columns)
        printed[degrees], held[degrees] = rasters(case.columns, PBI_30, frames)
    progress(1, 1)

    _draw(case, sheet, printed[asked], held[asked])
    names = case.columns.band_names
    for title, found in (("As the papers count", printed), ("Of bands that held something", held)):
        sheet.heading(f"Resets per band: {title.lower()}")
        lines = [(f"{degrees:g} degrees", *map(str, found[degrees].sum(axis=0))) for degrees in speeds]
        sheet.table(("Rotation", *(f"{name} texels" for name in names)), lines)
    sheet.csv("resets.csv", _table(case, printed, held))
    sheet.claims(_claims(printed, asked))


def rasters(columns: Haar, row: Entrant, frames: Sequence[Light]) -> tuple[Raster, Raster]:
    """Resets by Fig. 6.1's test, which also resets a band that holds nothing; and those that took something away."""
    count = int(columns.bands[-1]) + 1
    printed, held = np.zeros((2, len(frames), count), bool)
    for k, (moment, light) in enumerate(zip(follow(columns, row, frames), frames, strict=True)):
        printed[k] = _anew(columns, moment, light)
        held[k, list(moment.update.resets)] = True
    return printed, held


def _anew(columns: Haar, moment: Moment, light: Light) -> Raster:
    """Not |L - L~| < |L|, band by band, unless nothing has changed."""
    starts = band_starts(columns)
    change, whole = (np.add.reduceat(np.abs(of).sum(axis=1), starts) for of in (light - moment.before, light))
    return np.asarray((change > 0) & (change >= whole))


def _draw(case: Case, sheet: Sheet, printed: Raster, held: Raster) -> None:
    caption = (
        f"Frames in which {PBI_30} starts a band anew. Pale lines are resets of bands that held nothing, which cost "
        "and change nothing; below, the angle of the light."
    )
    counts = zip(printed.sum(axis=0), held.sum(axis=0), strict=True)
    notes = [f"{every} resets\n{own} of held light" for every, own in counts]
    layers = [(printed, "#9fc5e8"), (held, FAMILIES["PBI"])]
    options = {"sharex": True, "height_ratios": (2.4, 1)}
    with sheet.plot("resets.png", caption, 2, 1, (8.8, 5.2), **options) as (figure, both):
        draw_resets(both, case.columns, case.motion, layers, notes)
        figure.suptitle(f"Bands that {PBI_30} starts anew under {case.env.name}", fontsize=11)


def _table(case: Case, printed: dict[float, Raster], held: dict[float, Raster]) -> list[dict[str, Any]]:
    names = case.columns.band_names
    return [
        {"degrees": degrees, "frame": k, "band": name, "reset": int(raster[k, b]), "held": int(held[degrees][k, b])}
        for degrees, raster in printed.items()
        for k in range(len(raster))
        for b, name in enumerate(names)
    ]


def _claims(printed: dict[float, Raster], asked: float) -> list[Verdict]:
    counts = {degrees: raster.sum(axis=0) for degrees, raster in printed.items()}
    own = counts[asked]
    totals = [int(count.sum()) for count in counts.values()]
    said = "; ".join(f"{degrees:g} degrees: {' '.join(map(str, count))}" for degrees, count in counts.items())
    return [
        Verdict(
            "The two coarsest bands are always updated incrementally.",
            not own[:2].any(),
            f"resets of the two coarsest: {own[0]} and {own[1]}",
            "What they hold moves little from frame to frame, measured in their own texels.",
        ),
        Verdict(
            "Finer bands start anew more often than coarse ones.",
            bool(np.all(np.diff(own) >= 0)),
            f"coarse to fine: {' '.join(map(str, own))}",
            "A shift by a texel leaves a coarse wavelet nearly as it was and replaces a fine one."
            if np.all(np.diff(own) >= 0)
            else "In a fine band little is ever applied: where the test finds the light nearer to it than to zero, by "
            "however little, there is no reset.",
        ),
        Verdict(
            "The faster the light turns, the more resets there are.",
            bool(np.all(np.diff(totals) >= 0)),
            said,
            "Fast light has left what was applied before it is used again.",
        ),
    ]


STUDY = Study(
    title="Resets of each band over the rotation",
    intro="PBI decides in every frame, for every band of wavelets, whether to change what it has applied or to start "
    "from nothing. The simple test starts anew where the light is nearer to zero than to the copy.",
    run=run,
    light_files=("resets.png", "resets.csv"),
)
