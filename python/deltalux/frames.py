"""Frames of a turning light in files, numbered, with a table of what each one took."""

from __future__ import annotations

import os
from dataclasses import dataclass

from .environment import Environment
from .io import save_image, to_display
from .methods import Method
from .motion import Motion
from .output import check_folder, claim, write_csv
from .pictures import auto_exposure
from .progress import Progress, reporter
from .relight import Relighter
from .transport import Transport

__all__ = ["FORMATS", "Relit", "check_frames", "relight_frames"]

FORMATS = {"png": (".png",), "exr": (".exr",), "both": (".png", ".exr")}
_TABLE = "frames.csv"


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


def _names(motion: Motion, kind: str) -> list[str]:
    return [_TABLE, *(f"{_stem(k)}{suffix}" for k in range(len(motion.angles)) for suffix in FORMATS[kind])]


def _stem(frame: int) -> str:
    return f"frame-{frame:04d}"


def check_frames(folder: str | os.PathLike[str], motion: Motion, kind: str) -> None:
    """What `relight_frames` would refuse about its folder; writes nothing."""
    check_folder(folder, _names(motion, kind))


def relight_frames(
    transport: Transport,
    env: Environment,
    folder: str | os.PathLike[str],
    motion: Motion,
    method: Method,
    *,
    exposure: float | None = None,
    kind: str = "png",
    progress: bool | Progress = True,
) -> Relit:
    """Relights every frame of a motion and writes it.

    Parameters
    ----------
    exposure
        Stops for the PNGs, the same in all; None: from the first frame.
    kind
        A key of `FORMATS`: PNG for a display, EXR in linear radiance, or both.

    Raises
    ------
    ValueError, OSError
        If an argument cannot be used or the folder not be written.
    """
    relighter = Relighter(transport, method)
    path = claim(folder, _names(motion, kind))
    tell, rows = reporter(progress, "relight"), []
    for k, angle in enumerate(motion.angles):
        frame = relighter.step(motion.light(env, k))
        picture = frame.image
        if exposure is None:
            exposure = auto_exposure(transport.image(frame.values))
        about = {
            "software": "deltalux",
            "deltalux:environment": env.name,
            "deltalux:method": repr(method),
            "deltalux:frame": k,
            "deltalux:angle_degrees": float(angle),
            "deltalux:bound": frame.bound,
        }
        for suffix in FORMATS[kind]:
            save_image(path / f"{_stem(k)}{suffix}", to_display(picture, exposure) if suffix == ".png" else picture, about)
        rows.append(
            {
                "frame": k,
                "angle": angle,
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
        tell(k + 1, len(motion.angles))
    median = sorted(float(str(row["seconds"])) for row in rows)[len(rows) // 2]
    return Relit(str(folder), len(rows), exposure or 0.0, 1e3 * median)
