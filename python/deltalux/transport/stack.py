"""Light stacks: pictures of one view, each under one lamp or one group of lights, as M."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._core import ReceiverTable, TransportWriter
from .._core import Transport as CoreTransport
from ..camera import Camera
from ..checks import real_array
from ..columns.lamps import Lamps
from ..io import load_image
from ..mistakes import described
from ..plain import MOST_TEXT, read_plain
from ..progress import Progress, reporter
from .entry import TILE_ROWS, TILES_PER_SHARD
from .plan import Part, Plan

__all__ = ["read_lights", "write_stack"]

_SPAN = 26
"""Bits from the unit of M to its longest row: one less than exact sums take."""
_SMALLEST = -64
_FIELD = 20.0
"""Degrees that the view is taken to be high where no camera is given."""

_Path = str | os.PathLike[str]
_Picture = NDArray[np.float64]


def read_lights(path: _Path) -> tuple[list[Path] | None, NDArray[np.float64]]:
    """A list of lights: how many there are, then a line each, a direction, of RTI files (.lp) after the picture's name.

    Parameters
    ----------
    path
        A text file.

    Returns
    -------
    pictures : list of paths, or None where lines name none
    directions : (n, 3) float64

    Raises
    ------
    ValueError
        If it is no such list.
    """
    lines = [line for line in read_plain(Path(path), MOST_TEXT).decode("utf-8", "replace").splitlines() if line.strip()]
    try:
        expected, rows = int(lines[0]), [line.split() for line in lines[1:]]
        directions = np.array([[float(word) for word in row[-3:]] for row in rows], np.float64)
    except (IndexError, ValueError):
        raise ValueError(f"{os.fspath(path)}: expected a number of lights, then a line of three numbers each") from None
    if directions.shape != (expected, 3) or not expected:
        raise ValueError(f"{os.fspath(path)}: expected {expected} lights as it says, found {len(rows)}")
    # A name may have blanks in it.
    names = [line.rsplit(None, 3)[0].strip() if len(line.split()) > 3 else "" for line in lines[1:]]
    if not all(names):
        return None, directions
    # Programs write whole paths of their own machine: what lies beside the list is meant.
    return [Path(path).parent / name.replace("\\", "/").rsplit("/", 1)[-1] for name in names], directions


def write_stack(
    images: Any,
    lights: Any,
    path: _Path,
    mask: ArrayLike | _Path | None,
    intensities: ArrayLike | None,
    reach: float | None,
    camera: Camera | None,
    progress: bool | Progress,
) -> None:
    """Writes the transport of a stack."""
    TransportWriter.check(path)
    columns, images = _columns(images, lights, reach)
    tell = reporter(progress, "reading pictures")
    pictures = _pictures(images, columns, lambda done: tell(done, columns.columns))
    height, width = pictures[0].shape[:2]
    scales = _intensities(intensities, columns.columns)
    seen = _mask(mask, (height, width))
    rows = np.flatnonzero(seen)
    if not len(rows):
        raise ValueError("expected a mask that leaves some pixels, got one that leaves none")
    grey = all((picture == picture[..., :1]).all() for picture in pictures) and (scales == scales[:, :1]).all()
    channels = 1 if grey else 3
    stack = np.empty((len(rows), columns.columns, channels))
    for column, (picture, scale) in enumerate(zip(pictures, scales, strict=True)):
        stack[:, column] = (picture.reshape(-1, 3)[rows] / scale)[:, :channels]
    longest = float(np.sqrt(np.square(stack).sum(axis=1).max()))
    quantum = max(int(np.ceil(np.log2(longest))) - _SPAN if longest > 0 else 0, _SMALLEST)
    digest = hashlib.blake2b(stack.tobytes(), digest_size=16)
    digest.update(rows.tobytes())
    writer = TransportWriter(path, json.dumps({"stack": digest.hexdigest()}))
    _write_tiles(writer, stack, str(columns), quantum)
    name, shape = "direct", (len(rows), columns.columns)
    camera = camera or Camera(position=(0, 0, 5), target=(0, 0, 0), vertical_fov=_FIELD, width=width, height=height)
    writer.finish(
        parts=[(name, str(columns), len(rows), channels, quantum, "i16", TILE_ROWS)],
        receivers=_receivers(rows, (height, width), seen),
        camera=json.dumps(asdict(camera.resized(width, height))),
        plan=_plan(columns, shape, (width, height), channels).to_json(),
        scene=digest.hexdigest(),
        beside=[("lamps", list(columns.arrays().items()))],
    )
    tell(columns.columns, columns.columns)


def _columns(images: Any, lights: Any, reach: float | None) -> tuple[Lamps, Any]:
    if isinstance(lights, (str, os.PathLike)):
        named, directions = read_lights(lights)
        if images is None and named is None:
            raise ValueError(f"{os.fspath(lights)}: expected images, as this list of lights names none")
        return Lamps(directions, reach=reach), named if images is None else images
    if isinstance(lights, Lamps):
        return lights, images
    if isinstance(lights, (list, tuple)) and all(isinstance(name, str) for name in lights):
        return Lamps(None, lights), images
    return Lamps(lights, reach=reach), images


def _pictures(images: Any, columns: Lamps, tell: Callable[[int], object]) -> list[_Picture]:
    """All pictures, of one shape, (height, width, 3)."""
    if isinstance(images, (str, os.PathLike)):
        if columns.names is None:
            raise ValueError("expected the names of an image's layers as lights, or a picture for each light")
        layers: Sequence[str | None] = columns.names
        images = [images] * len(columns.names)
    else:
        layers = [None] * columns.columns
    if len(images) != columns.columns:
        raise ValueError(f"expected a picture for each of {columns.columns} lights, got {len(images)}")
    pictures = []
    for image, layer in zip(images, layers, strict=True):
        pictures.append(_picture(image, layer))
        if pictures[-1].shape != pictures[0].shape:
            found = " and ".join(f"{one.shape[1]}x{one.shape[0]}" for one in (pictures[0], pictures[-1]))
            raise ValueError(f"expected pictures of one size, got {found}")
        tell(len(pictures))
    return pictures


def _picture(image: Any, layer: str | None) -> _Picture:
    name = "a picture"
    if isinstance(image, (str, os.PathLike)):
        name, (image, _) = os.fspath(image), load_image(image, layer)
    elif np.asarray(image).dtype.kind in "iu":
        raise ValueError(
            "expected linear floats in an array; pictures in files of 8 bits are made linear as they are read"
        )
    array = real_array(name, image, np.float64)
    if array.ndim == 2:
        array = np.repeat(array[..., None], 3, axis=2)
    if array.ndim != 3 or array.shape[2] != 3 or not np.isfinite(array).all():
        raise ValueError(f"expected {name} to be finite and of shape (height, width) or (height, width, 3)")
    return array


def _intensities(intensities: ArrayLike | None, count: int) -> NDArray[np.float64]:
    """(columns, 3)"""
    if intensities is None:
        return np.ones((count, 3))
    array = real_array("intensities", intensities, np.float64)
    if array.shape not in ((count,), (count, 3)) or not (np.isfinite(array) & (array > 0)).all():
        raise ValueError(f"expected intensities of shape ({count},) or ({count}, 3), finite and above 0")
    return np.broadcast_to(array.reshape(count, -1), (count, 3))


def _mask(mask: ArrayLike | _Path | None, shape: tuple[int, int]) -> NDArray[np.bool_]:
    if mask is None:
        return np.ones(shape, bool)
    if isinstance(mask, (str, os.PathLike)):
        mask = load_image(mask)[0][..., 0] > 0.5
    array = np.asarray(mask)
    if array.shape != shape:
        raise ValueError(f"expected a mask of shape {shape}, got {described(mask)} of shape {array.shape}")
    return array.astype(bool)


def _write_tiles(writer: TransportWriter, stack: NDArray[np.float64], columns: str, quantum: int) -> None:
    rows = TILE_ROWS * TILES_PER_SHARD
    for shard, first in enumerate(range(0, len(stack), rows)):
        part = np.ascontiguousarray(stack[first : first + rows])
        part = part[..., 0] if part.shape[2] == 1 else part
        made = CoreTransport.from_dense(part, columns=columns, tile_rows=TILE_ROWS, quantum=quantum)
        writer.write_shard("direct", shard, made.tiles())


def _receivers(rows: NDArray[np.intp], shape: tuple[int, int], seen: NDArray[np.bool_]) -> ReceiverTable:
    """A row for each pixel that counts. Where its surface lies, no picture says."""
    nowhere = np.zeros((len(rows), 3), np.float32)
    return ReceiverTable.pixels(
        image=shape,
        pixel=rows.astype(np.uint32),
        weight=np.ones(len(rows), np.float32),
        background=np.where(seen, 0, 1).astype(np.float32).ravel(),
        albedo=np.ones((len(rows), 3), np.float32),
        position=nowhere,
        normal=nowhere,
    )


def _plan(columns: Lamps, shape: tuple[int, int], picture: tuple[int, int], channels: int) -> Plan:
    what = "groups of lights" if columns.directions is None else "lamps"
    part = Part(
        name="direct",
        make="direct",
        rows=shape[0],
        columns=str(columns),
        column_count=shape[1],
        bands=1,
        channels=channels,
        factors=1,
        bounces=0,
        why=f"pictures under {shape[1]} {what}, all light that they hold",
    )
    notes = []
    if columns.directions is not None:
        notes.append(f"{100 * columns.covered:.0f} % of the sphere is within reach of a lamp")
    return Plan("pictures", 0, picture, "pictures", 0.0, parts=[part], notes=notes)
