"""Light between surfaces: what many bounces are worth, and what they cost.

The scene is traced again and again: with more and more bounces, with fewer and fewer nodes, and all else alike; beside
it stand rooms that light hardly leaves (`furnaces`).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...columns import Haar
from ...io import auto_exposure
from ...pages.machine import require_release
from ...progress import Progress
from ...relight.entrants import PBI_30
from ...relight.errors import relative_errors
from ...relight.relighter import Relighter
from ...scene.scene import Scene
from ...transport.transport import Transport
from ...update.approximation import Approximation
from ...update.methods import Nonlinear
from ..case import Case, Light
from ..shape import Study
from ..sheet import Sheet
from . import bounce_pictures, furnace_pages, furnaces
from .bounce_claims import claims
from .bounce_findings import ENOUGH, TERMS, Findings, Shot
from .tracing import Traced, Tracing, tracing

__all__ = ["STUDY"]

_BOUNCES = (0, 1, 2, 3, 4, ENOUGH, "all")
_FEWER = (32, 16, 8, 4, 2)
"""By how much fewer the nodes are."""
_COLUMNS = Haar(16)


def run(case: Case, sheet: Sheet, progress: Progress) -> None:
    """All transports; what they show under the light, and what they take."""
    require_release()
    assert case.scene is not None
    with tracing(progress, len(_BOUNCES) + len(_FEWER) + furnaces.RUNS) as traced:
        counts = _by_bounces(traced, case.scene, case.columns)
        nodes = _by_nodes(traced, case.scene, case.columns, counts[ENOUGH])
        found = Findings(
            counts=_shots(case, counts),
            nodes=_node_shots(case, nodes),
            milliseconds=_milliseconds(case, [counts[0].transport, counts[ENOUGH].transport]),
            few_terms=_few_terms(case, counts[0].transport, counts[ENOUGH].transport),
            furnaces=[furnace for room in furnaces.ROOMS for furnace in furnaces.measure(traced, room)],
            balls=furnaces.measure_ball(traced),
        )
    _write(case, sheet, found)


def _by_bounces(traced: Tracing, scene: Scene, columns: Haar) -> dict[int | str, Traced]:
    found = {bounces: traced(scene, columns=columns, bounces=bounces) for bounces in _BOUNCES}
    if found["all"].transport.solve is None:
        raise ValueError(f"the study looks at light between surfaces, but none of {scene.name} sees another")
    return found


def _by_nodes(traced: Tracing, scene: Scene, columns: Haar, finest: Traced) -> list[Traced]:
    """From few nodes to as many as light varies."""
    caps = sorted({max(finest.transport.nodes // fewer, 1) for fewer in _FEWER})
    return [*(traced(scene, columns=columns, bounces=ENOUGH, nodes=cap) for cap in caps), finest]


def _shots(case: Case, runs: dict[int | str, Traced]) -> dict[int | str, Shot]:
    """Each number of bounces against all of them."""
    pictures = {bounces: _picture(case, run.transport) for bounces, run in runs.items()}
    return {bounces: _shot(run, pictures[bounces], pictures["all"]) for bounces, run in runs.items()}


def _node_shots(case: Case, runs: Sequence[Traced]) -> list[Shot]:
    """Each number of nodes against the last, the finest."""
    pictures = [_picture(case, run.transport) for run in runs]
    return [_shot(run, picture, pictures[-1]) for run, picture in zip(runs, pictures, strict=True)]


def _shot(run: Traced, picture: NDArray[np.float32], whole: NDArray[np.float32]) -> Shot:
    missing = 1 - _share(float(picture.sum(dtype=np.float64)), float(whole.sum(dtype=np.float64)))
    error = relative_errors(picture, whole)[1]
    return Shot(picture, error, missing, run.seconds, run.transport.nbytes, run.transport.solve)


def _share(part: float, whole: float) -> float:
    return part / whole if whole > 0 else 1.0


def _picture(case: Case, transport: Transport) -> NDArray[np.float32]:
    return transport.image(transport.multiply(transport.coefficients(case.env)))


def _milliseconds(case: Case, transports: Sequence[Transport]) -> list[float]:
    """The median frame of PBI-30 over each, side by side: what disturbs one disturbs the other."""
    relighters = [Relighter(transport, PBI_30.method, PBI_30.initial) for transport in transports]
    seconds = []
    for k in range(case.motion.stop + 1):
        light = case.motion.light(case.env, k)
        seconds.append([relighter.step(light).seconds for relighter in relighters])
    return [1e3 * float(median) for median in np.median(seconds[1:], axis=0)]


def _few_terms(case: Case, direct: Transport, bounced: Transport) -> list[float]:
    """What the largest few terms of the light leave out, of direct light and of what has bounced."""
    V = direct.coefficients(case.env)
    chosen = Approximation(direct.columns, Nonlinear(TERMS))
    chosen.step(V)

    def parts(light: Light) -> list[NDArray[np.float64]]:
        first, all_light = (transport.multiply(light).astype(np.float64) for transport in (direct, bounced))
        return [first, all_light - first]

    return [relative_errors(*pair)[1] for pair in zip(parts(chosen.values), parts(V), strict=True)]


def _write(case: Case, sheet: Sheet, found: Findings) -> None:
    stops = auto_exposure(found.whole.picture)
    sheet.heading("Bounces")
    bounce_pictures.strip(sheet, found, stops)
    bounce_pictures.count_plot(sheet, found)
    sheet.text(
        f"Light in {case.columns}, traced quickly and truncated to one percent. All bounces are solved until no value "
        f"is off by more than {found.whole.residual:.1g} of a column's largest. A receiver takes what has bounced "
        "from nodes, by weight, or gathers it where they do not speak for it. Bytes are those of M, and seconds those "
        "of the whole run, of which direct light takes what the first line says."
    )
    sheet.table(*_count_table(found))
    sheet.text(
        f"A frame of {PBI_30} while the light turns, the median, side by side: {found.milliseconds[0]:.3f} ms over "
        f"direct light, {found.milliseconds[1]:.3f} ms with {ENOUGH} bounces. What the {TERMS} largest terms of the "
        f"light leave out: {100 * found.few_terms[0]:.3g} % of direct light, {100 * found.few_terms[1]:.3g} % of what "
        "has bounced."
    )
    sheet.csv("bounces.csv", _rows(found))
    sheet.heading(f"Nodes, with {ENOUGH} bounces")
    bounce_pictures.node_plot(sheet, found)
    sheet.table(*_node_table(found))
    sheet.heading("Rooms that light hardly leaves")
    furnace_pages.show(sheet, found.furnaces, found.balls)
    sheet.claims(claims(found))


def _count_table(found: Findings) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    headings = ("Bounces", "L2 error", "Light missing", "MB of M", "Of which bounces", "Seconds", "Of which bounces")
    first = found.counts[0]
    lines: list[tuple[str, ...]] = [
        (
            str(bounces),
            f"{100 * shot.error:.2g} %",
            f"{100 * shot.missing:.2g} %",
            f"{shot.nbytes / 1e6:.2f}",
            f"{(shot.nbytes - first.nbytes) / 1e6:.2f}",
            f"{shot.seconds:.1f}",
            f"{max(shot.seconds - first.seconds, 0):.1f}",
        )
        for bounces, shot in found.counts.items()
    ]
    return headings, lines


def _node_table(found: Findings) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    headings = (
        *("Nodes", "L2 error of the picture", "Of bounced light", "As estimated (median / p95 / most)"),
        *("Receivers that gather", "MB", "Seconds"),
    )
    lines = []
    for shot in found.nodes:
        solve = shot.of_nodes
        estimate = " / ".join(f"{100 * off:.2g}" for off in solve.discretisation)
        size, seconds = found.beyond_direct(shot)
        errors = (f"{100 * error:.2g} %" for error in (shot.error, found.of_bounced(shot)))
        line = (*errors, f"{estimate} %", f"{100 * solve.gathering:.1f} %")
        lines.append((f"{solve.nodes:,}", *line, f"{size:.2f}", f"{seconds:.1f}"))
    return headings, lines


def _rows(found: Findings) -> list[dict[str, Any]]:
    """Every transport of the scene, one a line."""
    return [
        {
            "bounces": bounces,
            "nodes": shot.solve.nodes if shot.solve else 0,
            "compared_with": against,
            "image_l2": f"{shot.error:.6g}",
            "missing": f"{shot.missing:.6g}",
            "bytes": shot.nbytes,
            "seconds": f"{shot.seconds:.3f}",
            "gathering": f"{shot.solve.gathering if shot.solve else 0:.6g}",
            "estimated": f"{shot.solve.discretisation[0] if shot.solve else 0:.6g}",
        }
        for bounces, shot, against in (
            *((bounces, shot, "all bounces") for bounces, shot in found.counts.items()),
            *((ENOUGH, shot, "most nodes") for shot in found.nodes),
        )
    ]


STUDY = Study(
    title="Light between surfaces",
    intro="Light that comes from the sky directly is the first term of a series. Here a scene is traced with more and "
    "more bounces, and with fewer and fewer nodes, the points at which light between surfaces is solved: what each is "
    "worth under one light, and what it costs in bytes, in seconds and in a frame. Rooms of bright walls then try the "
    "solver, which proves how exact it is.",
    run=run,
    scene_files=("bounces.png", "counts.png", "bounces.csv", "nodes.png", "furnaces.png", "furnaces.csv"),
    traces="cornell",
    columns=_COLUMNS,
)
