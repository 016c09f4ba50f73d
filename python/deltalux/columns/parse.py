"""Columns by their names, as files and the command line hold them."""

from __future__ import annotations

import re
from typing import Any

from ..mistakes import no_columns
from .haar import Haar
from .harmonics import SphericalHarmonics

__all__ = ["Columns", "Haar", "SphericalHarmonics", "checked", "parse"]


Columns = Haar | SphericalHarmonics


def parse(text: str) -> Columns:
    """Reads what ``str(columns)`` writes.

    Parameters
    ----------
    text
        Such as ``"haar:64"``, ``"haar:64+texels"`` or ``"sh:20"``.

    Returns
    -------
    Haar or SphericalHarmonics
        The columns of this name.

    Raises
    ------
    ValueError
        If the text names no columns.
    """
    kind, _, number = text.partition(":")
    texels = kind == "haar" and number.endswith("+texels")
    number = number.removesuffix("+texels") if texels else number
    if kind not in ("haar", "sh") or not (number.isascii() and number.isdigit()):
        raise ValueError(f'expected columns like "haar:64", "haar:64+texels" or "sh:20", got {text!r}{_meant(text)}')
    return Haar(int(number), texels) if kind == "haar" else SphericalHarmonics(int(number))


def _meant(text: str) -> str:
    """The columns of the same number, where the kind is mistaken or not said."""
    number = re.search(r"\d+", text)
    if number is None:
        return ""
    kind = "sh" if text.lower().startswith("s") else "haar"
    return f'; did you mean "{kind}:{number[0]}{"+texels" if kind == "haar" and "+t" in text else ""}"?'


def checked(columns: Any) -> Columns:
    """Columns of light, or those that a text names.

    Raises
    ------
    TypeError
        If it is something else.
    ValueError
        If the text names no columns.
    """
    if isinstance(columns, str):
        return parse(columns)
    if not isinstance(columns, Columns):
        raise no_columns(columns)
    return columns
