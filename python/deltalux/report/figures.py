"""The plots of the report."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ..columns.inner import AnyColumns
from ..light.motion import Motion
from ..pages.plotting import FAMILIES, MARKERS, across, colour_of, draw_resets, drawing, mark_stop, percent
from ..relight.entrants import BI_30, EXACT, NWA_30, NWA_100, NWA_500, PBI_30, PBI_100, Entrant
from ..relight.replay import Replay
from .size_curve import Point

__all__ = ["bytes_figure", "frames_figure", "resets_figure", "terms_figure", "time_figure"]

_LINES = {
    NWA_30.name: (":", 1.4),
    NWA_100.name: ("--", 1.4),
    NWA_500.name: ("-", 1.4),
    BI_30.name: ("-", 1.6),
    PBI_30.name: ("-", 2.4),
    PBI_100.name: ("--", 1.6),
}


def frames_figure(path: Path, result: Replay, motion: Motion) -> None:
    """Error against frame: of the light as in the papers' Fig. 6.2, and of the image."""
    measures = (
        ("light_l1", "Light: area-weighted L1 error (%)"),
        ("image_l2", "Image: L2 error (%)"),
    )
    with drawing(path, 2, 1, (8.6, 7.4), sharex=True) as (figure, both):
        for axes, (what, title) in zip(both, measures, strict=True):
            others = {name: ("-", 1.8) for name in result.records if colour_of(name) == FAMILIES["own"]}
            for name, (style, width) in {**_LINES, **others}.items():
                if name not in result.records:
                    continue
                error = 100 * result.column(name, what)
                error[error <= 0] = np.nan
                axes.plot(error, style, linewidth=width, color=colour_of(name), label=name)
            axes.set_yscale("log")
            axes.set_ylabel(title)
            percent(axes.yaxis)
            mark_stop(axes, motion)
        both[1].set_xlabel("Frame")
        both[0].set_xlim(0, len(motion.angles) - 1)
        figure.suptitle(f"Error against frame under {result.environment}: {motion}", fontsize=11)
        handles, labels = both[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside right center")


def time_figure(path: Path, result: Replay, motion: Motion, rows: Sequence[Entrant], threads: int) -> None:
    """Error against run time: every method at its budgets; a bar from the median frame to the 95th percentile."""
    seconds = result.seconds[threads]
    turning = slice(1, motion.stop + 1)
    last = len(motion.angles) - 1
    panels = ((turning, "while rotating (mean)"), (slice(last, last + 1), f"{motion.hold} frames after the stop"))
    with drawing(path, 1, 2, (10.5, 4.9), sharex=True, sharey=True) as (figure, both):
        for axes, (frames, title) in zip(both, panels, strict=True):
            for family in dict.fromkeys(row.family for row in rows if row.family != EXACT.name):
                points = []
                for row in (row for row in rows if row.family == family):
                    p50, p95 = 1e3 * np.percentile(seconds[row.name][turning, 0], (50, 95))
                    points.append((p50, p95, 100 * result.column(row.name, "image_l2")[frames].mean(), row.budget))
                colour = FAMILIES[family]
                p50, p95, error, _ = np.array(points, float).T
                shown = error > 0
                axes.plot(
                    p50[shown], error[shown], "-", color=colour, marker=MARKERS[family], label=family, markersize=6
                )
                axes.hlines(error[shown], p50[shown], p95[shown], color=colour, alpha=0.35, linewidth=3)
                below = (0, 6) if family in ("NWA", "BI") else (0, -13)
                for x, _, y, budget in (point for point in points if point[2] > 0):
                    axes.annotate(
                        f"{budget}",
                        (x, y),
                        xytext=below,
                        textcoords="offset points",
                        fontsize=8,
                        color=colour,
                        ha="center",
                    )
            exact = 1e3 * np.median(seconds[EXACT.name][turning, 0])
            axes.axvline(exact, color="#000000", linestyle=":", linewidth=1.2, label="exact product (no error)")
            axes.set(xscale="log", yscale="log", title=title)
            plural = "s" if threads > 1 else ""
            axes.set_xlabel(f"Frame on {threads} thread{plural} (ms): median, bar to 95th percentile")
            percent(axes.xaxis)
            percent(axes.yaxis)
        both[0].set_ylabel("Image: L2 error (%)")
        figure.suptitle(f"Error against run time under {result.environment}; labels are terms a frame", fontsize=11)
        handles, labels = both[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=len(labels))


def resets_figure(path: Path, result: Replay, motion: Motion, columns: AnyColumns, method: str) -> None:
    """Resets of every band over the rotation (the papers' Fig. 6.4)."""
    records = result.records[method]
    held = np.array([[band in record.resets for band in range(len(columns.band_names))] for record in records])
    notes = [f"{count} resets" for count in held.sum(axis=0)]
    options = {"sharex": True, "height_ratios": (2.2, 1)}
    with drawing(path, 2, 1, (8.6, 4.8), **options) as (figure, both):
        draw_resets(both, columns, motion, [(held, FAMILIES["PBI"])], notes)
        figure.suptitle(
            f"Bands that {method} starts anew under {result.environment}; it changes them in all other frames",
            fontsize=11,
        )


def terms_figure(path: Path, result: Replay, columns: AnyColumns, methods: Sequence[str]) -> None:
    """Which bands the terms of a rotating frame go to."""
    names = columns.band_names
    with drawing(path, 1, 1, (8.6, 3.2)) as (figure, axes):
        width = 0.8 / len(methods)
        for k, name in enumerate(methods):
            at = np.arange(len(names)) + (k - (len(methods) - 1) / 2) * width
            bars = axes.bar(at, result.terms[name], width * 0.92, color=colour_of(name), label=name)
            axes.bar_label(bars, fmt="%.1f", fontsize=8, padding=1)
        axes.set_xticks(range(len(names)), names)
        axes.set(xlabel=f"{columns.band_label}, coarse to fine", ylabel="Terms a frame")
        axes.grid(False, axis="x")
        axes.margins(y=0.12)
        figure.suptitle(f"Where the terms go while rotating under {result.environment}", fontsize=11)
        figure.legend(loc="outside right center")


def bytes_figure(path: Path, points: Sequence[Point]) -> None:
    """Error against bytes: truncation from coarse to nothing, under the rotated lights and under one-texel suns."""
    curve, own = points[:-1], points[-1]
    megabytes = np.array([point.megabytes for point in curve])
    colours = ("#0072B2", "#009E73", "#56B4E9", "#F0E442")
    with drawing(path, 1, 1, (8.6, 4.8)) as (figure, axes):
        series = [(name, [p.errors[name] for p in points], f"{name}, rotated (mean)", "o-") for name in own.errors]
        series += [
            ("sun", [p.sun_mean for p in points], "one-texel sun (mean)", "s--"),
            ("sun", [p.sun_worst for p in points], "one-texel sun (worst)", "^:"),
        ]
        for k, (_, errors, label, style) in enumerate(series):
            colour = colours[k % len(colours)] if k < len(own.errors) else "#D55E00"
            values = 100 * np.array(errors)
            shown = values[:-1] > 0
            axes.plot(megabytes[shown], values[:-1][shown], style, color=colour, label=label, markersize=4.5)
            axes.plot(
                [own.megabytes],
                values[-1:],
                "*",
                color=colour,
                markersize=13,
                markeredgecolor="black",
                markeredgewidth=0.7,
            )
        axes.axvline(curve[-1].megabytes, color="#888888", linewidth=1, linestyle=":", zorder=0)
        lossless = {"ha": "center", "va": "bottom", "fontsize": 9, "color": "#555555", "transform": across(axes)}
        axes.text(curve[-1].megabytes, 1.01, "lossless: no error", **lossless)
        axes.axvline(own.megabytes, color="#888888", linewidth=1, zorder=0)
        axes.text(
            own.megabytes,
            1.01,
            "this transport",
            ha="center",
            va="bottom",
            fontsize=9,
            color="#555555",
            transform=across(axes),
        )
        axes.set(
            xscale="log",
            yscale="log",
            xlabel="Size of M (MB), extrapolated from the audited rows",
            ylabel="Image: L2 error (%)",
        )
        percent(axes.xaxis)
        percent(axes.yaxis)
        figure.suptitle("Error against bytes: what truncation costs (stars: this transport as it is)", fontsize=11)
        figure.legend(loc="outside right center")
