"""Frames as a film in one file: WebP by Pillow, MP4 by the ffmpeg that imageio-ffmpeg brings."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["SUFFIXES", "Reel", "check_video", "video"]

SUFFIXES = (".mp4", ".webp")
RATE = 25
"""Frames a second."""


Reel = Callable[[NDArray[np.uint8]], object]
"""Takes the frames of a film, (h, w, 3) of 8-bit sRGB or (h, w, 4) with alpha, one behind the other."""


def check_video(path: str | os.PathLike[str]) -> None:
    """What `video` would refuse, found before any work.

    Raises
    ------
    ValueError
        If the name ends otherwise, or a library is missing.
    """
    suffix = Path(path).suffix.lower()
    if suffix not in SUFFIXES:
        raise ValueError(f"expected a video ending in {' or '.join(SUFFIXES)}, got {os.fspath(path)}")
    if suffix == ".mp4" and find_spec("imageio_ffmpeg") is None:
        raise ValueError("expected a .webp, or imageio-ffmpeg to write a .mp4: pip install 'deltalux[video]'")


@contextmanager
def video(path: str | os.PathLike[str]) -> Iterator[Reel]:
    """A film that takes frames until the end of the block; it is there once it is whole.

    Parameters
    ----------
    path
        ``.mp4`` (H.264) or ``.webp``.
    """
    check_video(path)
    target = Path(path)
    beside = target.with_name(f".{target.stem}.tmp-{os.getpid()}{target.suffix}")
    try:
        if target.suffix.lower() == ".mp4":
            with _mp4(beside) as reel:
                yield reel
        else:
            frames: list[NDArray[np.uint8]] = []
            yield frames.append
            _save_webp(beside, frames)
        if beside.exists():
            os.replace(beside, target)
    finally:
        beside.unlink(missing_ok=True)


@contextmanager
def _mp4(path: Path) -> Iterator[Reel]:
    # An extra, which need not be there.
    import imageio_ffmpeg  # pyright: ignore[reportMissingImports]

    writer: Any = None

    def reel(frame: NDArray[np.uint8]) -> None:
        nonlocal writer
        # Chroma is stored for two by two pixels: an odd row or column is left out.
        even = _on_black(frame)[: frame.shape[0] // 2 * 2, : frame.shape[1] // 2 * 2]
        if writer is None:
            size = (even.shape[1], even.shape[0])
            writer = imageio_ffmpeg.write_frames(str(path), size, fps=RATE, quality=8, macro_block_size=1)
            writer.send(None)
        writer.send(np.ascontiguousarray(even))

    try:
        yield reel
    finally:
        if writer is not None:
            writer.close()


def _on_black(frame: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """What H.264 has no room for is left out."""
    return frame if frame.shape[2] == 3 else np.asarray(frame[..., :3] * (frame[..., 3:] / 255.0), np.uint8)


def _save_webp(path: Path, frames: list[NDArray[np.uint8]]) -> None:
    from PIL import Image

    if frames:
        first, *rest = [Image.fromarray(frame) for frame in frames]
        first.save(path, save_all=True, append_images=rest, duration=1000 // RATE, loop=0, quality=85)
