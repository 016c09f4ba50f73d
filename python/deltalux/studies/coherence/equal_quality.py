"""How many terms of NWA a method is worth: those with which NWA's error is the same (Overbeck 2006, Fig. 7.1)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...columns import Haar
from ...light.motion import Motion
from ...pages.plotting import logarithmic
from ...pages.verdict import Verdict
from ...progress import Progress
from ...relight.entrants import BI_30, PBI_30, PBI_100
from ...relight.errors import relative_errors
from ...transport.transport import Transport
from ..case import Case, Light, follow, light_errors, lights
from ..shape import Study
from ..sheet import Sheet

__all__ = ["STUDY", "nwa_light_errors", "terms_for"]

_ROWS = (
    BI_30,
    PBI_30,
    PBI_100,
)
_STYLES = {BI_30.name: ("#009E73", "-"), PBI_30.name: ("#0072B2", "-"), PBI_100.name: ("#56B4E9", "--")}
_AFTER = 5
"""Frames after the stop at which the papers look again."""
_IMAGES = 12
"""Turning frames whose pictures are compared."""


@dataclass(frozen=True)
class Curve:
    """NWA's error at numbers of terms, and each method's own, in one situation."""

    terms: NDArray[np.float64]
    nwa: NDArray[np.float64]
    others: dict[str, float]

    def worth(self, method: str) -> float:
        """The number of NWA's terms with which its error is the method's."""
        return terms_for(self.terms, self.nwa, self.others[method])


def terms_for(terms: NDArray[np.float64], errors: NDArray[np.float64], error: float) -> float:
    """Where a falling curve reaches an error, straight between points in logarithms; inf if it never does."""
    at = int(np.argmax(errors <= error))
    if errors[at] > error:
        return float("inf")
    if at == 0 or errors[at] <= 0:
        return float(terms[at])
    (x0, x1), (y0, y1) = np.log(terms[at - 1 : at + 1]), np.log(errors[at - 1 : at + 1])
    share = (np.log(error) - y0) / (y1 - y0)
    return float(np.exp(x0 + share * (x1 - x0)))


def nwa_light_errors(columns: Haar, light: Light) -> NDArray[np.float64]:
    """The area-weighted L1 error of NWA at 1, 2, ... terms: it takes the largest keys, and the rest is its error."""
    keys = np.sort(columns.areas * np.abs(light).sum(axis=1))
    left = np.cumsum(keys)[::-1]
    return np.asarray(np.append(left[1:], 0.0) / left[0])


def run(case: Case, sheet: Sheet, progress: Progress) -> None:
    """The light in every frame; with a scene, the picture in some."""
    frames = lights(case.env, case.motion, case.columns)
    turning, after = range(1, case.motion.stop + 1), min(case.motion.stop + _AFTER, len(frames) - 1)
    values: dict[str, list[Light]] = {}
    for k, row in enumerate(_ROWS):
        progress(k, len(_ROWS) + 2)
        values[row.name] = [moment.values for moment in follow(case.columns, row, frames)]
    progress(len(_ROWS), len(_ROWS) + 2)

    nwa = np.array([nwa_light_errors(case.columns, light) for light in frames])
    errors = {
        name: np.array([light_errors(case.columns, held, light)[0] for held, light in zip(own, frames, strict=True)])
        for name, own in values.items()
    }
    terms = np.arange(1.0, nwa.shape[1] + 1)
    moving = Curve(terms, nwa[turning].mean(axis=0), {name: float(own[turning].mean()) for name, own in errors.items()})
    stopped = Curve(terms, nwa[after], {name: float(own[after]) for name, own in errors.items()})
    worth = {
        name: np.array([terms_for(terms, curve, error) for curve, error in zip(nwa, own, strict=True)])
        for name, own in errors.items()
    }
    _draw_worth(case, sheet, worth)
    _draw_curves(sheet, "light-curves.png", "Light: area-weighted L1 error", moving, stopped)
    found = {"light": (moving, stopped)}
    if case.transport is not None:
        found["image"] = _images(case.transport, case.motion, frames, values, after)
        _draw_curves(sheet, "image-curves.png", "Image: L2 error", *found["image"])
    progress(1, 1)

    sheet.heading("Terms that NWA needs for the same error")
    lines = [
        (f"{what}, {when}", *(_terms(curve.worth(row.name)) for row in _ROWS))
        for what, curves in found.items()
        for when, curve in zip(("turning", f"{_AFTER} frames after the stop"), curves, strict=True)
    ]
    sheet.table(("Measured on the", *(row.name for row in _ROWS)), lines)
    sheet.csv("equal-quality.csv", _table(worth, errors))
    sheet.claims(_claims(found))


def _images(
    transport: Transport, motion: Motion, frames: Sequence[Light], values: dict[str, list[Light]], after: int
) -> tuple[Curve, Curve]:
    """The same by the picture: NWA at some budgets, in some frames."""
    grid = np.unique(np.geomspace(10, len(frames[0]), 16).round().astype(int))
    areas = transport.columns.areas

    def error(held: Light, exact: NDArray[np.float32]) -> float:
        return relative_errors(transport.image(transport.multiply(held)), exact)[1]

    def at(k: int) -> tuple[NDArray[np.float64], dict[str, float]]:
        exact = transport.image(transport.multiply(frames[k]))
        order = np.argsort(-areas * np.abs(frames[k]).sum(axis=1), kind="stable")
        nwa = []
        for terms in grid:
            kept = np.zeros_like(frames[k])
            kept[order[:terms]] = frames[k][order[:terms]]
            nwa.append(error(kept, exact))
        return np.array(nwa), {name: error(own[k], exact) for name, own in values.items()}

    some = [at(int(k)) for k in np.linspace(1, motion.stop, min(_IMAGES, motion.stop)).round()]
    mean = {name: float(np.mean([own[name] for _, own in some])) for name in values}
    moving = Curve(grid.astype(float), np.mean([nwa for nwa, _ in some], axis=0), mean)
    return moving, Curve(grid.astype(float), *at(after))


def _draw_worth(case: Case, sheet: Sheet, worth: dict[str, NDArray[np.float64]]) -> None:
    caption = (
        "Terms that NWA would need, frame by frame. For the error that each method has of the light (area-weighted "
        "L1); the first frames profit from an exact start."
    )
    with sheet.plot("worth.png", caption, 1, 1, (8.8, 4.2)) as (figure, axes):
        for name, terms in worth.items():
            colour, style = _STYLES[name]
            axes.plot(np.where(np.isfinite(terms), terms, np.nan), style, color=colour, label=name)
        for claimed in (100, 300):
            axes.axhline(claimed, color="#999999", linewidth=0.8, linestyle=":")
        axes.axvline(case.motion.stop, color="#888888", linewidth=1)
        axes.set(xlabel="Frame", ylabel="Terms of NWA", xlim=(0, len(case.motion.angles) - 1))
        logarithmic(axes)
        figure.legend(loc="outside right center")


def _draw_curves(sheet: Sheet, kind: str, what: str, moving: Curve, stopped: Curve) -> None:
    caption = f"{what} of NWA against its terms. Marks are where it meets the other methods."
    with sheet.plot(kind, caption, 1, 2, (10.0, 4.2), sharey=True) as (figure, both):
        for axes, curve, title in zip(
            both, (moving, stopped), ("turning (mean)", f"{_AFTER} frames after the stop"), strict=True
        ):
            shown = curve.nwa > 1e-5
            axes.plot(curve.terms[shown], 100 * curve.nwa[shown], color="#D55E00", label="NWA")
            for name, error in curve.others.items():
                worth, (colour, _) = curve.worth(name), _STYLES[name]
                axes.axhline(100 * error, color=colour, linewidth=1, linestyle=":")
                axes.plot([worth], [100 * error], "o", color=colour, label=name)
                axes.annotate(f"{_terms(worth)} ", (worth, 100 * error), color=colour, ha="right", va="top", fontsize=9)
            axes.set(xlabel="Terms of NWA", title=title)
            logarithmic(axes, "xy")
            axes.set_xlim(10, None)
        both[0].set_ylabel(f"{what} (%)")
        handles, labels = both[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside right center")


def _terms(worth: float) -> str:
    return f"{worth:,.0f}" if np.isfinite(worth) else "more than all"


def _table(worth: dict[str, NDArray[np.float64]], errors: dict[str, NDArray[np.float64]]) -> list[dict[str, Any]]:
    return [
        {"method": name, "frame": k, "light_l1": f"{errors[name][k]:.6g}", "nwa_terms": f"{terms:.6g}"}
        for name, own in worth.items()
        for k, terms in enumerate(own)
    ]


def _claims(found: dict[str, tuple[Curve, Curve]]) -> list[Verdict]:
    claims = (
        (f"While the light turns, {PBI_30} is worth about 100 terms of NWA.", 0, PBI_30.name, 100),
        (f"While the light turns, {PBI_100} is worth about 300 terms of NWA.", 0, PBI_100.name, 300),
        (f"Five frames after the stop, {PBI_30} is worth about 300 terms of NWA.", 1, PBI_30.name, 300),
    )
    return [_claim(found, *each) for each in claims]


def _claim(found: dict[str, tuple[Curve, Curve]], text: str, when: int, method: str, claimed: int) -> Verdict:
    """Judged by the picture where there is one, as the papers do; within a tenth."""
    worth = {what: curves[when].worth(method) for what, curves in found.items()}
    judged = worth.get("image", worth["light"])
    if judged >= 0.9 * claimed:
        why = "What is already there is not sent twice."
    elif when == 0:
        why = "This light changes in more terms a frame than the budget has: coherence saves less."
    else:
        why = "When this light stops, more is still amiss than five frames can mend."
    said = ", ".join(f"by the {what} {_terms(terms)}" for what, terms in worth.items())
    return Verdict(text, judged >= 0.9 * claimed, said, why)


STUDY = Study(
    title="Equal quality: what a term is worth",
    intro="NWA sends the largest terms of the light in every frame. How many would it need to be as near as BI and PBI "
    "are with 30 or 100? For the light the answer is exact: NWA's error at every budget follows from one sort.",
    run=run,
    light_files=("worth.png", "light-curves.png", "equal-quality.csv"),
    scene_files=("image-curves.png",),
)
