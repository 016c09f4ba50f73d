"""Bounds: no receiver is further from the product in float64 than its frame says.

Forms of storage and methods of the tests, with thousands of rows, whose entries each turn draws anew; lights from
smooth to one column, that move and jump.
"""

from __future__ import annotations

from pathlib import Path

import deltalux as dl
import forms
import numpy as np

from .tally import Clock, Tally

WHAT = "receivers within the bound of their frame"
SHARE = 1.0

ROWS, FRAMES = (1000, 4000), 60
"""Of a form, at least and below; of one pair of lights."""


def light(count: int, rng: np.random.Generator) -> np.ndarray:
    """Of many kinds: few columns or all, even or over decades, of either sign."""
    V = rng.lognormal(0, rng.uniform(0, 4), (count, 3)) * rng.choice([-1, 1], (count, 3))
    V *= rng.random((count, 1)) < rng.choice([1.0, 0.3, 0.02])
    return V * 10.0 ** rng.uniform(-8, 8)


def check(form: forms.Form, relighter: dl.Relighter, V: np.ndarray, tally: Tally, what: str) -> None:
    """One frame."""
    frame = relighter.step(V)
    error = np.abs(frame.values.astype(np.float64) - form.oracle(V))
    bounds = relighter.bounds(frame).astype(np.float64)
    beyond = int((~(error <= bounds)).sum())
    tally.count(error.size, beyond, f"{what}: {beyond} receivers")
    ratio = np.divide(error, bounds, out=np.zeros_like(error), where=bounds > 0)
    tally.see("largest error / bound", float(ratio.max()))


def run(clock: Clock, seed: int, folder: Path) -> Tally:
    tally, rng = Tally(), np.random.default_rng(seed)
    # Budgets in error refuse lights under which truncation alone takes more.
    methods = [name for name in forms.METHODS if name not in forms.STOP_SHORT]
    dl.set_threads(1)
    while clock.left():
        name, space = rng.choice(list(forms.FORMS)), rng.choice(list(forms.SPACES))
        forms.ROWS = int(rng.integers(*ROWS))
        form = forms.FORMS[name](forms.SPACES[space], rng)
        for method in rng.choice(methods, 4, replace=False):
            relighter, (here, there) = form.relighter(forms.METHODS[method]), (light(form.count, rng) for _ in range(2))
            for frame in range(FRAMES):
                if rng.random() < 0.1:
                    here, there = there, light(form.count, rng)
                share = (frame % 10) / 10
                check(form, relighter, here + share * (there - here), tally, f"{name}, {space}, {method}")
    return tally
