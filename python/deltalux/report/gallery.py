"""The pictures of the report: frames, the strip that compares methods, and the animation."""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..io import auto_exposure, magnification, save_image, to_display
from ..light.environment import Environment
from ..light.motion import Motion
from ..pages.plotting import INK
from ..transport.transport import Transport

if TYPE_CHECKING:
    from PIL.Image import Image
    from PIL.ImageDraw import ImageDraw
    from PIL.ImageFont import FreeTypeFont

__all__ = ["Gallery"]

_LARGEST_CELL = 256
_SMALLEST_CELL = 160
_GAP = 6
_LARGEST_ANIMATION = 5_000_000
_FRAME_MS = 50


class Gallery:
    """Keeps what the pictures need while the replay runs: small frames for the animation, four moments in full.

    All methods, frames and files share one exposure, chosen from the reference's first frame.
    """

    def __init__(self, transport: Transport, motion: Motion, methods: Sequence[str], moving: Sequence[str]) -> None:
        self._transport, self._motion = transport, motion
        self.methods, self.moving = list(methods), list(moving)
        self._moments = dict(motion.moments)
        self.exposure: float | None = None
        self._small: dict[str, list[NDArray[np.uint8]]] = {name: [] for name in moving}
        self._full: dict[tuple[str, int], NDArray[np.float32]] = {}
        self._behind: tuple[int, NDArray[np.float32]] = (-1, np.zeros((1, 1, 3), np.float32))

    def show(self, method: str, frame: int, light: Environment, values: NDArray[np.float32]) -> None:
        """Takes one frame of one method; the reference must come first."""
        if method not in self.methods and method not in self.moving:
            return
        surfaces = self._transport.image(values)
        if self._behind[0] != frame:
            self._behind = frame, self._transport.image(np.zeros_like(values), light)
        picture = surfaces + self._behind[1]
        if self.exposure is None:
            self.exposure = auto_exposure(picture)
        if method in self._small:
            self._small[method].append(self._display(_cell(picture)))
        if frame in self._moments and method in self.methods:
            self._full[method, frame] = picture

    def _display(self, picture: NDArray[np.float32]) -> NDArray[np.uint8]:
        return to_display(picture, self.exposure or 0.0)

    def save_frames(self, folder: Path, names: dict[tuple[str, int], str], environment: str) -> None:
        """The moments as PNG and as EXR in linear radiance."""
        for (method, frame), name in names.items():
            picture = self._full[method, frame]
            save_image(folder / f"{name}.png", self._display(picture))
            about = {
                "software": "deltalux",
                "deltalux:environment": environment,
                "deltalux:method": method,
                "deltalux:frame": frame,
                "deltalux:angle_degrees": float(self._motion.angles[frame]),
            }
            save_image(folder / f"{name}.exr", picture, about)

    def save_strip(self, path: Path, errors: dict[tuple[str, int], float]) -> None:
        """Methods down, moments across; under every approximation its difference from the exact picture."""
        from PIL import Image, ImageDraw

        reference, *others = self.methods
        rows = [(reference, False)] + [(name, signed) for name in others for signed in (False, True)]
        first = _cell(self._full[reference, self._motion.stop])
        height, width = first.shape[:2]
        left, top = 118, 44
        times = self._times(others[-1])
        size = (left + len(self._moments) * (width + _GAP), top + len(rows) * (height + _GAP))
        strip = Image.new("RGBA", size)
        draw, font, small = ImageDraw.Draw(strip), _font(15), _font(12)
        for k, (frame, title) in enumerate(self._moments.items()):
            x = left + k * (width + _GAP)
            draw.multiline_text((x + width / 2, top - 8), title, INK, font=small, anchor="md", align="center")
            exact = _cell(self._full[reference, frame])
            for j, (name, difference) in enumerate(rows):
                y = top + j * (height + _GAP)
                shown = _cell(self._full[name, frame])
                if difference:
                    shown = times * np.abs(shown - exact)
                strip.paste(Image.fromarray(self._display(shown)), (x, y))
                if not difference and name != reference:
                    _caption(draw, (x + 5, y + height - 5), f"{100 * errors[name, frame]:.2g} %", small)
        for j, (name, difference) in enumerate(rows):
            y = top + j * (height + _GAP) + height / 2
            label = f"|{name}\n\N{MINUS SIGN} exact|\n\N{MULTIPLICATION SIGN} {times}" if difference else name
            draw.multiline_text(
                (left - 10, y), label, INK, font=small if difference else font, anchor="rm", align="right"
            )
        strip.save(path, optimize=True)

    def _times(self, method: str) -> int:
        """How much a method's differences at the highest speed are made brighter."""
        exact, found = (self._full[name, self._motion.moments[1][0]] for name in (self.methods[0], method))
        return magnification(found - exact, self.exposure or 0.0)

    def save_animation(self, path: Path) -> None:
        """The methods side by side as an animated WebP, at the best quality that stays below 5 MB."""
        frames = [self._side_by_side(k) for k in range(len(self._motion.angles))]
        for quality in (80, 60, 40, 20):
            data = io.BytesIO()
            # The last frame stays a while before the animation starts again.
            durations = [_FRAME_MS] * (len(frames) - 1) + [1500]
            frames[0].save(
                data,
                "WEBP",
                save_all=True,
                append_images=frames[1:],
                duration=durations,
                loop=0,
                quality=quality,
                method=2,
            )
            if data.tell() < _LARGEST_ANIMATION:
                break
        path.write_bytes(data.getvalue())

    def _side_by_side(self, k: int) -> Image:
        from PIL import Image, ImageDraw

        height, width = self._small[self.moving[0]][k].shape[:2]
        top, bottom = 26, 26
        canvas = Image.new("RGBA", (len(self.moving) * (width + _GAP) - _GAP, top + height + bottom))
        draw, font, small = ImageDraw.Draw(canvas), _font(15), _font(12)
        for j, name in enumerate(self.moving):
            x = j * (width + _GAP)
            canvas.paste(Image.fromarray(self._small[name][k]), (x, top))
            draw.text((x + width / 2, top - 7), name, INK, font=font, anchor="ms")
        state = "turning" if k < self._motion.stop else "still"
        text = f"frame {k}   {self._motion.angles[k]:.1f}\N{DEGREE SIGN}   {state}"
        draw.text((4, top + height + 18), text, INK, font=small, anchor="ls")
        done = (k + 1) / len(self._motion.angles)
        draw.rectangle((190, top + height + 11, 190 + (canvas.width - 194) * done, top + height + 15), "#0072B2")
        return canvas


