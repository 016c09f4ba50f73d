"""Families: how far few functions are from a model whose parameter is edited (Nguyen 2010, section 7.1 and Fig. 5).

All six models of the paper, each over the range that it was shown with: the paper's basis, from parameters spread
evenly over the whole range, beside segments of the range. Neither light nor a scene is looked at.
"""

from __future__ import annotations

from collections.abc import Sequence

from ...brdf.family import Errors
from ...progress import Progress
from ..case import Case
from ..shape import Study
from ..sheet import Sheet
from . import family_pictures
from .family_claims import claims
from .family_findings import OURS, PAPERS, RANGES, Found, find

__all__ = ["STUDY"]


def run(case: Case, sheet: Sheet, progress: Progress) -> None:
    """All models, then pictures and claims of all of them."""
    found = []
    for k, model in enumerate(RANGES):
        progress(k, len(RANGES))
        found.append(find(model))
    progress(len(RANGES), len(RANGES))
    family_pictures.draw(sheet, found)
    family_pictures.tell(sheet, found)
    sheet.csv("families.csv", _table(found))
    sheet.claims(claims(found))


def _table(found: Sequence[Found]) -> list[dict[str, str]]:
    """Every family, and the errors along gamma of two of them."""
    lines = []
    for one in found:
        for kind, families in (("even", one.even), ("segments", one.cut)):
            lines += [_line(one.model, kind, live, "worst", family.errors) for live, family in families.items()]
        for kind, live, along in (("even", PAPERS, one.along[0]), ("segments", OURS, one.along[1])):
            lines += [_line(one.model, kind, live, f"{g:.6g}", off) for g, off in zip(one.gamma, along, strict=True)]
    return lines


def _line(model: str, basis: str, live: int, gamma: str, errors: Errors) -> dict[str, str]:
    measures = {"peak": errors.peak, "energy": errors.energy, "rms": errors.rms, "mse": errors.rms**2}
    found = {name: f"{value:.4e}" for name, value in measures.items()}
    return {"model": model, "basis": basis, "live": str(live), "gamma": gamma, **found}


STUDY = Study(
    title="Families: few functions for a model whose parameter is edited",
    intro="A model is edited by one parameter, and its transport is precomputed for a few functions that span what the "
    "parameter does. The paper takes the principal components of parameters spread evenly over the whole range, and "
    "counts the mean apart. Here that is held against segments of the range, equal by their logarithms, each with "
    "functions of its own in which both ends are exact. Errors are of parameters that no function was made of; "
    "neither light nor a scene is looked at.",
    run=run,
    own_files=("along.png", "counts.png", "functions.png", "rms.png", "rms-counts.png", "families.csv"),
    subject="six models",
)
