"""Layouts of environment images: recognised by their proportions, turned into lat-long pixels or six faces.

Inside a layout the tiles show what an eye at the origin sees (nothing is mirrored), and "forward" is -Z with +X to the
right, as on debevec.org: the middle of a cross and of an angular probe. Lat-long images are Mitsuba's and OpenEXR's,
u = atan2(x, -z) / 2π, whose middle is +Z. Strips of six faces are in OpenGL's order and orientation, unless an EXR file
says `envmap`: then they are in OpenEXR's orientation, which is the eye's.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..sphere import FACES, face_directions

LAYOUTS = ("latlong", "vertical-cross", "horizontal-cross", "angular", "cube")

Image = NDArray[np.float32]

# (right, down) of the faces of a cubemap as an eye at the origin sees them.
_EYE = np.array(
    [
        [[0, 0, 1], [0, -1, 0]],
        [[0, 0, -1], [0, -1, 0]],
        [[1, 0, 0], [0, 0, -1]],
        [[1, 0, 0], [0, 0, 1]],
        [[-1, 0, 0], [0, -1, 0]],
        [[1, 0, 0], [0, -1, 0]],
    ]
)

# Where each face stands in a cross: (row, column).
_VERTICAL = ((1, 2), (1, 0), (0, 1), (2, 1), (3, 1), (1, 1))
_HORIZONTAL = ((1, 2), (1, 0), (0, 1), (2, 1), (1, 3), (1, 1))


def recognise(image: Image, envmap: str | None) -> tuple[Image, str]:
    """The layout of an image, from the EXR attribute ``envmap`` or its proportions, and the image without padding."""
    height, width = image.shape[:2]
    if envmap is not None:
        return image, envmap
    if width == height:
        return _padded_cross(image) or (image, "angular")
    proportions = {(2, 1): "latlong", (3, 4): "vertical-cross", (4, 3): "horizontal-cross"}
    proportions |= {(6, 1): "cube", (1, 6): "cube"}
    for (wide, high), layout in proportions.items():
        if width * high == height * wide:
            return image, layout
    expected = "2:1 (latlong), 3:4 and 4:3 (crosses), 1:1 (angular), 6:1 and 1:6 (cube)"
    found = f"cannot recognise the layout of a {width}x{height} image"
    raise ValueError(f"{found}: expected {expected}; name it by layout=")


def _padded_cross(image: Image) -> tuple[Image, str] | None:
    """The cross within a square that was padded with one colour, at either end of it or in its middle; else None.

    A probe fills a disc, of which the corners of a cross and its padding would cut off a part.
    """
    side = len(image) // 4
    if side == 0 or len(image) % 4:
        return None
    empty = np.asarray((image == image[0, 0]).all(axis=-1))
    for layout, places in (("horizontal-cross", _HORIZONTAL), ("vertical-cross", _VERTICAL)):
        for start in (0, side // 2, side):
            tall = layout == "vertical-cross"
            rows, columns = (0, start) if tall else (start, 0)
            outside = np.ones_like(empty)
            faces = []
            for row, column in places:
                at = (
                    slice(rows + row * side, rows + (row + 1) * side),
                    slice(columns + column * side, columns + (column + 1) * side),
                )
                outside[at] = False
                faces.append(empty[at].all())
            if empty[outside].all() and not any(faces):
                high, wide = (4, 3) if tall else (3, 4)
                return image[rows : rows + high * side, columns : columns + wide * side], layout
    return None


def convert(image: Image, layout: str, envmap: str | None = None) -> Image:
    """Turn an image in any layout into lat-long pixels (h, w, 3) or six faces (6, n, n, 3)."""
    if layout not in LAYOUTS:
        raise ValueError(f"expected a layout of {', '.join(LAYOUTS)}, got {layout!r}")
    if layout == "latlong":
        return image
    if layout == "angular":
        return _angular(image)
    if layout == "cube":
        return _strip(image, eye=envmap == "cube")
    return _cross(image, layout)


def _tiles(image: Image, columns: int, rows: int, layout: str) -> int:
    """The side of the square tiles that the image consists of."""
    height, width = image.shape[:2]
    side = int(width // columns)
    if side == 0 or (width, height) != (side * columns, side * rows):
        raise ValueError(f"expected {columns}x{rows} square tiles for layout {layout!r}, got {width}x{height} pixels")
    return side


def _turned(tile: Image, face: int, right: NDArray[np.int_], down: NDArray[np.int_]) -> Image:
    """A tile spanned by (right, down), in OpenGL's orientation of its face."""
    side = len(tile)
    centres = (2 * np.arange(side) + 1 - side)[:, None]
    own_right, own_down, _ = FACES[face]
    # Each of the own axes is plus or minus one of the tile's: a flip, after a transposition where they are crossed.
    if own_right @ right == 0:
        tile, right, down = tile.swapaxes(0, 1), down, right
    columns = (centres * (own_right @ right) + side - 1).ravel() // 2
    rows = (centres * (own_down @ down) + side - 1).ravel() // 2
    return np.asarray(tile[rows[:, None], columns])


