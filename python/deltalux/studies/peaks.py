"""Suns and lamps: what truncation costs when the brightest light goes through texels, and when none of it does."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from ..columns.haar import PEAKS, Haar
from ..pages.plotting import FAMILIES, logarithmic
from ..pages.verdict import Verdict
from ..progress import Progress
from ..relight.entrants import BI_30, NWA_100, PBI_30, Entrant
from ..relight.errors import errors_of_lights
from ..transport.entry import entry_bytes
from ..transport.transport import Transport
from .case import Case, Light, follow, light_errors, lights
from .shape import Study
from .sheet import Sheet

__all__ = ["STUDY"]

_COUNTS = (0, 1, 4, 16, 64, PEAKS, 256)
_TABLE = (0.03, 0.012, 0.005)
_TOLERANCES = (0.1, 0.06, 0.04, 0.03, 0.02, 0.012, 0.008, 0.005, 0.003)
_FRAMES = 8
_FEW = "a few columns hold most of this light: whoever sends the largest has it, and a band that starts anew pays"
_HELD = 1.25
"""How far a light that a preset was not measured under may lie beyond its number."""


def run(case: Case, sheet: Sheet, progress: Progress) -> None:
    """Truncated again and again, the rows that the file keeps untruncated; then followers of the turning light."""
    transport = case.transport
    assert transport is not None and transport.audit is not None
    rows, audit = transport.audit
    turned = [case.env.rotated(360 * k / _FRAMES) for k in range(_FRAMES)]
    split = {peaks: np.stack([transport.coefficients(env, peaks) for env in turned]) for peaks in _COUNTS}
    exact = {peaks: audit.multiply(V) for peaks, V in split.items()}
    total = len(_TOLERANCES) + 2

    curve = []
    for k, tolerance in enumerate(_TOLERANCES):
        cut = audit.coarsened(tolerance, "i8")
        errors = {peaks: _error(cut.multiply(split[peaks]), exact[peaks]) for peaks in _COUNTS}
        curve.append((tolerance, _megabytes(transport, cut, len(rows)), errors))
        progress(k + 1, total)
    real = rows[rows < transport.shape[0]]
    mine = {peaks: transport.multiply(V)[:, real] for peaks, V in split.items()}
    own = {peaks: _error(mine[peaks], exact[peaks][:, : len(real)]) for peaks in _COUNTS}

    sheet.heading("Relative L2 error of the picture, percent, by how many peaks go through texels")
    found = len(case.env.peaks(256, case.columns.face))
    sheet.text(
        f"The light has {_peaks(found)}. Rows are truncations of the wavelets, by the error expected of natural light; "
        f"the last is this transport. Errors are means over {_FRAMES} rotations, against the same rows untruncated."
    )
    lines = [(f"{100 * t:g} %", *_percents(errors)) for t, _, errors in curve if t in _TABLE]
    sheet.table(("Truncation", *map(_peaks, _COUNTS)), [*lines, ("this transport", *_percents(own))])

    texels = _texel_megabytes(transport)
    _draw(sheet, curve, texels, transport, own)
    sheet.csv(
        "peaks.csv",
        [
            {
                "tolerance": tolerance,
                "peaks": peaks,
                "megabytes_wavelets": f"{size:.4f}",
                "megabytes_texels": f"{texels:.4f}",
                "image_l2": f"{errors[peaks]:.6g}",
            }
            for tolerance, size, errors in curve
            for peaks in _COUNTS
        ],
    )

    sheet.heading("Followers of the turning light: error of the light, mean while it moves")
    followers = _followers(case)
    progress(total, total)
    names = [row.name for row in (PBI_30, NWA_100, BI_30)]
    sheet.table(
        ("Columns", *names),
        [(what, *(f"{100 * errors[name]:.3g} %" for name in names)) for what, errors in followers.items()],
    )
    sheet.claims(_claims(transport, curve, texels, own, followers))


def _error(found: NDArray[np.float32], exact: NDArray[np.float32]) -> float:
    """The mean over lights."""
    return float(errors_of_lights(found, exact).mean())


def _megabytes(transport: Transport, cut: Transport, rows: int) -> float:
    """Of the wavelets of all rows, by the entries that some of them keep."""
    return entry_bytes("i8", 1) * cut.entries * transport.shape[0] / rows / 1e6


def _texel_megabytes(transport: Transport) -> float:
    """Of the bits of all rows."""
    return max(transport.nbytes - entry_bytes(transport.width, 1) * transport.entries, 0) / 1e6


def _peaks(count: int) -> str:
    return "1 peak" if count == 1 else f"{count} peaks"


def _percents(errors: dict[int, float]) -> Iterator[str]:
    return (f"{100 * errors[peaks]:.2f}" for peaks in _COUNTS)


Curve = list[tuple[float, float, dict[int, float]]]


def _draw(sheet: Sheet, curve: Curve, texels: float, transport: Transport, own: dict[int, float]) -> None:
    caption = (
        "Error against bytes of M. All light through wavelets, and the brightest of it through texels, whose bits "
        "are counted with the norms of the rows; the cross is this transport."
    )
    with sheet.plot("peaks.png", caption, 1, 1, (9.4, 4.8)) as (figure, axes):
        sizes = np.array([size for _, size, _ in curve])
        axes.plot(sizes, [100 * errors[0] for *_, errors in curve], color=FAMILIES["NWA"], marker="o", label="wavelets")
        for peaks, style in ((1, ":"), (16, "--"), (PEAKS, "-")):
            label = f"and {_peaks(peaks)} in texels"
            y = [100 * errors[peaks] for *_, errors in curve]
            axes.plot(sizes + texels, y, style, color=FAMILIES["PBI"], marker="^", label=label)
        axes.plot(transport.nbytes / 1e6, 100 * own[PEAKS], "x", color="black", markersize=9)
        axes.set_xscale("log")
        logarithmic(axes)
        axes.set_xlabel("MB of M")
        axes.set_ylabel("Relative L2 error of the picture, %")
        axes.legend(frameon=False)


def _followers(case: Case) -> dict[str, dict[str, float]]:
    """Mean error of the light while it turns, of three methods, in wavelets alone and with texels."""
    return {
        what: {row.name: _while_turning(case, columns, row) for row in (PBI_30, NWA_100, BI_30)}
        for what, columns in (
            ("wavelets", Haar(case.columns.size)),
            ("wavelets and texels", Haar(case.columns.size, texels=True)),
        )
    }


def _while_turning(case: Case, columns: Haar, row: Entrant) -> float:
    frames: list[Light] = lights(case.env, case.motion, columns)
    moments = follow(columns, row, frames)
    errors = [light_errors(columns, moment.values, light)[0] for moment, light in zip(moments, frames, strict=True)]
    return float(np.mean(errors[1 : case.motion.stop + 1]))


def _claims(
    transport: Transport, curve: Curve, texels: float, own: dict[int, float], followers: dict[str, dict[str, float]]
) -> list[Verdict]:
    kept = own[PEAKS] <= _HELD * transport.error
    plain, both = followers["wavelets"], followers["wavelets and texels"]
    # At the bytes of wavelets and texels together, wavelets alone would keep more.
    _, size, errors = min(curve, key=lambda point: abs(point[0] - _TABLE[1]))
    sizes = [s for _, s, _ in curve]
    alone = float(np.interp(np.log(size + texels), np.log(sizes), [e[0] for *_, e in curve]))
    return [
        Verdict(
            "The number of the preset holds under this light",
            kept,
            f"{100 * own[PEAKS]:.2f} % here; {100 * transport.error:.2f} % measured, times {_HELD}",
            "" if kept else "much of this light is bright and wide: neither a few peaks nor few wavelets",
        ),
        Verdict(
            "At equal bytes wavelets and texels are better than wavelets alone",
            errors[PEAKS] < alone,
            f"{100 * errors[PEAKS]:.2f} against {100 * alone:.2f} % at {size + texels:.3g} MB",
            "" if errors[PEAKS] < alone else "this light has no peaks to speak of",
        ),
        *(
            Verdict(
                f"PBI-30 follows the turning light better than {other.name}, in {what}",
                errors_of[PBI_30.name] < errors_of[other.name],
                f"{100 * errors_of[PBI_30.name]:.3g} against {100 * errors_of[other.name]:.3g} %",
                "" if errors_of[PBI_30.name] < errors_of[other.name] else _FEW,
            )
            for what, errors_of in (("wavelets", plain), ("wavelets and texels", both))
            for other in (NWA_100, BI_30)
        ),
    ]


STUDY = Study(
    title="Suns and lamps",
    intro=(
        "A sun has as much energy in the finest wavelets as in the coarsest, so that truncation, which knows only what "
        "is usual, makes a floor under it too dark as a whole. Here the brightest lights go through columns of their "
        "own, a texel each, which are not truncated."
    ),
    run=run,
    scene_files=("peaks.png", "peaks.csv"),
    needs_scene=True,
    needs_texels=True,
    columns=Haar(64, texels=True),
)
