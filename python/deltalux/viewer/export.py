"""A page that relights by itself: M of a small picture in a file beside it, and no server."""

from __future__ import annotations

import base64
import json
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._core import __version__
from ..columns.haar import Haar
from ..light.environment import Environment
from ..output import check_folder, claim
from ..precomputation.run import precompute
from ..progress import Progress
from ..relight.errors import relative_errors
from ..scene.scene import Scene
from ..transport.transport import Transport
from .preview import resized

__all__ = ["Exported", "export"]

_LONGER, _SIZE = 128, 16
"""Pixels along the longer edge, and texels along a face."""
_MAP = 64
"""Texels along a face of the maps of light."""
_LARGEST = 15e6
_ENTRIES = 4.5e6
"""Entries of M that fit besides all else, times what each takes beside one of a single channel."""
_BATCH = 96
_STATIC = Path(__file__).parent / "static"
_DATA = "data.js"


@dataclass(frozen=True)
class Exported:
    """What was written.

    Attributes
    ----------
    page
        To be opened in a browser.
    nbytes
        Of all files.
    entries
        Of M.
    errors
        Relative L2 error of the picture that 8 bits an entry and entries that were left out make, by light.
    """

    page: Path
    nbytes: int
    entries: int
    errors: Mapping[str, float]

    def __str__(self) -> str:
        worst = max(self.errors.values())
        return (
            f"{self.page}: {self.nbytes / 1e6:.1f} MB, {self.entries:,} entries of M of 8 bits, which cost at most "
            f"{100 * worst:.2g} % under its {len(self.errors)} lights"
        )


def export(
    scene: Scene | Transport, folder: Path, lights: Mapping[str, Environment], progress: bool | Progress = True
) -> Exported:
    """Writes the page.

    Parameters
    ----------
    scene
        What is relit; of a transport the scene that it keeps, with as many bounces.
    folder
        To make, or to write into anew.
    lights
        By name, to choose from; the first one is shown.
    progress
        As for `precompute`.

    Raises
    ------
    ValueError
        If a transport keeps no scene, or the page would be larger than 15 MB.
    OSError
        If the disk refuses.
    """
    names = [*sorted(own.name for own in _STATIC.iterdir()), _DATA]
    check_folder(folder, names)
    bounces: int | str = 0
    if isinstance(scene, Transport):
        bounces = "all" if scene.bounces < 0 else scene.bounces
        scene = Scene.of_surface(scene.surface, scene.camera, scene.plan.scene)
    seen = scene.with_camera(resized(scene.camera, _LONGER))
    with tempfile.TemporaryDirectory(prefix="deltalux-export-") as place:
        path = Path(place) / "page.transport"
        transport = precompute(seen, path, columns=Haar(_SIZE), bounces=bounces, progress=progress)
        data, errors, entries = _data(transport, scene.name, lights)
    text = f"window.DELTALUX = {json.dumps(data, separators=(',', ':'))};\n"
    files = {own.name: own.read_bytes() for own in _STATIC.iterdir()} | {_DATA: text.encode()}
    nbytes = sum(map(len, files.values()))
    if nbytes > _LARGEST:
        raise ValueError(f"expected a page of at most {_LARGEST / 1e6:.0f} MB, but this scene takes {nbytes / 1e6:.1f}")
    target = claim(folder, names)
    for name, content in files.items():
        (target / name).write_bytes(content)
    return Exported(target / "index.html", nbytes, entries, errors)


