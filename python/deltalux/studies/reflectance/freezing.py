"""Studios: what live and frozen transport cost, and lamps that move with few terms (Nguyen 2010, Fig. 6, table 5)."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from pathlib import Path

from ...io import auto_exposure
from ...pages.plotting import FAMILIES
from ...pages.verdict import Verdict
from ...progress import Progress
from ..case import Case
from ..pictures import show
from ..shape import Study
from ..sheet import Sheet
from . import carriers
from .freezing_findings import METHODS, SWEEPS, Findings, found_of

__all__ = ["STUDY"]

_HALF, _TENTH = 0.5, 0.1


def run(case: Case, sheet: Sheet, progress: Progress) -> None:
    """A studio in a directory that is gone afterwards: its table, its pictures, then lamps that sweep."""
    assert case.scene is not None
    with tempfile.TemporaryDirectory() as folder:
        findings = found_of(case.scene, Path(folder) / "a.studio", progress)
    _tell(sheet, findings)
    _draw(sheet, findings)
    _sweep(sheet, findings)
    _carry(sheet, findings)
    sheet.csv("freezing.csv", findings.table())
    sheet.claims(_claims(findings))


def _tell(sheet: Sheet, findings: Findings) -> None:
    sheet.heading("What is kept, and what moves (table 5, and what it does not say)")
    sheet.text(
        f"{findings.samples:,} gather samples, {findings.rows:,} rows of the view, two bounces; made in "
        f"{findings.seconds:.0f} s. The material that is edited is live, all functions of its family; all others are "
        "frozen."
    )
    lines = [
        (
            own.name,
            own.model,
            *(f"{size / 1e6:.2f}" for size in (own.memory.live, own.memory.frozen, own.memory.total)),
            f"{1e3 * own.freeze:.0f}",
            f"{1e3 * own.edit:.2f}",
            f"{1e3 * own.move_live:.1f}",
            f"{100 * own.frozen_error:.2g} %",
        )
        for own in findings.objects
    ]
    headings = [
        "Live",
        "Model",
        "Live, MB",
        "Frozen, MB",
        "All with D and M_s, MB",
        "Freezing, ms",
        "Edit of gamma, ms",
    ]
    sheet.table([*headings, "Move of a lamp, ms", "Frozen beside live, L1"], lines)
    sheet.text(
        f"D takes {findings.objects[0].memory.diffuse / 1e6:.2f} MB, M_s "
        f"{findings.objects[0].memory.bounces / 1e6:.2f} MB; with all frozen a lamp moves in "
        f"{1e3 * findings.move:.1f} ms."
    )


def _draw(sheet: Sheet, findings: Findings) -> None:
    stops = auto_exposure(findings.pictures[0][1])
    caption = "One material edited under a lamp that stands, and the lamp moved with all frozen (Fig. 6)."
    with sheet.plot("looks.png", caption, 1, len(findings.pictures), (11.0, 2.7)) as (_, axes):
        for panel, (title, picture) in zip(axes, findings.pictures, strict=True):
            panel.set_title(title, fontsize=9)
            show(panel, picture, stops)


def _sweep(sheet: Sheet, findings: Findings) -> None:
    sheet.heading("Lamps that move with few terms")
    sheet.text(
        "A spot sweeps through the scene in 24 frames; what D and T make of it is sent by so many terms a frame. "
        "Errors are of the picture's indirect light, L1 in the mean over frames, against all of it. Nobody has "
        "published this."
    )
    lines = [
        (f"{terms} terms", sweep, *(f"{100 * findings.errors[name, terms, sweep]:.3g} %" for name in METHODS))
        for terms in findings.terms
        for sweep in SWEEPS
    ]
    sheet.table(["Budget", "Sweep over", *METHODS], lines)
    caption = (
        "Error against the time of a frame, lamps traced included; the grey line is the time of the plain product."
    )
    with sheet.plot("sweep.png", caption, 1, len(SWEEPS), (11.0, 3.0)) as (_, axes):
        for panel, sweep in zip(axes, SWEEPS, strict=True):
            for name in METHODS:
                at = [(findings.times[name, terms], findings.errors[name, terms, sweep]) for terms in findings.terms]
                panel.plot(
                    [1e3 * seconds for seconds, _ in at],
                    [100 * max(error, 1e-6) for _, error in at],
                    "o-",
                    color=FAMILIES[name],
                    label=name,
                )
            panel.axvline(1e3 * findings.move, color="grey", linewidth=0.8)
            panel.set(title=f"{sweep}", xlabel="ms a frame", yscale="log")
        axes[0].set_ylabel("error, %")
        axes[0].legend(fontsize=7)


def _carry(sheet: Sheet, findings: Findings) -> None:
    sheet.heading("Nodes beside D")
    sheet.text(
        "Diffuse light that has bounced once, as nodes carry it to the view and as D does, which all above is made "
        f"with; against {carriers.SIDE**2:,} rays of some rows to what the lamp lights, L1. First under a lamp that "
        "shines evenly, then under one with a sharp cone. Nodes are what studios are made with unless asked otherwise."
    )
    lines = [
        (
            own.name,
            f"{own.nbytes / 1e6:.2f}",
            f"{own.seconds:.1f}",
            f"{1e3 * own.step:.2f}",
            " / ".join(f"{100 * error:.2g}" for error in own.errors.values()) + " %",
            " / ".join(f"{100 * total:+.2g}" for total in own.totals.values()) + " %",
        )
        for own in findings.ways
    ]
    headings = ["By", "MB", "Made in, s", "Move of a lamp but for its rays, ms", "Error", "Of all its light"]
    sheet.table(headings, lines)


def _claims(findings: Findings) -> Sequence[Verdict]:
    terms = findings.terms[0]
    ratios = {s: findings.errors["BI", terms, s] / max(findings.errors["NWA", terms, s], 1e-12) for s in SWEEPS}
    told = ", ".join(f"{sweep}: {ratio:.2g}" for sweep, ratio in ratios.items())
    slowest = ratios[next(iter(SWEEPS))]
    frozen = max(own.frozen_error for own in findings.objects)
    edit = max(own.edit for own in findings.objects)
    nodes, gathered = findings.ways[0], findings.ways[-1]
    off, other = (max(abs(total) for total in own.totals.values()) for own in (nodes, gathered))
    return [
        Verdict(
            "A frozen material looks as the live one (section 6).",
            frozen <= 2 * findings.tolerance,
            f"{100 * frozen:.2g} % beside a tolerance of {100 * findings.tolerance:g} %",
            "" if frozen <= 2 * findings.tolerance else "What truncation took of the sum is more than of its parts.",
        ),
        Verdict(
            "Edits of gamma take far less time than moves of a lamp (table 5 says them of neither).",
            edit <= 0.5 * findings.move,
            f"{1e3 * edit:.2f} ms beside {1e3 * findings.move:.1f} ms",
            "" if edit <= 0.5 * findings.move else "With so few rows both take what calling the parts takes.",
        ),
        Verdict(
            f"BI of {terms} terms leaves half of NWA's error or less at all speeds, a tenth at the slowest (our aim).",
            max(ratios.values()) <= _HALF and slowest <= _TENTH,
            told,
            ""
            if max(ratios.values()) <= _HALF and slowest <= _TENTH
            else "Few samples are few wavelets: the same terms are most of them.",
        ),
        Verdict(
            "Nodes lose less light than D, in less time (our aim).",
            off <= other and nodes.step <= gathered.step,
            f"{100 * off:.2g} % beside {100 * other:.2g} %, {1e3 * nodes.step:.2f} ms beside {1e3 * gathered.step:.2f}",
            "" if off <= other and nodes.step <= gathered.step else "D of few samples and rows is a small matrix.",
        ),
    ]


STUDY = Study(
    title="Studios: live and frozen transport, and lamps that move",
    intro="Materials are edited one at a time: the transport of all functions of its family is live, that of the "
    "others frozen into one matrix each. Lamps move; their light is gathered from samples of the surfaces, over a tree "
    "of them.",
    run=run,
    scene_files=("looks.png", "sweep.png", "freezing.csv"),
    traces="studio-box",
)