def _cross(image: Image, layout: str) -> Image:
    """The faces of a cross; what lies outside its arms is left out, whatever it holds."""
    vertical = layout == "vertical-cross"
    side = _tiles(image, *((3, 4) if vertical else (4, 3)), layout)
    faces = []
    for face, (row, column) in enumerate(_VERTICAL if vertical else _HORIZONTAL):
        tile = image[row * side : (row + 1) * side, column * side : (column + 1) * side]
        right, down = _EYE[face]
        # Behind is the foot of the vertical cross, upside down: one walks over the floor to it.
        turn = -1 if vertical and face == 4 else 1
        faces.append(_turned(tile, face, turn * right, turn * down))
    return np.stack(faces)


def _strip(image: Image, eye: bool) -> Image:
    if image.shape[0] < image.shape[1]:
        side = _tiles(image, 6, 1, "cube")
        tiles = image.reshape(side, 6, side, 3).swapaxes(0, 1)
    else:
        side = _tiles(image, 1, 6, "cube")
        tiles = image.reshape(6, side, side, 3)
    return np.stack([_turned(tiles[face], face, *_EYE[face]) for face in range(6)]) if eye else tiles


def _angular(image: Image) -> Image:
    """Debevec's light probe, resampled bilinearly to faces twice as fine: 90 degrees are a quarter of its width.

    The distance from the middle is the angle to -Z (the rim is +Z), in the direction in which the eye sees it.
    """
    side = _tiles(image, 1, 1, "angular")
    size = max(side // 2, 1)
    x, y, z = np.moveaxis(face_directions(size), -1, 0)
    flat = np.hypot(x, y)
    radius = np.arctan2(flat, -z) / np.pi
    # Beyond the rim is no image: keep the four pixels of a lookup inside the disc.
    radius = np.minimum(radius, max(1 - 3 / side, 0)) / np.maximum(flat, 1e-30)
    column = ((1 + x * radius) * side - 1) / 2
    row = ((1 - y * radius) * side - 1) / 2
    return _bilinear(image, row, column)


def _bilinear(image: Image, row: NDArray[np.float64], column: NDArray[np.float64]) -> Image:
    height, width = image.shape[:2]
    top, left = np.floor(row).astype(int), np.floor(column).astype(int)
    v, u = (row - top)[..., None], (column - left)[..., None]
    rows = [np.clip(top + k, 0, height - 1) for k in (0, 1)]
    columns = [np.clip(left + k, 0, width - 1) for k in (0, 1)]
    lines = [image[r, columns[0]] * (1 - u) + image[r, columns[1]] * u for r in rows]
    return np.asarray(lines[0] * (1 - v) + lines[1] * v, np.float32)
