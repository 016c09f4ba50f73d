"""Error against bytes: what truncation costs, measured on the rows that the file keeps untruncated.

A transport with an audit holds some bundles of its rows as they were traced. They are truncated again, from a few
percent of error to nothing, and their products compared; bytes are those of these rows times the share they are of M.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..columns import Haar, SphericalHarmonics
from ..light.environment import Environment
from ..light.motion import Motion
from ..relight.errors import errors_of_lights
from ..transport.entry import entry_bytes
from ..transport.transport import Transport

__all__ = ["Point", "size_curve"]

_TOLERANCES = (0.2, 0.1, 0.06, 0.04, 0.03, 0.02, 0.015, 0.01, 0.007, 0.005, 0.003, 0.002, 0.001)
_SUNS = 32

Product = Callable[[NDArray[np.float64]], NDArray[np.float32]]
"""From lights (k, columns, 3) to what they reflect, (k, rows, 3)."""


@dataclass(frozen=True)
class Point:
    """One truncation: bytes of the whole of M, and relative L2 errors of the reflected light of the audit's rows."""

    label: str
    tolerance: float
    megabytes: float
    extrapolated: bool
    errors: dict[str, float]
    sun_mean: float
    sun_worst: float


def size_curve(transport: Transport, envs: Sequence[Environment], motion: Motion) -> list[Point]:
    """The curve, smallest first, and last this transport as it is; nothing where the file has no audit."""
    found = transport.audit
    if found is None:
        return []
    rows, audit = found
    # Groups at the end of M may be shorter than 16: rows past the end stay out of the comparison.
    real = rows < transport.shape[0]
    weight = np.sqrt(transport.pixels.weight[rows[real], None]) * transport.albedo[rows[real]]
    lights = {env.name: _turning(transport, env, motion) for env in envs}
    if isinstance(transport.columns, Haar) and transport.columns.texels:
        lights |= {f"{env.name}, wavelets alone": _turning(transport, env, motion, 0) for env in envs}
    suns = _suns(transport)

    def errors(multiply: Product) -> tuple[dict[str, float], float, float]:
        of = {
            name: float(np.mean(errors_of_lights(multiply(V), audit.multiply(V)[:, real], weight)))
            for name, V in lights.items()
        }
        sun = errors_of_lights(multiply(suns), audit.multiply(suns)[:, real], weight)
        return of, float(np.mean(sun)), float(np.max(sun))

    # Entries grow with the rows; what lists them and the norms of the rows are as large for every truncation.
    share, own_entry = transport.shape[0] / len(rows), entry_bytes(transport.width, 1)
    fixed = transport.nbytes - own_entry * transport.entries
    points: list[Point] = []
    cuts = [(f"{100 * t:g} %", t, "i8") for t in _TOLERANCES]
    for label, tolerance, width in [*cuts, ("lossless", 0.0, "i16")]:
        cut = audit.coarsened(tolerance, width)
        megabytes = (fixed + entry_bytes(width, 1) * cut.entries * share) / 1e6
        # Eight bits reach no smaller error than their rounding: what is asked for beyond changes nothing.
        if not points or megabytes != points[-1].megabytes:
            points.append(Point(label, tolerance, megabytes, True, *errors(partial(_some_rows, cut, real))))
    own = errors(partial(_some_rows, transport, rows[real]))
    return [*points, Point("this transport", transport.plan.tolerance, transport.nbytes / 1e6, False, *own)]


def _some_rows(transport: Transport, rows: NDArray[Any], V: NDArray[np.float64]) -> NDArray[np.float32]:
    """Products of k lights, of these rows only: (k, rows, 3)."""
    return transport.multiply(V)[:, rows]


def _turning(transport: Transport, env: Environment, motion: Motion, peaks: int | None = None) -> NDArray[np.float64]:
    """V in some dozen frames of the rotation, (k, columns, 3)."""
    frames = np.unique(np.linspace(0, motion.stop, 12).round().astype(int))
    return np.stack([transport.coefficients(motion.light(env, int(k)), peaks) for k in frames])


def _suns(transport: Transport) -> NDArray[np.float64]:
    """V of single bright texels of the upper half of the sky, (k, columns, 3)."""
    columns = transport.columns
    n = columns.face if isinstance(columns, Haar | SphericalHarmonics) else 1
    random = np.random.default_rng(1)
    maps = np.zeros((_SUNS, 6, n, n, 3), np.float32)
    for cubemap in maps:
        # The faces that a light from above can be on, and of the four sides their upper half.
        face, row, column = int(random.choice([0, 1, 2, 4, 5])), int(random.integers(n)), int(random.integers(n))
        cubemap[face, row if face == 2 else row // 2, column] = 1.0
    return np.stack([transport.coefficients(Environment.from_cubemap(cubemap)) for cubemap in maps])
