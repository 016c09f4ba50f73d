"""What the study of two bases compares: harmonics of three orders, PBI on them, and wavelets of 25 terms."""

from __future__ import annotations

from ...relight.entrants import Entrant, bi, nwa, pbi
from ...update.methods import Full, HarmonicOrder, Linear, PerBand

__all__ = [
    "BI_25",
    "NWA_25",
    "PBI_25",
    "PBI_25_ON_SH",
    "PBI_SH_25",
    "SH_ORDER_10",
    "SH_ORDER_20",
    "SH_ORDER_5",
]

SH_ORDER_5 = Entrant("SH order 5", "SH", Linear(25), initial=None)
SH_ORDER_10 = Entrant("SH order 10", "SH", Linear(100), initial=None)
SH_ORDER_20 = Entrant("SH order 20", "SH", Full())
PBI_SH_25 = Entrant("PBI-SH-25", "PBI-SH", HarmonicOrder(terms=25, tolerance=5e-4))
PBI_25_ON_SH = Entrant("PBI-25 on SH", "PBI-SH", PerBand(25, weight="none"))
NWA_25, BI_25, PBI_25 = nwa(25), bi(25), pbi(25)
