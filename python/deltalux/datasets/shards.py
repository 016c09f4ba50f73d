"""Shards: some pictures of one camera, made in one piece by whoever is asked, and put into their place whole.

What a shard holds follows from its task alone: any worker makes the same bytes, and one that is killed leaves nothing
but a folder whose name begins with a dot.
"""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import tarfile
import time
import uuid
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._core import __version__
from ..camera import Camera
from ..io import auto_exposure
from ..light.environment import Environment
from ..relight.backdrop import Backdrop
from ..transport.transport import Transport
from .encoding import PICTURES, Format
from .lights import LightRecipe, Source

__all__ = ["CAMERAS", "SHARDS", "Lit", "Made", "Shard", "camera_layers", "lit", "split_of", "write_shard"]

SHARDS, CAMERAS = "pictures", "cameras"
_TOGETHER = 32
"""Lights of one product: as many as the core takes through M at once."""
_ROOM = 64 << 20
"""Bytes that these and their products may have, where that is no less than eight."""


@dataclass(frozen=True, eq=False)
class Shard:
    """What a worker is asked for.

    Attributes
    ----------
    folder
        Of the data set.
    number
        Of the shard.
    first
        The number of its first picture.
    recipes, lights
        Its lights, and their numbers.
    transport, camera, view
        What is looked at: M, from where, and the number of that.
    sources
        The environments by their names.
    still
        Files of what no light changes, by their layers, from a sidecar's folder on.
    layers, format, tar
        What a sample has, and how it is written.
    background, exposure
        As of the data set; None: each picture has an exposure of its own.
    coefficients
        Whether V is kept.
    seed, splits
        Of the rule by which lights are drawn and parted.
    """

    folder: str
    number: int
    first: int
    recipes: tuple[LightRecipe, ...]
    lights: range
    transport: Transport
    camera: Camera
    view: int
    sources: Mapping[str, Source]
    still: Mapping[str, str]
    layers: tuple[str, ...]
    format: Format
    tar: bool
    background: str
    exposure: float | None
    coefficients: bool
    seed: int
    splits: tuple[tuple[str, float], ...]

    @property
    def place(self) -> Path:
        """Where it is once it is whole."""
        return Path(self.folder) / SHARDS / (f"{self.number:05}.tar" if self.tar else f"{self.number:05}")


@dataclass(frozen=True)
class Made:
    """What a shard took: pictures, and seconds in all, of its products, and of encoding."""

    pictures: int
    seconds: float
    products: float
    encoding: float


def split_of(seed: int, light: int, splits: Sequence[tuple[str, float]]) -> str:
    """The part that a light belongs to, from all cameras: by a hash of the seed and its number, and of nothing else."""
    digest = hashlib.blake2b(f"{seed} {light}".encode(), digest_size=8).digest()
    left = int.from_bytes(digest, "big") / 2**64 * sum(share for _, share in splits)
    for name, share in splits:
        left -= share
        if left < 0:
            return name
    return splits[-1][0]


def camera_layers(transport: Transport, layers: Sequence[str]) -> dict[str, NDArray[Any]]:
    """What of a sample no light changes."""
    return {name: transport.aov(name) for name in layers if name not in PICTURES}


@dataclass(frozen=True, eq=False)
class Lit:
    """One picture, before it is a file."""

    arrays: dict[str, NDArray[Any]]
    bound: float | None
    V: NDArray[np.float64]


