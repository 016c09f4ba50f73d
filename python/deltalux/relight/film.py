"""Frames of a moving light in files, numbered, with a table of what each one took."""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from ..io import auto_exposure, save_image, to_display
from ..light.environment import Environment
from ..output import check_folder, claim, write_csv
from ..progress import Progress, reporter
from ..transport.transport import Transport
from ..update.methods import Method
from .relighter import Relighter

__all__ = ["FORMATS", "Film", "Relit", "check_frames", "relight_frames"]

FORMATS = {"png": (".png",), "exr": (".exr",), "both": (".png", ".exr")}
_TABLE = "frames.csv"


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

    def __str__(self) -> str:
        return (
            f"{self.folder} holds {self.frames} frames and {_TABLE}; exposure {self.exposure:+.2f} stops, "
            f"median {self.median_ms:.2f} ms a frame"
        )


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
    progress: bool | Progress = True,
) -> Relit:
    """Relights every frame of a moving light and writes it.

    Parameters
    ----------
    exposure
        Stops for the PNGs, the same in all; None: from the exact picture under the film's key light.
    kind
        A key of `FORMATS`: PNG for a display, EXR in linear radiance, or both.

    Raises
    ------
    ValueError, OSError
        If an argument cannot be used or the folder not be written.
    """
    relighter = Relighter(transport, method)
    path = claim(folder, _names(film.frames, kind))
    if exposure is None:
        exposure = auto_exposure(transport.image(transport.multiply(transport.coefficients(film.key))))
    tell, rows = reporter(progress, "relight"), []
    for k, env in enumerate(film.lights):
        frame = relighter.step(env)
        picture = frame.image
        about: dict[str, str | int | float] = {
            "software": "deltalux",
            "deltalux:environment": env.name,
            "deltalux:method": repr(method),
            "deltalux:frame": k,
            "deltalux:bound": frame.bound,
        }
        angle = film.angle(k)
        if angle is not None:
            about["deltalux:angle_degrees"] = angle
        for suffix in FORMATS[kind]:
            save_image(
                path / f"{_stem(k)}{suffix}", to_display(picture, exposure) if suffix == ".png" else picture, about
            )
        rows.append(
            {
                "frame": k,
                "angle": "" if angle is None else angle,
                "seconds": f"{frame.seconds:.6g}",
                "choosing": f"{frame.choosing:.6g}",
                "multiplying": f"{frame.multiplying:.6g}",
                "bound": frame.bound,
                "columns": len(frame.columns),
                "resets": " ".join(map(str, frame.resets)),
                "converged": frame.converged,
            }
        )
        # Row by row, so that an interrupted run leaves a table of the frames that are there.
        write_csv(path / _TABLE, rows)
        tell(k + 1, film.frames)
    median = sorted(float(str(row["seconds"])) for row in rows)[len(rows) // 2]
    return Relit(str(folder), len(rows), exposure, 1e3 * median)
