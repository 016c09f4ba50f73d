"""Frames of a moving light in files, numbered, with a table of what each one took."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._core import threads
from ..io import save_image, to_display
from ..light.environment import Environment
from ..output import Table, check_folder, claim
from ..progress import Progress, reporter
from ..transport.transport import Transport
from ..update.methods import Method
from .backdrop import Backdrop
from .relighter import Relighter
from .video import Reel

__all__ = ["FORMATS", "Film", "Relit", "check_frames", "relight_frames"]

FORMATS = {"png": (".png",), "exr": (".exr",), "both": (".png", ".exr")}
_TABLE = "frames.csv"
_AHEAD = 2
"""Pictures that wait to be written, for each thread that writes."""


@dataclass(frozen=True)
class Film:
    """The light of every frame, and how many there are.

    `key` is the light that exposure is chosen under, `angles` are degrees where the light rotates.
    """

    lights: Iterable[Environment]
    frames: int
    key: Environment
    angles: Sequence[float] | None = None

    def angle(self, frame: int) -> float | None:
        """Degrees, or None if nothing rotates."""
        return None if self.angles is None else float(self.angles[frame])


@dataclass(frozen=True)
class Relit:
    """What was written, in a sentence."""

    folder: str
    frames: int
    exposure: float
    median_ms: float
    budget_ms: float | None = None
    within: int = 0

    def __str__(self) -> str:
        return (
            f"{self.folder} holds {self.frames} frames and {_TABLE}; exposure {self.exposure:+.2f} stops, "
            f"median {self.median_ms:.2f} ms a frame{self._met}"
        )

    @property
    def _met(self) -> str:
        """Of a budget in time: how many frames kept it. The first is a whole product, and is not counted."""
        if self.budget_ms is None:
            return ""
        return f", {self.within} of {self.frames - 1} within {self.budget_ms:g} ms after the first"


def _names(frames: int, kind: str) -> list[str]:
    return [_TABLE, *(f"{_stem(k)}{suffix}" for k in range(frames) for suffix in FORMATS[kind])]


def _stem(frame: int) -> str:
    return f"frame-{frame:04d}"


def check_frames(folder: str | os.PathLike[str], film: Film, kind: str) -> None:
    """What `relight_frames` would refuse about its folder; writes nothing."""
    check_folder(folder, _names(film.frames, kind))


def relight_frames(
    transport: Transport,
    film: Film,
    folder: str | os.PathLike[str],
    method: Method,
    *,
    exposure: float | None = None,
    kind: str = "png",
    half: bool = False,
    background: str = "env",
    catcher: bool = False,
    tone: str = "srgb",
    reel: Reel | None = None,
    progress: bool | Progress = True,
) -> Relit:
    """Relights every frame of a moving light and writes it.

    Parameters
    ----------
    exposure
        Stops for the PNGs, the same in all; None: from the exact picture under the film's key light, with what is seen
        behind the scene.
    kind
        A key of `FORMATS`: PNG for a display, EXR in linear radiance, or both.
    half
        Half floats in the EXRs.
    background
        What is shown where no surface is: "env", "none" (the files have alpha), or a colour, "#rrggbb".
    catcher
        Of the scene's ground only the shadow on it is shown.
    tone
        The curve of the PNGs, as for `to_display`.
    reel
        Takes every frame as it is shown.

    Raises
    ------
    ValueError, OSError
        If an argument cannot be used or the folder not be written.
    """
    tell = reporter(progress, "relight")
    relighter, backdrop = Relighter(transport, method), Backdrop(transport, background, catcher=catcher)
    plain = background == "env" and not catcher
    path = claim(folder, _names(film.frames, kind))
    if exposure is None:
        tell.begin("exposure")
        exposure = backdrop.exposure(transport.multiply(transport.coefficients(film.key)), film.key)
    seconds, table = [], Table(path / _TABLE)
    tell.step("frames")
    with _Encoder(exposure, half, tone) as encoder:
        for k, env in enumerate(film.lights):
            frame = relighter.step(env)
            picture = frame.image if plain else backdrop.picture(frame.values, env, exposure, relighter.values)
            about: dict[str, str | int | float] = {
                "software": "deltalux",
                "deltalux:environment": env.name,
                "deltalux:method": repr(method),
                "deltalux:frame": k,
                "deltalux:bound": float(frame.bound),
            }
            angle = film.angle(k)
            if angle is not None:
                about["deltalux:angle_degrees"] = angle
            row = {
                "frame": k,
                "angle": "" if angle is None else angle,
                "seconds": f"{frame.seconds:.6g}",
                "choosing": f"{frame.choosing:.6g}",
                "multiplying": f"{frame.multiplying:.6g}",
                "bound": float(frame.bound),
                "columns": len(frame.columns),
                "resets": " ".join(map(str, frame.resets)),
                "converged": frame.converged,
            }
            seconds.append(frame.seconds)
            if reel is not None:
                reel(to_display(picture, exposure, tone))
            files = [path / f"{_stem(k)}{suffix}" for suffix in FORMATS[kind]]
            # Row by row, so that an interrupted run leaves a table of the frames that are there.
            encoder.save(files, picture, about, partial(_saved, table, row, tell, k + 1, film.frames))
    median = sorted(seconds)[len(seconds) // 2]
    budget = method.milliseconds
    within = sum(1e3 * own <= budget for own in seconds[1:]) if budget is not None else 0
    return Relit(str(folder), len(seconds), exposure, 1e3 * median, budget, within)


def _saved(table: Table, row: dict[str, Any], tell: Progress, done: int, total: int) -> None:
    table.add(row)
    tell(done, total)


class _Encoder:
    """Writes pictures on threads of its own, while the next frames are multiplied; a few may wait."""

    def __init__(self, exposure: float, half: bool, tone: str) -> None:
        self._exposure, self._half, self._tone = exposure, half, tone
        # As many as multiply: compressing a picture costs more than a frame of few terms.
        self._writers = ThreadPoolExecutor(threads(), "deltalux-encoder")
        self._waiting: deque[tuple[Future[None], Callable[[], None]]] = deque()

    def __enter__(self) -> _Encoder:
        return self

    def save(
        self, files: list[Path], picture: NDArray[np.float32], about: dict[str, Any], saved: Callable[[], None]
    ) -> None:
        """Takes a picture; `saved` is called on this thread once all its files are there."""
        self._waiting.append((self._writers.submit(self._write, files, picture, about), saved))
        while len(self._waiting) > _AHEAD * threads() or (self._waiting and self._waiting[0][0].done()):
            self._finish()

    def _finish(self) -> None:
        job, saved = self._waiting.popleft()
        job.result()
        saved()

    def _write(self, files: list[Path], picture: NDArray[np.float32], about: dict[str, Any]) -> None:
        for file in files:
            shown = to_display(picture, self._exposure, self._tone) if file.suffix == ".png" else picture
            save_image(file, shown, about, half=self._half)

    def __exit__(self, kind: object, error: object, trace: object) -> None:
        try:
            # What was made before an interruption is not thrown away.
            while self._waiting:
                self._finish()
        finally:
            self._writers.shutdown(cancel_futures=True)