def lit(
    transport: Transport, backdrop: Backdrop, lights: Sequence[Environment], layers: Sequence[str], exposure: float
) -> Iterator[Lit]:
    """Pictures under some lights, a few products at a time; and what of each is direct, where that is asked for."""
    bounded = transport.second_columns is None and transport.factors == 1
    apart = [name for name in ("direct", "indirect") if name in layers]
    rows, columns = transport.shape
    together = min(max(_ROOM // (12 * rows + 24 * columns), 8), _TOGETHER)
    for start in range(0, len(lights), together):
        some = lights[start : start + together]
        V = np.stack([transport.coefficients(light) for light in some])
        products = transport.multiply(V)
        direct = transport.direct.multiply(V) if apart else products
        bounds = [float(bound) for bound in transport.bounds(V)] if bounded else [None] * len(some)
        for k, light in enumerate(some):
            arrays: dict[str, NDArray[Any]] = {"picture": backdrop.picture(products[k], light, exposure)}
            if apart:
                seen = transport.image(direct[k])
                both = {"direct": seen, "indirect": transport.image(products[k]) - seen}
                arrays |= {name: both[name] for name in apart}
            yield Lit(arrays, bounds[k], V[k])


def write_shard(shard: Shard) -> Made:
    """Makes a shard, unless it is there already.

    Returns
    -------
    Made
        What it took.
    """
    started = time.perf_counter()
    if shard.place.exists():
        return Made(0, 0.0, 0.0, 0.0)
    beside = shard.place.with_name(f".{shard.place.name}.{uuid.uuid4().hex}")
    beside.mkdir()
    try:
        encoding = _write_samples(shard, beside)
        packing = time.perf_counter()
        _publish(shard, beside)
        encoding += time.perf_counter() - packing
    finally:
        shutil.rmtree(beside, ignore_errors=True)
    seconds = time.perf_counter() - started
    return Made(len(shard.recipes), seconds, seconds - encoding, encoding)


def _write_samples(shard: Shard, folder: Path) -> float:
    """All files of a shard into a folder; seconds of encoding."""
    encoding = 0.0
    backdrop = Backdrop(
        shard.transport, shard.background, shard.camera if shard.transport.receivers.kind == "vertices" else None
    )
    # A sample of a tar is read without its neighbours.
    still = camera_layers(shard.transport, shard.layers) if shard.tar else {}
    lights = [recipe.light(shard.sources) for recipe in shard.recipes]
    for k, one in enumerate(lit(shard.transport, backdrop, lights, shard.layers, shard.exposure or 0.0)):
        started = time.perf_counter()
        key = f"{shard.first + k:08}"
        arrays = one.arrays | still | ({"light": one.V} if shard.coefficients else {})
        exposure = auto_exposure(one.arrays["picture"]) if shard.exposure is None else shard.exposure
        files = shard.format.write(folder, key, arrays, exposure)
        about = _about(shard, k, one, exposure, files)
        (folder / f"{key}.json").write_text(json.dumps(about, sort_keys=True) + "\n", encoding="utf-8")
        encoding += time.perf_counter() - started
    return encoding


def _about(shard: Shard, k: int, one: Lit, exposure: float, files: Mapping[str, str]) -> dict[str, Any]:
    """The sidecar of a picture."""
    return {
        "number": shard.first + k,
        "seed": shard.seed,
        "split": split_of(shard.seed, shard.lights[k], shard.splits),
        "light": {"number": shard.lights[k], "layers": [_layer(shard, layer) for layer in shard.recipes[k].layers]},
        "camera": {"number": shard.view, **asdict(shard.camera)},
        "background": shard.background,
        "exposure": exposure if shard.format.encoding == "srgb" else None,
        "encoding": shard.format.encoding,
        "bound": one.bound,
        "columns": str(shard.transport.columns),
        "transport": shard.transport.digest,
        "files": {**files, **shard.still},
        "software": f"deltalux {__version__}",
    }


def _layer(shard: Shard, layer: Any) -> dict[str, Any]:
    source = None if layer.environment is None else shard.sources[layer.environment]
    about = asdict(layer) | {"matrix": layer.matrix}
    return about | ({} if source is None else {"sha256": source.sha256, "file": source.name})


def _publish(shard: Shard, beside: Path) -> None:
    """Puts a shard that is whole into its place, where another may have been quicker."""
    if shard.tar:
        packed = beside / "all.tar"
        _pack(beside, packed)
        os.replace(packed, shard.place)
        return
    for file in beside.iterdir():
        _sync(file)
    try:
        os.rename(beside, shard.place)
    except OSError:
        if not shard.place.exists():
            raise


def _pack(folder: Path, path: Path) -> None:
    """A tar of the files of a folder by their names, sample after sample; nothing in it says when or by whom."""
    names = sorted(file.name for file in folder.iterdir())
    with open(path, "wb") as whole, tarfile.open(fileobj=whole, mode="w", format=tarfile.USTAR_FORMAT) as archive:
        for name in names:
            entry = tarfile.TarInfo(name)
            entry.size, entry.mode = (folder / name).stat().st_size, 0o644
            with open(folder / name, "rb") as file:
                archive.addfile(entry, file)
    _sync(path)


def _sync(path: Path) -> None:
    with open(path, "rb") as file:
        os.fsync(file.fileno())
