"""The plan: what a precomputation will compute, what it leaves out and why, and what it will cost."""

from __future__ import annotations

import json
import os
import shutil
from dataclasses import asdict, dataclass, field
from pathlib import Path

from . import _core
from .columns import Columns, Haar
from .scene import Scene

__all__ = ["QUALITIES", "Plan", "Quality", "make_plan"]


@dataclass(frozen=True)
class Quality:
    """How closely M is computed and how much of it is kept.

    Attributes
    ----------
    edges
        Whether pixels that show several surfaces become several receivers.
    edge_side
        A texel that an edge runs through takes edge_side x edge_side rays; 0 lets its centre speak for it.
    tolerance
        Relative L2 error of the image that truncation may cause, under light with the spectrum of natural scenes.
    width
        Integers of 8 or 16 bits.
    """

    edges: bool
    edge_side: int
    tolerance: float
    width: str


QUALITIES = {
    "preview": Quality(edges=False, edge_side=0, tolerance=0.05, width="i8"),
    "publication": Quality(edges=True, edge_side=3, tolerance=0.012, width="i8"),
    "lossless": Quality(edges=True, edge_side=4, tolerance=0.0, width="i16"),
}
"""Presets by outcome; `lossless` keeps every coefficient above 2^-24."""

# Estimates, from the built-in plant at 512 x 512 and haar:64: rows for each pixel, the share of rays above the horizon,
# edge rays for each first ray, rays a second and thread, and entries for each group of 16 rows.
_ROWS_PER_PIXEL = 1.25
_ABOVE = 0.5
_EDGE_RAYS = 1.2
_RAYS_PER_SECOND = 6e6
_ENTRIES_PER_GROUP = {"preview": 60, "publication": 420, "lossless": 9000}


@dataclass(frozen=True)
class Plan:
    """What will be computed, and what will not.

    Attributes
    ----------
    rows, columns, bands, channels, bounces, factors
        The shape of M. Before the receivers are found, `rows` is the most that the picture can need.
    rays
        Estimated rays of the pass.
    bytes_on_disk, bytes_in_memory
        Estimates: the finished transport, and the peak of the run.
    seconds
        Estimated time, with `threads` threads.
    left_out
        What this scene does not need, each with its reason.
    notes
        What was found in the scene: degenerate and duplicate triangles, materials that were replaced.
    """

    scene: str
    triangles: int
    picture: tuple[int, int]
    rows: int
    columns: str
    column_count: int
    bands: int
    channels: int
    bounces: int
    factors: int
    quality: str
    tolerance: float
    rays: float
    bytes_on_disk: float
    bytes_in_memory: float
    seconds: float
    threads: int
    left_out: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)

    def __str__(self) -> str:
        width, height = self.picture
        lines = [
            f"{self.scene}: {self.triangles:,} triangles, {width} x {height} pixels",
            f"  compute   M of up to {self.rows:,} receivers x {self.column_count:,} columns ({self.columns}), "
            f"{self.bands} bands, {self.channels} channel, bounces: {self.bounces}, factors: {self.factors}",
            f"  quality   {self.quality}: truncated to {100 * self.tolerance:g} % expected image error",
            f"  cost      about {self.rays / 1e6:,.0f} million rays, {self.seconds:,.0f} s on {self.threads} threads, "
            f"{self.bytes_on_disk / 1e6:,.0f} MB on disk, {self.bytes_in_memory / 1e6:,.0f} MB in memory",
        ]
        lines += [f"  left out  {reason}" for reason in self.left_out]
        lines += [f"  note      {note}" for note in self.notes]
        return "\n".join(lines)

    def to_json(self) -> str:
        return json.dumps(asdict(self), sort_keys=True)

    @staticmethod
    def from_json(text: str) -> Plan:
        known = {name for name in Plan.__dataclass_fields__}
        fields = {name: value for name, value in json.loads(text).items() if name in known}
        fields["picture"] = tuple(fields["picture"])
        return Plan(**fields)


