"""Transport of a studio: what surfaces send each other, for lamps that move and materials of families."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._core import LitPoints, ReceiverTable, SampleTree
from .._core import Scene as CoreScene
from ..brdf.family import Family
from ..camera import Camera
from ..columns.inner import Inner
from .coordinates import Coordinates
from .folder import Folder, array, stored_arrays
from .passing import NODES, Gathered, StudioNodes
from .receivers import Pixels
from .transport import Transport

__all__ = ["EACH", "FOLDER", "POINTS", "StudioPart", "StudioTransport"]

FOLDER = Folder("a transport of a studio", "studio.json", 2)
POINTS = ("origin", "normal", "horizon")
"""What is kept of points that lamps shine on."""
EACH = 4
"""Places of a cell at which light that arrives directly is looked at; their mean is the sample's."""


@dataclass(frozen=True, eq=False)
class StudioPart:
    """What one material of a family shows of the light of other surfaces.

    Attributes
    ----------
    name
        Of the material.
    number
        Its place among the scene's materials.
    family
        What its gamma is edited in.
    segments : tuple of Transport
        T_k of each segment of the family: a row for each pixel that shows the material, a factor for each function.
    rows : (n,) uint32
        Those pixels' places among all rows of the view.
    threshold
        At which T was truncated: that at which a frozen T is.
    """

    name: str
    number: int
    family: Family
    segments: tuple[Transport, ...]
    rows: NDArray[np.uint32]
    threshold: float

    @property
    def nbytes(self) -> int:
        """Bytes of all segments."""
        return sum(segment.nbytes for segment in self.segments)

    def __str__(self) -> str:
        return f"{self.name}: {self.family.model}, {len(self.rows):,} rows, {self.nbytes / 1e6:.1f} MB"


@dataclass(frozen=True, eq=False)
class StudioTransport:
    """What light does between the surfaces of a still scene after it has arrived, whatever the lamps.

    Made by `precompute_studio` and opened by `StudioTransport.open`; `Studio` relights and edits. Nothing in it
    changes.

    Attributes
    ----------
    path : Path
        The directory.
    pixels : Pixels
        The rows of the view.
    between : StudioNodes or Gathered
        What carries diffuse light from surface to surface.
    parts : mapping of str to StudioPart
        By the names of materials.
    passes : int
        How often light passes between surfaces before the view gathers it.
    camera : Camera
        Whose pixels the rows are.
    weights : (columns,) float64
        How much light is expected in each column.
    albedo : (samples, 3) float32
        Diffuse reflectances of the samples.
    material : (samples,) uint16
        Whose they are.
    seconds : float
        That it took to make.
    coordinates : Coordinates or None
        Texture coordinates, where the scene has some.
    """

    path: Path
    pixels: Pixels
    between: StudioNodes | Gathered
    parts: Mapping[str, StudioPart]
    passes: int
    camera: Camera
    weights: NDArray[np.float64]
    albedo: NDArray[np.float32]
    material: NDArray[np.uint16]
    seconds: float
    coordinates: Coordinates | None
    _arrays: Mapping[str, NDArray[Any]] = field(repr=False)
    _eyes: dict[str, NDArray[np.float32]] = field(default_factory=dict, repr=False)

    @property
    def nbytes(self) -> int:
        """Bytes of all matrices."""
        return sum(self.between.sizes) + sum(part.nbytes for part in self.parts.values())

    @cached_property
    def scene(self) -> CoreScene:
        """The surfaces ready for rays."""
        surfaces = (self._arrays[name] for name in ("vertices", "triangles", "of_triangle"))
        return CoreScene(*surfaces, eye=self.camera.position)

    @cached_property
    def view(self) -> LitPoints:
        """The rows of the view, which lamps shine on."""
        return self._points("view")

    @cached_property
    def cells(self) -> LitPoints:
        """`EACH` points of the cell of each sample."""
        return self._points("cell")

    @cached_property
    def nodes(self) -> LitPoints:
        """`EACH` points of the cell of each node."""
        return self._points("node")

    def _points(self, of: str) -> LitPoints:
        origin, normal, horizon = (self._arrays[f"{of}_{what}"] for what in ("origin", "normal", "horizon"))
        return LitPoints.of_arrays(self.scene, origin, normal, horizon)

    @cached_property
    def tree(self) -> SampleTree:
        """The wavelets over the samples."""
        return SampleTree(self._arrays["areas"])

    def surfaces(self, of: str) -> tuple[NDArray[np.float32], NDArray[np.uint16]]:
        """Diffuse reflectances, and the materials that have them.

        Parameters
        ----------
        of
            "view", "samples" or "nodes".

        Returns
        -------
        (k, 3) float32 and (k,) uint16
        """
        if of == "view":
            assert self.pixels.material is not None
            return self.pixels.albedo, self.pixels.material
        if of == "samples":
            return self.albedo, self.material
        assert isinstance(self.between, StudioNodes)
        return self.between.albedo, self.between.material

    def eyes_of(self, part: StudioPart) -> NDArray[np.float32]:
        """Unit vectors to the camera from the rows of a material.

        Parameters
        ----------
        part
            The material.

        Returns
        -------
        (n, 3) float32
        """
        if part.name not in self._eyes:
            way = np.asarray(self.camera.position) - self.pixels.position[part.rows]
            self._eyes[part.name] = np.asarray(way / np.linalg.norm(way, axis=1, keepdims=True), np.float32)
        return self._eyes[part.name]

    @property
    def areas(self) -> NDArray[np.float64]:
        """Of what samples stand for, in units of the tree: (samples,)."""
        return self._arrays["areas"]

    @staticmethod
    def open(path: str | os.PathLike[str]) -> StudioTransport:
        """Opens a directory that `precompute_studio` made.

        Parameters
        ----------
        path
            The directory.

        Returns
        -------
        StudioTransport

        Raises
        ------
        FileError
            (a ValueError) If it holds something else, or a file is damaged.
        OSError
            If a file cannot be read.
        """
        path = Path(path)
        with FOLDER.opened(path) as (about, stored):
            samples = len(stored["areas"])
            view = {name[6:]: own for name, own in stored.items() if name.startswith("pixel_")}
            camera, seconds = Camera(**about["camera"]), float(about["seconds"])
            if view.pop("image").tolist() != [camera.height, camera.width]:
                raise ValueError("expected pixels of the camera's picture")
            pixels = Pixels(ReceiverTable.pixels(image=(camera.height, camera.width), **view))
            between, beside = _between(path, len(pixels), samples)
            stored |= beside
            nodes = len(between) if isinstance(between, StudioNodes) else 0
            _check(stored, len(pixels), samples, nodes)
            coordinates = Coordinates.of_arrays(stored, len(pixels), samples, nodes)
            parts = {own["name"]: _part(path, own, stored) for own in about["parts"]}
            weights, albedo, material = (stored[name] for name in ("weights", "albedo", "material"))
            passes = int(about["passes"])
            if not 0 <= passes <= 64:
                raise ValueError(f"expected passes from 0 to 64, found {passes}")
            return StudioTransport(
                path, pixels, between, parts, passes, camera, weights, albedo, material, seconds, coordinates, stored
            )

    def __repr__(self) -> str:
        rows, samples = len(self.pixels), len(self.albedo)
        return f"<StudioTransport of {rows:,} rows and {samples:,} samples, {self.nbytes / 1e6:.1f} MB>"


