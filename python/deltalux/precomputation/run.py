"""Precomputation: the loop over parts and tiles (progress, Ctrl-C, resume). Rust does everything inside a tile."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Callable
from concurrent.futures import Executor
from contextlib import closing, suppress
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from .._core import Links, TileData, TransportWriter, __version__
from .._core import Nodes as CoreNodes
from ..columns import Columns, parse
from ..mistakes import checked_path, instead_of
from ..progress import Progress, Reporter, reporter, steps
from ..scene.scene import Scene
from ..tasks import checked_executor, completed
from ..transport.entry import TILE_ROWS, TILES_PER_SHARD
from ..transport.plan import Part, Plan, Solve
from ..transport.transport import Transport
from .between import RESIDUAL, KnownNodes, between, linked
from .errands import delivered, errand_of, hand_over
from .planning import DIRECT, EMISSION, NODES, make_plan, renewed, said
from .preparation import BUNDLE, COLUMNS, QUANTUM, Prepared, Request, surveyed_bundles
from .room import check_folder_of, check_room
from .tracing import traced_tile

__all__ = ["Precomputation", "plan", "precompute"]


def plan(
    scene: Scene,
    *,
    columns: Columns | str = COLUMNS,
    quality: str = "publication",
    tolerance: float | None = None,
    bounces: int | str = 0,
    residual: float = RESIDUAL,
    nodes: int | str = "auto",
    receivers: str = "pixels",
    normals: str = "smooth",
    gloss: bool = True,
    factors: int | str = "auto",
    refine: float | None = None,
) -> Plan:
    """What `precompute` would compute and leave out, and what it would cost.

    The receivers are found, and a probe of about a second on the scene tells rays, bytes and time.

    Parameters
    ----------
    scene
        Geometry, materials and camera.
    columns, quality, tolerance, bounces, residual, nodes, receivers, normals, gloss, factors, refine
        As for `precompute`.

    Returns
    -------
    Plan
        Its parts are what `precompute` runs.

    Raises
    ------
    ValueError
        As `precompute`, but for what would not fit on a disk.
    """
    asked = between(bounces, residual, nodes)
    return Precomputation(
        scene, Request(columns, quality, tolerance, receivers, normals, asked, gloss, factors, refine)
    ).plan


def precompute(
    scene: Scene,
    path: str | os.PathLike[str],
    *,
    receivers: str = "pixels",
    columns: Columns | str = COLUMNS,
    quality: str = "publication",
    tolerance: float | None = None,
    bounces: int | str = 0,
    residual: float = RESIDUAL,
    nodes: int | str = "auto",
    normals: str = "smooth",
    gloss: bool = True,
    factors: int | str = "auto",
    refine: float | None = None,
    progress: bool | Progress = True,
    again: bool = False,
    executor: Executor | None = None,
) -> Transport:
    """Ray traces the light transport of a scene into a directory, and opens it.

    A run that is interrupted, by Ctrl-C, a kill or a full disk, resumes where it stopped when it is called again with
    the same arguments, and ends with the same bits. What was at `path` stays until the new result is whole.

    Parameters
    ----------
    scene
        Geometry, materials and camera.
    path
        Directory to make, by custom ``NAME.transport``. A transport that is there is replaced, or opened where it is of
        this very request; anything else is left alone, with an error.
    receivers
        "pixels": the rows of M are what the pixels of the camera show. "vertices": they are the vertices of the
        mesh, one for each side that lies open, each material, and each way that the surface faces there; any camera can
        look at them (`Transport.render`).
    columns
        The basis of the light: `Haar` or `SphericalHarmonics`, or its name ("haar:64", "sh:20"). With texels
        ("haar:64+texels"), the default, suns and lamps go through transport that is not truncated.
    quality
        "preview", "publication" or "lossless" (`QUALITIES`).
    tolerance
        Relative L2 error of the image that truncation may cause (default: the quality's): with texels the worst that is
        measured under the built-in lights and a sun, else expected of light with the spectrum of natural scenes.
    bounces
        Of light between surfaces: so many, or "all", as many as it takes to a proved `residual`. They are solved at
        nodes, from which receivers take by weight; 2 outdoors and 6 indoors leave about one percent.
    residual
        With "all": no value of a column is further off than this share of its largest.
    nodes
        "auto", as many as light between surfaces varies (at most 32,768), or the most that there may be.
    normals
        "smooth", as the scene brings them, with the pictures of normals that its materials have in pixels; or "flat",
        of its triangles. Where it brings none, pixels are flat, and vertices have the mean of the faces around by
        area, up to creases of 40 degrees. Nothing is seen below the horizon of either.
    gloss
        Whether materials with a lobe have rows for it, as the camera sees them (without them it is black to the eye,
        but reflects between surfaces as if it were diffuse). What they reflect of other surfaces takes bounces, and is
        as sharp as the nodes. At vertices, which are seen from anywhere, lobes are sums of factors; there, and where a
        material is measured, columns are without texels.
    factors
        Of a lobe at vertices: "auto", as few as leave a tenth of it under natural light, at most 24, or how many. The
        plan says what they leave.
    refine
        None: the mesh as it is. Above 0: edges at whose ends rows of vertices differ by more than
        ``refine / sqrt(area)`` of a row in the mean are split, the longest first, up to 200,000 triangles or four times
        the scene's; `area` is the share of the scene's surface in the triangles there. 0.003 is fine.
    progress
        True: a bar on standard error. A callable: progress(rows done, rows in all).
    again
        Whether a transport that is there already, of the same scene, settings and version, is computed anew.
    executor
        Who traces, shard by shard (32,768 rows), with the bits of a run alone: any of `concurrent.futures`, Dask's, or
        MPI's, whose workers see the same files. A worker that dies costs its shard. What comes before and after, and
        light between surfaces, is done here.

    Returns
    -------
    Transport
        Opened from `path`.

    Raises
    ------
    ValueError
        If an argument cannot be used or the result would not fit, before any long work.
    OSError
        If the disk refuses; what was finished is kept for the next run.

    Notes
    -----
    Rows are T_p = V cos / pi per steradian (Overbeck 2006, eq. 3.2 without the albedo), in the Haar basis that is
    orthonormal on the sphere.
    """
    checked_path(path, "a scene, and then the path of a transport")
    asked = between(bounces, residual, nodes)
    request = Request(columns, quality, tolerance, receivers, normals, asked, gloss, factors, refine)
    check_folder_of(Path(path))
    return Precomputation(scene, request, progress=progress).run(path, again, checked_executor(executor))


class Precomputation:
    """One request: first its plan, then the run of the plan.

    Parameters
    ----------
    scene
        Geometry, materials and camera.
    request
        What is asked of it.
    known
        Nodes of the same scene that are solved already.
    progress
        As for `precompute`, from the first look at the scene to the end of the run.
    """

    def __init__(
        self, scene: Scene, request: Request, known: KnownNodes | None = None, progress: bool | Progress = False
    ) -> None:
        if not isinstance(scene, Scene):
            raise instead_of("Scene", scene)
        self._tell = reporter(progress, scene.name)
        self._prepared, self._known = Prepared(scene, request, known, self._tell.begin), known is not None

    @cached_property
    def plan(self) -> Plan:
        """What will be computed: see `plan`."""
        self._tell.begin("a probe")
        return make_plan(self._prepared)

    @cached_property
    def _job(self) -> str:
        """All that decides what is computed, as text."""
        job = {
            "scene": self._prepared.scene.content_hash(),
            "columns": str(self._prepared.columns),
            "version": __version__,
            **asdict(self._prepared.settings),
            **self._prepared.asked,
        }
        return json.dumps(job, sort_keys=True)

    @property
    def _digest(self) -> str:
        # Nodes of another transport are no part of the job's text: what they make is not the same.
        return "" if self._known else hashlib.blake2b(self._job.encode(), digest_size=16).hexdigest()

    def made(self, path: str | os.PathLike[str]) -> Transport | None:
        """The transport at a path, where it is of this very request, by this version.

        Parameters
        ----------
        path
            As for `precompute`.

        Returns
        -------
        Transport or None
        """
        with suppress(ValueError, OSError):
            transport = Transport.open(path)
            return transport if self._digest and transport.plan.job == self._digest else None
        return None

    def run(self, path: str | os.PathLike[str], again: bool = False, executor: Executor | None = None) -> Transport:
        """Computes every part of the plan, and opens the result.

        Parameters
        ----------
        path, again, executor
            As for `precompute`.

        Returns
        -------
        Transport

        Raises
        ------
        ValueError, OSError
            As `precompute`.
        """
        if not again and (found := self.made(path)) is not None:
            return found
        check_room(self.plan, Path(path))
        writer = TransportWriter(path, self._job)
        run = _Run(self._prepared, writer, self._tell, self.plan)
        if executor is not None:
            run.others = _Others(executor, os.path.abspath(path), self._job)
        for part in self.plan.parts:
            run.begin(part)
            _PASSES[part.make](run, part)
        run.finish(replace(self.plan, job=self._digest))
        transport = Transport.open(path)
        self._tell.say(run.summary())
        return transport


@dataclass(frozen=True)
class _Others:
    """Who traces shards in this process's place, and of which run."""

    executor: Executor
    path: str
    job: str


class _Run:
    """The passes of one precomputation, and what they leave for the end."""

    def __init__(self, prepared: Prepared, writer: TransportWriter, whole: Reporter, plan: Plan) -> None:
        self.prepared, self.writer, self.whole = prepared, writer, whole
        self.lengths = {part.name: part.cost.seconds if part.cost else 0.0 for part in plan.parts}
        self.step_of = steps(whole, prepared.scene.name, list(self.lengths.values()))
        whole.expect(plan.seconds)
        self.started, self.rays = prepared.clock(), 0
        self.parts: list[tuple[str, str, int, int, int, str, int]] = []
        self.links: Links | None = None
        self.beside: dict[str, dict[str, np.ndarray]] = {}
        self.solve: Solve | None = None
        self.notes: list[str] = []
        self.others: _Others | None = None

    def begin(self, part: Part) -> None:
        """The next part of the plan."""
        self.tell = self.step_of(part.name)

    def direct(self, part: Part) -> None:
        """Looks at some bundles, then traces tile after tile; shards that are there already are not traced again."""
        count, settings = self.prepared.count, self.prepared.settings
        bundles = surveyed_bundles(count)
        looked = min(bundles * BUNDLE, count)
        total = looked + count
        survey = self.prepared.survey(bundles, lambda done: self.tell(done, total))
        self.rays += survey.looked.first_rays + survey.looked.edge_rays
        if part.cost is not None:
            cost = renewed(self.prepared, part.cost, survey, self.prepared.clock() - self.started, looked)
            self.whole.expect(cost.seconds + sum(self.lengths.values()) - self.lengths[part.name])
            self.tell.say(f"{self.prepared.scene.name}: {cost}, {said(survey, self.prepared)}")
        threshold = survey.looked.threshold
        self.survey = survey
        finished = set(self.writer.finished(part.name))
        missing = [shard for shard in range(-(-self.prepared.tiles // TILES_PER_SHARD)) if shard not in finished]
        if self.others is None:
            for shard in missing:
                first = shard * TILES_PER_SHARD
                numbers = range(first, min(first + TILES_PER_SHARD, self.prepared.tiles))
                made = [self._tile(tile, threshold, looked, total) for tile in numbers]
                self.writer.write_shard(part.name, shard, made)
        else:
            self._handed_out(self.others, part, missing, threshold, looked)
        self.tell(total, total)
        self.parts.append((part.name, part.columns, count, part.channels, QUANTUM, settings.width, TILE_ROWS))
        self.notes.append(f"truncated at {threshold:.3g}: {said(survey, self.prepared)}")

    def nodes(self, part: Part) -> None:
        """Light between surfaces: what nodes are to each other and to receivers, and their rows."""
        own, prepared = self.prepared.between, self.prepared
        assert own is not None
        # In rays, or what takes as long as one.
        steps = (len(own), prepared.count, len(own) + int(parse(own.columns).columns))
        total = sum(steps)

        def tell(before: int) -> Callable[[int], None]:
            return lambda done: self.tell(min(before + done, total), total)

        sources = own.sources(tell(0))
        links = linked(sources, prepared.core, prepared.rows, prepared.settings, tell(steps[0]))
        made = own.rows(links, self.survey.looked.threshold, QUANTUM, tell(steps[0] + steps[1]))
        self.tell(total, total)
        finished = set(self.writer.finished(part.name))
        for shard in range(-(-len(made.tiles) // TILES_PER_SHARD)):
            if shard not in finished:
                tiles = made.tiles[shard * TILES_PER_SHARD : (shard + 1) * TILES_PER_SHARD]
                self.writer.write_shard(part.name, shard, tiles)
        self.parts.append((part.name, own.columns, made.rows, own.channels, made.quantum, made.width, made.tile_rows))
        self.links = links
        self.beside["nodes"] = {"kept": sources.kept()}
        self.rays += links.rays + made.rays
        unspoken, audited, few, glossy = links.gathering
        self.solve = replace(made.solve, gathering=(unspoken + audited + few + glossy) / prepared.count)
        self.notes += [
            f"{100 * self.solve.gathering:.1f} % of {prepared.count:,} receivers gather: {unspoken:,} as fewer than "
            f"two nodes speak for them, {audited:,} by the audit, {few:,} as they see four nodes at most, {glossy:,} "
            f"as they are glossy; {links.nbytes / prepared.count:.1f} bytes of links a receiver",
            str(self.solve) + ("" if own.rays else "; discretisation as of the view that they were solved for"),
        ]

    def emission(self, part: Part) -> None:
        """Light that surfaces give off by themselves: what arrives of it at rows, directly and from nodes."""
        prepared, emitters = self.prepared, self.prepared.emitters
        assert emitters is not None
        nodes = prepared.between if self.links is not None else None
        before = CoreNodes.CELL * len(nodes) if nodes else 0

        def tell(first: int) -> Callable[[int], None]:
            return lambda done: self.tell(min(first + done, before + part.rows), before + part.rows)

        side = prepared.settings.emission_rays
        response = emitters.arriving(prepared.core, prepared.rows, side=side, progress=tell(before))
        self.rays += 2 * side**2 * part.rows
        if nodes is not None and self.links is not None:
            emitted = nodes.emitted(emitters, tell(0))
            response += self.links.weights.taken(emitted)
            self.beside["nodes"]["emitted"] = emitted
        arrays = {"response": response.astype(np.float32), "radiance": prepared.radiance()}
        self.beside["emission"] = arrays

    def _tile(self, tile: int, threshold: float, looked: int, total: int) -> TileData:
        data, rays = traced_tile(
            self.prepared, tile, threshold, lambda done: self.tell(looked + tile * TILE_ROWS + done, total)
        )
        self.rays += rays
        return data

    def _handed_out(self, others: _Others, part: Part, shards: list[int], threshold: float, looked: int) -> None:
        """Shards that others trace and deliver; what is told is how many have come."""
        first = errand_of(others.path, others.job, self.prepared, part.name, threshold)
        hand_over(others.job, self.prepared)
        try:
            errands = [replace(first, number=shard) for shard in shards]
            with closing(completed(delivered, errands, others.executor)) as finished:
                for done, (number, rays) in enumerate(finished, 1):
                    self.writer.adopt(part.name, shards[number])
                    self.rays += rays
                    self.tell(looked + self.prepared.count * done // len(shards), looked + self.prepared.count)
        finally:
            hand_over(others.job, None)

    def summary(self) -> str:
        """What it took, and what came of it."""
        seconds = self.prepared.clock() - self.started
        return (
            f"{self.prepared.scene.name}: {self.rays / 1e6:,.0f} million rays in {seconds:,.1f} s, "
            f"{said(self.survey, self.prepared)}"
        )

    def finish(self, plan: Plan) -> None:
        """Writes what turns rows into pictures, and what was done and left out."""
        scene, rows = self.prepared.scene, self.prepared.rows
        looked = self.survey.looked
        table = rows.table(
            self.prepared.albedo(),
            scene.material[rows.triangle].astype(np.uint16),
            self.prepared.texels,
        )
        kept = self.prepared.kept
        arrays = kept.arrays()
        arrays |= self.prepared.beside() if arrays else {}
        self.writer.finish(
            parts=self.parts,
            receivers=table,
            camera=json.dumps(asdict(scene.camera)),
            plan=plan.done(self.notes, self.survey.errors, self.survey.without, self.solve).to_json(),
            scene=kept.content_hash(),
            first=len(self.parts),
            link=None if self.links is None else self.links.link,
            audit=(looked.groups, looked.audit) if len(looked.groups) else None,
            beside=[(name, list(own.items())) for name, own in ({"scene": arrays} | self.beside).items() if own],
        )


_PASSES: dict[str, Callable[[_Run, Part], None]] = {
    DIRECT: _Run.direct,
    NODES: _Run.nodes,
    EMISSION: _Run.emission,
}
"""By what a part's ``make`` says."""
