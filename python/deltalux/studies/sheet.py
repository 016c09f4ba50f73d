"""Where a study puts what it finds: files into one folder, and the page that shows them and ends with the claims."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from ..output import write_csv
from ..pages.machine import machine
from ..pages.page import Page, figure, table
from ..pages.plotting import drawing, with_pictures
from ..pages.verdict import MARKS, Verdict, summed

__all__ = ["Sheet"]

PAGE = "index.html"
_OPENING = 2
"""Parts of a page before its first chapter."""


class Sheet:
    """The results of one study, chapter by chapter.

    Files get the chapter's name before their own. Only names that were claimed before the work began are written.
    """

    def __init__(self, folder: Path, title: str, intro: str, names: Sequence[str]) -> None:
        self._folder, self._names = folder, frozenset(names)
        self._page = Page(f"deltalux: {title}")
        self._page.heading(title, 1)
        self._page.text(intro)
        self._chapter = ""
        self._title = ""
        self._claims: list[tuple[str, Verdict]] = []

    def chapter(self, slug: str, title: str) -> None:
        """What follows is about this case."""
        self._chapter, self._title = slug, title
        self._page.heading(title, anchor=slug)

    def append(self, other: Sheet) -> None:
        """Takes over what a sheet of its own holds of another chapter."""
        self._page.parts += other._page.parts[_OPENING:]
        self._claims += other._claims

    def heading(self, text: str) -> None:
        self._page.heading(text, 3)

    def text(self, text: str) -> None:
        self._page.text(text)

    def _path(self, kind: str) -> Path:
        name = f"{self._chapter}-{kind}" if self._chapter else kind
        if name not in self._names:
            raise RuntimeError(f"{name} was not claimed for this study")
        return self._folder / name

    @contextmanager
    def plot(
        self, kind: str, caption: str, rows: int, columns: int, size: tuple[float, float], **options: Any
    ) -> Iterator[tuple[Any, Any]]:
        """A figure and its axes, saved as PNG and shown with its caption."""
        path = self._path(kind)
        with drawing(path, rows, columns, size, **options) as drawn:
            yield drawn
        alt = f"{caption.partition('.')[0]}: {self._title}"
        self._page.add(figure(path.name, caption, alt, path.name, plot=not with_pictures(drawn[0])))

    def csv(self, kind: str, rows: Sequence[Mapping[str, Any]]) -> None:
        """All figures, as a file with a link."""
        path = self._path(kind)
        write_csv(path, rows)
        self._page.add(f'<p>All figures: <a href="{path.name}">{path.name}</a></p>')

    def table(self, headings: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
        self._page.add(table(headings, rows))

    def claims(self, claims: Sequence[Verdict]) -> None:
        """What this chapter says of the papers' claims; all chapters' stand in one table at the end."""
        self._claims += [(self._title, claim) for claim in claims]

    def save(self) -> Path:
        """Writes the page, after all that it shows."""
        page = self._page
        page.heading("What the papers claim, and what was found", anchor="claims")
        page.text(summed(found for _, found in self._claims))
        rows = [(title, found.claim, found.figures, found.word, found.why) for title, found in self._claims]
        headings = ("Under", "The claim", "Our figure", "Here it", "In plain words")
        page.add(table(headings, rows, words=True, marks=MARKS))
        page.heading("Machine and run", anchor="how")
        page.add(table(("Machine and run", ""), list(machine().items()), words=True))
        path = self._folder / PAGE
        path.write_text(str(page), encoding="utf-8")
        return path
