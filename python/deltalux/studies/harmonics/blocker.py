"""A light of 0, 20 and 40 degrees behind a blocker, at several orders of harmonics (Sloan 2005, "Quality of SH").

The slide shows a blocker whose shadow falls on a plane. It does not say whether its degrees are diameters; they are
taken as such, and 0 as one texel of the cubemap. The scene is made here and traced in both bases; beside the slide's
lights stands the chapter's own, an environment.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from textwrap import fill
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...camera import Camera
from ...columns import Haar, SphericalHarmonics
from ...io import to_display
from ...light import skies
from ...light.discs import disc
from ...light.environment import Environment
from ...pages.plotting import percent
from ...pages.verdict import Verdict
from ...precomputation.run import precompute
from ...progress import Progress
from ...relight.errors import relative_errors
from ...scene.builtin.shapes import Model, box, quad
from ...scene.scene import Scene
from ...sphere import face_directions
from ...transport.transport import Transport
from ..case import Case
from ..shape import Study
from ..sheet import Sheet

__all__ = ["STUDY"]

_ORDERS = (2, 3, 5, 8, 12, 20, 30)
_SIZES = (0, 20, 40)
_PLACE = (-50.0, 42.0)
"""Azimuth from -Z towards +X, and elevation, of the discs' middle: behind the blocker, to the left."""
_PICTURE = (144, 108)
_HAAR = Haar(64)
_HARMONICS = SphericalHarmonics(_ORDERS[-1])
_RIGHT = 0.05
"""A picture within this relative error is taken for right."""
_COLOURS = ("#D55E00", "#E69F00", "#0072B2", "#009E73")


class Shot(NamedTuple):
    """A picture of one light at one order, and what is wrong with it, relative to the exact one."""

    picture: NDArray[np.float32]
    error: float
    above: float
    """How much brighter its brightest 0.5 % of values are than the exact picture's, as a share of those."""
    below: float
    """How far its lowest value lies below zero, as a share of those."""


Shots = dict[tuple[str, int, bool], Shot]
"""By light, order and whether windowed."""


def run(case: Case, sheet: Sheet, progress: Progress) -> None:
    """Traces the scene in both bases, and lights it."""
    lights = {_name(size): _disc_light(size) for size in _SIZES} | {case.env.name: _same_flux(case.env)}
    with _traced(progress) as (haar, harmonic):
        exact = {name: haar.image(haar.multiply(haar.coefficients(light))) for name, light in lights.items()}
        shots = _shots(harmonic, lights, exact)
    progress(1, 1)

    _strip(sheet, exact, shots)
    _curves(sheet, list(lights), shots)
    sheet.text(
        "A disc's degrees are its diameter; 0 is one texel, about 1.4 degrees. All lights have the same flux, with "
        "which a disc shows the unshadowed ground in its own colour: one exposure fits all. Exact is Haar 64 with all "
        "its columns, of an M truncated to 0.1 %. A window tapers the degrees up to the order (Hanning)."
    )
    sheet.table(*_table(list(lights), shots))
    sheet.csv("blocker.csv", _rows(shots))
    sheet.claims(_claims(list(lights), shots))


def _name(size: float) -> str:
    return f"{size:g}\N{DEGREE SIGN}"


@contextmanager
def _traced(progress: Progress) -> Iterator[tuple[Transport, Transport]]:
    """The transport in Haar columns and in harmonics, for as long as it is looked at."""
    # The exact picture of a light of one texel shows every wavelet that is left out as a speckle in its shadow.
    options: dict[str, Any] = {"quality": "lossless", "tolerance": 0.001}
    with TemporaryDirectory(prefix="deltalux-", ignore_cleanup_errors=True) as folder:
        scene = _scene()
        yield (
            precompute(
                scene, Path(folder) / "haar", columns=_HAAR, progress=lambda k, n: progress(k, 2 * n), **options
            ),
            precompute(
                scene, Path(folder) / "sh", columns=_HARMONICS, progress=lambda k, n: progress(n + k, 2 * n), **options
            ),
        )


def _scene() -> Scene:
    """A wide ground, and a blocker that stands on it."""
    model = Model("blocker", {"ground": (0.75, 0.73, 0.70), "blocker": (0.45, 0.16, 0.10)})
    model.add("ground", quad((-20, 0, -20), (40, 0, 0), (0, 0, 40)))
    model.add("blocker", box((-0.4, 0.0, -0.04), (0.4, 1.2, 0.04)))
    width, height = _PICTURE
    camera = Camera((0.7, 2.5, 3.4), (0.38, 0.5, 0.3), vertical_fov=33.0, width=width, height=height)
    return Scene.from_content(model.content(camera))


