"""Precomputation of a studio: what surfaces send each other of any light, for materials of families (Nguyen 2010).

    L   = L_d + rho (indirect light there)       light that leaves the gather samples
    B   = direct + k_d (indirect light there) + k_s sum_k c_k(gamma) T_k L

T_k are made here, over wavelets on the tree of the samples; and what carries diffuse light: nodes, or D and M_s as they
were published. All else is the run time's.
"""

from __future__ import annotations

import json
import os
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .._core import (
    Bounces,
    GatherPass,
    GatherSamples,
    LitPoints,
    Receivers,
    ReceiverTable,
    SampleTree,
    TileData,
    TransportWriter,
    __version__,
)
from .._core import Nodes as CoreNodes
from ..brdf.family import Family
from ..checks import count
from ..columns.inner import Inner
from ..light.lamps import PointLight, Spot
from ..progress import Progress, reporter
from ..scene.scene import Scene
from ..surface.shading import footprints
from ..transport.entry import TILES_PER_SHARD
from ..transport.passing import NODES, StudioNodes
from ..transport.plan import Part, Plan
from ..transport.studio import EACH, FOLDER, POINTS, StudioTransport
from .between import MOST_NODES, linked
from .preparation import shaded
from .quality import QUALITIES
from .room import check_folder_of, check_gathering, check_request, claim

__all__ = ["precompute_studio"]

QUANTUM = -30
"""Rows are in units of the root of an area: far smaller numbers than those of light from everywhere."""
_TILE_ROWS = 2048
_FEWEST, _MOST = 64, 1 << 18
_BUNDLES = 6
# Lamps that the light in each column is expected from, and under which truncation is measured.
_LAMPS, _MEASURED = 24, 4
_GAMMAS = 24


def precompute_studio(
    scene: Scene,
    path: str | os.PathLike[str],
    *,
    families: Mapping[str, Family],
    gather: int = 16384,
    bounces: int = 2,
    nodes: int | str = "auto",
    quality: str = "publication",
    tolerance: float | None = None,
    progress: bool | Progress = True,
) -> StudioTransport:
    """Ray traces what surfaces send each other, for lamps that move and materials that are edited, into a directory.

    Light that arrives from lamps is traced at run time; what it does then is a product with what is made here. A run
    that is interrupted resumes where it stopped when it is called again with the same arguments. (Nguyen 2010.)

    Parameters
    ----------
    scene
        Geometry, materials and camera. All materials are diffuse, but for those of families.
    path
        Directory to make. A studio that is there is replaced; anything else is not.
    families
        By the names of the scene's materials: the lobe that each has besides its diffuse albedo. At its start gamma is
        the least of the range, and k_s is 0.3.
    gather
        Gather samples: points of surfaces from which light is gathered, as the camera sees them.
    bounces
        How often light is reflected between lamp and the surface that is seen: 1 from sample to view, each further one
        between surfaces, which are diffuse.
    nodes
        The most nodes between which diffuse light passes, as for `precompute`, or "auto". 0: none; gather samples carry
        it, by the published matrices D and M_s, which take more bytes and time and lose about 3 % of the light.
    quality
        "preview", "publication" or "lossless" (`QUALITIES`): of truncation, and of nodes.
    tolerance
        Relative L2 error of what each matrix shows that truncation may cause, under the worst of some lamps and gammas
        (default: the quality's).
    progress
        True: a bar on standard error. A callable: progress(rows done, rows in all).

    Returns
    -------
    StudioTransport
        Opened from `path`.

    Raises
    ------
    ValueError
        If an argument cannot be used, a material is not in the scene or no pixel shows it; before any long work.
    FileExistsError
        If something else is at `path`.
    OSError
        If the disk refuses; what was finished is kept for the next run.
    """
    if quality not in QUALITIES:
        raise ValueError(f"expected a quality of {', '.join(QUALITIES)}, got {quality!r}")
    allowed = QUALITIES[quality].tolerance if tolerance is None else tolerance
    if not 0 <= allowed < 1:
        raise ValueError(f"expected a tolerance from 0 to 1 (0.01 is 1 %), got {tolerance!r}")
    gather, bounces = count("gather", gather), count("bounces", bounces)
    if not _FEWEST <= gather <= _MOST:
        raise ValueError(f"expected {_FEWEST} to {_MOST:,} gather samples, got {gather}")
    if not 1 <= bounces <= 16:
        raise ValueError(f"expected 1 to 16 bounces, got {bounces}")
    if isinstance(nodes, str) and nodes != "auto":
        raise ValueError(f'expected nodes to be "auto" or the most there may be, got {nodes!r}')
    cap = MOST_NODES if isinstance(nodes, str) else count("nodes", nodes)
    return _Studio(scene, dict(families), gather, bounces, cap, (quality, float(allowed)), progress).run(Path(path))


