"""The pictures of the study of the slides: strips, and grids of signed images in two colours."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...io import auto_exposure, magnification
from ...transport.transport import Transport
from ..pictures import cross, show
from ..sheet import Sheet
from .basis_images import BasisImage
from .slide_claims import BOUNCES, Transfers

__all__ = ["channels", "harmonics", "transfers", "wavelets"]

_SIGNED = "RdBu_r"
_NOTHING = "#d4d4d4"
"""Where there is no surface; white is a surface that receives nothing."""
_INSET = (0.0, 0.68, 0.42, 0.32)


def transfers(sheet: Sheet, transport: Transport, found: Transfers) -> None:
    """Unshadowed, shadowed, interreflected, and what each step changes."""
    pictures = [transport.image(B) for B in (found.unshadowed, found.shadowed, found.bounced)]
    stops = auto_exposure(pictures[-1])
    changes = {
        "taken by shadows": pictures[0] - pictures[1],
        f"added by {BOUNCES} bounces": pictures[2] - pictures[1],
    }
    caption = (
        "One light, three transfers. Without shadows every surface receives all of the sky above it; with shadows what "
        f"it sees of the sky; and then what {BOUNCES} bounces bring from other surfaces. One exposure for all; on the "
        "right what each step changes, made brighter by the factor that is said."
    )
    titles = ("unshadowed", "shadowed", "with light between surfaces")
    _strip(sheet, "transfers.png", caption, dict(zip(titles, pictures, strict=True)), changes, stops)


def channels(sheet: Sheet, transport: Transport, found: Transfers) -> None:
    """Three channels, one, and what lies between."""
    three, one = (transport.image(B) for B in (found.bounced, found.one))
    stops = auto_exposure(three)
    caption = (
        "Colours that bleed. With a transfer vector for each colour light takes on the colours of the surfaces between "
        "which it bounces; with one for all, those surfaces are grey to it, as bright as before. On the right how far "
        "red, green and blue differ, made brighter by the factor that is said: most where something coloured is near."
    )
    pictures = {"one vector for each colour": three, "one for all colours": one}
    _strip(sheet, "channels.png", caption, pictures, {"difference": np.abs(three - one)}, stops)


def _strip(
    sheet: Sheet,
    kind: str,
    caption: str,
    pictures: Mapping[str, NDArray[np.float32]],
    changes: Mapping[str, NDArray[np.float32]],
    stops: float,
) -> None:
    """Pictures at one exposure, and then changes, each made brighter until it is plain to see."""
    height, width = next(iter(pictures.values())).shape[:2]
    count = len(pictures) + len(changes)
    side = 12.0 / max(count, 4)
    with sheet.plot(kind, caption, 1, count, (side * count, side * height / width + 0.25)) as (_, axes):
        for panel, (title, picture) in zip(axes, pictures.items(), strict=False):
            panel.set_title(title, fontsize=9)
            show(panel, picture, stops)
        for panel, (title, change) in zip(axes[len(pictures) :], changes.items(), strict=True):
            times = magnification(change, stops)
            panel.set_title(title, fontsize=9)
            show(panel, times * change, stops, f"× {times}")


def harmonics(sheet: Sheet, degrees: Sequence[Sequence[BasisImage]]) -> None:
    """Degrees down, and m across, around the middle."""
    caption = (
        "The scene in the light of single spherical harmonics, a degree l a line. Red is positive and blue negative: a "
        "light may take away as well as give. Every image has a scale of its own; in its corner the harmonic on the "
        "faces of a cube, -Z in the middle. A picture under any light is the sum of such images, each times the "
        "light's coefficient."
    )
    most = len(degrees[-1])
    beside = [[None] * ((most - len(line)) // 2) for line in degrees]
    _grid(sheet, "harmonics.png", caption, [[*none, *line, *none] for none, line in zip(beside, degrees, strict=True)])


def wavelets(sheet: Sheet, bands: Sequence[Sequence[BasisImage]]) -> None:
    """Bands across, from coarse to fine; down, one of every face shown."""
    caption = (
        "The scene in the light of single Haar wavelets. Across, bands from coarse to fine, by the texels under a "
        "wavelet, the first constant over a face; down, the wavelet that reaches the scene most, of three faces. Red "
        "is positive and blue negative, in a scale of each image's own; in the corner the wavelet on the faces of a "
        "cube. The finer the wavelet, the sharper what it draws: the edges of shadows."
    )
    _grid(sheet, "wavelets.png", caption, list(zip(*bands, strict=True)))


def _grid(sheet: Sheet, kind: str, caption: str, grid: Sequence[Sequence[BasisImage | None]]) -> None:
    first = next(image for line in grid for image in line if image is not None)
    height, width = first.picture.shape
    side = 11.6 / max(len(grid[0]), 4)
    size = (side * len(grid[0]), (side * height / width + 0.3) * len(grid))
    with sheet.plot(kind, caption, len(grid), len(grid[0]), size, squeeze=False) as (_, axes):
        for panel, image in zip(axes.flat, (image for line in grid for image in line), strict=True):
            if image is None:
                panel.set_axis_off()
                continue
            _signed(panel, image.picture)
            panel.set_facecolor(_NOTHING)
            panel.set_title(image.name, fontsize=8)
            inset = panel.inset_axes(_INSET)
            inset.patch.set_alpha(0)
            _signed(inset, cross(image.function[..., None], np.nan)[..., 0])


def _signed(panel: Any, values: NDArray[np.floating]) -> None:
    """Red above zero and blue below, white at zero; a few extreme values may leave the scale."""
    size = np.abs(values[np.isfinite(values)])
    most = float(np.quantile(size, 0.995)) if size.size else 0.0
    most = most or float(size.max(initial=0.0)) or 1.0
    panel.imshow(values, cmap=_SIGNED, vmin=-most, vmax=most, interpolation="nearest")
    panel.set(xticks=[], yticks=[])
    panel.spines[:].set_visible(False)
    panel.grid(False)
