"""The papers' claims (Overbeck 2006, section 6.3), each held against this run: it holds or does not, with figures."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..light.motion import Motion
from ..pages.verdict import Verdict, tied
from ..relight.entrants import BI_30, EXACT, NWA_30, NWA_60, NWA_100, NWA_500, PBI_30
from ..relight.replay import Replay

__all__ = ["Verdict", "verdicts"]

# NWA-30 of the papers chooses nothing finer than wavelets over 256 texels of 64 x 64 faces: the third band.
_COARSE_BANDS = 3
# Frames of standing still that the papers look at.
_AFTER = 25


def verdicts(result: Replay, motion: Motion) -> list[Verdict]:
    """What can be said of one environment's replay."""
    rules = (
        _as_nwa_100,
        _better_than_bi,
        _below_nwa_500,
        _coarse_bands_stay,
        _coarse_terms,
        _still_light,
        _follower,
        _bound,
    )
    return [rule(result, motion) for rule in rules]


def _mean(result: Replay, method: str, frames: slice, measure: str = "light_l1") -> float:
    return 100 * float(result.column(method, measure)[frames].mean())


def _in_the_picture(result: Replay, names: tuple[str, str], frames: slice, holds: bool) -> str:
    """Where the picture disagrees with the light, both are said."""
    ours, theirs = (_mean(result, name, frames, "image_l2") for name in names)
    if (ours <= theirs) == holds or tied(ours, theirs):
        return ""
    return f"In the picture (L2) it is the other way round: {ours:.3g} % against {theirs:.3g} %."


def _turning(motion: Motion) -> slice:
    return slice(1, motion.stop + 1)


def resets(result: Replay, method: str, frames: slice) -> list[int]:
    """Resets of every band."""
    bands = len(result.terms[method])
    records = result.records[method][frames]
    return [sum(band in record.resets for record in records) for band in range(bands)]


def _as_nwa_100(result: Replay, motion: Motion) -> Verdict:
    frames = _turning(motion)
    pbi, nwa, nwa60 = (_mean(result, name, frames) for name in (PBI_30.name, NWA_100.name, NWA_60.name))
    return Verdict(
        f"While the light turns, {PBI_30} is on average no worse than {NWA_100} (area-weighted L1 error of the light).",
        pbi <= nwa,
        f"{PBI_30} {pbi:.3g} %, {NWA_100} {nwa:.3g} %, {NWA_60} {nwa60:.3g} %.",
        _in_the_picture(result, (PBI_30.name, NWA_100.name), frames, pbi <= nwa),
        tied(pbi, nwa),
    )


def _better_than_bi(result: Replay, motion: Motion) -> Verdict:
    frames = _turning(motion)
    pbi, bi = _mean(result, PBI_30.name, frames), _mean(result, BI_30.name, frames)
    image = [100 * float(result.column(name, "image_l2")[frames].mean()) for name in (PBI_30.name, BI_30.name)]
    return Verdict(
        f"{PBI_30} is on average better than {BI_30} (area-weighted L1 error of the light).",
        pbi < bi,
        f"light: {PBI_30} {pbi:.3g} %, {BI_30} {bi:.3g} %; image (L2): {image[0]:.3g} % and {image[1]:.3g} %.",
        _in_the_picture(result, (PBI_30.name, BI_30.name), frames, pbi < bi),
        tied(pbi, bi),
    )


def _below_nwa_500(result: Replay, motion: Motion) -> Verdict:
    after = slice(motion.stop, motion.stop + _AFTER + 1)
    pbi, nwa = (result.column(name, "light_l1")[after] for name in (PBI_30.name, NWA_500.name))
    below = np.flatnonzero(pbi <= nwa)
    when = f"after {below[0]} frames" if below.size else f"not within {len(pbi) - 1} frames"
    # A shorter hold shows when it is, and never that it is not.
    seen = bool(below.size) or motion.hold >= _AFTER
    return Verdict(
        f"Within {_AFTER} frames of the stop, {PBI_30} is below {NWA_500} (area-weighted L1 error of the light).",
        bool(below.size) if seen else None,
        f"{when}; at the end of the hold {PBI_30} {100 * pbi[-1]:.3g} %, {NWA_500} {100 * nwa[-1]:.3g} %",
    )


def _coarse_bands_stay(result: Replay, motion: Motion) -> Verdict:
    count = resets(result, PBI_30.name, slice(1, None))
    return Verdict(
        f"The two coarsest bands of {PBI_30} never start anew; finer bands do so more often.",
        not any(count[:2]),
        f"resets per band, coarse to fine: {', '.join(map(str, count))}",
    )


def _coarse_terms(result: Replay, motion: Motion) -> Verdict:
    nwa, pbi = result.terms[NWA_30.name], result.terms[PBI_30.name]
    return Verdict(
        f"{NWA_30} sends next to nothing (1 % of its terms) beyond the three coarsest bands.",
        bool(nwa[_COARSE_BANDS:].sum() <= 0.01 * nwa.sum()),
        f"terms a frame per band: {NWA_30} {_list(nwa)}; {PBI_30} {_list(pbi)}",
    )


def _still_light(result: Replay, motion: Motion) -> Verdict:
    still = result.still
    assert still is not None
    return Verdict(
        f"Light that stands still is reached exactly by {still.method}: the picture is a fresh product's, bit for bit.",
        still.exact,
        f"{still.frames} frames after the stop; at most {still.most_frames} are needed",
    )


def _follower(result: Replay, motion: Motion) -> Verdict:
    worst = max(record.image_worst for record in result.records[EXACT.name])
    return Verdict(
        "A product that is only ever updated (the exact method) equals a fresh product in every frame: no drift.",
        worst == 0.0,
        f"largest difference of any pixel in {len(result.records['exact'])} frames: {worst:g}",
    )


def _bound(result: Replay, motion: Motion) -> Verdict:
    records = [record for method in result.records.values() for record in method]
    broken = sum(not record.within_bound for record in records)
    return Verdict(
        "The bound that comes with every frame is never exceeded by any receiver.",
        broken == 0,
        f"{len(records) - broken:,} of {len(records):,} frames within it",
    )


def _list(terms: Sequence[float] | np.ndarray) -> str:
    return " / ".join(f"{value:.1f}" for value in terms)
