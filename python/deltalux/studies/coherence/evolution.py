"""What the light applied looks like as the light turns, and the picture under it (Overbeck 2006, Figs. 5.1-6.3)."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..._core import haar_inverse
from ...io import auto_exposure, magnification, to_display
from ...light.motion import Motion
from ...pages.plotting import FAMILIES, logarithmic
from ...pages.verdict import Verdict
from ...progress import Progress
from ...relight.entrants import BI_30, EXACT, NWA_30, PBI_30
from ...relight.errors import relative_errors
from ...transport.transport import Transport
from ..case import Case, Light, follow, light_errors, lights
from ..pictures import CORNER, cross, window
from ..shape import Study
from ..sheet import Sheet
from .ghosts import cubemap_ghosts, image_ghosts

__all__ = ["STUDY"]

_ROWS = (
    NWA_30,
    EXACT,
    BI_30,
    PBI_30,
)
_HOLD = 300
"""Still frames: the papers look at frame 400."""
_AFTER = 25
_EVERY = 5
"""Pictures are measured in every fifth frame."""

Series = dict[str, dict[int, tuple[float, float]]]
"""For each method and frame: error, and ghosts."""
Pictures = dict[tuple[str, int], NDArray[np.float32]]


def run(case: Case, sheet: Sheet, progress: Progress) -> None:
    """Cubemaps and pictures at five moments, and ghosts in all frames."""
    motion = replace(case.motion, hold=max(case.motion.hold, _HOLD))
    frames, moments = lights(case.env, motion, case.columns), _moments(motion)
    light: Series = {row.name: {} for row in _ROWS}
    held: dict[tuple[str, int], Light] = {}
    image: Series = {row.name: {} for row in _ROWS}
    for j, row in enumerate(_ROWS):
        for k, moment in enumerate(follow(case.columns, row, frames)):
            progress(j * len(frames) + k, len(_ROWS) * len(frames))
            ghosts = cubemap_ghosts(case.columns, moment.values, frames[k])
            light[row.name][k] = light_errors(case.columns, moment.values, frames[k])[0], ghosts
            if k in moments or (case.transport is not None and k % _EVERY == 0):
                held[row.name, k] = moment.values
    progress(1, 1)

    cubemaps = {(row.name, k): _cubemap(case, held[row.name, k]) for row in _ROWS for k in moments}
    _strip(sheet, "cubemap.png", "The light applied, unfolded.", cubemaps, moments, {})
    details = {key: _details(cubemaps, key, moments) for key in cubemaps}
    _strip(sheet, "cubemap-details.png", _DETAILS, details, moments, {})
    _curves(sheet, "ghosts.png", "Light", light, motion)
    if case.transport is not None:
        images = {key: case.transport.image(case.transport.multiply(values)) for key, values in held.items()}
        image = {row.name: _measure(images, row.name) for row in _ROWS}
        _pictures(case.transport, sheet, images, image, moments)
        _curves(sheet, "image-ghosts.png", "Image", image, motion)
    sheet.text(
        "Ghosts: in every block of every band of a Haar pyramid, the detail energy that is shown beyond what the exact "
        "one has there, over the energy of all exact detail. What is blurred away is no ghost."
    )
    sheet.csv("evolution.csv", _table(light, image))
    sheet.claims(_claims(light, image, moments))


def _moments(motion: Motion) -> dict[int, str]:
    (slow, _), (fast, _), (stop, _), (last, _) = motion.moments
    named = {slow: "turning slowly", fast: "turning fastest", stop: "stopped"}
    return {**named, stop + _AFTER: f"{_AFTER} frames later", last: f"{last - stop} frames later"}


def _cubemap(case: Case, values: Light) -> NDArray[np.float32]:
    return np.asarray(cross(haar_inverse(case.columns.size, values).astype(np.float32), 0.0))


_DETAILS = (
    "Two details of the light. Left, around the brightest texel of the moment; right, where BI differs most from the "
    "exact light while it turns fastest."
)


def _details(cubemaps: Pictures, key: tuple[str, int], moments: dict[int, str]) -> NDArray[np.float32]:
    """Two windows side by side."""
    name, frame = key
    _, fast, *_ = moments
    exact, size = cubemaps[EXACT.name, frame], cubemaps[key].shape[0] // 6
    worst = np.abs(cubemaps[BI_30.name, fast] - cubemaps[EXACT.name, fast])
    gap = np.full((size, max(size // 16, 1), 3), np.inf, np.float32)
    return np.concatenate([window(cubemaps[key], exact, size), gap, window(cubemaps[key], worst, size)], axis=1)


def _strip(
    sheet: Sheet, kind: str, caption: str, shown: Pictures, moments: dict[int, str], errors: dict[Any, str]
) -> None:
    """Methods down, moments across, all with the exposure of the exact first."""
    height, width = next(iter(shown.values())).shape[:2]
    stops = auto_exposure(np.where(np.isfinite(first := shown[EXACT.name, next(iter(moments))]), first, 0))
    size = (2.3 * len(moments) + 0.5, (2.3 * height / width + 0.1) * len(_ROWS) + 0.5)
    with sheet.plot(kind, caption, len(_ROWS), len(moments), size) as (_, axes):
        for line, row in zip(axes, _ROWS, strict=True):
            for panel, frame in zip(line, moments, strict=True):
                panel.imshow(to_display(shown[row.name, frame], stops), interpolation="nearest")
                panel.set_axis_off()
                panel.text(0.02, 0.03, errors.get((row.name, frame), ""), transform=panel.transAxes, **CORNER)
                if row is _ROWS[0]:
                    panel.set_title(f"frame {frame}\n{moments[frame]}", fontsize=9)
            line[0].text(-0.03, 0.5, row.name, rotation=90, va="center", ha="right", transform=line[0].transAxes)


def _measure(images: Pictures, name: str) -> dict[int, tuple[float, float]]:
    frames = [k for method, k in images if method == name]
    pairs = {k: (images[name, k], images[EXACT.name, k]) for k in sorted(frames)}
    return {k: (relative_errors(shown, exact)[1], image_ghosts(shown, exact)) for k, (shown, exact) in pairs.items()}


def _pictures(transport: Transport, sheet: Sheet, images: Pictures, series: Series, moments: dict[int, str]) -> None:
    _, fast, *_ = moments
    others = {name: of for name, of in series.items() if name != EXACT.name}
    errors = {(name, k): f"{100 * of[k][0]:.2g} %" for name, of in others.items() for k in moments}
    caption = "The picture. Exact, and with thirty terms a frame; in the corner the relative L2 error."
    _strip(sheet, "image.png", caption, images, moments, errors)
    worst = np.abs(images[BI_30.name, fast] - images[EXACT.name, fast])
    size = max(min(worst.shape[:2]) // 2, 8)
    times = magnification(worst, auto_exposure(images[EXACT.name, fast]))
    gap = np.full((size, max(size // 16, 1), 3), np.inf, np.float32)
    details = {
        (name, k): np.concatenate(
            [window(shown, worst, size), gap, times * np.abs(window(shown - images[EXACT.name, k], worst, size))],
            axis=1,
        )
        for (name, k), shown in images.items()
        if k in moments
    }
    caption = (
        "A detail of the picture. Where BI differs most from the exact picture while the light turns fastest; beside "
        f"it, the difference times {times}."
    )
    _strip(sheet, "image-details.png", caption, details, moments, {})


def _curves(sheet: Sheet, kind: str, what: str, series: Series, motion: Motion) -> None:
    caption = f"{what}: ghosts against frame. Energy shown where the exact one has none; NWA has next to none, or none."
    last = motion.stop + 2 * _AFTER
    with sheet.plot(kind, caption, 1, 1, (8.6, 3.8)) as (figure, axes):
        for row in (row for row in _ROWS if row.name != EXACT.name):
            frames = [k for k in series[row.name] if 0 < k <= last]
            ghosts = np.array([100 * series[row.name][k][1] for k in frames])
            axes.plot(frames, np.where(ghosts > 0, ghosts, np.nan), color=FAMILIES[row.family], label=row.name)
        axes.axvline(motion.stop, color="#888888", linewidth=1)
        axes.set(xlabel="Frame", ylabel=f"{what}: ghosts (% of detail energy)", xlim=(0, last))
        logarithmic(axes)
        figure.legend(loc="outside right center")


def _table(light: Series, image: Series) -> list[dict[str, Any]]:
    """One line for every method and frame; pictures are measured in some."""
    rows = []
    for name, of in light.items():
        for k, (error, ghosts) in of.items():
            seen = image[name].get(k)
            rows.append(
                {
                    "method": name,
                    "frame": k,
                    "light_l1": f"{error:.6g}",
                    "light_ghosts": f"{ghosts:.6g}",
                    "image_l2": f"{seen[0]:.6g}" if seen else "",
                    "image_ghosts": f"{seen[1]:.6g}" if seen else "",
                }
            )
    return rows


def _claims(light: Series, image: Series, moments: dict[int, str]) -> list[Verdict]:
    _, fast, _, _, last = moments
    verdicts = [_ghosts_claim("light", light, [k for k in light[EXACT.name] if 0 < k <= fast * 2])]
    if image[EXACT.name]:
        verdicts.append(_ghosts_claim("picture", image, [k for k in image[EXACT.name] if 0 < k <= fast * 2]))
    nwa, bi, pbi = (100 * light[name][last][0] for name in (NWA_30.name, BI_30.name, PBI_30.name))
    verdicts.append(
        Verdict(
            "Long after the stop BI and PBI show the exact light, and NWA never does.",
            bool(max(bi, pbi) < 0.01 * nwa),
            f"error of the light in frame {last}: NWA {nwa:.3g} %, BI {bi:.3g} %, PBI {pbi:.3g} %",
            "What is sent stays: every still frame adds thirty terms.",
        )
    )
    return verdicts


def _ghosts_claim(what: str, series: Series, frames: list[int]) -> Verdict:
    mean = {name: 100 * float(np.mean([of[k][1] for k in frames])) for name, of in series.items()}
    holds = mean[PBI_30.name] < 0.5 * mean[BI_30.name]
    if holds:
        why = "Resets take out what BI leaves behind."
    elif what == "picture":
        why = "BI's ghosts live in the fine bands, which a diffuse scene averages away: few of them reach the picture."
    else:
        why = "At this speed few bands are ever worth a reset: PBI then does what BI does."
    return Verdict(
        f"While the light turns BI shows ghosts, and PBI few of them ({what}; C2, D8).",
        holds,
        ", ".join(f"{name} {value:.2g} %" for name, value in mean.items() if name != EXACT.name),
        why,
    )


STUDY = Study(
    title="The evolution of the light and of the picture",
    intro="The same turning light as NWA, BI and PBI show it with thirty terms a frame, beside the exact one: turning "
    "slowly, turning fastest, when it has stopped, and later, when those that follow have converged.",
    run=run,
    light_files=("cubemap.png", "cubemap-details.png", "ghosts.png", "evolution.csv"),
    scene_files=("image.png", "image-details.png", "image-ghosts.png"),
)
