"""The page of a report: one self-contained index.html, well-formed, readable in light and dark and on a phone."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from html import escape

__all__ = ["Page", "figure", "table"]

_STYLE = """
:root { color-scheme: light dark; --ink: #1c1e21; --soft: #5a6169; --paper: #fbfbfa; --line: #d9dcdf; --card: #fff;
        --good: #00674a; --bad: #a63d00; --link: #00589a; }
@media (prefers-color-scheme: dark) {
  :root { --ink: #e6e8ea; --soft: #a2aab2; --paper: #15171a; --line: #363b41; --card: #1d2024;
          --good: #4cc9a0; --bad: #ff9a5c; --link: #7cc0f5; } }
* { box-sizing: border-box; }
body { margin: 0 auto; padding: 1.5rem 1.25rem 4rem; max-width: 68rem; background: var(--paper); color: var(--ink);
       font: 16px/1.55 system-ui, "DejaVu Sans", sans-serif; }
h1 { font-size: 1.7rem; line-height: 1.25; margin: 0.5rem 0; }
h2 { font-size: 1.25rem; margin: 2.8rem 0 0.6rem; padding-top: 0.8rem; border-top: 1px solid var(--line); }
h3 { font-size: 1.02rem; margin: 1.8rem 0 0.4rem; }
p { max-width: 46rem; overflow-wrap: anywhere; }
a { color: var(--link); }
figure { margin: 1rem 0 1.6rem; }
figure img { display: block; max-width: 100%; height: auto; border: 1px solid var(--line);
             border-radius: 6px; }
figcaption { color: var(--soft); font-size: 0.9rem; margin-top: 0.45rem; max-width: 46rem; }
.scroll { overflow-x: auto; border: 1px solid var(--line); border-radius: 6px; background: var(--card);
          margin: 0.8rem 0; }
table { border-collapse: collapse; font-size: 0.86rem; width: 100%; font-variant-numeric: tabular-nums; }
th, td { padding: 0.38rem 0.7rem; text-align: right; white-space: nowrap; }
th { color: var(--soft); font-weight: 600; border-bottom: 1px solid var(--line); vertical-align: bottom; }
th:first-child, td:first-child { text-align: left; }
tr + tr td { border-top: 1px solid var(--line); }
.words td, .words th { text-align: left; white-space: normal; overflow-wrap: break-word; }
.holds { color: var(--good); font-weight: 600; } .fails { color: var(--bad); font-weight: 600; }
.open { color: var(--soft); font-weight: 600; }
td.holds, td.fails, td.open { white-space: nowrap; }
.gallery { display: grid; grid-template-columns: repeat(auto-fill, minmax(11rem, 1fr)); gap: 0.8rem; }
.plot img { background: #fff; }
@media (prefers-color-scheme: dark) { .plot img { filter: invert(0.88) hue-rotate(180deg); } }
@media (max-width: 30rem) {
  body { padding: 0.8rem 0.7rem 3rem; font-size: 15px; } h1 { font-size: 1.4rem; }
  table { font-size: 0.78rem; } th, td { padding: 0.3rem 0.4rem; }
  td.holds, td.fails, td.open { white-space: normal; } }
.gallery figure { margin: 0; } nav a { margin-right: 1.1rem; }
"""


@dataclass
class Page:
    """Pieces of well-formed HTML, in order."""

    title: str
    parts: list[str] = field(default_factory=list)

    def heading(self, text: str, level: int = 2, anchor: str | None = None) -> None:
        mark = f' id="{escape(anchor)}"' if anchor else ""
        self.parts.append(f"<h{level}{mark}>{escape(text)}</h{level}>")

    def text(self, text: str) -> None:
        self.parts.append(f"<p>{escape(text)}</p>")

    def add(self, html: str) -> None:
        self.parts.append(html)

    def __str__(self) -> str:
        return (
            '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8"/>\n'
            '<meta name="viewport" content="width=device-width, initial-scale=1"/>\n'
            f'<meta name="generator" content="deltalux"/>\n<title>{escape(self.title)}</title>\n'
            f"<style>{_STYLE}</style>\n</head>\n<body>\n" + "\n".join(self.parts) + "\n</body>\n</html>\n"
        )


def figure(source: str, caption: str, alt: str, link: str | None = None, *, plot: bool = False) -> str:
    """A picture with a caption; `link` is what a click opens. A plot, black on white, is turned over in the dark."""
    image = f'<img src="{escape(source)}" alt="{escape(alt)}" loading="lazy"/>'
    linked = f'<a href="{escape(link)}">{image}</a>' if link else image
    kind = ' class="plot"' if plot else ""
    return f"<figure{kind}>{linked}<figcaption>{caption}</figcaption></figure>"


def table(
    headings: Sequence[str],
    rows: Iterable[Sequence[str]],
    *,
    words: bool = False,
    marks: Mapping[str, str] | None = None,
) -> str:
    """A table of texts; `marks` gives the class of cells with a certain text."""
    marks = marks or {}
    head = "".join(f"<th>{escape(text)}</th>" for text in headings)
    body = "".join("<tr>" + "".join(_cell(text, marks.get(text)) for text in row) + "</tr>" for row in rows)
    kind = ' class="words"' if words else ""
    return f'<div class="scroll"><table{kind}><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></div>'


def _cell(text: str, mark: str | None) -> str:
    kind = f' class="{mark}"' if mark else ""
    return f"<td{kind}>{escape(text)}</td>"
