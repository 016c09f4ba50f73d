"""Precomputation: the loop over tiles (progress, Ctrl-C, resume). Rust does everything inside a tile."""

from __future__ import annotations

import json
import os
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np

from .._core import DirectPass, TileData, TransportWriter, __version__
from .._core import Scene as CoreScene
from ..columns import Columns, parse
from ..progress import Progress, reporter
from ..scene.scene import Scene
from ..transport.entry import TILE_ROWS
from ..transport.plan import Plan
from ..transport.transport import Transport
from .planning import make_plan
from .quality import QUALITIES, Quality
from .room import check_room

__all__ = ["plan", "precompute"]

# Every value of M is an integer times 2^-24: below what an image can show, coarse enough for exact sums.
_QUANTUM = -24
# Bundles of 64 rows that are looked at first, to choose the threshold for the stated error: one in twenty, but at
# least and at most so many.
_SURVEY = (8, 64)


def _settings(quality: str, tolerance: float | None) -> Quality:
    if quality not in QUALITIES:
        raise ValueError(f"expected a quality of {', '.join(QUALITIES)}, got {quality!r}")
    chosen = QUALITIES[quality]
    if tolerance is None:
        return chosen
    if not 0 <= tolerance < 1:
        raise ValueError(f"expected a tolerance from 0 to 1 (0.01 is 1 % image error), got {tolerance}")
    return replace(chosen, tolerance=float(tolerance))


def _columns(columns: Columns | str) -> Columns:
    return parse(columns) if isinstance(columns, str) else columns


def plan(
    scene: Scene, *, columns: Columns | str = "haar:64", quality: str = "publication", tolerance: float | None = None
) -> Plan:
    """What `precompute` would compute and leave out, and about what it would cost; shoots no ray."""
    return make_plan(scene, _columns(columns), quality, _settings(quality, tolerance))


def precompute(
    scene: Scene,
    path: str | os.PathLike[str],
    *,
    receivers: str = "pixels",
    columns: Columns | str = "haar:64",
    quality: str = "publication",
    tolerance: float | None = None,
    progress: bool | Progress = True,
) -> Transport:
    """Ray traces the light transport of a scene into a directory, and opens it.

    A run that is interrupted, by Ctrl-C, a kill or a full disk, resumes where it stopped when it is called again with
    the same arguments, and ends with the same bits. What was at `path` stays until the new result is whole.

    Parameters
    ----------
    scene
        Geometry, materials and camera.
    path
        Directory to make, by custom ``NAME.transport``. A transport that is there is replaced; anything else is not.
    receivers
        "pixels": the rows of M are what the pixels of the camera show.
    columns
        The basis of the light: `Haar` or `SphericalHarmonics`, or its name ("haar:64", "sh:20").
    quality
        "preview", "publication" or "lossless" (`QUALITIES`).
    tolerance
        Relative L2 error of the image that truncation may cause (default: the quality's).
    progress
        True: a bar on standard error. A callable: progress(rows done, rows in all).

    Raises
    ------
    ValueError
        If an argument cannot be used or the result would not fit, before any ray is shot.
    OSError
        If the disk refuses; what was finished is kept for the next run.

    Notes
    -----
    Rows are T_p = V cos / pi per steradian (Overbeck 2006, eq. 3.2 without the albedo), in the Haar basis that is
    orthonormal on the sphere.
    """
    if receivers != "pixels":
        raise ValueError(f'expected receivers="pixels", got {receivers!r}')
    columns, settings, path = _columns(columns), _settings(quality, tolerance), Path(path)
    drawn = make_plan(scene, columns, quality, settings)
    check_room(drawn, path)

    job = {"scene": scene.content_hash(), "columns": str(columns), "version": __version__, **asdict(settings)}
    run = _Run(scene, columns, settings, reporter(progress, scene.name))
    run.writer = TransportWriter(path, json.dumps(job, sort_keys=True))
    error, threshold = run.trace()
    run.finish(drawn, error, threshold)
    return Transport.open(path)


