"""Curves: BI against NWA where a highlight is edited, and where BI does not win (Overbeck 2006, Fig. 4.1)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from ...pages.verdict import Verdict
from ...progress import Progress
from ..case import Case
from ..shape import Study
from ..sheet import Sheet
from .edit_findings import BUDGETS, MEASURES, Followed, entrants, follow_edits
from .edit_pictures import draw_errors, draw_pearl
from .edits import LOCAL, MODELS, SCRIPTS, STILL
from .pearls import traced_pearls

__all__ = ["STUDY"]

_MOST = 9
"""Frames that the paper guarantees of 30 terms."""
_WORDS = {
    "peak": "the largest error of the curve over its peak",
    "energy": "the error of the curve's energy",
    "picture": "the error of what the pearl reflects",
}

Found = Mapping[tuple[str, str], dict[str, Followed]]
"""By script and model: what each method made of it."""


def run(case: Case, sheet: Sheet, progress: Progress) -> None:
    """Three pearls traced, then every script with every model under every budget."""
    rows = [row for budget in BUDGETS for row in entrants(*budget)]
    with traced_pearls(case.env, progress) as transport:
        found = {
            (script.title, name): follow_edits(part, script, rows)
            for script in SCRIPTS
            for name, part in transport.parts.items()
        }
        for terms in (30, 10):
            draw_pearl(sheet, transport, found, terms)
    draw_errors(sheet, found)
    for measure in MEASURES:
        _tell(sheet, found, measure)
    _tell_stops(sheet, found)
    _tell_losses(sheet, found)
    sheet.csv("curves.csv", _lines(found))
    sheet.claims(_claims(found))


class _Pair(NamedTuple):
    """One budget behind one script: BI and NWA."""

    script: str
    ours: Followed
    theirs: Followed

    def lost(self, measure: str) -> bool:
        """Whether NWA is as near, in the mean."""
        return self.theirs.mean(measure) <= self.ours.mean(measure)

    def lost_frames(self, measure: str) -> int:
        """Frames in which it is."""
        return int((self.ours.errors[measure] >= self.theirs.errors[measure])[1 : 1 + self.ours.moving].sum())


def _pairs(found: Found) -> list[_Pair]:
    named = [tuple(row.name for row in entrants(*budget)) for budget in BUDGETS]
    return [_Pair(script, own[bi], own[nwa]) for (script, _), own in found.items() for bi, nwa in named]


def _budget(terms: int, weight: str) -> str:
    return f"{terms} terms" + (", unweighted" if weight == "none" else "")


def _tell(sheet: Sheet, found: Found, measure: str) -> None:
    """One measure of all scripts and models, BI beside NWA."""
    sheet.heading(f"BI / NWA, {_WORDS[measure]}, %")
    if measure == MEASURES[0]:
        sheet.text(
            "In the mean of the frames in which the curve moves. Changes are weighed by area where nothing is said."
        )

    def cell(own: Mapping[str, Followed], terms: int, weight: str) -> str:
        ours, theirs = (own[row.name].mean(measure) for row in entrants(terms, weight))
        return f"{100 * ours:.2g} / {100 * theirs:.2g}" + (" (NWA)" if theirs <= ours else "")

    lines = [(script, model, *(cell(own, *budget) for budget in BUDGETS)) for (script, model), own in found.items()]
    sheet.table(("Edit", "Model", *(_budget(*budget) for budget in BUDGETS)), lines)


def _tell_stops(sheet: Sheet, found: Found) -> None:
    """How long until what stands still is applied in full."""
    sheet.heading("Standing still: frames of BI until all is applied, the last that moved included")
    sheet.text(f"Nothing is edited for {STILL} frames after each script. NWA stays as far off as it is.")

    def cell(own: Mapping[str, Followed], terms: int, weight: str) -> str:
        exact = own[entrants(terms, weight)[0].name].exact
        return str(exact) if exact is not None else f"more than {STILL}"

    lines = [(script, model, *(cell(own, *budget) for budget in BUDGETS)) for (script, model), own in found.items()]
    sheet.table(("Edit", "Model", *(_budget(*budget) for budget in BUDGETS)), lines)


def _tell_losses(sheet: Sheet, found: Found) -> None:
    """Where BI does not win, by each measure."""
    sheet.heading("Where BI does not win")
    pairs = _pairs(found)
    moving = sum(pair.ours.moving for pair in pairs)
    for measure in MEASURES:
        lost = [pair.script for pair in pairs if pair.lost(measure)]
        frames = sum(pair.lost_frames(measure) for pair in pairs)
        which = "; ".join(f"{script} ({lost.count(script)})" for script in dict.fromkeys(lost))
        sheet.text(
            f"By {_WORDS[measure]}: in {len(lost)} of {len(pairs)} means, and in {frames} of {moving} single frames. "
            + (f"The means: {which}." if lost else "")
        )


def _lines(found: Found) -> list[dict[str, str]]:
    return [
        {
            "edit": script,
            "model": model,
            "method": name,
            **{measure: f"{one.mean(measure):.5g}" for measure in MEASURES},
            "last": f"{one.errors['picture'][-1]:.5g}",
            "exact": "" if one.exact is None else str(one.exact),
        }
        for (script, model), own in found.items()
        for name, one in own.items()
    ]


def _claims(found: Found) -> Sequence[Verdict]:
    ours, theirs = entrants(*BUDGETS[0])
    pairs = _pairs(found)
    lost = {measure: sum(pair.lost(measure) for pair in pairs) for measure in MEASURES}
    stops = [own[ours.name].exact for own in found.values()]
    longest = max(STILL + 1 if stop is None else stop for stop in stops)
    still, last = (max(float(own[row.name].errors["picture"][-1]) for own in found.values()) for row in (theirs, ours))
    local = [own[ours.name] for (script, _), own in found.items() if script in LOCAL]
    once = max(one.mean("picture") for one in local)
    return [
        Verdict(
            "Changes of a curve compress much better than the curve: BI is nearer with as many terms (chapter 4).",
            not any(lost.values()),
            ", ".join(f"{measure}: {len(pairs) - n} of {len(pairs)}" for measure, n in lost.items()) + " means won",
            "A fast drag changes the whole highlight in every frame: such a change is no more compressible than it.",
        ),
        Verdict(
            f"An edit is applied in full after {_MOST} frames of 30 terms at most (4.1).",
            longest <= _MOST,
            f"{longest} at most",
            "256 samples are fewer than 9 times 30" if longest <= _MOST else "Some edits take more.",
        ),
        Verdict(
            "Standing still BI becomes exact, and the error of NWA is capped by its budget (chapter 4).",
            last == 0.0 < still,
            f"{100 * last:.2g} % and {100 * still:.2g} % of the picture with 30 terms",
            "" if last == 0.0 < still else "Under this light both are as near.",
        ),
        Verdict(
            "As edits are local, a single update is often all (chapter 4).",
            any(one.exact == 1 for one in local),
            f"{100 * once:.2g} % of the picture are left after one update of 30 terms; all is there after "
            f"{max(one.exact or STILL + 1 for one in local)} frames",
            "To the eye it is, to the bit not: a change that is smooth has small coefficients everywhere under it.",
        ),
    ]


STUDY = Study(
    title="Curves: following edits of a highlight",
    intro="A highlight is a curve of 256 samples, and its edits are what moves. BI sends the largest changes of its "
    f"wavelets, NWA its largest wavelets, to pearls of {', '.join(MODELS)}: rows that are traced once hold them for "
    "every curve. Held against the product with the whole curve, as the drag goes on and as it stands still.",
    run=run,
    light_files=("pearl-30.png", "pearl-10.png", "errors.png", "curves.csv"),
)
