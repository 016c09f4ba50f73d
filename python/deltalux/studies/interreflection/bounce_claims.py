"""What is said of light between surfaces, held against one scene and light."""

from __future__ import annotations

from ...pages.verdict import Verdict
from ...relight.entrants import PBI_30
from .bounce_findings import ENOUGH, TERMS, Findings

__all__ = ["claims"]

_ABOUT = 0.015
"""What is still about one percent."""
_SAME = 1.1
"""Times within a tenth of each other are the same."""
_PAPER = 0.01
"""How near the integrating sphere has to come to what is known."""


def claims(found: Findings) -> list[Verdict]:
    """The slides' first, then our own."""
    return [_run_time(found), _smooth(found), _enough(found), _certificate(found), _sphere(found)]


def _run_time(found: Findings) -> Verdict:
    direct, bounced = found.milliseconds
    holds = bounced <= _SAME * direct
    return Verdict(
        "With light between surfaces added to the transfer, the run time remains the same (Sloan et al. 2005, G7).",
        holds,
        f"a frame of {PBI_30}: {direct:.3f} ms with direct light, {bounced:.3f} ms with {ENOUGH} bounces",
        "The slides add all bounces into one vector a point. Here they stay apart, at nodes: a frame multiplies those "
        "as well, and takes four of them for each receiver. Added up they would cost several times the bytes.",
    )


def _smooth(found: Findings) -> Verdict:
    direct, bounced = found.few_terms
    return Verdict(
        f"Light that has bounced is smoother in the light's directions than direct light: {TERMS} terms are nearer "
        "to it.",
        bounced < direct,
        f"left out by the {TERMS} largest terms: {100 * direct:.3g} % of direct light, {100 * bounced:.3g} % of what "
        "has bounced",
        "A bounce averages over all that a surface sees, so that single lamps count less. Where they come in through a "
        "small opening it may not."
        if bounced >= direct
        else "A bounce averages over all that a surface sees.",
    )


def _enough(found: Findings) -> Verdict:
    least = next((bounces for bounces, shot in found.counts.items() if shot.error <= _ABOUT), "all")
    holds = isinstance(least, int) and least <= ENOUGH
    return Verdict(
        f"Two bounces (outdoors) to {ENOUGH} (indoors) leave about one percent of the picture.",
        holds,
        f"2 leave {100 * found.counts[2].error:.2g} %, {ENOUGH} leave {100 * found.counts[ENOUGH].error:.2g} %; within "
        f"{100 * _ABOUT:g} % from {least} on",
        "Every bounce keeps the share of the light that does not find a way out and is not absorbed."
        if holds
        else "Here light finds few ways out, and walls are bright: each bounce keeps much of the one before.",
    )


def _certificate(found: Findings) -> Verdict:
    ratios = [furnace.ratio for furnace in found.furnaces if furnace.error > 0]
    holds = all(furnace.error <= furnace.solve.residual for furnace in found.furnaces)
    most = max(furnace.solve.products[2] for furnace in found.furnaces)
    return Verdict(
        "What is proved of the solution is never below its true error, however long light stays in a room.",
        holds,
        f"{len(found.furnaces)} rooms: proved over true {min(ratios, default=1):.2g} to {max(ratios, default=1):.2g}, "
        f"{most} products at most",
        "The residual bounds the error by the light that walls of this albedo would have if they glowed themselves."
        if holds
        else "A receiver is off by more than was proved of nodes: what is stored in 16 bits is not in the proof.",
    )


def _sphere(found: Findings) -> Verdict:
    worst = max(ball.error for ball in found.balls)
    return Verdict(
        f"An integrating sphere receives what is known on paper, within {100 * _PAPER:g} %.",
        worst <= _PAPER,
        "; ".join(f"albedo {ball.albedo:g}: {ball.found:.4f} for {ball.known:.4f}" for ball in found.balls),
        "The sphere is of flat triangles, and its opening is seen in texels; both are in the difference.",
    )
