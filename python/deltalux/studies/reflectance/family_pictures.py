"""What the study of families shows: errors along the parameter and against the number of functions, and these."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np

from ...brdf.family import Errors, Family
from ...pages.plotting import FAMILIES, logarithmic
from ..sheet import Sheet
from .family_findings import Found

__all__ = ["draw", "tell"]

_PAPER, _OURS = FAMILIES["NWA"], FAMILIES["PBI"]
_SIZE = (11.0, 6.0)


def draw(sheet: Sheet, found: Sequence[Found]) -> None:
    """All figures."""
    _along(sheet, found)
    _counts(sheet, found)
    _rms(sheet, found)
    _rms_counts(sheet, found)
    _functions(sheet, found)


def _along(sheet: Sheet, found: Sequence[Found]) -> None:
    caption = (
        "Errors along the parameter. The paper's seven functions (orange) and six of three segments (blue), of which "
        "the borders are marked; solid: the largest difference, relative to the peak; dashed: of the energy."
    )

    def panel(axes: Any, one: Found) -> None:
        for along, colour in zip(one.along, (_PAPER, _OURS), strict=True):
            axes.plot(one.gamma, _percent(off.peak for off in along), color=colour)
            axes.plot(one.gamma, _percent(off.energy for off in along), "--", color=colour)
        _mark(axes, one)

    _six(sheet, "along.png", caption, found, panel, "gamma", "Off by (%)", "xy")


def _counts(sheet: Sheet, found: Sequence[Found]) -> None:
    caption = (
        "Errors against live functions. The worst of parameters that no function was made of: the paper's (orange), "
        "the mean counted, and three segments (blue); solid: of the peak; dashed: of the energy."
    )

    def panel(axes: Any, one: Found) -> None:
        for families, colour in ((one.even, _PAPER), (one.cut, _OURS)):
            _lines(axes, families, lambda errors: 100 * errors.peak, "o-", colour)
            _lines(axes, families, lambda errors: 100 * errors.energy, "s--", colour)

    _six(sheet, "counts.png", caption, found, panel, "Live functions", "Off by at worst (%)", "y")


def _rms(sheet: Sheet, found: Sequence[Found]) -> None:
    caption = (
        "The paper's own measure. The RMS difference over delta along the parameter, of the mean and six functions "
        "(Fig. 5c; orange), and of six functions of three segments (blue); the line is what the paper says of Blinn "
        "and Phong's."
    )

    def panel(axes: Any, one: Found) -> None:
        for along, colour in zip(one.along, (_PAPER, _OURS), strict=True):
            axes.plot(one.gamma, [off.rms or np.nan for off in along], color=colour)
        if one.model == "blinn-phong":
            axes.axhline(1e-5, color="#000000", linewidth=1, linestyle=":")
        _mark(axes, one)

    _six(sheet, "rms.png", caption, found, panel, "gamma", "RMS (1 / sr)", "x", y_log=True)


def _rms_counts(sheet: Sheet, found: Sequence[Found]) -> None:
    caption = (
        "The paper's own measure against live functions. The RMS difference (Fig. 5a; solid) and its square (dashed), "
        "at the worst parameter: the paper's (orange), the mean counted, and three segments (blue)."
    )

    def panel(axes: Any, one: Found) -> None:
        for families, colour in ((one.even, _PAPER), (one.cut, _OURS)):
            _lines(axes, families, lambda errors: errors.rms, "o-", colour)
            _lines(axes, families, lambda errors: errors.rms**2, "s--", colour)

    _six(
        sheet, "rms-counts.png", caption, found, panel, "Live functions", "RMS (1 / sr), MSE (1 / sr²)", "", y_log=True
    )


def _functions(sheet: Sheet, found: Sequence[Found]) -> None:
    caption = (
        "The functions of delta. The paper's first seven, the mean darkest (Fig. 5b), each over its largest value; on "
        "delta's logarithm, where narrow lobes differ. Lafortune's begin at a cosine of 0.999, as there."
    )
    delta = np.geomspace(0.01, np.pi / 2, 400).clip(0, np.pi / 2)

    def panel(axes: Any, one: Found) -> None:
        values = one.papers.basis(one.papers.range[0], delta)
        for k, function in enumerate(values.T):
            shade = 0.75 * k / (values.shape[1] - 1)
            axes.plot(np.degrees(delta), function / np.abs(function).max(), color=(shade,) * 3, linewidth=1.2)

    _six(sheet, "functions.png", caption, found, panel, "delta (degrees)", "b", "x")


def tell(sheet: Sheet, found: Sequence[Found]) -> None:
    """The two families of each model in figures."""
    sheet.heading("The paper's seven functions beside six of three segments: the worst parameters held out")
    lines = []
    for one in found:
        low, high = one.papers.range
        lines += [
            (name, *_measures(family.errors))
            for name, family in (
                (f"{one.model} {low:g} to {high:g}, 7 even", one.papers),
                (f"{one.model}, 6 of {one.ours.segments}", one.ours),
            )
        ]
    sheet.table(("Model", "Peak", "Energy", "RMS", "MSE"), lines)


def _measures(errors: Errors) -> list[str]:
    peak, energy, rms = errors
    return [f"{100 * peak:.2g} %", f"{100 * energy:.2g} %", f"{rms:.1e}", f"{rms**2:.1e}"]


def _six(
    sheet: Sheet,
    name: str,
    caption: str,
    found: Sequence[Found],
    panel: Callable[[Any, Found], None],
    across: str,
    up: str,
    logs: str,
    *,
    y_log: bool = False,
) -> None:
    """A panel for each model."""
    with sheet.plot(name, caption, 2, -(-len(found) // 2), _SIZE, squeeze=False) as (_, panels):
        for axes, one in zip(panels.flat, found, strict=False):
            panel(axes, one)
            axes.set_title(one.model)
            logarithmic(axes, logs)
            if y_log:
                axes.set_yscale("log")
        for axes in panels[-1]:
            axes.set_xlabel(across)
        for axes in panels[:, 0]:
            axes.set_ylabel(up)


def _lines(axes: Any, families: dict[int, Family], of: Callable[[Errors], float], style: str, colour: str) -> None:
    axes.plot(list(families), [of(family.errors) for family in families.values()], style, color=colour, markersize=4)


def _mark(axes: Any, one: Found) -> None:
    """The borders between segments."""
    for border in one.ours.borders[1:-1]:
        axes.axvline(border, color="#888888", linewidth=1)


def _percent(values: Iterable[float]) -> list[float]:
    """What is exact has no place on a logarithmic axis."""
    return [100 * value if value > 1e-9 else float("nan") for value in values]
