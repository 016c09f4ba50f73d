"""Frames, one after another: after any history B has the bits of a fresh product, and no frame leaves memory behind.

Four scripts: a light that turns in a loop, lights that fade into each other, a brush with jumps between lights, and
gains over 40 decades; over all forms of storage, columns and methods of the tests. Rows are few, as it is the number of
frames that counts.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from functools import cache
from itertools import product
from pathlib import Path

import deltalux as dl
import forms
import numpy as np
from numpy.typing import NDArray

from .tally import Clock, Tally

WHAT = "frames, their bits against a fresh product"
SHARE = 1.5

FRAMES, EVERY, WARM = 20_000, 499, 4_000
"""Of one run; between two comparisons; before memory is looked at."""

Lights = list[NDArray[np.float64]]


@cache
def _small(name: str) -> dl.Environment:
    """A built-in light at twice the finest columns: lights are many, and are to cost less than frames."""
    return dl.Environment.from_cubemap(dl.Environment.builtin(name).cubemap(16))


def _sky(columns, name: str, degrees: float) -> NDArray[np.float64]:
    return columns.coefficients(_small(name).rotated(degrees))


def rotation(columns, rng: np.random.Generator) -> Lights:
    return [_sky(columns, "hall", 3.6 * k) for k in range(100)]


def crossfade(columns, rng: np.random.Generator) -> Lights:
    ends = [_sky(columns, name, 360 * rng.random()) for name in ("hall", "sky", "studio", "hall")]
    shares = np.linspace(0, 1, 40, endpoint=False)
    return [a + share * (b - a) for a, b in zip(ends, [*ends[1:], ends[0]], strict=True) for share in shares]


def painting(columns, rng: np.random.Generator) -> Lights:
    lights, here = [], _sky(columns, "sky", 0.0)
    for _ in range(150):
        # A stroke changes a few columns; now and then another light takes the place of all.
        here = here.copy()
        if rng.random() < 0.1:
            here = rng.lognormal(0, 2, here.shape)
        here[rng.integers(len(here), size=5)] += rng.normal(size=(5, 3))
        lights.append(here)
    return lights


def gains(columns, rng: np.random.Generator) -> Lights:
    light = _sky(columns, "hall", 0.0)
    return [light * 10.0**exponent for exponent in rng.uniform(-20, 20, 120)] + [0 * light]


SCRIPTS: dict[str, Callable[..., Lights]] = {
    "rotation": rotation, "crossfade": crossfade, "painting": painting, "gains": gains
}  # fmt: skip


def resident() -> float:
    """MiB of this process in memory."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 2**20


def bits_apart(found: NDArray[np.float32], wanted: NDArray[np.float32]) -> int:
    """How many of the last bits two pictures differ in, at most."""
    a, b = (x.view(np.int32).astype(np.int64) for x in (found, wanted))
    return int(np.abs(a - b).max()).bit_length()


def play(form: forms.Form, method: dl.Method, lights: Lights, clock: Clock, tally: Tally, what: str) -> None:
    """One relighter for thousands of frames."""
    relighter = form.relighter(method)
    times, before = [], 0.0
    for number in range(FRAMES):
        light = lights[number % len(lights)]
        started = time.perf_counter()
        frame = relighter.step(light)
        times.append(time.perf_counter() - started)
        tally.count(1)
        if number == WARM:
            before = resident()
        if number % EVERY == EVERY - 1 and (not form.two_stages or frame.converged):
            apart = bits_apart(frame.values, form.multiply(relighter.values))
            tally.see("drift in bits", apart)
            tally.add("comparisons", 1)
            if apart:
                tally.count(0, 1, f"{what}: {apart} bits after {number} frames")
            if not clock.left():
                break
    if len(times) > 2 * WARM:
        tally.see("growth in MiB", resident() - before)
        half = np.array(times[len(times) // 2 :])
        tally.see("p99.9 in ms", 1e3 * float(np.quantile(half, 0.999)))
        tally.see("median in ms", 1e3 * float(np.median(half)))


def run(clock: Clock, seed: int, folder: Path) -> Tally:
    tally, rng = Tally(), np.random.default_rng(seed)
    # Budgets in error refuse lights under which truncation alone takes more.
    methods = [method for method in forms.METHODS if method not in forms.STOP_SHORT]
    cases = list(product(SCRIPTS, forms.FORMS, forms.SPACES, methods))
    dl.set_threads(1)
    while clock.left():
        script, name, space, method = cases[rng.integers(len(cases))]
        form = forms.FORMS[name](forms.SPACES[space], rng)
        lights = SCRIPTS[script](form.columns, rng)
        play(form, forms.METHODS[method], lights, clock, tally, f"{script}, {name}, {space}, {method}")
    return tally
