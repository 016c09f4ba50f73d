"""What the report writes of its measurements: the tables (CSV), the plots, and the page that shows them all."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from html import escape
from pathlib import Path
from typing import Any

import numpy as np

from ..light.motion import Motion
from ..output import write_csv
from ..pages.machine import machine
from ..pages.page import Page, figure, table
from ..pages.verdict import MARKS, summed
from ..relight.entrants import BI_30, NWA_30, PBI_30, Entrant
from ..relight.replay import Replay
from ..transport.transport import Transport
from .figures import bytes_figure, frames_figure, resets_figure, terms_figure, time_figure
from .size_curve import Point
from .verdicts import resets, verdicts

__all__ = ["Chapter", "write"]

Chapter = tuple[str, Replay, float, dict[tuple[str, int], str]]
"""Prefix of the files, measurements, exposure in stops, and the stems of the saved frames."""

# Overbeck 2006, section 6.3: six band images of 512 x 512 pixels and one copy of the light, in floats.
_PAPER_BYTES = 19_169_280


def write(
    path: Path,
    transport: Transport,
    motion: Motion,
    rows: Sequence[Entrant],
    chapters: Sequence[Chapter],
    points: Sequence[Point],
) -> None:
    """All files but the pictures; the page last, so that it never shows what is not there.

    The page begins with the light under which methods differ most.
    """
    chapters = sorted(chapters, key=lambda chapter: -_spread(chapter, motion))
    summaries = [_summary(result, motion, rows, transport) for _, result, _, _ in chapters]
    write_csv(path / "frames.csv", [line for _, result, _, _ in chapters for line in _frames(result, rows)])
    write_csv(path / "methods.csv", [line for summary in summaries for line in summary])
    for slug, result, _, _ in chapters:
        frames_figure(path / f"{slug}-error-against-frame.png", result, motion)
        time_figure(path / f"{slug}-error-against-time.png", result, motion, rows, 1)
        resets_figure(path / f"{slug}-resets.png", result, motion, transport.columns, PBI_30.name)
        terms_figure(path / f"{slug}-terms.png", result, transport.columns, (NWA_30.name, BI_30.name, PBI_30.name))
    if points:
        bytes_figure(path / "error-against-bytes.png", points)
        write_csv(path / "bytes.csv", [_point(point) for point in points])

    page = Page(f"deltalux: {transport.plan.scene}, {motion.rotate:g} degrees")
    _opening(page, transport, motion, chapters)
    for chapter, summary in zip(chapters, summaries, strict=True):
        _chapter(page, chapter, summary, motion)
    _size(page, transport, motion, points, chapters)
    _method(page, motion)
    (path / "index.html").write_text(str(page), encoding="utf-8")


def _frames(result: Replay, rows: Sequence[Entrant]) -> list[dict[str, Any]]:
    """One line for every method and frame."""
    lines = []
    for row in rows:
        for k, record in enumerate(result.records[row.name]):
            line = asdict(record)
            line["resets"] = " ".join(map(str, record.resets))
            for threads, seconds in result.seconds.items():
                total, choosing, multiplying = seconds[row.name][k]
                line[f"seconds_{threads}"] = f"{total:.6g}"
                line[f"choosing_{threads}"] = f"{choosing:.6g}"
                line[f"multiplying_{threads}"] = f"{multiplying:.6g}"
            lines.append(line)
    return lines


def _summary(result: Replay, motion: Motion, rows: Sequence[Entrant], transport: Transport) -> list[dict[str, Any]]:
    """One line for every method: errors, run times of rotating frames, and bytes."""
    turning = slice(1, motion.stop + 1)
    lines = []
    for row in rows:
        line: dict[str, Any] = {"environment": result.environment, "method": row.name, "terms": row.budget}
        for what in ("light_l1", "light_l2", "image_l1", "image_l2"):
            errors = result.column(row.name, what)
            line[f"{what}_mean"], line[f"{what}_end"] = float(errors[turning].mean()), float(errors[-1])
        line["image_worst"] = float(result.column(row.name, "image_worst")[turning].max())
        for threads, seconds in result.seconds.items():
            milliseconds = 1e3 * seconds[row.name]
            line[f"first_ms_{threads}"] = float(milliseconds[0, 0])
            for name, column in (("", 0), ("choosing_", 1), ("multiplying_", 2)):
                p50, p95 = np.percentile(milliseconds[turning, column], (50, 95))
                line[f"{name}p50_ms_{threads}"], line[f"{name}p95_ms_{threads}"] = float(p50), float(p95)
            line[f"max_ms_{threads}"] = float(milliseconds[1:, 0].max())
        line["columns_mean"] = float(result.column(row.name, "columns")[turning].mean())
        line["streamed_bytes_mean"] = float(result.column(row.name, "streamed_bytes")[turning].mean())
        line["relighter_bytes"], line["transport_bytes"] = result.relighter_bytes[row.name], transport.nbytes
        line["resets_per_band"] = " ".join(map(str, resets(result, row.name, slice(1, None))))
        lines.append(line)
    return lines


def _point(point: Point) -> dict[str, Any]:
    errors = {f"image_l2_{name}": error for name, error in point.errors.items()}
    return {
        "truncation": point.label,
        "tolerance": point.tolerance,
        "megabytes": point.megabytes,
        "extrapolated": point.extrapolated,
        **errors,
        "sun_l2_mean": point.sun_mean,
        "sun_l2_worst": point.sun_worst,
    }


def _spread(chapter: Chapter, motion: Motion) -> float:
    """How much methods of one budget differ under a light: the largest mean error of the picture less the least.

    Their ratio would prefer a light that all of them follow too closely to be told apart by eye.
    """
    turning = slice(1, motion.stop + 1)
    means = [chapter[1].column(row.name, "image_l2")[turning].mean() for row in (NWA_30, BI_30, PBI_30)]
    return float(max(means) - min(means))


def _opening(page: Page, transport: Transport, motion: Motion, chapters: Sequence[Chapter]) -> None:
    plan = transport.plan
    page.heading(f"Relighting {plan.scene}: error, run time and bytes", 1)
    names = ", ".join(result.environment for _, result, _, _ in chapters)
    rows, columns = transport.shape
    page.text(
        f"The light turns {motion}. Every method follows it over one precomputed transport of {rows:,} receivers "
        f"and {columns:,} columns ({transport.nbytes / 1e6:,.1f} MB), and is held against the exact product, frame by "
        f"frame. Light: {names}."
    )
    for _, result, _, _ in chapters:
        page.text(f"Under {result.environment}: {summed(verdicts(result, motion))}")
    links = "".join(f'<a href="#{slug}">{escape(result.environment)}</a>' for slug, result, _, _ in chapters)
    tables = '<a href="frames.csv">frames.csv</a><a href="methods.csv">methods.csv</a>'
    page.add(f'<nav>{links}<a href="#bytes">bytes</a><a href="#how">how it was measured</a>{tables}</nav>')


def _chapter(page: Page, chapter: Chapter, summary: list[dict[str, Any]], motion: Motion) -> None:
    slug, result, exposure, stems = chapter
    name = result.environment
    page.heading(f"Light: {name}", anchor=slug)
    page.add(
        figure(
            f"{slug}-animation.webp",
            "The exact product beside three methods with 30 terms a frame. NWA starts anew in every frame, BI only "
            "adds changes, PBI decides for every band of wavelets.",
            f"Animation of the exact product, {NWA_30}, {BI_30} and {PBI_30} under {name}",
        )
    )
    page.heading("What the papers claim, and what was found", 3)
    found = [(v.claim, v.word, " ".join((v.figures, v.why)).strip()) for v in verdicts(result, motion)]
    page.add(table(("Claim", "Here", "Figures"), found, words=True, marks=MARKS))
    page.text(
        "The papers make these claims for a map of many lights that turns by some 45 degrees in 100 frames. Under one "
        "lamp or sun that outshines the rest, and at higher speeds, they need not hold."
    )
    page.heading("Four moments", 3)
    page.add(
        figure(
            f"{slug}-strip.png",
            "Methods down, moments across; below each approximation its difference from the exact picture, made "
            "brighter by the factor at the left. The figure in a corner is the relative L2 error of the image "
            "(surfaces only).",
            f"Strip of methods at four moments under {name}",
        )
    )
    for kind, title, caption in _PLOTS:
        page.heading(title, 3)
        page.add(figure(f"{slug}-{kind}.png", escape(caption), f"{title} under {name}", plot=True))
    page.heading("All methods", 3)
    page.add(table(_HEADINGS, [_line(line) for line in summary]))
    still = result.still
    assert still is not None
    page.text(
        "Errors are means over the rotating frames; worst is the largest error of a pixel in any of them over the root "
        "mean square of the picture. Times are of rotating frames; max is over all frames but the first, which for "
        "methods that follow is a whole product. M read is what a frame streams of the transport, and state is what a "
        "follower holds beyond it. After the light has stood still until "
        f"{still.method} had all of it, the first frame of a new movement took {1e3 * still.restart_seconds:.2f} ms at "
        f"the highest speed (resets: {_bands(still.restart_resets)}) and {1e3 * still.jump_seconds:.2f} ms for a jump "
        f"by 90 degrees (resets: {_bands(still.jump_resets)}), with {still.threads} threads. A frame that sends "
        f"nothing took {1e3 * still.fixed_seconds:.2f} ms: no budget in milliseconds below it can be kept."
    )
    page.heading("Relit frames", 3)
    page.text(f"Each as PNG (exposure {exposure:+.2f} stops, sRGB, nothing else) and as EXR in linear radiance.")
    cards = [
        figure(
            f"{stem}.png",
            f'{escape(method)}, frame {frame}: <a href="{stem}.exr">EXR</a>',
            f"{method}, frame {frame}",
            f"{stem}.png",
        )
        for (method, frame), stem in stems.items()
    ]
    page.add(f'<div class="gallery">{"".join(cards)}</div>')


_PLOTS = (
    (
        "error-against-frame",
        "Error against frame",
        "Relative to the exact light and the exact image. The papers' measure of light is the sum over columns and "
        "colours of the wavelet's area times the absolute difference of orthonormal coefficients.",
    ),
    (
        "error-against-time",
        "Error against run time",
        "Every method at its budgets on one thread, in the state that a running program finds: caches cold, the light "
        "resampled, transformed and chosen from within the time shown.",
    ),
    ("resets", "Resets", "Vertical lines are frames in which a band starts anew; below, the angle of the light."),
    ("terms", "Terms per band", "How each method spends its thirty terms."),
)

_HEADINGS = (
    "Method", "light L1 %", "light L2 %", "image L1 %", "image L2 %", "worst %", "after hold L2 %",
    "1 thread p50 ms", "p95", "max", "choosing", "multiplying", "2 threads p50 ms", "p95", "max",
    "columns", "M read MB", "state MB",
)  # fmt: skip


def _line(line: dict[str, Any]) -> list[str]:
    """One method, in the order of `_HEADINGS`."""
    errors = ("light_l1_mean", "light_l2_mean", "image_l1_mean", "image_l2_mean", "image_worst", "image_l2_end")
    times = (
        "p50_ms_1",
        "p95_ms_1",
        "max_ms_1",
        "choosing_p50_ms_1",
        "multiplying_p50_ms_1",
        "p50_ms_2",
        "p95_ms_2",
        "max_ms_2",
    )
    return [
        line["method"],
        *(_percent(line[name]) for name in errors),
        *(f"{line[name]:.2f}" for name in times),
        f"{line['columns_mean']:,.0f}",
        f"{line['streamed_bytes_mean'] / 1e6:.2f}",
        f"{line['relighter_bytes'] / 1e6:.1f}",
    ]


def _percent(error: float) -> str:
    return "0" if error == 0 else f"{100 * error:.3g}"


def _bands(numbers: Sequence[int]) -> str:
    return f"bands {', '.join(map(str, numbers))}" if numbers else "none"


def _size(
    page: Page, transport: Transport, motion: Motion, points: Sequence[Point], chapters: Sequence[Chapter]
) -> None:
    page.heading("Bytes", anchor="bytes")
    rows, columns = transport.shape
    bands = int(transport.columns.bands[-1]) + 1
    state = chapters[0][1].relighter_bytes[PBI_30.name]
    pixels = transport.camera.width * transport.camera.height
    formula = bands * pixels * 12 + columns * 12
    page.text(
        f"M takes {transport.nbytes:,} bytes, its receivers {transport.receivers.nbytes:,}. A PBI follower holds "
        f"{state:,} bytes beyond M. The papers' recipe, one float image for every band and a copy of the light, takes "
        f"{formula:,} bytes for this picture ({_PAPER_BYTES:,} at 512 x 512 with six bands)."
    )
    page.text(f"Truncation, as the file states it: {_stated(transport)}.")
    if transport.errors:
        under = ", ".join(f"{name} {_percent(error)} %" for name, error in transport.errors.items())
        page.text(f"Measured when it was made, on the rows of its survey, the worst rotation: {under}.")
    if not points:
        page.text("This transport keeps no untruncated rows, so no curve of error against bytes can be drawn.")
        return
    page.add(
        figure(
            "error-against-bytes.png",
            "Truncation only, against the untruncated product: relative L2 error of the light that the audited rows "
            "reflect. Bytes are extrapolated from those rows, a sample of M, to all rows; the stars are this "
            "transport, with its true size and its error measured on the same rows. Wavelets alone: no peak of the "
            "light goes through texels, where there are any; their bytes are counted all the same.",
            "Error against bytes",
            plot=True,
        )
    )
    names = list(points[0].errors)
    headings = ("Truncation asked for", "MB", *(f"{name} %" for name in names), "one-texel sun, mean %", "worst %")
    lines = [
        (
            p.label,
            f"{p.megabytes:,.1f}",
            *(_percent(p.errors[name]) for name in names),
            _percent(p.sun_mean),
            _percent(p.sun_worst),
        )
        for p in points
    ]
    page.add(table(headings, lines))


def _stated(transport: Transport) -> str:
    notes = [note for note in transport.plan.notes if note.startswith("truncated")]
    return notes[-1] if notes else f"{100 * transport.plan.tolerance:g} %"


def _method(page: Page, motion: Motion) -> None:
    page.heading("How it was measured", anchor="how")
    page.text(
        "The reference of every frame is a fresh product of the whole light, and its light is the rotated environment "
        "on the grid of the products. The error of light is measured on orthonormal coefficients; L1 is weighted by "
        "the area of each wavelet. The angle follows t\N{SUPERSCRIPT TWO}(3 \N{MINUS SIGN} 2t). Run times come from "
        "passes of their own, in which the methods take turns; a neighbour on the machine shows in the 95th percentile "
        "and the maximum."
    )
    page.add(table(("Machine and run", ""), list(machine().items()), words=True))