def _data(
    transport: Transport, name: str, lights: Mapping[str, Environment]
) -> tuple[dict[str, Any], dict[str, float], int]:
    """All that the page is told; by light, what 8 bits cost; and the entries of M."""
    columns = transport.columns
    assert isinstance(columns, Haar)
    dense = _dense(transport)
    scales = np.abs(dense).max(axis=(1, 2)).astype(np.float32) / np.float32(127)
    whole = np.rint(dense / np.where(scales > 0, scales, 1)[:, None, None]).astype(np.int8)
    coefficients = {light: transport.coefficients(env) for light, env in lights.items()}
    _thin(whole, np.abs(dense), columns, list(coefficients.values()))
    errors = {}
    for light, V in coefficients.items():
        coarse = np.einsum("crk,ck->rk", whole.astype(np.float64), V * scales[:, None])
        exact = transport.multiply(V)
        errors[light] = relative_errors(transport.albedo * coarse, transport.albedo * exact)[1]
    there = whole.any(axis=2)
    starts = np.concatenate([[0], np.cumsum(there.sum(axis=1))]).astype(np.uint32)
    pixels, camera = transport.pixels, transport.camera
    open_ = np.flatnonzero(pixels.background.reshape(-1) > 0)
    base = transport.image(np.zeros((transport.shape[0], 3), np.float32))
    arrays = {
        "starts": starts,
        "rows": np.nonzero(there)[1].astype(np.uint32 if transport.shape[0] > 0xFFFF else np.uint16),
        "values": whole[there],
        "scales": scales,
        "bands": columns.bands.astype(np.uint8),
        "pixel": pixels.pixel.astype(np.uint32),
        "weight": pixels.weight,
        "albedo": pixels.albedo,
        "open": open_.astype(np.uint32),
        "share": pixels.background.reshape(-1)[open_],
        "towards": camera.directions().reshape(-1, 3)[open_].astype(np.float32),
        **({"base": base} if base.any() else {}),
    }
    data = {
        "version": __version__,
        "name": name,
        "width": camera.width,
        "height": camera.height,
        "size": columns.size,
        "channels": dense.shape[2],
        "arrays": {key: _coded(array) for key, array in arrays.items()},
        "map": _MAP,
        "lights": {light: _coded(_shared_exponents(env.cubemap(_MAP))) for light, env in lights.items()},
        "errors": errors,
    }
    return data, errors, int(there.sum())


def _thin(
    whole: NDArray[np.int8], sizes: NDArray[np.float32], columns: Haar, lights: Sequence[NDArray[np.float64]]
) -> None:
    """Leaves out entries that matter least under the lights until the page is small enough."""
    # How much light a column of a band carries, in the mean of all turns.
    energy = np.mean([np.bincount(columns.bands, (V**2).sum(axis=1)) for V in lights], axis=0)
    carried = np.sqrt(energy / np.bincount(columns.bands))[columns.bands].astype(np.float32)
    worth = sizes.max(axis=2) * carried[:, None]
    there = whole.any(axis=2)
    most = int(_ENTRIES / (1 + whole.shape[2] / 2))
    if (count := int(there.sum())) > most:
        least = np.partition(worth[there], count - most)[count - most]
        whole[worth < least] = 0


def _dense(transport: Transport) -> NDArray[np.float32]:
    """M as it multiplies, (columns, rows, channels): whatever its parts are, a product for each column."""
    rows, columns = transport.shape
    # Without bounces of colours, three columns are multiplied as the three colours of one light.
    one = transport.channels == 1
    dense = np.empty((columns, rows, 1 if one else 3), np.float32)
    step = 3 * _BATCH if one else _BATCH
    for first in range(0, columns, step):
        own = np.arange(first, min(first + step, columns))
        if one:
            lights = np.zeros((-(-len(own) // 3), columns, 3))
            lights[np.arange(len(own)) // 3, own, np.arange(len(own)) % 3] = 1.0
            dense[own, :, 0] = transport.multiply(lights).swapaxes(1, 2).reshape(-1, rows)[: len(own)]
        else:
            lights = np.zeros((len(own), columns, 3))
            lights[np.arange(len(own)), own] = 1.0
            dense[own] = transport.multiply(lights)
    return dense


def _shared_exponents(colours: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Radiance's RGBE (Ward 1991): (.., 4) bytes."""
    largest = np.maximum(colours, 0).max(axis=-1)
    mantissa, exponent = np.frexp(np.where(largest > 1e-30, largest, 1.0))
    scale = np.where(largest > 1e-30, mantissa * 256.0 / np.where(largest > 1e-30, largest, 1.0), 0.0)
    bytes_ = np.zeros((*colours.shape[:-1], 4), np.uint8)
    bytes_[..., :3] = np.floor(np.maximum(colours, 0) * scale[..., None]).clip(0, 255)
    bytes_[..., 3] = np.where(largest > 1e-30, exponent + 128, 0).clip(0, 255)
    return bytes_


def _coded(array: NDArray[Any]) -> list[str]:
    """The type and the bytes of an array, in letters."""
    return [str(array.dtype), base64.b64encode(np.ascontiguousarray(array).tobytes()).decode()]
