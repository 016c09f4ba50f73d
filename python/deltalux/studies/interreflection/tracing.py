"""Scenes that a study traces itself, in several ways, and holds as long as it looks at them."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

from ...precomputation.run import precompute
from ...progress import Progress
from ...scene.scene import Scene
from ...transport.transport import Transport

__all__ = ["Traced", "Tracing", "tracing"]

_STEPS = 1000
"""Of progress, for every run."""


class Traced(NamedTuple):
    """A transport, and how long it took."""

    transport: Transport
    seconds: float


class Tracing:
    """Traces into one folder, and tells how many of its runs are done."""

    def __init__(self, folder: Path, progress: Progress, runs: int) -> None:
        self._folder, self._progress, self._runs, self._done = folder, progress, runs, 0

    def __call__(self, scene: Scene, **options: Any) -> Traced:
        """One run of `precompute`; quick and truncated to one percent, if the options do not say otherwise."""
        number, self._done = self._done, self._done + 1

        def tell(done: int, total: int) -> None:
            self._progress(_STEPS * number + _STEPS * done // max(total, 1), _STEPS * self._runs)

        quick: dict[str, Any] = {"quality": "preview", "tolerance": 0.01}
        started = time.perf_counter()
        transport = precompute(scene, self._folder / f"{number}.transport", progress=tell, **(quick | options))
        return Traced(transport, time.perf_counter() - started)


@contextmanager
def tracing(progress: Progress, runs: int) -> Iterator[Tracing]:
    """For as long as transports are looked at: they lie in files."""
    with TemporaryDirectory(prefix="deltalux-", ignore_cleanup_errors=True) as folder:
        yield Tracing(Path(folder), progress, runs)
    progress(1, 1)
