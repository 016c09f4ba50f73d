"""A session: edits one after the other, each followed until it is applied, with what every frame was off."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from ..io import auto_exposure, save_image, to_display
from ..output import claim, write_csv
from ..pages.page import Page, figure, table
from ..pages.plotting import drawing, logarithmic
from ..progress import SILENT, Reporter
from .editor import BrdfEditor

__all__ = ["Edit", "play", "read_each", "read_session"]

Item = TypeVar("Item")

_MOST_FRAMES = 200
_FRAMES, _PAGE, _CURVES, _ERRORS = "frames.csv", "index.html", "curves.png", "errors.png"


@dataclass(frozen=True)
class Edit:
    """One edit of a material.

    Attributes
    ----------
    title
        What it does, in words.
    material
        Its name; empty: nothing is edited.
    parameters
        As for `BrdfEditor.set`.
    curve
        Angles and values, as for `BrdfEditor.set_curve`; None: no curve is drawn.
    """

    title: str
    material: str = ""
    parameters: Mapping[str, Any] | None = None
    curve: tuple[Any, Any] | None = None

    def apply(self, editor: BrdfEditor) -> None:
        """Asks an editor for it."""
        if self.curve is not None:
            editor.set_curve(self.material, *self.curve)
        if self.parameters:
            editor.set(self.material, **self.parameters)


def read_session(path: str | os.PathLike[str]) -> list[Edit]:
    """Edits from a file.

    Parameters
    ----------
    path
        JSON: a list of objects with "material", and "set", an object of parameters, or "theta" and "values"; "title" is
        for people.

    Returns
    -------
    list of Edit

    Raises
    ------
    ValueError
        If it is something else.
    OSError
        If it cannot be read.
    """
    return read_each(path, "edits", _edit)


def read_each(path: str | os.PathLike[str], what: str, one: Callable[[int, Mapping[str, Any]], Item]) -> list[Item]:
    """What each object of a JSON list says, by `one`; ValueError where the file is something else."""
    try:
        found = json.loads(Path(path).read_text(encoding="utf-8"))
        return [one(number, own) for number, own in enumerate(found)]
    except (ValueError, TypeError, LookupError, RecursionError) as error:
        raise ValueError(f"{os.fspath(path)}: expected a list of {what}: {error}") from None


def _edit(number: int, own: Mapping[str, Any]) -> Edit:
    unknown = set(own) - {"title", "material", "set", "theta", "values"}
    if unknown or not ("set" in own or {"theta", "values"} <= set(own)):
        raise ValueError(f'edit {number} has "material", and "set" or "theta" and "values", got {sorted(own)}')
    curve = (own["theta"], own["values"]) if "theta" in own else None
    return Edit(str(own.get("title", f"edit {number + 1}")), str(own["material"]), own.get("set"), curve)


def play(
    editor: BrdfEditor,
    edits: Sequence[Edit],
    folder: str | os.PathLike[str],
    title: str,
    tell: Reporter = SILENT,
) -> Path:
    """Plays edits, and leaves pictures, curves, errors and a page.

    Parameters
    ----------
    editor
        As its transport was made.
    edits
        In their order; each is followed until it is applied, at most 200 frames.
    folder
        Made where there is none; only files of ours are overwritten.
    title
        Of the page.
    tell
        Is told of each edit.

    Returns
    -------
    Path
        The page, index.html.

    Raises
    ------
    ValueError
        If an edit cannot be made.
    OSError
        If the disk refuses.
    """
    edits = [Edit("as it was made"), *edits]
    pictures = [f"step-{number:02}.png" for number in range(len(edits))]
    path = claim(folder, [_PAGE, _FRAMES, _CURVES, _ERRORS, *pictures])
    exposure, rows, drawn, summary = 0.0, [], [], []
    for number, edit in enumerate(edits):
        tell.begin(edit.title)
        edit.apply(editor)
        frames = [editor.step()]
        while not frames[-1].converged and len(frames) < _MOST_FRAMES:
            frames.append(editor.step())
        whole = frames[-1].image
        if number == 0:
            exposure = auto_exposure(whole)
        size = float(np.linalg.norm(whole)) or 1.0
        errors = [float(np.linalg.norm(frame.image - whole)) / size for frame in frames]
        bounds = [frame.bound for frame in frames]
        save_image(path / pictures[number], to_display(whole, exposure))
        rows += [
            {
                "step": number,
                "frame": k,
                "columns": frame.columns,
                "milliseconds": 1e3 * frame.seconds,
                "error": error,
                "bound": bound,
                "residual": frame.residual,
            }
            for k, (frame, error, bound) in enumerate(zip(frames, errors, bounds, strict=True))
        ]
        drawn.append((edit, editor.curve(edit.material) if edit.material else None, errors))
        median = 1e3 * float(np.median([frame.seconds for frame in frames]))
        summary.append(
            [
                f"{number} {edit.title}",
                str(len(frames)),
                f"{100 * errors[0]:.2f} %",
                f"{median:.2f} ms",
                f"{bounds[-1]:.2g}",
                f"{100 * frames[-1].residual:.2f} %",
            ]
        )
        tell(number + 1, len(edits))
    write_csv(path / _FRAMES, rows)
    _draw(path, drawn)
    (path / _PAGE).write_text(str(_page(editor, title, edits, pictures, summary)), encoding="utf-8")
    return path / _PAGE


_Drawn = Sequence[tuple[Edit, tuple[NDArray[np.float64], NDArray[np.float64]] | None, list[float]]]


def _draw(path: Path, drawn: _Drawn) -> None:
    """The curve after each edit, and the error of the frames that follow it."""
    curves = [(number, edit, curve) for number, (edit, curve, _) in enumerate(drawn) if curve is not None]
    with drawing(path / _CURVES, 1, 1, (9.0, 4.2)) as (_, axes):
        for number, edit, (theta, values) in curves:
            axes.plot(np.degrees(theta), values.max(axis=1), label=f"{number} {edit.material}: {edit.title}")
        axes.set(xlabel="half angle / degrees", ylabel="curve, 1 / sr", ylim=(1e-4, None), yscale="log")
        if curves:
            axes.legend()
    with drawing(path / _ERRORS, 1, 1, (9.0, 4.2)) as (_, axes):
        for number, (edit, _, errors) in enumerate(drawn):
            if len(errors) > 1:
                axes.plot(range(len(errors)), 100 * np.array(errors), marker="o", label=f"{number} {edit.title}")
        axes.set(xlabel="frame after the edit", ylabel="error of the picture / %")
        logarithmic(axes)
        if axes.lines:
            axes.legend()


def _page(
    editor: BrdfEditor, title: str, edits: Sequence[Edit], pictures: Sequence[str], summary: Sequence[Sequence[str]]
) -> Page:
    page = Page(title)
    page.heading(title, 1)
    page.text("; ".join(str(part) for part in editor.transport.parts.values()) + f". Method: {editor.method!r}.")
    page.add('<div class="gallery">')
    for number, (edit, picture) in enumerate(zip(edits, pictures, strict=True)):
        page.add(figure(picture, f"{number} {edit.title}", edit.title, link=picture))
    page.add("</div>")
    page.heading("Each step")
    page.text(
        "The error is that of the first frame after the edit against the frame in which all of it is applied, in the "
        "norm of the picture; the bound is what the last frame guarantees, truncation and reflectance included."
    )
    page.add(table(["step", "frames", "first error", "time a frame", "bound", "residual"], summary))
    page.add(figure(_CURVES, "The curve of the edited material after each step.", "curves"))
    page.add(figure(_ERRORS, "How each edit is reached.", "errors"))
    return page