def _disc_light(size: float) -> Environment:
    """A round light of this diameter in degrees; of one texel, if it is 0."""
    if size > 0:
        cover = disc(_PLACE, size / 2)
    else:
        cover = np.zeros((6, 64, 64), np.float32)
        cover.flat[np.argmax(face_directions(64) @ skies.toward(*np.radians(_PLACE)))] = 1
    return _same_flux(Environment.from_cubemap(np.repeat(cover[..., None], 3, axis=3)))


def _same_flux(env: Environment) -> Environment:
    """Scaled to the flux with which a disc shows the unshadowed ground in its own colour."""
    flux = np.sqrt(4 * np.pi) * float(SphericalHarmonics(1).coefficients(env).mean())
    return env.scaled(np.pi / np.sin(np.radians(_PLACE[1])) / flux) if flux > 0 else env


def _shots(harmonic: Transport, lights: dict[str, Environment], exact: dict[str, NDArray[np.float32]]) -> Shots:
    shots: Shots = {}
    for name, light in lights.items():
        V, bright = harmonic.coefficients(light), max(_bright(exact[name]), 1e-30)
        for order in _ORDERS:
            linear = np.where(_HARMONICS.bands[:, None] < order, V, 0.0)
            for windowed, c in ((False, linear), (True, _HARMONICS.windowed(V, order))):
                picture = harmonic.image(harmonic.multiply(c))
                above, below = _bright(picture) / bright - 1, -float(picture.min()) / bright
                error = relative_errors(picture, exact[name])[1]
                shots[name, order, windowed] = Shot(picture, error, max(above, 0.0), max(below, 0.0))
    return shots


def _bright(picture: NDArray[np.float32]) -> float:
    """What 0.5 % of the values exceed: ringing, but not a speckle."""
    return float(np.quantile(picture, 0.995))


def _strip(sheet: Sheet, exact: dict[str, NDArray[np.float32]], shots: Shots) -> None:
    """Light sizes down, orders across, the exact picture last."""
    caption = (
        "Lights behind a blocker. Sizes down, each without and with a window; orders of harmonics across, with their "
        "terms; the exact picture last. In the corner the relative L2 error."
    )
    lines = [(name, windowed) for name in exact for windowed in (False, True)]
    size = (1.5 * (len(_ORDERS) + 1) + 0.4, (1.5 * _PICTURE[1] / _PICTURE[0] + 0.04) * len(lines) + 0.5)
    corner: dict[str, Any] = {"color": "white", "fontsize": 6, "bbox": {"color": "#202020", "pad": 1, "linewidth": 0}}
    with sheet.plot("blocker.png", caption, len(lines), len(_ORDERS) + 1, size) as (_, axes):
        for line, (name, windowed) in zip(axes, lines, strict=True):
            pictures = [shots[name, order, windowed].picture for order in _ORDERS]
            for panel, picture in zip(line, [*pictures, exact[name]], strict=True):
                panel.imshow(to_display(picture), interpolation="nearest")
                panel.set_axis_off()
            for panel, order in zip(line[:-1], _ORDERS, strict=True):
                text = f"{100 * shots[name, order, windowed].error:.2g} %"
                panel.text(0.97, 0.04, text, ha="right", transform=panel.transAxes, **corner)
            label = fill(name, 14) + ("\nwindow" if windowed else "")
            place = {"rotation": 90, "va": "center", "ha": "right", "transform": line[0].transAxes}
            line[0].text(-0.04, 0.5, label, fontsize=8, **place)
        for panel, title in zip(axes[0], [*(f"order {n}\n{n * n} terms" for n in _ORDERS), "exact"], strict=True):
            panel.set_title(title, fontsize=9)


