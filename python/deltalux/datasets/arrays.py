"""The pictures of a data set as one array, read as it is asked for."""

from __future__ import annotations

import json
import tarfile
import tempfile
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..images.reading import load_image
from ..plain import MOST_TEXT, read_plain

if TYPE_CHECKING:
    import dask.array

__all__ = ["array_of"]

Place = tuple[Path, int, int]
"""Where a shard is, the number of its first picture, and how many there are."""


def array_of(shards: Sequence[Place], size: tuple[int, int]) -> dask.array.Array:
    """(pictures, height, width, 3) float32 of linear radiance, a shard a chunk; ValueError where dask is missing."""
    if find_spec("dask") is None:
        raise ValueError("expected dask for an array of pictures: pip install 'deltalux[arrays]'")
    import dask.array as da
    from dask.delayed import delayed

    # Functions of dask's have no types.
    lazy: Any = da
    read = delayed(_read, pure=True)
    chunks = [lazy.from_delayed(read(*shard), (shard[2], *size, 3), np.float32) for shard in shards]
    array: dask.array.Array = lazy.concatenate(chunks)
    return array


def _read(place: Path, first: int, count: int) -> NDArray[np.float32]:
    """All pictures of a shard."""
    keys = [f"{number:08}" for number in range(first, first + count)]
    if place.suffix != ".tar":
        return np.stack([_one(place, key) for key in keys])
    with tempfile.TemporaryDirectory() as folder, tarfile.open(place) as archive:
        archive.extractall(folder, filter="data")
        return np.stack([_one(Path(folder), key) for key in keys])


def _one(folder: Path, key: str) -> NDArray[np.float32]:
    path = folder / json.loads(read_plain(folder / f"{key}.json", MOST_TEXT))["files"]["picture"]
    if path.suffix != ".npz":
        return load_image(path)[0]
    with np.load(path) as arrays:
        return np.asarray(arrays["picture"][..., :3], np.float32)
