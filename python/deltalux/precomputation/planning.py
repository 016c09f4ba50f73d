"""The plan: what a precomputation will compute, what it leaves out and why, and what it will cost."""

from __future__ import annotations

from .._core import threads as used_threads
from ..columns import Columns, Haar
from ..scene.scene import Scene
from ..transport.entry import ENTRY_BYTES, GROUP, TILE_ROWS
from ..transport.plan import Plan
from .quality import Quality

__all__ = ["make_plan"]

# Estimates, from the built-in plant at 512 x 512 and haar:64: rows for each pixel, the share of rays above the horizon,
# edge rays for each first ray, rays a second and thread, and entries for each group of 16 rows.
_ROWS_PER_PIXEL = 1.25
_ABOVE = 0.5
_EDGE_RAYS = 1.2
_RAYS_PER_SECOND = 6e6
_ENTRIES_PER_GROUP = {"preview": 60, "publication": 420, "lossless": 9000}


def make_plan(scene: Scene, columns: Columns, quality: str, settings: Quality) -> Plan:
    """Looks at the scene and the request; shoots no ray."""
    camera = scene.camera
    pixels = camera.width * camera.height
    rows = round(pixels * (_ROWS_PER_PIXEL if settings.edges else 1))
    threads = used_threads()
    edge_rays = _EDGE_RAYS if settings.edge_side else 0.0
    texels = 6 * columns.face**2
    rays = rows * texels * _ABOVE * (1 + edge_rays)
    entry = ENTRY_BYTES[settings.width]
    # Entries grow slower than columns, fine wavelets being sparse; harmonics are dense.
    sparse = _ENTRIES_PER_GROUP.get(quality, 420) * (columns.columns / 24576) ** 0.5
    entries = sparse if isinstance(columns, Haar) else columns.columns
    triangles = len(scene.triangles)
    in_flight = threads * 16 * texels * 4 * 2 + 4 * TILE_ROWS / GROUP * entries * entry * 3
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
        bytes_on_disk=rows / GROUP * entries * entry + 60.0 * rows,
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