def _curves(sheet: Sheet, names: list[str], shots: Shots) -> None:
    caption = "Error and ringing against order. Ringing: how much too bright the brightest 0.5 % are."
    with sheet.plot("blocker-orders.png", caption, 1, 2, (10.4, 4.2)) as (figure, axes):
        for name, colour in zip(names, _COLOURS, strict=True):
            for windowed, style in ((False, "-"), (True, "--")):
                of = [shots[name, order, windowed] for order in _ORDERS]
                label = f"{name}, window" if windowed else name
                axes[0].plot(_ORDERS, [100 * shot.error for shot in of], style, marker="o", color=colour, label=label)
                axes[1].plot(_ORDERS, [100 * shot.above for shot in of], style, marker="o", color=colour)
        axes[0].set(yscale="log", ylabel="Image: L2 error (%)")
        axes[0].axhline(100 * _RIGHT, color="#888888", linewidth=1, linestyle=":")
        percent(axes[0].yaxis)
        axes[1].set(ylabel="Too bright (%)")
        for panel in axes:
            panel.set(xscale="log", xlabel="Order n (n² terms)")
            panel.set_xticks(_ORDERS, [str(order) for order in _ORDERS])
            panel.minorticks_off()
        figure.legend(loc="outside right center")


def _table(names: list[str], shots: Shots) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    lines = [
        (f"{name}, window" if windowed else name, *(f"{100 * shots[name, n, windowed].error:.3g} %" for n in _ORDERS))
        for name in names
        for windowed in (False, True)
    ]
    return ("Light", *(f"order {order}" for order in _ORDERS)), lines


def _rows(shots: Shots) -> list[dict[str, Any]]:
    return [
        {
            "light": name,
            "order": order,
            "terms": order**2,
            "windowed": windowed,
            "image_l2": f"{shot.error:.6g}",
            "above": f"{shot.above:.6g}",
            "below": f"{shot.below:.6g}",
        }
        for (name, order, windowed), shot in shots.items()
    ]


def _claims(names: list[str], shots: Shots) -> list[Verdict]:
    point, middle, large, own = names
    needed = {name: _least_order(name, shots) for name in names}
    said = {name: f"order {order}" if np.isfinite(order) else f"beyond {_ORDERS[-1]}" for name, order in needed.items()}
    return [
        Verdict(
            "The smaller the light behind the blocker, the higher the order that its shadow needs.",
            needed[point] > needed[middle] > needed[large],
            f"least order within {100 * _RIGHT:g} %: {', '.join(f'{name} {order}' for name, order in said.items())}",
            "A shadow is as sharp as its light is small. An environment is a sum of both: its large part needs few "
            "orders, and its lamps many.",
        ),
        Verdict(
            "Point lights do not work well in harmonics, large area lights do.",
            shots[large, 8, False].error <= _RIGHT < shots[point, _ORDERS[-1], False].error,
            f"{large} at order 8: {100 * shots[large, 8, False].error:.2g} %; {point} at order 8: "
            f"{100 * shots[point, 8, False].error:.2g} %, at order {_ORDERS[-1]}: "
            f"{100 * shots[point, _ORDERS[-1], False].error:.2g} %",
            "A point's coefficients do not fall with the degree, so that every order leaves out as much again.",
        ),
        _ringing(point, large, shots),
    ]


def _least_order(name: str, shots: Shots) -> float:
    return next((order for order in _ORDERS if shots[name, order, False].error <= _RIGHT), float("inf"))


def _ringing(point: str, large: str, shots: Shots) -> Verdict:
    """Judged at order 8, in the middle of those shown."""
    small, wide, soft = shots[point, 8, False], shots[large, 8, False], shots[point, 8, True]
    return Verdict(
        "Small lights ring: bright rims round the shadow; a window takes them away and blurs.",
        small.above > wide.above and soft.above < 0.25 * small.above and soft.error > small.error,
        f"too bright at order 8: {point} {100 * small.above:.2g} %, {large} {100 * wide.above:.2g} %, {point} windowed "
        f"{100 * soft.above:.2g} %; error of {point} {100 * small.error:.2g} %, windowed {100 * soft.error:.2g} %",
        "Cut off sharply, a sum of harmonics overshoots beside every edge (Gibbs). Tapered it does not, but its last "
        "degrees are then all but wasted: by the error a plain cut is better.",
    )


STUDY = Study(
    title="Lights behind a blocker",
    intro="The slides' test of spherical harmonics: one texel, a disc of 20 and a disc of 40 degrees throw the shadow "
    "of an upright blocker on the ground, at orders 2 to 30 (4 to 900 terms), against the exact picture. The scene and "
    "the discs are the study's own; the environment given is one more light.",
    run=run,
    light_files=("blocker.png", "blocker-orders.png", "blocker.csv"),
)
