"""Which wavelets a method sends, and what of the sphere they cover (Overbeck 2006, Fig. 5.3; EGSR Fig. 4)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...columns import Haar
from ...columns.haar import blocks_under
from ...light.motion import Motion
from ...pages.plotting import FAMILIES
from ...pages.verdict import Verdict
from ...progress import Progress
from ...relight.entrants import BI_30, NWA_30, PBI_30, nwa
from ..case import Case, follow, lights
from ..pictures import cross
from ..shape import Study
from ..sheet import Sheet

__all__ = ["STUDY", "covered_levels"]

_ROWS = (NWA_30, BI_30, PBI_30)
# The histogram under other weights (METHODS, X1): what is chosen depends on how a coefficient is measured.
_WEIGHTED = _ROOT_AREA, _UNWEIGHTED = tuple(nwa(30, weight, weight=weight) for weight in ("root-area", "none"))
_WINDOW = 5
"""Frames that are summed, as in the papers."""

Sent = list[NDArray[np.uint32]]
"""The columns sent in every frame."""


def covered_levels(columns: Haar, chosen: NDArray[np.uint32]) -> NDArray[np.int64]:
    """How many levels have a chosen wavelet over each texel: (6, size, size)."""
    size, bands = columns.size, columns.bands
    levels = np.zeros((6, size, size), np.int64)
    for band in np.unique(bands[chosen]):
        covered = np.zeros((6, 2**band, 2**band), bool)
        covered.reshape(-1)[blocks_under(columns, chosen, band)] = True
        times = size // 2**band
        levels += covered.repeat(times, axis=1).repeat(times, axis=2)
    return levels


def run(case: Case, sheet: Sheet, progress: Progress) -> None:
    """Maps at four moments, and histograms of what is sent."""
    frames = lights(case.env, case.motion, case.columns)
    sent: dict[str, Sent] = {}
    for k, row in enumerate((*_ROWS, *_WEIGHTED)):
        progress(k, len(_ROWS) + len(_WEIGHTED))
        sent[row.name] = [moment.update.columns for moment in follow(case.columns, row, frames)]
    progress(1, 1)

    moments = _moments(case.motion)
    _maps(case, sheet, sent, moments, 1)
    _maps(case, sheet, sent, moments, _WINDOW)
    histograms = {name: _histogram(case.columns, columns) for name, columns in sent.items()}
    _bars(case, sheet, histograms, moments)
    names = case.columns.band_names
    sheet.heading("Terms per band, mean over turning frames")
    turning = slice(1, case.motion.stop + 1)
    means = {name: table[turning].mean(axis=0) for name, table in histograms.items()}
    sheet.table(
        ("Method", *(f"{name} texels" for name in names)),
        [(name, *(f"{value:.1f}" for value in mean)) for name, mean in means.items()],
    )
    sheet.csv("coverage.csv", _table(names, histograms))
    sheet.claims(_claims(case, histograms))


def _moments(motion: Motion) -> list[tuple[int, str]]:
    """Turning slowly, turning fastest, and converging: the last frame."""
    slow, fast, _, last = (frame for frame, _ in motion.moments)
    return [(slow, "turning slowly"), (fast, "turning fastest"), (last, "converging")]


def _histogram(columns: Haar, sent: Sent) -> NDArray[np.int64]:
    """Terms of every frame per band: (frames, bands)."""
    bands = int(columns.bands[-1]) + 1
    return np.array([np.bincount(columns.bands[chosen], minlength=bands) for chosen in sent])


def _maps(case: Case, sheet: Sheet, sent: dict[str, Sent], moments: list[tuple[int, str]], window: int) -> None:
    bands = int(case.columns.bands[-1]) + 1
    over = "in one frame" if window == 1 else f"over {window} frames"
    caption = (
        f"Coverage {over}. The brighter a texel of the unfolded cubemap, the more levels of wavelets over it were "
        "sent: 0 is black; NWA covers again what it covered before, BI and PBI go on to finer levels."
    )
    size = (3.1 * len(moments) + 0.6, 2.5 * len(_ROWS) + 0.5)
    with sheet.plot(f"coverage-{window}.png", caption, len(_ROWS), len(moments), size) as (figure, axes):
        images = []
        for line, row in zip(axes, _ROWS, strict=True):
            for panel, (frame, what) in zip(line, moments, strict=True):
                first = max(frame - window + 1, 1)
                columns = np.unique(np.concatenate(sent[row.name][first : frame + 1]))
                levels = cross(covered_levels(case.columns, columns)[..., None].astype(float), -1.0)[..., 0]
                shown = np.ma.masked_less(levels, 0)
                images.append(panel.imshow(shown, cmap="inferno", vmin=0, vmax=bands, interpolation="nearest"))
                panel.set_axis_off()
                if row is _ROWS[0]:
                    panel.set_title(f"frame {frame}, {what}", fontsize=10)
            line[0].text(-0.04, 0.5, row.name, rotation=90, va="center", ha="right", transform=line[0].transAxes)
        figure.colorbar(images[-1], ax=axes, label="levels", shrink=0.6)


def _bars(case: Case, sheet: Sheet, histograms: dict[str, NDArray[np.int64]], moments: list[tuple[int, str]]) -> None:
    names = case.columns.band_names
    caption = (
        f"Terms sent per band: full bars are means over {_WINDOW} frames that end at the one named, outlines the frame "
        "alone."
    )
    with sheet.plot("histograms.png", caption, 1, len(moments), (11.0, 3.6), sharey=True) as (figure, axes):
        for panel, (frame, what) in zip(axes, moments, strict=True):
            for k, row in enumerate(_ROWS):
                at = np.arange(len(names)) + (k - 1) * 0.27
                table = histograms[row.name]
                mean = table[max(frame - _WINDOW + 1, 1) : frame + 1].mean(axis=0)
                panel.bar(at, mean, 0.25, color=FAMILIES[row.family], label=row.name)
                panel.bar(at, table[frame], 0.25, fill=False, edgecolor="black", linewidth=0.7)
            panel.set_xticks(range(len(names)), names, rotation=45)
            panel.set_title(f"frame {frame}, {what}", fontsize=10)
            panel.set_xlabel(case.columns.band_label)
            panel.grid(False, axis="x")
        axes[0].set_ylabel("Terms a frame")
        figure.legend(*axes[0].get_legend_handles_labels(), loc="outside right center")


def _table(names: Sequence[str], histograms: dict[str, NDArray[np.int64]]) -> list[dict[str, Any]]:
    keys = [f"texels_{name.replace(',', '')}" for name in names]
    return [
        {"method": method, "frame": k, **dict(zip(keys, map(int, line), strict=True))}
        for method, table in histograms.items()
        for k, line in enumerate(table)
    ]


def _claims(case: Case, histograms: dict[str, NDArray[np.int64]]) -> list[Verdict]:
    turning = slice(1, case.motion.stop + 1)
    fine = histograms[NWA_30.name].shape[1] // 2
    share = {name: _shares(table[turning]) for name, table in histograms.items()}
    late = {name: float(_shares(histograms[name][-_WINDOW:])[fine:].sum()) for name in (BI_30.name, PBI_30.name)}
    own, bi = share[NWA_30.name], share[BI_30.name]
    per_band = {name: _list(30 * share[name]) for name in (NWA_30.name, _ROOT_AREA.name, _UNWEIGHTED.name)}
    return [
        Verdict(
            f"{NWA_30} chooses nothing finer than wavelets over 256 texels: a map of 6 x 8 x 8 (area weights).",
            bool(own[3:].sum() <= 0.01),
            f"terms a frame per band: {per_band['NWA-30']}",
            "So it is with weight area x orthonormal coefficient, the reading that reproduces the papers."
            if own[3:].sum() <= 0.01
            else "Lights of a few texels are bright enough here to bring finer wavelets in even by area.",
        ),
        Verdict(
            "Under the root of the area, or none, the same method reaches fine bands.",
            bool(share[_UNWEIGHTED.name][3:].sum() > share[_ROOT_AREA.name][3:].sum() >= own[3:].sum()),
            f"root-area {per_band['NWA-30 root-area']}; none {per_band['NWA-30 none']}",
            "The weight decides what is chosen; each flatters its own measure of error.",
        ),
        Verdict(
            "BI spreads its terms over finer levels than NWA.",
            bool(bi[fine:].sum() > 2 * own[fine:].sum() and bi[fine:].sum() > 0.05),
            f"terms in the {len(bi) - fine} finest bands: BI {100 * bi[fine:].sum():.1f} %, "
            f"NWA {100 * own[fine:].sum():.1f} %",
            "What is already right need not be sent again, so that terms are left for detail.",
        ),
        Verdict(
            "Once the light stands still, only fine bands are worked on.",
            bool(min(late.values()) >= 0.9),
            f"terms in the {len(bi) - fine} finest bands in the last {_WINDOW} frames: "
            + ", ".join(f"{name} {100 * value:.0f} %" for name, value in late.items()),
            "Coarse bands are already exact."
            if min(late.values()) >= 0.9
            else f"After {case.motion.hold} still frames the coarse bands are not yet exact: they are finished first.",
        ),
    ]


def _shares(table: NDArray[np.int64]) -> NDArray[np.float64]:
    total = table.sum(axis=0)
    return np.asarray(total / max(int(total.sum()), 1))


def _list(values: NDArray[np.float64]) -> str:
    return " / ".join(f"{value:.1f}" for value in values)


STUDY = Study(
    title="Which wavelets are sent",
    intro="NWA sends the largest terms of the light again and again; BI and PBI send what has changed. The maps show "
    "what of the sphere each one's thirty wavelets cover, the bars how fine they are.",
    run=run,
    light_files=("coverage-1.png", f"coverage-{_WINDOW}.png", "histograms.png", "coverage.csv"),
)
