"""Precomputation: the loop over tiles (progress, Ctrl-C, resume). Rust does everything inside a tile."""

from __future__ import annotations

import json
import os
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np

from . import _core
from .columns import Columns, Haar, parse
from .plan import QUALITIES, Plan, Quality, check_room, make_plan
from .progress import Progress, reporter
from .scene import Scene
from .transport import Transport

__all__ = ["plan", "precompute"]

# Every value of M is an integer times 2^-24: below what an image can show, coarse enough for exact sums.
_QUANTUM = -24
_TILE_ROWS = 8192
# Bundles of 64 rows that are looked at first, to choose the threshold for the stated error.
_SURVEY = 64


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
    scene: Scene, *, columns: Columns | str = Haar(64), quality: str = "publication", tolerance: float | None = None
) -> Plan:
    """What `precompute` would compute and leave out, and about what it would cost; shoots no ray."""
    return make_plan(scene, _columns(columns), quality, _settings(quality, tolerance))


def precompute(
    scene: Scene,
    path: str | os.PathLike[str],
    *,
    receivers: str = "pixels",
    columns: Columns | str = Haar(64),
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

    job = {"scene": scene.content_hash(), "columns": str(columns), "version": _core.__version__, **asdict(settings)}
    writer = _core.TransportWriter(path, json.dumps(job, sort_keys=True))
    return _run(scene, path, columns, settings, drawn, writer, progress)


def _run(
    scene: Scene,
    path: Path,
    columns: Columns,
    settings: Quality,
    drawn: Plan,
    writer: _core.TransportWriter,
    progress: bool | Progress,
) -> Transport:
    camera = scene.camera
    right, up, forward = camera.basis()
    core = _core.Scene(scene.vertices, scene.triangles, scene.material)
    rows = core.receivers(
        position=tuple(camera.position),
        right=tuple(right),
        up=tuple(up),
        forward=tuple(forward),
        half_height=float(np.tan(np.radians(camera.vertical_fov) / 2)),
        width=camera.width,
        height=camera.height,
        edges=settings.edges,
    )
    count = len(rows)
    if count == 0:
        raise ValueError(f"the camera sees nothing of {scene.name}: no pixel shows a surface")

    tell = reporter(progress, scene.name)
    direct = _core.DirectPass(core, rows, columns=str(columns), edge_side=settings.edge_side)
    stored = {"quantum": _QUANTUM, "width": settings.width}
    survey_rows = min(_SURVEY * 64, count)
    total = survey_rows + count
    threshold, error, _, audit_groups, audit = direct.survey(
        _SURVEY, tolerance=settings.tolerance, progress=lambda done: tell(done, total), **stored
    )

    rays = [0, 0]
    tiles = -(-count // _TILE_ROWS)
    finished = set(writer.finished())
    for shard in range(-(-tiles // writer.TILES_PER_SHARD)):
        first = shard * writer.TILES_PER_SHARD
        made = []
        for tile in range(first, min(first + writer.TILES_PER_SHARD, tiles)):
            start = tile * _TILE_ROWS
            size = min(_TILE_ROWS, count - start)
            if shard not in finished:
                data, first_rays, edge_rays = direct.tile(
                    start,
                    size,
                    threshold=threshold,
                    progress=lambda done, start=start: tell(survey_rows + start + done, total),
                    **stored,
                )
                made.append(data)
                rays = [rays[0] + first_rays, rays[1] + edge_rays]
            tell(survey_rows + start + size, total)
        if made:
            writer.write_shard(shard, made)

    done = replace(
        drawn,
        rows=count,
        left_out=[*drawn.left_out, f"{int((rows.background == 1).sum()):,} pixels of background"],
        notes=[*drawn.notes, f"truncation: {100 * error:.3g} % expected image error at a threshold of {threshold:.3g}"],
    )
    source, barycentric = rows.triangle, rows.barycentric
    writer.finish(
        columns=str(columns),
        rows=count,
        tile_rows=_TILE_ROWS,
        image=(camera.height, camera.width),
        camera=json.dumps(asdict(camera)),
        plan=done.to_json(),
        scene=scene.content_hash(),
        pixel=rows.pixel,
        weight=rows.weight,
        albedo=scene.albedo_at(source, barycentric),
        position=rows.position,
        normal=rows.normal,
        background=rows.background,
        material=scene.material[source].astype(np.uint16),
        audit=(audit_groups, audit) if len(audit_groups) else None,
        **stored,
    )
    return Transport.open(path)