def make_plan(scene: Scene, columns: Columns, quality: str, settings: Quality) -> Plan:
    """Looks at the scene and the request; shoots no ray."""
    camera = scene.camera
    pixels = camera.width * camera.height
    rows = round(pixels * (_ROWS_PER_PIXEL if settings.edges else 1))
    threads = _core.threads()
    edge_rays = _EDGE_RAYS if settings.edge_side else 0.0
    texels = 6 * columns.face**2
    rays = rows * texels * _ABOVE * (1 + edge_rays)
    entry = 18 if settings.width == "i8" else 34
    # Entries grow slower than columns, fine wavelets being sparse; harmonics are dense.
    sparse = _ENTRIES_PER_GROUP.get(quality, 420) * (columns.columns / 24576) ** 0.5
    entries = sparse if isinstance(columns, Haar) else columns.columns
    triangles = len(scene.triangles)
    in_flight = threads * 16 * texels * 4 * 2 + 4 * 8192 / 16 * entries * entry * 3
    return Plan(
        scene=scene.name,
        triangles=triangles,
        picture=(camera.width, camera.height),
        rows=rows,
        columns=str(columns),
        column_count=columns.columns,
        bands=int(columns.bands[-1]) + 1,
        channels=1,
        bounces=0,
        factors=1,
        quality=quality,
        tolerance=settings.tolerance,
        rays=rays,
        bytes_on_disk=rows / 16 * entries * entry + 60.0 * rows,
        bytes_in_memory=120e6 + 400.0 * triangles + 250.0 * rows + in_flight,
        seconds=rays / (_RAYS_PER_SECOND * threads),
        threads=threads,
        left_out=_left_out(scene, settings),
        notes=[*(f"{count} {what}" for what, count in scene.counts.items() if count), *scene.warnings],
    )


def _left_out(scene: Scene, settings: Quality) -> list[str]:
    reasons = [
        "2 of 3 colour channels: surfaces are diffuse and lit directly, so albedos stay outside M",
        "bounces: light that arrives directly only",
        "view factors: the view is fixed and surfaces are diffuse",
        "rows for pixels and parts of pixels that see no surface: they show the environment itself",
        "rays and columns below each receiver's horizon, and entries of M that truncation finds too small",
    ]
    if not settings.edges:
        reasons.append("samples of pixel edges: one receiver a pixel (preview)")
    if not settings.edge_side:
        reasons.append("rays into shadow edges: one ray a texel (preview)")
    if all(texture is None for texture in scene.textures):
        reasons.append("texture look-ups: no material has a texture")
    return reasons


def check_room(plan: Plan, path: Path) -> None:
    """Refuses, before any work, what would not fit on the disk or in memory.

    Raises
    ------
    ValueError
        With the number that is needed and the number that there is.
    """
    folder = path.absolute().parent
    if not folder.is_dir():
        raise FileNotFoundError(f"expected a directory to write {path.name} into, but {folder} does not exist")
    free = shutil.disk_usage(folder).free
    if plan.bytes_on_disk > free:
        raise ValueError(
            f"{plan.scene} would take about {plan.bytes_on_disk / 1e6:,.0f} MB on disk, "
            f"but only {free / 1e6:,.0f} MB are free at {folder}; take fewer pixels or columns, or a lower quality"
        )
    memory = _available_memory()
    if memory is not None and plan.bytes_in_memory > memory:
        raise ValueError(
            f"{plan.scene} would need about {plan.bytes_in_memory / 1e6:,.0f} MB of memory, "
            f"but only {memory / 1e6:,.0f} MB are available; take fewer columns or fewer threads"
        )


def _available_memory() -> float | None:
    """Bytes that this process may still take: the least of what is free and what its limits allow; None if unknown."""
    limits: list[float] = []
    try:
        fields = dict(line.split(":") for line in Path("/proc/meminfo").read_text().splitlines())
        limits.append(float(fields["MemAvailable"].split()[0]) * 1024)
    except (OSError, KeyError, ValueError):
        if hasattr(os, "sysconf") and "SC_AVPHYS_PAGES" in os.sysconf_names:
            limits.append(float(os.sysconf("SC_AVPHYS_PAGES")) * os.sysconf("SC_PAGE_SIZE"))
    try:
        import resource

        soft, _ = resource.getrlimit(resource.RLIMIT_AS)
        if soft != resource.RLIM_INFINITY:
            used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
            limits.append(float(soft - used))
    except (ImportError, OSError, ValueError):
        pass
    return min(limits) if limits else None