class _Run:
    """One precomputation: find the receivers, look at some of them, then trace tile after tile."""

    writer: TransportWriter
    """Given once the receivers are found: a camera that sees nothing must leave nothing on the disk."""

    def __init__(self, scene: Scene, columns: Columns, settings: Quality, tell: Progress) -> None:
        self.scene, self.columns, self.settings, self.tell = scene, columns, settings, tell
        camera = scene.camera
        right, up, forward = camera.basis()
        core = CoreScene(scene.vertices, scene.triangles, scene.material)
        self.rows = core.receivers(
            position=tuple(camera.position),
            right=tuple(right),
            up=tuple(up),
            forward=tuple(forward),
            half_height=float(np.tan(np.radians(camera.vertical_fov) / 2)),
            width=camera.width,
            height=camera.height,
            edges=settings.edges,
        )
        self.count = len(self.rows)
        if self.count == 0:
            raise ValueError(f"the camera sees nothing of {scene.name}: no pixel shows a surface")
        self.direct = DirectPass(core, self.rows, columns=str(columns), edge_side=settings.edge_side)

    def trace(self) -> tuple[float, float]:
        """Writes every shard that is not there yet; returns the expected error and the threshold that gives it."""
        bundles = min(max(self.count // (20 * 64), _SURVEY[0]), _SURVEY[1])
        looked = min(bundles * 64, self.count)
        total = looked + self.count
        threshold, error, _, groups, tile = self.direct.survey(
            bundles,
            tolerance=self.settings.tolerance,
            quantum=_QUANTUM,
            width=self.settings.width,
            progress=lambda done: self.tell(done, total),
        )
        self.audit = (groups, tile)
        tiles = -(-self.count // TILE_ROWS)
        per_shard = self.writer.TILES_PER_SHARD
        finished = set(self.writer.finished())
        for shard in range(-(-tiles // per_shard)):
            numbers = range(shard * per_shard, min((shard + 1) * per_shard, tiles))
            if shard not in finished:
                self.writer.write_shard(shard, [self._tile(tile, threshold, looked, total) for tile in numbers])
            self.tell(looked + min(numbers.stop * TILE_ROWS, self.count), total)
        return error, threshold

    def _tile(self, tile: int, threshold: float, looked: int, total: int) -> TileData:
        first = tile * TILE_ROWS

        def tell(done: int) -> None:
            self.tell(looked + first + done, total)

        data, _, _ = self.direct.tile(
            first,
            min(TILE_ROWS, self.count - first),
            threshold=threshold,
            quantum=_QUANTUM,
            width=self.settings.width,
            progress=tell,
        )
        return data

    def finish(self, drawn: Plan, error: float, threshold: float) -> None:
        """Writes what turns rows into pictures, and what was done and left out."""
        scene, camera, rows = self.scene, self.scene.camera, self.rows
        behind = int((rows.background == 1).sum())
        done = replace(
            drawn,
            rows=self.count,
            left_out=[*drawn.left_out, f"{behind:,} pixels of background"],
            notes=[*drawn.notes, f"truncated at {threshold:.3g}: {100 * error:.3g} % expected image error"],
        )
        groups, tile = self.audit
        self.writer.finish(
            columns=str(self.columns),
            rows=self.count,
            quantum=_QUANTUM,
            width=self.settings.width,
            tile_rows=TILE_ROWS,
            image=(camera.height, camera.width),
            camera=json.dumps(asdict(camera)),
            plan=done.to_json(),
            scene=scene.content_hash(),
            pixel=rows.pixel,
            weight=rows.weight,
            albedo=scene.albedo_at(rows.triangle, rows.barycentric),
            position=rows.position,
            normal=rows.normal,
            background=rows.background,
            material=scene.material[rows.triangle].astype(np.uint16),
            audit=(groups, tile) if len(groups) else None,
        )
