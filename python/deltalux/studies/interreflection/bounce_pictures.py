"""The pictures of the study of bounces: a strip, and curves."""

from __future__ import annotations

import numpy as np

from ...io import magnification
from ...pages.plotting import FAMILIES, logarithmic
from ..pictures import label, show
from ..sheet import Sheet
from .bounce_findings import ENOUGH, Findings

__all__ = ["count_plot", "node_plot", "strip"]

_SHOWN: tuple[int | str, ...] = (0, 1, 2, ENOUGH, "all")
_DIRECT, _BOUNCED = FAMILIES["NWA"], FAMILIES["PBI"]


def strip(sheet: Sheet, found: Findings, stops: float) -> None:
    """More and more bounces, and what they lack."""
    caption = (
        "More and more bounces of light between surfaces, at one exposure. In the corner the relative L2 error against "
        "all bounces; below, the light that is missing, made brighter by the factor that is said: where next to "
        "nothing is missing, truncation shows. Direct light leaves black what the sky does not reach; bounces bring "
        "light there, and the colours of the walls. (Bands on the walls are shadows in a light of few, large texels.)"
    )
    height, width = found.whole.picture.shape[:2]
    size = (2.3 * len(_SHOWN) + 0.3, (2.3 * height / width + 0.15) * 2 + 0.4)
    with sheet.plot("bounces.png", caption, 2, len(_SHOWN), size) as (_, axes):
        for (upper, lower), bounces in zip(axes.T, _SHOWN, strict=True):
            shot = found.counts[bounces]
            upper.set_title(_title(bounces), fontsize=10)
            if shot is found.whole:
                show(upper, shot.picture, stops)
                lower.set_axis_off()
                continue
            missing = found.whole.picture - shot.picture
            times = magnification(missing, stops)
            show(upper, shot.picture, stops, f"{100 * shot.error:.2g} %")
            show(lower, times * np.abs(missing), stops, f"× {times}")
        label(axes[0, 0], "picture")
        label(axes[1, 0], "what is missing")


def _title(bounces: int | str) -> str:
    names = {"0": "direct light alone", "1": "1 bounce", "all": "all bounces"}
    return names.get(str(bounces), f"{bounces} bounces")


def count_plot(sheet: Sheet, found: Findings) -> None:
    """The error against the number of bounces, and what each brings."""
    caption = (
        "What bounces are worth. Left, how far the picture is from that with all bounces, and how much of its light is "
        "missing. Right, the share of each bounce in all the light of the picture that has bounced."
    )
    with sheet.plot("counts.png", caption, 1, 2, (10.0, 3.8)) as (_, (left, right)):
        numbers = [bounces for bounces in found.counts if bounces != "all"]
        for what, colour, marker in (("error", _BOUNCED, "o"), ("missing", _DIRECT, "s")):
            y = [100 * getattr(found.counts[bounces], what) for bounces in numbers]
            name = "L2 error" if what == "error" else "light missing"
            left.plot(numbers, y, color=colour, marker=marker, label=name)
        left.axhline(1, color="#888888", linewidth=1, linestyle=":")
        left.set(xlabel="Bounces", ylabel="Against all bounces (%)")
        left.set_xticks(numbers, [str(number) for number in numbers])
        logarithmic(left)
        left.legend()
        names, shares = zip(*found.steps(), strict=True)
        bars = right.bar(names, [100 * share for share in shares], color=_BOUNCED)
        right.bar_label(bars, [f"{100 * share:.2g}" for share in shares], fontsize=9)
        right.set(xlabel="Bounce", ylabel="Share of the bounced light (%)")
        right.grid(axis="x", visible=False)


def node_plot(sheet: Sheet, found: Findings) -> None:
    """Error, bytes and seconds against the number of nodes."""
    caption = (
        f"What nodes are worth, with {ENOUGH} bounces. Left, the error of the light that has bounced: in the picture, "
        "against the one with the most nodes; and as precomputation itself estimates it, the median of 64 receivers "
        "against 4,096 rays of their own, which knows as well what the most nodes lack. Middle and right, what light "
        "between surfaces adds to the bytes of M and to the time of the run. Where nodes are few, many receivers "
        "gather from what their own rays meet: that costs bytes and time, and is noisy, but keeps the error from "
        "growing."
    )
    with sheet.plot("nodes.png", caption, 1, 3, (11.4, 3.8)) as (_, (left, middle, right)):
        numbers = np.array([shot.of_nodes.nodes for shot in found.nodes])
        errors = 100 * np.array([found.of_bounced(shot) for shot in found.nodes])
        # The last is compared with itself.
        left.plot(numbers[:-1], errors[:-1], color=_BOUNCED, marker="o", label="picture, against the most nodes")
        estimates = [100 * shot.of_nodes.discretisation[0] for shot in found.nodes]
        left.plot(numbers, estimates, "--", color=_DIRECT, marker="s", label="receivers, as estimated")
        left.set(ylabel="Error of bounced light (%)")
        left.legend(loc="lower left")
        sizes, seconds = zip(*(found.beyond_direct(shot) for shot in found.nodes), strict=True)
        middle.plot(numbers, sizes, color=_BOUNCED, marker="o")
        middle.axhline(found.counts[0].nbytes / 1e6, color="#888888", linewidth=1, linestyle=":", label="direct light")
        middle.set(ylabel="MB beyond direct light")
        right.plot(numbers, seconds, color=_BOUNCED, marker="o")
        right.axhline(found.counts[0].seconds, color="#888888", linewidth=1, linestyle=":", label="direct light")
        right.set(ylabel="Seconds beyond direct light")
        for panel in (left, middle, right):
            logarithmic(panel, "x")
            panel.set(xlabel="Nodes")
            panel.set_xticks(numbers, [f"{number:,}" for number in numbers], rotation=45, fontsize=8)
            panel.minorticks_off()
            panel.set_ylim(bottom=0)
        for panel in (middle, right):
            panel.legend()