class _Work(NamedTuple):
    """What is made of one kernel, or of one family."""

    name: str
    made: GatherPass
    table: ReceiverTable
    scales: NDArray[np.float64]
    """How much of each factor is taken."""
    mixes: list[list[float]]
    """What pictures take of the factors, under which truncation is measured."""


class _Studio:
    """One request: materials checked, then the run."""

    def __init__(
        self,
        scene: Scene,
        families: dict[str, Family],
        gather: int,
        bounces: int,
        cap: int,
        quality: tuple[str, float],
        progress: bool | Progress,
    ) -> None:
        check_request(scene)
        for name, family in families.items():
            if not isinstance(family, Family):
                raise ValueError(f"expected a dl.Family for {name}, got {family!r}")
            again = Family(family.model, family.range, live=family.live, segments=family.segments, f0=family.f0)
            if again.errors != family.errors:
                raise ValueError(f"expected a family of segments for {name}, got {family!r} by Family.even")
        self.numbers = {name: scene.numbered(name) for name in families}
        if scene.emission is not None:
            raise ValueError("expected a scene whose surfaces give off no light: give it lamps at run time")
        shiny = [
            n for n, model in enumerate(scene.models or ()) if model is not None and n not in self.numbers.values()
        ]
        if shiny:
            raise ValueError(f"expected a family for every glossy material, but none is given for number {shiny[0]}")
        self.scene, self.families, self.gather, self.passes = scene, families, gather, bounces - 1
        self.cap = cap
        self.quality, self.tolerance = quality
        if any(cutout is not None for cutout in scene.cutouts):
            raise ValueError("expected a scene whose surfaces are whole: lamps at run time see no holes in them")
        functions = max((family.live * family.segments for family in families.values()), default=0)
        check_gathering(scene, gather, max(functions, 0 if cap else 1))
        self.tell = reporter(progress, f"studio of {scene.name}")
        self.tell.begin("receivers")
        self.core, self.camera = scene.traced(scene.camera.position), scene.camera.rays()
        self.rows = shaded(scene, self.core.receivers(self.camera, edges=QUALITIES[self.quality].edges), tangents=False)
        self.material = scene.material[self.rows.triangle]
        self.of = {name: np.flatnonzero(self.material == number) for name, number in self.numbers.items()}
        unseen = [name for name, own in self.of.items() if not own.size]
        if unseen or not len(self.rows):
            raise ValueError(
                f"expected materials that the camera sees, but no pixel shows {', '.join(unseen) or 'any'}"
            )

    def run(self, path: Path) -> StudioTransport:
        """Part after part, and last what says that all is there."""
        started = time.perf_counter()
        check_folder_of(path)
        claim(path, "a studio", self._job())
        tell = self.tell
        tell.begin("gather samples")
        glossy = np.isin(self.scene.material, list(self.numbers.values()))
        self.samples = GatherSamples.place(self.core, self.camera, glossy, self.gather)
        self.cells = LitPoints.of_cells(self.core, self.samples, EACH)
        self.tree = SampleTree(self.samples.tree_areas)
        self.albedo, self.of_sample = self._albedo()
        lights = [self.tree.forward(light) for light in self._lamplight()]
        self.weights = _prior(lights, self.tree.columns)
        self.lights = _broadest(lights)
        works = self._works()
        total, done = sum(len(work.table) for work in works), 0
        if self.cap:
            # Of nodes there are a few thousand, whatever the rows.
            tell.step("nodes")
            done = 2 * len(self.rows)
            total += done
            self._nodes(path, tell.after(0, total))
        thresholds: dict[str, float] = {}
        for work in works:
            tell.step(work.name)
            thresholds[work.name] = self._part(path, work, tell.after(done, total))
            done += len(work.table)
        self._finish(path, thresholds, time.perf_counter() - started)
        tell(total, total)
        return StudioTransport.open(path)

    def _works(self) -> list[_Work]:
        """T of each family, and D and M_s where there are no nodes."""
        one, eye = np.ones(1), self.scene.camera.position
        works = []
        if not self.cap:
            diffuse = GatherPass(self.samples, (self.rows, eye), [None])
            bounces = GatherPass(self.samples, None, [None])
            works = [
                _Work("diffuse", diffuse, self._pixels(self.rows), one, [[1.0]]),
                _Work("bounces", bounces, self._table(), one, [[1.0]]),
            ]
        for name, family in self.families.items():
            rows = self._rows(name)
            # A border belongs to the segment below it.
            made = GatherPass(self.samples, (rows, eye), [(family._core, border) for border in family.borders[1:]])
            works.append(_Work(name, made, self._pixels(rows), *_mixes(family)))
        return works

    def _nodes(self, path: Path, tell: Callable[[int], None]) -> None:
        """Nodes, how light passes between them, and who takes from them; unless a run before has made them."""
        if (path / NODES).exists():
            return
        settings, scene, core = QUALITIES[self.quality], self.scene, self.core
        placed = CoreNodes.place(core, self.rows, self.camera, share=settings.spacing, cap=self.cap)
        # A cell's colour is the mean of its points: textures are finer than nodes.
        colours = scene.albedo_at(placed.triangle, placed.barycentric).reshape(len(placed), EACH, 3)
        albedo = np.ascontiguousarray(colours.mean(axis=1), np.float32)
        between = Bounces(core, placed, albedo, side=settings.node_rays, progress=lambda _: tell(0))
        sources = between.sources()
        tell(len(self.rows) // 2)
        view = linked(sources, core, self.rows, settings, lambda done: tell(len(self.rows) // 2 + done))
        places = LitPoints.of_cells(core, self.samples, 1)
        samples = linked(sources, core, places, settings, lambda _: tell(3 * len(self.rows) // 2))
        material = scene.material[placed.triangle[::EACH]].astype(np.uint16)
        made = StudioNodes(between.factors(), albedo, material, view.weights, samples.weights)
        points = placed.points(core).arrays()
        beside: dict[str, np.ndarray] = {f"node_{what}": own for what, own in zip(POINTS, points, strict=True)}
        if scene.uv is not None:
            beside["uv_nodes"] = scene.uv_at(placed.triangle, placed.barycentric).reshape(len(placed), EACH, 2)
        made.save(path, beside)

    def _rows(self, name: str) -> Receivers:
        """The receivers that show a material."""
        own = [number == self.numbers[name] for number in range(len(self.scene.albedo))]
        return self.rows.glossy(self.material, own, [[] for _ in own], self.scene.camera.position)

    def _albedo(self) -> tuple[NDArray[np.float32], NDArray[np.uint16]]:
        """Diffuse reflectances of the samples, in the mean over their cells, and their materials."""
        starts = self.samples.cell_starts.astype(np.intp)
        triangles, barycentric = self.samples.cell_places()
        each = self.scene.albedo_at(triangles, barycentric)
        mean = np.add.reduceat(each, starts[:-1]) / np.diff(starts)[:, None]
        return mean.astype(np.float32), self.scene.material[triangles[starts[:-1]]].astype(np.uint16)

    def _lamplight(self) -> Iterator[NDArray[np.float64]]:
        """Light at the samples of lamps all over the scene: half shine everywhere, half down a cone."""
        low, high = self.scene.vertices.min(axis=0), self.scene.vertices.max(axis=0)
        share = (0.5 + np.outer(np.arange(1, _LAMPS + 1), [0.8191725, 0.6710436, 0.5497005])) % 1  # R3 of Roberts 2018
        middle = 0.5 * (low + high)
        for number, place in enumerate(low + (0.1 + 0.8 * share) * (high - low)):
            aim = middle + (middle - place) * 0.5
            lamp = PointLight(place) if number % 2 else Spot(place, aim if np.any(aim != place) else low, angle=35)
            (part,) = lamp._parts
            light = self.albedo * self.cells.irradiance(part, self.cells.sights(part), together=EACH)
            if light.any():
                yield light

    def _part(self, path: Path, work: _Work, tell: Callable[[int], None]) -> float:
        """One matrix, or of a family all factors of all segments: a survey for the threshold, then tile after tile."""
        folders, each = _folders(path, work.name, self.numbers, self.families)
        known = path / f"{folders[0].name}.survey"
        if not known.exists():
            known.write_text(json.dumps(self._surveyed(work)), encoding="utf-8")
        found = json.loads(known.read_text(encoding="utf-8"))
        threshold, width = float(found[0]), str(found[1])
        shared: dict[str, Any] = {"weights": self.weights, "scales": work.scales, "quantum": QUANTUM, "width": width}
        if all(folder.exists() for folder in folders):
            return threshold
        writers = [TransportWriter(folder, self._job() + folder.name) for folder in folders]
        names = [f"function_{k}" for k in range(each)] if each > 1 else ["gathered"]
        rows = len(work.table)
        tiles = range(-(-rows // _TILE_ROWS))
        finished = set.intersection(*(set(writer.finished(own)) for writer in writers for own in names))
        for shard in range(-(-len(tiles) // TILES_PER_SHARD)):
            if shard in finished:
                continue
            numbers = tiles[shard * TILES_PER_SHARD : (shard + 1) * TILES_PER_SHARD]

            def of_tile(number: int) -> list[TileData]:
                first = number * _TILE_ROWS
                last = min(first + _TILE_ROWS, rows)
                made = work.made.tiles(
                    first, last - first, threshold=threshold, progress=lambda done: tell(first + done), **shared
                )
                # Of what is made at once the pass has nothing to tell.
                tell(last)
                return made

            by_factor = list(zip(*(of_tile(number) for number in numbers), strict=True))
            for k, data in enumerate(by_factor):
                writers[k // each].write_shard(names[k % each], shard, list(data))
        for segment, writer in enumerate(writers):
            columns = self.tree.columns
            what = f"what {work.name} gathers" + (f", segment {segment + 1}" if len(writers) > 1 else "")
            part = Part(names[0], "gather", rows, columns, len(self.weights), 1, 1, each, self.passes + 1, what)
            writer.finish(
                parts=[(own, columns, rows, 1, QUANTUM, width, _TILE_ROWS) for own in names],
                receivers=work.table,
                camera=json.dumps(asdict(self.scene.camera)) if work.table.kind == "pixels" else None,
                plan=self._plan(part, threshold).to_json(),
                scene=self.scene.content_hash(),
                first=each,
            )
        return threshold

    def _surveyed(self, work: _Work) -> tuple[float, str]:
        """The threshold that keeps the tolerance, and integers that are wide enough for it: rows of a group share their
        units, and where lobes are narrow they differ much."""
        measures = [(mix, light) for mix in work.mixes for light in self.lights]

        def found(width: str) -> tuple[float, float, float]:
            return work.made.threshold_for(
                _BUNDLES,
                tolerance=self.tolerance,
                weights=self.weights,
                scales=work.scales,
                quantum=QUANTUM,
                width=width,
                measures=measures,
            )

        if self.quality != "lossless":
            threshold, error, _ = found("i8")
            if error <= self.tolerance:
                return threshold, "i8"
        return found("i16")[0], "i16"

    def _plan(self, part: Part, threshold: float) -> Plan:
        camera = self.scene.camera
        return Plan(
            self.scene.name,
            len(self.scene.triangles),
            (camera.width, camera.height),
            self.quality,
            self.tolerance,
            [part],
            notes=[f"{len(self.samples):,} gather samples; truncated at {threshold:.3g}"],
        )

    def _pixels(self, rows: Receivers) -> ReceiverTable:
        albedo = self.scene.albedo_at(rows.triangle, rows.barycentric, self.scene.camera)
        return rows.table(albedo, self.scene.material[rows.triangle].astype(np.uint16))

    def _table(self) -> ReceiverTable:
        samples = self.samples
        return ReceiverTable.gather(
            area=samples.area.astype(np.float32),
            albedo=self.albedo,
            position=samples.position,
            normal=samples.normal,
            material=self.of_sample,
        )

    def _job(self) -> str:
        """What a run is known by."""
        families = {name: [own.model, *own.borders, own.live, own.f0] for name, own in self.families.items()}
        about = {"scene": self.scene.content_hash(), "families": families, "gather": self.gather}
        more = {
            "passes": self.passes,
            "nodes": self.cap,
            "quality": self.quality,
            "tolerance": self.tolerance,
            "version": __version__,
        }
        return json.dumps(about | more, sort_keys=True)

    def _finish(self, path: Path, thresholds: Mapping[str, float], seconds: float) -> None:
        """The arrays, then the manifest: it stands for a whole directory, so it comes last."""
        lit = {"view": LitPoints.of_rows(self.core, self.rows), "cell": self.cells}
        arrays: dict[str, np.ndarray] = {
            "vertices": self.scene.vertices.astype(np.float64),
            "triangles": self.scene.triangles.astype(np.uint32),
            "of_triangle": self.scene.material.astype(np.uint32),
            "areas": self.samples.tree_areas,
            "weights": self.weights,
            "albedo": self.albedo,
            "material": self.of_sample,
            **_table_arrays(self._pixels(self.rows)),
        }
        if self.scene.uv is not None:
            arrays |= self._coordinates()
        for of, points in lit.items():
            arrays |= {f"{of}_{what}": own for what, own in zip(POINTS, points.arrays(), strict=True)}
        arrays |= {f"rows_{self.numbers[name]}": own.astype(np.uint32) for name, own in self.of.items()}
        parts = []
        for name, family in self.families.items():
            about = {"name": name, "number": self.numbers[name], "threshold": thresholds[name]}
            own = {"model": family.model, "range": family.range, "live": family.live, "segments": family.segments}
            parts.append(about | own | {"f0": family.f0})
        about = {"passes": self.passes, "seconds": seconds, "camera": asdict(self.scene.camera), "parts": parts}
        FOLDER.write(path, about, arrays)

    def _coordinates(self) -> dict[str, np.ndarray]:
        """Texture coordinates of the view and of samples; those of nodes are kept with the nodes."""
        view = self.rows.triangle, self.rows.barycentric
        arrays = {
            "uv_view": self.scene.uv_at(*view),
            "uv_steps": footprints(self.scene, *view, self.scene.camera).astype(np.float32),
            "uv_cells": self.scene.uv_at(*self.samples.cell_places()),
            "uv_starts": self.samples.cell_starts.astype(np.uint32),
        }
        return arrays if self.cap else arrays | {"uv_nodes": np.zeros((0, EACH, 2), np.float32)}


def _table_arrays(table: ReceiverTable) -> dict[str, NDArray[Any]]:
    """What the rows of the view are, for a file."""
    names = ("pixel", "weight", "background", "albedo", "position", "normal", "material")
    arrays = {f"pixel_{name}": np.ascontiguousarray(getattr(table, name)) for name in names}
    arrays["pixel_background"] = arrays["pixel_background"].ravel()
    return arrays | {"pixel_image": np.array(table.image_shape, np.int64)}


def _folders(
    path: Path, name: str, numbers: Mapping[str, int], families: Mapping[str, Family]
) -> tuple[list[Path], int]:
    """The directories of a matrix, one a segment of a family, and the matrices in each."""
    if name not in families:
        return [path / name], 1
    family = families[name]
    return [path / f"part-{numbers[name]}-{k}" for k in range(family.segments)], family.live


def _mixes(family: Family) -> tuple[NDArray[np.float64], list[list[float]]]:
    """How much of each factor a family takes, root mean square over gamma, and what it takes in the middle and at the
    end of each segment: factors of all segments, one after the other."""
    scales: list[NDArray[np.float64]] = []
    mixes: list[list[float]] = []
    live = family.live
    for segment, (low, high) in enumerate(pairwise(family.borders)):
        # A border belongs to the segment below it.
        gammas = np.geomspace(low * (1 + 1e-9), high, _GAMMAS)
        taken = np.array([family.coefficients(min(gamma, high)) for gamma in gammas])
        scales.append(np.sqrt((taken**2).mean(axis=0)))
        for own in (taken[_GAMMAS // 2], taken[-1]):
            mix = np.zeros(live * family.segments)
            mix[segment * live : (segment + 1) * live] = own
            mixes.append(mix.tolist())
    return np.maximum(np.concatenate(scales), 1e-12), mixes


def _broadest(lights: list[NDArray[np.float64]]) -> list[NDArray[np.float64]]:
    """Of the half that has the least in its finest wavelets, some: under a lamp at a wall, which lights a spot that
    few rows see, an error relative to next to nothing would decide."""
    fine = [float((light[len(light) // 4 :] ** 2).sum() / (light**2).sum()) for light in lights]
    order = np.argsort(fine, kind="stable")[: max(len(lights) // 2, 1)]
    return [lights[k] for k in order[:: max(len(order) // _MEASURED, 1)][:_MEASURED]]


def _prior(lights: list[NDArray[np.float64]], columns: str) -> NDArray[np.float64]:
    """The root mean square of light in the wavelets of each level."""
    bands = Inner(columns).bands
    squares = np.zeros(len(bands))
    for light in lights:
        squares += (light**2).sum(axis=1) / max(float((light**2).sum()), 1e-300)
    by_band = np.bincount(bands, squares) / np.bincount(bands)
    return np.maximum(np.sqrt(by_band)[bands], 1e-12)