def _cell(picture: NDArray[np.float32]) -> NDArray[np.float32]:
    """The picture in the size of a cell: whole blocks of pixels averaged in linear light, or pixels repeated."""
    largest = max(picture.shape[:2])
    if largest < _SMALLEST_CELL:
        times = -(-_SMALLEST_CELL // largest)
        return picture.repeat(times, axis=0).repeat(times, axis=1)
    times = -(-largest // _LARGEST_CELL)
    height, width = (max(side // times, 1) * times for side in picture.shape[:2])
    blocks = picture[:height, :width].reshape(height // times, times, width // times, times, 3)
    return np.asarray(blocks.mean(axis=(1, 3), dtype=np.float32))


def _font(size: int) -> FreeTypeFont:
    """DejaVu Sans as matplotlib brings it, the font of the plots."""
    from matplotlib import font_manager
    from PIL import ImageFont

    return ImageFont.truetype(font_manager.findfont("DejaVu Sans"), size)


def _caption(draw: ImageDraw, at: tuple[float, float], text: str, font: FreeTypeFont) -> None:
    """White on a dark plate, readable over any picture."""
    box = draw.textbbox(at, text, font=font, anchor="ls")
    draw.rectangle((box[0] - 3, box[1] - 3, box[2] + 3, box[3] + 3), "#202020")
    draw.text(at, text, "white", font=font, anchor="ls")