def _between(path: Path, rows: int, samples: int) -> tuple[StudioNodes | Gathered, dict[str, NDArray[Any]]]:
    """What carries diffuse light, and the arrays of nodes."""
    if (path / NODES).exists():
        stored = stored_arrays(path / NODES)
        points = {name: own for name, own in stored.items() if name.startswith("node_") or name == "uv_nodes"}
        return StudioNodes.of_arrays(stored, rows, samples), points
    between = Gathered(Transport.open(path / "diffuse"), Transport.open(path / "bounces"))
    if between.diffuse.shape[0] != rows or between.bounces.shape[0] != samples:
        raise ValueError(f"expected matrices of {rows} rows and {samples} samples, found others")
    if {str(own.columns) for own in (between.diffuse, between.bounces)} != {f"tree:{samples}"}:
        raise ValueError(f"expected matrices over the tree of their samples, found {between.bounces.columns}")
    return between, {}


def _check(stored: Mapping[str, NDArray[Any]], rows: int, samples: int, nodes: int) -> None:
    """Shapes and kinds of all arrays, whoever wrote them."""
    triangles, columns = len(stored["triangles"]), Inner(f"tree:{samples}").columns
    shapes: dict[str, tuple[type, tuple[int, ...]]] = {
        "vertices": (np.float64, (len(stored["vertices"]), 3)),
        "triangles": (np.uint32, (triangles, 3)),
        "of_triangle": (np.uint32, (triangles,)),
        "areas": (np.float64, (samples,)),
        "weights": (np.float64, (columns,)),
        "albedo": (np.float32, (samples, 3)),
        "material": (np.uint16, (samples,)),
    }
    for of, count in (("view", rows), ("cell", samples * EACH), ("node", nodes * EACH)):
        if count:
            shapes |= {f"{of}_{what}": (np.float32, (count, 3)) for what in POINTS}
    for name, (kind, shape) in shapes.items():
        array(stored, name, kind, shape)
    if not ((stored["weights"] > 0).all() and (stored["albedo"] >= 0).all() and (stored["areas"] > 0).all()):
        raise ValueError("expected weights and areas above 0, and albedos of at least 0")


def _part(folder: Path, about: Mapping[str, Any], stored: Mapping[str, NDArray[Any]]) -> StudioPart:
    """One material of a manifest."""
    number = int(about["number"])
    low, high = about["range"]
    parts, f0 = int(about["segments"]), float(about["f0"])
    family = Family(about["model"], (low, high), live=int(about["live"]), segments=parts, f0=f0)
    segments = tuple(Transport.open(folder / f"part-{number}-{k}") for k in range(family.segments))
    rows = stored[f"rows_{number}"]
    if rows.dtype != np.uint32 or rows.shape != (segments[0].shape[0],):
        raise ValueError(f"expected the rows of {about['name']}, found {rows.dtype} {rows.shape}")
    if any(segment._core.factors != family.live for segment in segments):
        raise ValueError(f"expected {family.live} factors of {about['name']}")
    return StudioPart(str(about["name"]), number, family, segments, rows, float(about["threshold"]))
