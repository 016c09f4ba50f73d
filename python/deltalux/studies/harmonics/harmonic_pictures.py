"""The pictures of the study of spherical harmonics: strips with errors, and curves (Overbeck 2006, Figs. 8.2, 8.3)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from ..._core import haar_inverse
from ...columns import Haar
from ...io import auto_exposure, magnification
from ...light.motion import Motion
from ...pages.plotting import FAMILIES, mark_stop, percent
from ...relight.entrants import EXACT, NWA_100, PBI_100, Entrant
from ...transport.transport import Transport
from ...update.approximation import Approximation
from ...update.methods import Nonlinear
from ..case import Light
from ..pictures import cross, label, show
from ..sheet import Sheet
from .entrants import NWA_25, PBI_25_ON_SH, PBI_SH_25, SH_ORDER_5, SH_ORDER_10
from .flicker import Track
from .projection import HarmonicView

__all__ = ["Pictures", "bases_strip", "frames_plot", "moments_strip", "terms_plot"]

Pictures = dict[tuple[str, int], NDArray[np.float32]]
"""By method and frame."""


_COLOURS = FAMILIES | {"SH": "#CC79A7", "PBI-SH": "#E69F00"}
_STYLES = {SH_ORDER_5.name: ":", NWA_25.name: ":"} | dict.fromkeys(
    (SH_ORDER_10.name, PBI_25_ON_SH.name, NWA_100.name, PBI_100.name), "--"
)
_TITLES = {SH_ORDER_5.name: "SH-25 (order 5)", SH_ORDER_10.name: "SH-100 (order 10)"}


def bases_strip(
    sheet: Sheet, transport: Transport, view: HarmonicView, V: Light, pictures: Mapping[str, NDArray[np.float32]]
) -> None:
    """Fig. 8.3: 25 and 100 terms of both bases; what they lack, and the light they stand for."""
    names = (SH_ORDER_5.name, SH_ORDER_10.name, NWA_25.name, NWA_100.name, EXACT.name)
    lights = dict(zip(names, _applied(transport, view, V), strict=True))
    exact = pictures[EXACT.name]
    stops = auto_exposure(exact)
    times = magnification(np.stack([pictures[name] - exact for name in names[:-1]]), stops)
    caption = (
        "25 and 100 terms of each basis, while the light turns fastest. Relative L2 error in the corner; below, the "
        f"difference from the exact picture, {times} times, and the light that the terms stand for (negative light is "
        "black)."
    )
    faces = [cross(lights[name], np.inf) for name in names]
    light_stops = auto_exposure(np.where(np.isfinite(faces[-1]), faces[-1], 0))
    height, width = exact.shape[:2]
    tall = (height / width, height / width, 0.75)
    size = (11.0, 2.2 * sum(tall) + 0.5)
    with sheet.plot("bases.png", caption, 3, 5, size, height_ratios=tall) as (_, axes):
        for column, name, face in zip(axes.T, names, faces, strict=True):
            column[0].set_title(_TITLES.get(name, name))
            difference = np.abs(pictures[name] - exact)
            show(column[0], pictures[name], stops, None if name == EXACT.name else _error(difference, exact))
            show(column[1], times * difference, stops)
            show(column[2], face, light_stops)
        for panel, what in zip(axes[:, 0], ("picture", f"difference, × {times}", "light"), strict=True):
            label(panel, what)


def _applied(transport: Transport, view: HarmonicView, V: Light) -> list[NDArray[np.float32]]:
    """The light as 25 and 100 terms of each basis have it, and all of it, as cubemaps."""
    assert isinstance(transport.columns, Haar)
    c, found = view.light(V), []
    for order in (5, 10):
        found.append(view.wavelets(np.where(np.arange(len(c))[:, None] < order**2, c, 0.0)))
    for terms in (25, 100):
        chosen = Approximation(transport.columns, Nonlinear(terms))
        chosen.step(V)
        found.append(chosen.values)
    return [haar_inverse(transport.columns.size, values).astype(np.float32) for values in (*found, V)]


def moments_strip(sheet: Sheet, pictures: Pictures, tracks: Mapping[str, Track], moments: Mapping[int, str]) -> None:
    """Methods while the light turns fastest and at the end: the picture, and what it lacks."""
    names, (fast, *_) = list(tracks), moments
    stops = auto_exposure(pictures[EXACT.name, fast])
    differences = {key: pictures[key] - pictures[EXACT.name, key[1]] for key in pictures if key[1] in moments}
    times = magnification(np.stack([differences[name, fast] for name in names[1:]]), stops)
    caption = (
        f"Both bases at two moments. Beside each picture its difference from the exact one, {times} times; in the "
        "corner the relative L2 error and the flicker, the change of the error image since the frame before."
    )
    height, width = pictures[EXACT.name, fast].shape[:2]
    across = 2 * len(moments)
    size = (2.2 * across + 0.5, (2.2 * height / width + 0.06) * len(names) + 0.5)
    with sheet.plot("moments.png", caption, len(names), across, size) as (_, axes):
        for line, name in zip(axes, names, strict=True):
            for j, (frame, what) in enumerate(moments.items()):
                error, flicker = tracks[name].errors[frame], tracks[name].flicker[frame]
                corner = f"{100 * error:.2g} %" + (f", flicker {100 * flicker:.2g} %" if flicker > 0 else "")
                show(line[2 * j], pictures[name, frame], stops, corner if error > 0 else None)
                show(line[2 * j + 1], times * np.abs(differences[name, frame]), stops)
                if name == names[0]:
                    line[2 * j].set_title(f"frame {frame}, {what}", fontsize=9)
                    line[2 * j + 1].set_title(f"difference, × {times}", fontsize=9)
            label(line[0], name)


def frames_plot(sheet: Sheet, tracks: Mapping[str, Track], rows: Sequence[Entrant], motion: Motion) -> None:
    """Error, flicker and unrest against frame."""
    measures = {"errors": "Error (%)", "flicker": "Flicker (%)", "unrest": "Unrest (%)"}
    caption = "Error, flicker and unrest against frame. Relative to the exact picture; what they are stands below."
    with sheet.plot("frames.png", caption, 3, 1, (9.2, 9.0), sharex=True) as (figure, axes):
        for panel, (what, title) in zip(axes, measures.items(), strict=True):
            for row in rows:
                series = 100 * np.array(getattr(tracks[row.name], what))
                series[series <= 0] = np.nan
                width = 2.4 if row.name == PBI_SH_25.name else 1.4
                style = _STYLES.get(row.name, "-")
                panel.plot(series, style, linewidth=width, color=_COLOURS[row.family], label=row.name)
            panel.set(yscale="log", ylabel=title)
            percent(panel.yaxis)
            mark_stop(panel, motion)
        axes[-1].set(xlabel="Frame", xlim=(0, max(len(motion.angles) - 1, 1)))
        # In the hold most stand still, and what little moves would stretch the axis.
        for panel, what in zip(axes[1:], ("flicker", "unrest"), strict=True):
            moving = [100 * value for track in tracks.values() for value in getattr(track, what) if value > 1e-5]
            if moving:
                panel.set_ylim(0.7 * min(moving), 1.4 * max(moving))
        handles, labels = axes[2].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside right center")


def terms_plot(sheet: Sheet, curves: Mapping[str, Mapping[int, float]], tolerance: float) -> None:
    """Error against the number of terms, and how exact M itself is."""
    caption = "Error against terms. The mean over turning frames; an order n of harmonics has n² terms."
    looks = (("SH", "-", "o"), ("NWA", "-", "s"), ("NWA", "--", "^"))
    with sheet.plot("terms.png", caption, 1, 1, (7.2, 4.2)) as (_, axes):
        for (name, of), (family, style, marker) in zip(curves.items(), looks, strict=True):
            error = np.array([100 * value or np.nan for value in of.values()])
            axes.plot(list(of), error, style, marker=marker, markersize=5, color=_COLOURS[family], label=name)
        ticks = (4, 9, 25, 64, 100, 196, 400)
        axes.set(xscale="log", yscale="log", xlabel="Terms", ylabel="Image: L2 error (%)")
        axes.set_xticks(ticks, [str(tick) for tick in ticks])
        axes.minorticks_off()
        # Below a ten-thousandth of the largest error there is nothing to see.
        axes.set_ylim(bottom=max(axes.get_ylim()[0], 1e-4 * axes.get_ylim()[1]))
        if tolerance > 0:
            axes.axhline(100 * tolerance, color="#888888", linewidth=1, linestyle=":", label="truncation of M")
        percent(axes.yaxis)
        axes.legend()


def _error(difference: NDArray[np.float32], exact: NDArray[np.float32]) -> str:
    track = Track()
    track.add(exact + difference, exact)
    return f"{100 * track.errors[0]:.2g} %"
