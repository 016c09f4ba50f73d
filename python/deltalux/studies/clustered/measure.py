"""What is measured of clustered transport: step two by its terms, sizes, and followers beside plain sparse storage."""

from __future__ import annotations

import math
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...relight.entrants import PBI_30, PBI_100, Entrant
from ...relight.errors import relative_errors
from ...relight.relighter import Relighter
from ...transport.entry import entry_bytes
from ...transport.transport import Transport
from ...update.methods import Incremental, Nonlinear
from ..case import Light

__all__ = [
    "EACH",
    "EQUAL",
    "QUARTER",
    "SHOWN",
    "TERMS",
    "Cost",
    "Picture",
    "Size",
    "at_error",
    "clustered",
    "costs_of",
    "error_of",
    "size_of",
    "step_two",
]

EACH = 25
QUARTER = 6
TERMS = (1, 2, 4, QUARTER, 9, 12, 18, EACH)
SHOWN = (2, 4, QUARTER, EACH)
_WARM_UP = 0.2
"""The share of the turning frames that is not counted: followers start from an exact product."""
_LOOKED = 12
"""Turning frames whose pictures are compared."""
_HALVINGS = 7
"""Of the tolerance that brings plain storage to the error of clusters, in logarithms."""

EQUAL = "sparse, at equal error"
"""What plain storage is called that has been truncated to the error of clusters."""

Picture = NDArray[np.float32]


@dataclass(frozen=True)
class Size:
    """Clusters x representatives of each: bytes, and the error of the picture under light that stands still."""

    clusters: int
    each: int
    megabytes: float
    error: float


@dataclass(frozen=True)
class Cost:
    """A follower over one form of storage: per frame what it sends and takes, and its error."""

    form: str
    method: str
    megabytes: float
    first: float
    """Entries of the first step, or of the only one."""
    entries: float
    """Of both."""
    milliseconds: float
    error: float


@contextmanager
def clustered(source: Transport, clusters: int, each: int) -> Iterator[Transport]:
    with tempfile.TemporaryDirectory() as folder:
        yield source.clustered(Path(folder) / "clustered.transport", clusters, each, progress=False)


def error_of(found: Picture, exact: Picture) -> float:
    return relative_errors(found, exact)[1]


def _still_error(
    source: Transport, multiply: Callable[[Light], Picture], still: NDArray[np.float64], rows: Transport
) -> float:
    """The mean over lights of a product, whose rows are those of another transport, against the source's pictures."""
    return float(np.mean([error_of(rows.image(multiply(V)), source.image(source.multiply(V))) for V in still]))


def size_of(source: Transport, made: Transport, still: NDArray[np.float64]) -> Size:
    clusters = int(made.cluster_map().max()) + 1
    each = made.plan.parts[0].rows // clusters - 1
    error = _still_error(source, made.multiply, still, made)
    return Size(clusters, each, made.nbytes / 1e6, error)


def _terms_of(made: Transport, each: int) -> int:
    """Columns of the second step: the mean and so many representatives for each cluster, where they are needed most."""
    of = made.plan.parts[0].rows
    clusters = int(made.cluster_map().max()) + 1
    return min(clusters * (1 + each), of)


def _follower(made: Transport, method: Any, each: int) -> Relighter:
    return Relighter(made, method, second=Incremental(_terms_of(made, each), weight="transport"))


def _looked(frames: Sequence[Light]) -> list[int]:
    first = math.ceil(_WARM_UP * (len(frames) - 1))
    return sorted({int(k) for k in np.linspace(max(first, 1), len(frames) - 1, _LOOKED)})


def step_two(
    source: Transport, made: Transport, frames: Sequence[Light]
) -> tuple[dict[int, tuple[float, float]], dict[int, Picture]]:
    """By terms of step 2: what it leaves of the picture that all of them make, and the error of the whole against the
    source under the same 300 terms of light; and pictures where the light turns fastest, 0 for the source's."""
    followers = {each: _follower(made, Nonlinear(300), each) for each in TERMS}
    left: dict[int, list[float]] = {each: [] for each in TERMS}
    whole: dict[int, list[float]] = {each: [] for each in TERMS}
    looked, shown = _looked(frames), {}
    for k, V in enumerate(frames):
        values = {each: follower.step(V).values for each, follower in followers.items()}
        if k not in looked:
            continue
        exact = source.image(source.multiply(followers[EACH].values))
        pictures = {each: made.image(found) for each, found in values.items()}
        for each, picture in pictures.items():
            left[each].append(error_of(picture, pictures[EACH]))
            whole[each].append(error_of(picture, exact))
        if k <= looked[len(looked) // 2]:
            shown = {0: exact, **{each: pictures[each] for each in SHOWN}}
    return {each: (float(np.mean(left[each])), float(np.mean(whole[each]))) for each in TERMS}, shown


def at_error(source: Transport, error: float, still: NDArray[np.float64]) -> Transport:
    """The source, truncated further until its error is that of the clusters: plain storage at equal error."""
    low, high = 1e-4, 0.5
    for _ in range(_HALVINGS):
        middle = math.sqrt(low * high)
        multiply = source.coarsened(middle, source.width).multiply
        more = _still_error(source, multiply, still, source) > error
        low, high = (low, middle) if more else (middle, high)
    return source.coarsened(low, source.width)


def costs_of(source: Transport, made: Transport, plain: Transport, frames: Sequence[Light]) -> list[Cost]:
    """Followers take turns frame by frame, so that what disturbs one disturbs all."""
    columns = made.second_columns
    assert columns is not None
    first = _entries(made, slice(None), source.width)
    step_two_sends = _terms_of(made, QUARTER) * (made.entries - first) / columns.columns
    forms = {"sparse": source, EQUAL: plain, "clustered": made}
    rows: dict[tuple[str, Entrant], Relighter] = {
        (form, entrant): _follower(made, entrant.method, QUARTER)
        if transport is made
        else Relighter(transport, entrant.method)
        for form, transport in forms.items()
        for entrant in (PBI_30, PBI_100)
    }
    seconds: dict[tuple[str, Entrant], list[float]] = {key: [] for key in rows}
    entries: dict[tuple[str, Entrant], list[float]] = {key: [] for key in rows}
    errors: dict[tuple[str, Entrant], list[float]] = {key: [] for key in rows}
    looked = _looked(frames)
    for k, V in enumerate(frames):
        exact = source.image(source.multiply(V)) if k in looked else None
        for key, follower in rows.items():
            frame, transport = follower.step(V), forms[key[0]]
            if k < looked[0]:
                continue
            seconds[key].append(frame.seconds)
            sent = _entries(transport, frame.columns, source.width)
            entries[key].append(sent)
            if exact is not None:
                found = made.image(frame.values) if transport is made else source.image(frame.values)
                errors[key].append(error_of(found, exact))
    return [
        Cost(
            form=form,
            method=str(entrant),
            megabytes=forms[form].nbytes / 1e6,
            first=float(np.mean(entries[form, entrant])),
            entries=float(np.mean(entries[form, entrant])) + (step_two_sends if forms[form] is made else 0.0),
            milliseconds=1e3 * float(np.median(seconds[form, entrant])),
            error=float(np.mean(errors[form, entrant])),
        )
        for form, entrant in rows
    ]


def _entries(transport: Transport, columns: Any, width: str) -> float:
    """Groups of sixteen rows in some columns of the first stage, whose numbers are so wide."""
    return float(transport.column_bytes[columns].sum()) / entry_bytes(width, 1)
