"""How all plots look (matplotlib without a display): a style, a palette, plain percentages, where light stops."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..columns.inner import AnyColumns
from ..light.motion import Motion

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = [
    "FAMILIES",
    "INK",
    "MARKERS",
    "across",
    "colour_of",
    "draw_resets",
    "drawing",
    "logarithmic",
    "mark_stop",
    "percent",
    "with_pictures",
]

# Okabe and Ito's colours, which colour-blind readers tell apart; shades run with the budget.
FAMILIES = {
    "NWA": "#D55E00",
    "BI": "#009E73",
    "PBI": "#0072B2",
    "PBI by transport": "#CC79A7",
    "own": "#E69F00",
    "exact": "#000000",
}
MARKERS = {"NWA": "o", "BI": "s", "PBI": "D", "PBI by transport": "^", "own": "X", "exact": "*"}
_STYLE: Any = {
    "font.family": "DejaVu Sans",
    "font.size": 10,
    "axes.titlesize": 11,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#e3e3e3",
    "legend.frameon": False,
    "figure.dpi": 110,
    "savefig.facecolor": "white",
}
_NOTHING = 1e-8
"""Of the largest value of a logarithmic axis."""
INK = "#767b82"
"""What is written around pictures, with nothing behind it: read on white and on black alike, about 4 to 1."""


@contextmanager
def drawing(
    path: Path, rows: int, columns: int, size: tuple[float, float], **options: Any
) -> Iterator[tuple[Figure, Any]]:
    """A figure that is saved at the end; it needs no display and leaves the caller's matplotlib as it is.

    Black on white, which a page turns over in the dark; around pictures, whose colours stay, readable on either.
    """
    import matplotlib
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    with matplotlib.rc_context(_STYLE):
        figure = Figure(figsize=size, layout="constrained")
        FigureCanvasAgg(figure)
        yield figure, figure.subplots(rows, columns, **options)
        shown = with_pictures(figure)
        if shown:
            _write_grey(figure)
        figure.savefig(path, dpi=110, facecolor="none" if shown else "white")


def with_pictures(figure: Figure) -> bool:
    """Whether a figure shows pictures, besides lines or alone."""
    return any(axes.images for axes in figure.axes)


def _write_grey(figure: Figure) -> None:
    """All that is black around pictures in the ink for either background."""
    from matplotlib.colors import same_color
    from matplotlib.text import Text

    for axes in figure.axes:
        axes.tick_params(color=INK, labelcolor=INK)
        for spine in axes.spines.values():
            spine.set_edgecolor(INK)
    for text in figure.findobj(Text):
        if isinstance(text, Text) and same_color(text.get_color(), "black"):
            text.set_color(INK)


def logarithmic(axes: Axes, which: str = "y") -> None:
    """Plain numbers along logarithmic axes, "x", "y" or "xy"; where nothing is above zero, an axis stays as it is."""
    for name in which:
        # Lines across the whole plot, such as the mark of the stop, are no data.
        own = [line for line in axes.lines if line.get_transform() == axes.transData]
        data = [np.asarray(getattr(line, f"get_{name}data")(), float) for line in own]
        positive = np.concatenate([values[values > 0] for values in data]) if data else np.zeros(0)
        if positive.size:
            axes.set(**{f"{name}scale": "log"})
            # What falls to nothing leaves the plot, before marks are too many to be drawn.
            if positive.min() < _NOTHING * positive.max():
                axes.set(**{f"{name}lim": (_NOTHING * positive.max(), None)})
            percent(getattr(axes, f"{name}axis"))


def percent(axis: Any) -> None:
    """Plain numbers on an axis that is logarithmic."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    low, high = axis.get_view_interval()
    few = high <= 1e4 * max(low, 1e-300)
    # Or the locator, short of room for marks between powers of ten, draws none at all.
    axis.set_major_locator(LogLocator(10, subs=(1, 2, 5) if few else (1,), numticks=99))
    axis.set_major_formatter(
        FuncFormatter(lambda value, _: np.format_float_positional(value, 6, trim="-", fractional=False))
    )
    axis.set_minor_formatter(NullFormatter())


def mark_stop(axes: Axes, motion: Motion) -> None:
    """A line where the light comes to rest."""
    axes.axvline(motion.stop, color="#888888", linewidth=1)
    axes.text(motion.stop, 1.01, "stop ", ha="right", va="bottom", color="#555555", fontsize=9, transform=across(axes))


def draw_resets(
    both: Sequence[Axes],
    columns: AnyColumns,
    motion: Motion,
    layers: Sequence[tuple[NDArray[np.bool_], str]],
    notes: Sequence[str],
) -> None:
    """Resets of every band over the rotation, and its angle below (Overbeck 2006, Fig. 6.4).

    Layers are rasters (frames, bands) with their colours; a note stands to the right of each band.
    """
    raster, profile = both
    bands = len(columns.band_names)
    for band in range(bands):
        raster.axhline(band, color="#bbbbbb", linewidth=1)
        for which, colour in layers:
            raster.vlines(np.flatnonzero(which[:, band]), band - 0.36, band + 0.36, color=colour, linewidth=1.8)
        raster.text(1.01, band, notes[band], transform=raster.get_yaxis_transform(), va="center", fontsize=8)
    raster.set_yticks(range(bands), columns.band_names)
    raster.set_ylim(bands - 0.4, -0.6)
    raster.set_ylabel(columns.band_label)
    raster.grid(False)
    profile.plot(motion.angles, color="#000000", linewidth=1.6)
    profile.set(xlabel="Frame", ylabel="Angle (degrees)", xlim=(0, len(motion.angles) - 1))
    for axes in both:
        axes.axvline(motion.stop, color="#888888", linewidth=1)


def colour_of(method: str) -> str:
    """The colour of a method by its name; those of one's own share one."""
    return FAMILIES.get(method.split("-")[0], FAMILIES["own"])


def across(axes: Axes) -> Any:
    """Data along x, the axes' own height along y."""
    return axes.get_xaxis_transform()
