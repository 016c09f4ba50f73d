"""What the study of bounces shows of rooms that light hardly leaves."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ...pages.plotting import logarithmic
from ..sheet import Sheet
from .furnaces import ALBEDOS, FINE, RESIDUAL, ROOMS, STRONG, Ball, Furnace

__all__ = ["show"]


def show(sheet: Sheet, found: Sequence[Furnace], balls: Sequence[Ball]) -> None:
    """A picture, two tables and a file."""
    _draw(sheet, found)
    _tables(sheet, found, balls)
    sheet.csv("furnaces.csv", _rows(found))


def _draw(sheet: Sheet, found: Sequence[Furnace]) -> None:
    """Products against albedo, and the certificate beside the true error."""
    caption = (
        "Rooms that light hardly leaves. Left, how often the form factors are multiplied before the error is proved to "
        f"be below {RESIDUAL:g} of a column's largest value: the median of all columns, and in bars the fewest and the "
        "most. Plain summing of bounces would take about as many as there are bounces until so little is left (grey). "
        "Right, how many times the true error what was proved is; below 1 it would be no proof."
    )
    with sheet.plot("furnaces.png", caption, 1, 2, (10.4, 4.2)) as (figure, (left, right)):
        x = np.arange(len(ALBEDOS))
        for k, (room, colour, marker) in enumerate(zip(ROOMS, ("#0072B2", "#D55E00"), ("o", "s"), strict=True)):
            of = [furnace for furnace in found if furnace.room == room]
            fewest, median, most = np.array([furnace.solve.products for furnace in of], float).T
            look = {"color": colour, "marker": marker}
            left.errorbar(x + 0.08 * k, median, (median - fewest, most - median), capsize=3, label=room, **look)
            right.plot(x, [furnace.ratio for furnace in of], **look)
        left.plot(x, [_bounces(albedo) for albedo in ALBEDOS], ":", color="#777777", label="bounce by bounce")
        left.set(ylabel="Products")
        logarithmic(left)
        right.axhline(1, color="#777777", linewidth=1)
        right.set(ylabel="Proved error / true error")
        right.set_ylim(bottom=0)
        for panel in (left, right):
            panel.set(xlabel="Albedo")
            panel.set_xticks(x, [f"{albedo:g}" for albedo in ALBEDOS])
        figure.legend(loc="outside right center")


def _bounces(albedo: float) -> float:
    """Bounces until the light that is left is `RESIDUAL` of all, where none is lost on the way."""
    return float(np.log(RESIDUAL) / np.log(albedo))


def _tables(sheet: Sheet, found: Sequence[Furnace], balls: Sequence[Ball]) -> None:
    """The solver's figures, and the sphere's."""
    sheet.table(
        ("Room", "Albedo", "Method", "Products (fewest, median, most)", "Proved error", "True error", "Ratio"),
        [
            (
                furnace.room,
                f"{furnace.albedo:g}",
                furnace.solve.method,
                " / ".join(map(str, furnace.solve.products)),
                f"{furnace.solve.residual:.2g}",
                f"{furnace.error:.2g}",
                f"{furnace.ratio:.2g}",
            )
            for furnace in found
        ],
    )
    sheet.text(
        f"Errors are relative to a column's largest value; the true one is what receivers differ by from a solution to "
        f"{FINE:g}, in columns that bring at least {100 * STRONG:g} % of the strongest. With an integrating sphere, "
        "whose answer is known on paper, the whole way is tested: direct light, form factors, solution and links."
    )
    sheet.table(
        ("Integrating sphere, albedo", "Received from a white sky", "On paper", "Off by"),
        [(f"{ball.albedo:g}", f"{ball.found:.4f}", f"{ball.known:.4f}", f"{100 * ball.error:.2g} %") for ball in balls],
    )


def _rows(found: Sequence[Furnace]) -> list[dict[str, Any]]:
    return [
        {
            "room": furnace.room,
            "albedo": furnace.albedo,
            "method": furnace.solve.method,
            "fewest_products": furnace.solve.products[0],
            "median_products": furnace.solve.products[1],
            "most_products": furnace.solve.products[2],
            "proved": f"{furnace.solve.residual:.6g}",
            "true": f"{furnace.error:.6g}",
        }
        for furnace in found
    ]
