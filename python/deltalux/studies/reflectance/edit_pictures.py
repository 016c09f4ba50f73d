"""Pictures of edits that are followed: the curve above the pearl, and errors against frames."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...brdf.curves import ANGLES
from ...io import auto_exposure
from ...pages.plotting import FAMILIES, logarithmic
from ...transport.curves import CurveTransport
from ..pictures import label, show
from ..sheet import Sheet
from .edit_findings import BUDGETS, Followed, entrants
from .edits import MODELS, SCRIPTS

__all__ = ["draw_errors", "draw_pearl"]

_SHOWN = (SCRIPTS[1], SCRIPTS[3])
"""A drag in its middle, and a step."""
_TIMES = {30: 100, 10: 10}
"""By terms, how much stronger differences are shown."""
_MODEL = next(iter(MODELS))

Found = Mapping[tuple[str, str], dict[str, Followed]]


def draw_errors(sheet: Sheet, found: Found) -> None:
    """The curve's largest error and the picture's, frame after frame."""
    caption = (
        f"Errors of the curve over its peak and of the picture, {_MODEL}. A grey line is where the curve comes to "
        "rest; solid: 30 terms a frame, weighed by area; dashed: 10; paler: unweighted."
    )
    with sheet.plot("errors.png", caption, 2, len(SCRIPTS), (3.2 * len(SCRIPTS), 6.0)) as (_, axes):
        for script, column in zip(SCRIPTS, axes.T, strict=True):
            own = found[script.title, _MODEL]
            for panel, measure in zip(column, ("peak", "picture"), strict=True):
                for budget in BUDGETS:
                    for row in entrants(*budget):
                        panel.plot(100 * own[row.name].errors[measure], **_line(row.family, *budget))
                panel.axvline(script.frames, color="#888888", linewidth=1)
                panel.set(xlabel="Frame", ylabel=f"{'Curve' if measure == 'peak' else 'Picture'} off by (%)")
                logarithmic(panel)
            column[0].set_title(script.title.replace(" in ", "\nin "), fontsize=9)
        axes[0, 0].legend(fontsize=8)


def _line(family: str, terms: int, weight: str) -> dict[str, Any]:
    usual = weight == "area"
    style = {"color": FAMILIES[family], "linestyle": "-" if terms == 30 else "--", "linewidth": 1.3}
    return {**style, "alpha": 1.0 if usual else 0.35, "label": f"{family}-{terms}" if usual else None}


def draw_pearl(sheet: Sheet, transport: CurveTransport, found: Found, terms: int) -> None:
    """The curve above the pearl, for NWA, BI and all of it, with what they are off (Fig. 4.1)."""
    ours, theirs = entrants(terms, "area")
    names, times = (theirs.name, ours.name, "exact"), _TIMES[terms]
    caption = (
        f"The curve above the pearl, {terms} terms a frame, {_MODEL}. Left three: {_SHOWN[0].title}, in the middle of "
        f"it; right three: {_SHOWN[1].title}, the first frame after it. In grey the curve asked for; below, what the "
        f"picture is off, {times} times (Fig. 4.1)."
    )
    with sheet.plot(f"pearl-{terms}.png", caption, 3, 2 * len(names), (13.0, 6.4)) as (_, axes):
        for number, script in enumerate(_SHOWN):
            own = {name: found[script.title, _MODEL][name] for name in names}
            columns = axes.T[number * len(names) :]
            for name, panels in zip(names, columns, strict=False):
                panels[0].set_title(name, fontsize=9)
                _column(panels, transport, own[name], own["exact"], (script.frames + 1) // 2, times, name)
        for panel, text in zip(axes[1:, 0], ("the pearl", f"{times} x difference"), strict=True):
            label(panel, text)


def _column(
    panels: Any, transport: CurveTransport, own: Followed, exact: Followed, frame: int, times: int, name: str
) -> None:
    """A method's curve, its picture, and how far that is off."""
    _curve(panels[0], own.curves[frame], exact.curves[frame], FAMILIES[name.split("-")[0]])
    picture, whole = _pearl(transport, own.values[frame]), _pearl(transport, exact.values[frame])
    stops = auto_exposure(whole)
    show(panels[1], picture, stops)
    off = f"{100 * own.errors['picture'][frame]:.2g} %" if own is not exact else None
    show(panels[2], times * np.abs(picture - whole), stops, off)


def _pearl(transport: CurveTransport, values: NDArray[np.float32]) -> NDArray[np.float32]:
    """The part of the picture that shows the first pearl, its lobe on all else."""
    part = transport.parts[_MODEL].transport
    shown = part.image(np.ones_like(values)).max(axis=2) > 0
    rows, columns = np.flatnonzero(shown.any(axis=1)), np.flatnonzero(shown.any(axis=0))
    picture = transport.base + part.image(values)
    return picture[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]


def _curve(panel: Any, curve: NDArray[np.float64], wanted: NDArray[np.float64], colour: str) -> None:
    def root(own: NDArray[np.float64]) -> NDArray[np.float64]:
        scaled: NDArray[np.float64] = np.sqrt(np.maximum(own, 0) / wanted.max())
        return scaled

    panel.plot(np.degrees(ANGLES), root(wanted), color="#bbbbbb", linewidth=3)
    panel.plot(np.degrees(ANGLES), root(curve), color=colour, linewidth=1.2)
    panel.set(xlim=(0, 45), ylim=(0, 1.05), xlabel="half angle / degrees", ylabel="root of the curve")
