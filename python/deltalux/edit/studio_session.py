"""A session in a studio: materials edited and lamps moved, with pictures and the time of each frame.

A file is JSON, a list of steps:

    {"title": "for people", "lights": [{"kind": "spot", "position": [0, 2, 0], "target": [0, 0, 0], "intensity": 8}]}
    {"lights": [{"kind": "spot", "position": [1, 2, 0], "target": [0, 0, 0], "intensity": 8}], "frames": 12}
    {"material": "floor", "set": {"gamma": 100, "k_s": 0.5}, "frames": 5}

"lights" are "point", "spot" and "area", with the attributes of `PointLight`, `Spot` and `AreaLight`; "material" is the
one that is edited from then on, and "set" what `Studio.set` takes, the path of a picture as well as numbers. Over so
many "frames" numbers move evenly from what they were to what they become: of lights where there are as many of the same
kinds, and of a material.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from ..io import auto_exposure, save_image, to_display
from ..light.lamps import AreaLight, Lamp, PointLight, Spot
from ..output import claim, write_csv
from ..pages.page import Page, figure, table
from ..pages.plotting import drawing, logarithmic
from ..progress import SILENT, Reporter
from .laid import Laid
from .session import read_each
from .studio import Studio, StudioFrame

__all__ = ["Step", "play_studio", "read_studio_session"]

_KINDS: dict[str, type[Lamp]] = {"point": PointLight, "spot": Spot, "area": AreaLight}
_MOST_FRAMES, _SETTLING = 1000, 200
_FRAMES, _PAGE, _TIMES = "frames.csv", "index.html", "times.png"


@dataclass(frozen=True)
class Step:
    """One step.

    Attributes
    ----------
    title
        What it does, in words.
    lights
        The lamps at its end; None: they stand.
    material
        That is edited from here on; empty: the one that was.
    changes
        As for `Studio.set`.
    frames
        How many it takes.
    """

    title: str
    lights: tuple[Lamp, ...] | None = None
    material: str = ""
    changes: Mapping[str, Any] | None = None
    frames: int = 1


def read_studio_session(path: str | os.PathLike[str]) -> list[Step]:
    """Steps from a file.

    Parameters
    ----------
    path
        JSON, as above.

    Returns
    -------
    list of Step

    Raises
    ------
    ValueError
        If it is something else, or its first step has no lights.
    OSError
        If it cannot be read.
    """
    steps = read_each(path, "steps", _step)
    if not steps or steps[0].lights is None:
        what = "the first one has lights: without them all is black"
        raise ValueError(f"{os.fspath(path)}: expected a list of steps: {what}")
    return steps


def _step(number: int, own: Mapping[str, Any]) -> Step:
    unknown = set(own) - {"title", "lights", "material", "set", "frames"}
    if unknown or not ("lights" in own or "material" in own) or ("set" in own and "material" not in own):
        raise ValueError(f'step {number} has "lights", or "material" and "set", got {sorted(own)}')
    frames = own.get("frames", 1)
    if isinstance(frames, bool) or not isinstance(frames, int) or not 1 <= frames <= _MOST_FRAMES:
        raise ValueError(f"step {number} takes 1 to {_MOST_FRAMES} frames, got {frames!r}")
    lights = tuple(_lamp(number, lamp) for lamp in own["lights"]) if "lights" in own else None
    title, material = str(own.get("title", f"step {number + 1}")), str(own.get("material", ""))
    return Step(title, lights, material, dict(own.get("set", {})), frames)


def _lamp(number: int, own: Mapping[str, Any]) -> Lamp:
    given = dict(own)
    kind = given.pop("kind", None)
    if kind not in _KINDS:
        raise ValueError(f'a light of step {number} has a "kind" of {", ".join(_KINDS)}, got {kind!r}')
    return _KINDS[kind](**given)


def play_studio(
    studio: Studio,
    steps: Sequence[Step],
    folder: str | os.PathLike[str],
    title: str,
    tell: Reporter = SILENT,
) -> Path:
    """Plays steps, and leaves pictures, times and a page.

    Parameters
    ----------
    studio
        Without lights yet.
    steps
        In their order. Each ends when all light has been sent, at most 200 frames after its last move.
    folder
        Made where there is none; only files of ours are overwritten.
    title
        Of the page.
    tell
        Is told of each step.

    Returns
    -------
    Path
        The page, index.html.

    Raises
    ------
    ValueError
        If a step cannot be made.
    OSError
        If the disk refuses.
    """
    pictures = [f"step-{number:02}.png" for number in range(len(steps))]
    path = claim(folder, [_PAGE, _FRAMES, _TIMES, *pictures])
    exposure: float | None = None
    lights: tuple[Lamp, ...] = ()
    rows: list[dict[str, Any]] = []
    summary: list[list[str]] = []
    for number, step in enumerate(steps):
        tell.begin(step.title)
        frames = list(_played(studio, step, lights))
        lights = lights if step.lights is None else step.lights
        picture = frames[-1].image
        exposure = auto_exposure(picture) if exposure is None else exposure
        save_image(path / pictures[number], to_display(picture, exposure))
        rows += [_row(number, k, frame) for k, frame in enumerate(frames)]
        times = 1e3 * np.array([frame.seconds for frame in frames])
        summary.append(
            [
                f"{number} {step.title}",
                str(len(frames)),
                f"{np.median(times):.2f} ms",
                f"{times.max():.2f} ms",
                f"{frames[-1].bound:.2g}",
                f"{100 * frames[-1].residual:.2f} %",
            ]
        )
        tell(number + 1, len(steps))
    write_csv(path / _FRAMES, rows)
    with drawing(path / _TIMES, 1, 1, (9.0, 4.2)) as (_, axes):
        axes.plot([row["milliseconds"] for row in rows], label="all")
        axes.plot([row["tracing"] for row in rows], label="of which rays")
        axes.set(xlabel="frame", ylabel="ms")
        logarithmic(axes)
        axes.legend()
    (path / _PAGE).write_text(str(_page(studio, title, steps, pictures, summary)), encoding="utf-8")
    return path / _PAGE


def _played(studio: Studio, step: Step, lights: Sequence[Lamp]) -> Iterator[StudioFrame]:
    """The frames of a step, until all light has been sent."""
    if step.material:
        studio.edit(step.material)
    before = vars(studio.looks[step.material]) if step.material else {}
    for k in range(1, step.frames + _SETTLING + 1):
        share = min(k / step.frames, 1.0)
        if step.changes:
            changes = {name: _between(before.get(name), value, share) for name, value in step.changes.items()}
            studio.set(step.material, **changes)
        if step.lights is not None:
            studio.set_lights(_moved(lights, step.lights, share))
        frame = studio.step()
        yield frame
        if share == 1 and frame.converged:
            return


def _moved(before: Sequence[Lamp], after: Sequence[Lamp], share: float) -> list[Lamp]:
    """Lamps on their way."""
    if share == 1 or [type(lamp) for lamp in before] != [type(lamp) for lamp in after]:
        return list(after)
    return [_on_its_way(old, new, share) for old, new in zip(before, after, strict=True)]


def _on_its_way(before: Lamp, after: Lamp, share: float) -> Lamp:
    at = {own.name: getattr(after, own.name) for own in fields(after)}  # type: ignore[arg-type]
    return replace(after, **{name: _between(getattr(before, name), value, share) for name, value in at.items()})  # type: ignore[type-var]


def _between(before: Any, after: Any, share: float) -> Any:
    """A number or some on their way, evenly; what has no start is there at once, as pictures are."""
    if before is None or isinstance(before, Laid) or isinstance(after, str) or share == 1:
        return after
    return ((1 - share) * np.asarray(before, np.float64) + share * np.asarray(after, np.float64)).tolist()


def _row(number: int, k: int, frame: StudioFrame) -> dict[str, Any]:
    return {
        "step": number,
        "frame": k,
        "milliseconds": 1e3 * frame.seconds,
        "tracing": 1e3 * frame.traced,
        "solving": 1e3 * frame.solved,
        "sending": 1e3 * frame.sent,
        "bound": frame.bound,
        "converged": frame.converged,
    }


def _page(
    studio: Studio, title: str, steps: Sequence[Step], pictures: Sequence[str], summary: Sequence[Sequence[str]]
) -> Page:
    page = Page(title)
    page.heading(title, 1)
    parts = "; ".join(str(part) for part in studio.transport.parts.values())
    page.text(f"{parts}. Method: {studio.method!r}. In memory at the end: {studio.memory.total / 1e6:.1f} MB.")
    page.add('<div class="gallery">')
    for number, (step, picture) in enumerate(zip(steps, pictures, strict=True)):
        page.add(figure(picture, f"{number} {step.title}", step.title, link=picture))
    page.add("</div>")
    page.heading("Each step")
    page.text("A frame's time is of all its work but for putting the picture together; the bound is the last one's.")
    page.add(table(["step", "frames", "median", "slowest", "bound", "residual"], summary))
    page.add(figure(_TIMES, "The time of each frame.", "times"))
    return page
