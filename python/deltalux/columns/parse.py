"""Columns by their names, as files and the command line hold them."""

from __future__ import annotations

from .haar import Haar
from .harmonics import SphericalHarmonics

__all__ = ["Columns", "Haar", "SphericalHarmonics", "parse"]


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
        raise ValueError(f'expected columns like "haar:64", "haar:64+texels" or "sh:20", got {text!r}')
    return Haar(int(number), texels) if kind == "haar" else SphericalHarmonics(int(number))
