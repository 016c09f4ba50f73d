"""The plan: what a precomputation will compute, what it leaves out and why, and what it will cost.

Every line follows from the scene and the request; the cost from a probe of about a second on the scene itself.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from .._core import threads as used_threads
from ..columns import parse
from ..scene.scene import GROUND
from ..transport.entry import GROUP, TILE_ROWS, TILES_PER_SHARD, entry_bytes
from ..transport.plan import Cost, LeftOut, Part, Plan
from .preparation import BUNDLE, QUANTUM, Prepared, Survey, surveyed_bundles
from .room import INTERPRETER, PIXEL, TRIANGLE

__all__ = ["DIRECT", "EMISSION", "GLOSS", "NODES", "make_plan", "said"]

DIRECT = "direct"
"""The part, and the pass, of light that arrives directly."""
NODES = "nodes"
"""The part, and the pass, of light between surfaces."""
EMISSION = "emission"
"""The part, and the pass, of light that surfaces give off by themselves: it is no part of M."""
GLOSS = "rows of glossy lobes"
"""What plans call them where they are left out."""

# Seconds of the probe, and bundles that are surveyed for it.
_PROBE = 0.8
_LOOKED = 8
# Untruncated groups that a transport keeps, and how much of their columns is not zero.
_AUDIT_GROUPS, _FILLED = 32, 0.5
# How far runs of one scene on one idle machine scatter, besides what the probe does not see.
_SCATTER = 0.1
# Of light between surfaces: rays and bytes of a receiver's links, different nodes met by a ray, cells of nodes that are
# traced as one bundle, products where all bounces are asked, and multiply-adds of a thread in a second.
_LINK_RAYS, _LINK_BYTES, _APART, _CELLS_A_BUNDLE, _ALL_PRODUCTS, _FLOPS = 70, 30, 0.3, 16, 20, 6e9
# The same of a lobe, at most: four nodes around what each of its rays meets; and bytes of a factor at a vertex, in a
# closed box: those of one vertex share their rays.
_LOBE_RAYS, _LOBE_BYTES, _FACTOR_BYTES = 256, 6 * 4 * 256, 360
# A ray by itself, in rays of a fan.
_A_SINGLE_RAY = 8.0
# A plan is held to this on an idle machine (`benches/plan.py`).
_AT_MOST = 0.3


@dataclass(frozen=True)
class _Probe:
    """What a second on the scene has told. Shares and entries are the scene's own, the same on any machine."""

    bundle_seconds: float
    survey_seconds: float
    first_rays: float
    edge_rays: float
    above_share: float
    hit_share: float
    survey: Survey
    uncertainty: float


def make_plan(prepared: Prepared) -> Plan:
    """What is computed for a scene whose receivers are found, and what it costs."""
    scene, settings, columns = prepared.scene, prepared.settings, prepared.columns
    probe = _probe(prepared)
    part = Part(
        name=DIRECT,
        make=DIRECT,
        rows=prepared.count,
        columns=str(columns),
        column_count=columns.columns,
        bands=int(columns.bands[-1]) + 1,
        channels=prepared.direct.channels,
        factors=max([1, *(own.count for own in prepared.factored.values())]),
        bounces=0,
        why=f"light of {6 * columns.face**2:,} texels that arrives directly{_texels(prepared, probe)}",
        cost=_cost(
            prepared,
            probe.survey,
            prepared.bundles * (probe.first_rays + probe.edge_rays),
            probe.bundle_seconds,
            probe.survey_seconds,
            probe.uncertainty,
        ),
    )
    return Plan(
        scene=scene.name,
        triangles=len(scene.triangles),
        picture=(scene.camera.width, scene.camera.height),
        quality=prepared.quality,
        tolerance=settings.tolerance,
        parts=[part, *_nodes(prepared, probe), *_emission(prepared, probe)],
        left_out=_left_out(prepared, probe, part),
        errors=probe.survey.errors,
        without=probe.survey.without,
        ground=scene.names.index(GROUND) if GROUND in scene.names else None,
        notes=[
            *(f"{count:,} {what}" for what, count in _found(prepared).items() if count),
            *_factors(prepared),
            *scene.warnings,
            *_hardly_seen(prepared),
        ],
    )


_HARDLY = 0.01
"""A camera that shows the scene in a smaller share of its pixels was hardly meant."""


def _hardly_seen(prepared: Prepared) -> list[str]:
    """Whether nearly all of the picture shows nothing."""
    camera = prepared.scene.camera
    seen = 1.0 - prepared.rows.unseen / (camera.width * camera.height)
    if prepared.request.receivers != "pixels" or seen >= _HARDLY:
        return []
    return [f"{100 * seen:.2g} % of the pixels see the scene: another camera would show more of it"]


def _materials(prepared: Prepared) -> str:
    """What the materials are, as far as they have rows."""
    count = len(prepared.scene.albedo)
    glossy = sum(model is not None for model in prepared.scene.models) if prepared.glossy else 0
    if glossy:
        return f"{glossy} of {count} materials are glossy in one grey lobe each colour of theirs, the others diffuse"
    return "its material is diffuse" if count == 1 else f"all {count} materials are diffuse"


def _factors(prepared: Prepared) -> list[str]:
    """What factors leave of each lobe, and what four would."""
    said = []
    for number, own in prepared.factored.items():
        left, four = (100 * own.left[min(count, len(own.left) - 1)] for count in (own.count, 4))
        said.append(
            f"material {number}, {prepared.scene.models[number]}: {own.count} factors leave {left:.0f} % of a "
            f"highlight under natural light (4: {four:.0f} %)"
        )
    return said


def _found(prepared: Prepared) -> dict[str, int]:
    """What was put right in the scene, and what its vertices are."""
    return {
        **prepared.scene.counts,
        "triangles of refinement, where rows of vertices differ": len(prepared.scene.triangles)
        - prepared.own_triangles,
        "buried vertices, which see nothing and show their neighbour": prepared.rows.buried,
    }


def _nodes(prepared: Prepared, probe: _Probe) -> list[Part]:
    """Light between surfaces, where some see others. What it costs follows from how long placing the nodes took."""
    own = prepared.between
    if own is None or probe.hit_share == 0:
        return []
    columns, nodes, bounces = parse(own.columns), len(own), own.bounces
    why = f"light between surfaces, of which receivers take from {own.why}"
    if prepared.factored:
        why += f"; factors of lobes take by {_LOBE_RAYS} rays a vertex, with weights of either sign"
    part = Part(
        name=NODES,
        make=NODES,
        rows=nodes,
        columns=own.columns,
        column_count=columns.columns,
        bands=int(columns.bands[-1]) + 1,
        channels=own.channels,
        factors=1,
        bounces=bounces,
        why=why,
    )
    # Nodes that are known are neither traced nor solved.
    solved = nodes if own.rays else 0
    glossy = int((prepared.rows.lobe >= 0).sum())
    # All factors of a vertex have the rays of one lobe.
    lobes = int((prepared.rows.lobe == 0).sum()) if prepared.factored else glossy
    rays = solved * prepared.settings.node_rays**2 + (prepared.count - glossy) * _LINK_RAYS + lobes * _LOBE_RAYS
    pairs = solved * prepared.settings.node_rays**2 * probe.hit_share * _APART
    products = bounces if bounces > 0 else _ALL_PRODUCTS
    solving = 2.0 * pairs * columns.columns * products * own.channels / (_FLOPS * used_threads())
    direct = solved / _CELLS_A_BUNDLE * probe.bundle_seconds
    # A look-up of the nearest node costs as much again as a ray; where none was placed, a ray is one of the probe's.
    a_ray = own.seconds / own.rays if own.rays else probe.bundle_seconds / (probe.first_rays + probe.edge_rays)
    seconds = 2 * rays * a_ray + direct + solving
    entry = entry_bytes(prepared.settings.width, own.channels)
    # Of each node its irradiance and its radiosity.
    matrix = 2 * nodes / GROUP * probe.survey.looked.entries_per_group * entry + prepared.count * _LINK_BYTES
    matrix += glossy * (_FACTOR_BYTES if prepared.factored else _LOBE_BYTES)
    cost = Cost(
        rays=rays + solved / _CELLS_A_BUNDLE * (probe.first_rays + probe.edge_rays),
        bytes_on_disk=matrix,
        bytes_in_memory=INTERPRETER + TRIANGLE * len(prepared.scene.triangles) + 8 * pairs + 4 * matrix,
        seconds=seconds,
        least_seconds=0.5 * seconds,
        most_seconds=2 * seconds,
        threads=used_threads(),
    )
    return [replace(part, cost=cost)]


def _emission(prepared: Prepared, probe: _Probe) -> list[Part]:
    """Light that surfaces give off by themselves, where some do."""
    scene, nodes = prepared.scene, prepared.between
    if scene.emission is None:
        return []
    shining = int(scene.emission.any(axis=1).sum())
    rays = 2 * prepared.settings.emission_rays**2 * (prepared.count + (len(nodes) if nodes and nodes.rays else 0))
    seconds = _A_SINGLE_RAY * rays * probe.bundle_seconds / (probe.first_rays + probe.edge_rays)
    cost = Cost(
        rays=rays,
        bytes_on_disk=24 * prepared.count,
        bytes_in_memory=INTERPRETER + TRIANGLE * len(scene.triangles) + 64 * prepared.count,
        seconds=seconds,
        least_seconds=0.5 * seconds,
        most_seconds=2 * seconds,
        threads=used_threads(),
    )
    why = f"what {shining} of {len(scene.albedo)} materials give off: beside M, as it does not move with the light"
    return [
        Part(
            name=EMISSION,
            make=EMISSION,
            rows=prepared.count,
            columns="none of M",
            column_count=1,
            bands=1,
            channels=3,
            factors=1,
            bounces=nodes.bounces if nodes and probe.hit_share else 0,
            why=why,
            cost=cost,
        )
    ]


def _texels(prepared: Prepared, probe: _Probe) -> str:
    """What texel columns cost this scene; what they buy is in the plan's errors."""
    size = probe.survey.looked.texel_bytes * prepared.bundles / 1e6
    return f"; suns and lamps through texels, {size:,.1f} MB" if size else ""


def said(survey: Survey, prepared: Prepared) -> str:
    """The error that a threshold was chosen for, in words."""
    measured = any(light.decides for light in prepared.lights)
    how = "of the picture at most, measured" if measured else "expected image error"
    return f"{100 * survey.looked.error:.3g} % {how}"


def _probe(prepared: Prepared) -> _Probe:
    """Surveys a few bundles for a threshold, and then makes bundles as the pass will, for most of a second."""
    # Of a small scene less: what is looked at here is traced once more.
    looked = max(1, min(_LOOKED, prepared.bundles // 32))
    started = prepared.clock()
    survey = prepared.survey(looked)
    threshold, rays = survey.looked.threshold, survey.looked.first_rays
    surveyed = prepared.clock() - started
    # Where all is done in a moment, a probe would take longer than the work.
    seconds = min(_PROBE, max(0.015 * surveyed / looked * prepared.bundles, 0.005))
    bundles, took, first, edge = prepared.direct.probe(
        seconds, threshold=threshold, quantum=QUANTUM, width=prepared.settings.width
    )
    texels = 6 * prepared.columns.face**2
    return _Probe(
        bundle_seconds=took / bundles,
        survey_seconds=surveyed / looked,
        first_rays=first / bundles,
        edge_rays=edge / bundles,
        above_share=rays / (min(looked * BUNDLE, prepared.count) * texels),
        hit_share=1 - survey.looked.open_rays / max(rays, 1),
        survey=survey,
        uncertainty=min(_SCATTER + 0.5 / bundles**0.5, _AT_MOST),
    )


def renewed(prepared: Prepared, cost: Cost, survey: Survey, seconds: float, looked: int) -> Cost:
    """A cost as a survey of so many rows, which took so many seconds, lets one see it: bytes, and the time to go."""
    again = _cost(prepared, survey, 0.0, seconds / looked * BUNDLE, 0.0)
    spread = [getattr(cost, name) / cost.seconds for name in ("least_seconds", "most_seconds")]
    return replace(
        again, rays=cost.rays, least_seconds=spread[0] * again.seconds, most_seconds=spread[1] * again.seconds
    )


def _cost(
    prepared: Prepared, survey: Survey, rays: float, bundle_seconds: float, survey_seconds: float, spread: float = 0.0
) -> Cost:
    rows, columns, settings = prepared.count, prepared.columns, prepared.settings
    groups, tiles = -(-rows // GROUP), -(-rows // TILE_ROWS)
    channels = prepared.direct.channels
    entry = entry_bytes(settings.width, channels)
    entries, texels = survey.looked.entries_per_group, survey.looked.texel_bytes
    tile = TILE_ROWS / GROUP * entries * entry + TILE_ROWS / BUNDLE * texels
    audit = min(_AUDIT_GROUPS, groups // 64) * prepared.stored * _FILLED * entry_bytes("i16", channels)
    bands = int(columns.bands[-1]) + 1
    receivers = rows * (4 + 4 + 36 + 2) + _own_bytes(prepared)
    matrix = groups * entries * entry + tiles * 4 * (prepared.stored + 1) + rows * bands * 4 + prepared.bundles * texels
    seconds = (
        surveyed_bundles(rows) * survey_seconds
        + prepared.bundles * bundle_seconds
        # Writing, syncing and the check of everything: some milliseconds a file, and each byte thrice.
        + 0.02 * (3 + -(-tiles // TILES_PER_SHARD))
        + 3 * (matrix + receivers + audit) / 1e9
    )
    scratch = used_threads() * GROUP * 6 * columns.face**2 * 8
    return Cost(
        rays=rays,
        bytes_on_disk=matrix + receivers + audit,
        bytes_in_memory=INTERPRETER
        + TRIANGLE * len(prepared.scene.triangles)
        + PIXEL * rows
        + scratch
        + min(tiles, TILES_PER_SHARD) * tile * 3
        + audit,
        seconds=seconds,
        least_seconds=seconds * (1 - spread),
        most_seconds=seconds * (1 + spread),
        threads=used_threads(),
    )


def _own_bytes(prepared: Prepared) -> float:
    """Of the picture, or of the corners of triangles; and of the scene, which is kept."""
    scene, camera = prepared.scene, prepared.scene.camera
    own = 4 * camera.width * camera.height if prepared.request.receivers == "pixels" else 12 * len(scene.triangles)
    return own + sum(array.nbytes for array in prepared.kept.arrays().values())


def _left_out(prepared: Prepared, probe: _Probe, part: Part) -> list[LeftOut]:
    """What the scene and the request do not call for: each reason names what was found."""
    scene, settings, columns = prepared.scene, prepared.settings, prepared.columns
    materials = _materials(prepared)
    left_out = []
    if part.channels == 1:
        why = f"{materials}, so that a receiver's colour stays outside M"
        left_out.append(LeftOut("2 of 3 colour channels", why))
    if prepared.between is None or probe.hit_share == 0:
        left_out.append(LeftOut("bounces", _bounces(probe)))
    if part.factors == 1 and not prepared.factored:
        view = "one view, and " if prepared.request.receivers == "pixels" else ""
        left_out.append(LeftOut("view factors", f"{view}{materials}"))
    if scene.models and not prepared.glossy:
        left_out.append(LeftOut(GLOSS, "not asked for"))
    if prepared.texels_left_out:
        left_out.append(LeftOut("texel columns", prepared.texels_left_out))
    if any(relief is not None for relief in scene.reliefs):
        if prepared.request.receivers == "vertices":
            left_out.append(LeftOut("pictures of normals", "vertices face as the mesh does"))
        elif prepared.request.normals == "flat":
            left_out.append(LeftOut("pictures of normals", "not asked for"))
    behind = prepared.rows.unseen
    if behind:
        left_out.append(LeftOut("rows for pixels without a surface", f"{behind:,} pixels show the environment itself"))
    left_out.append(
        LeftOut(
            "rays below the horizon",
            f"{100 * (1 - probe.above_share):.0f} % of {6 * columns.face**2:,} directions a receiver",
        )
    )
    kept = probe.survey.looked.entries_per_group / prepared.stored
    if settings.tolerance > 0 and kept < 1:
        left_out.append(
            LeftOut("entries that truncation finds too small", f"{100 * (1 - kept):.1f} % of columns in 16 rows")
        )
    if not settings.edges and prepared.request.receivers == "pixels":
        left_out.append(LeftOut("samples of pixel edges", f"one receiver a pixel ({prepared.quality})"))
    if not settings.edge_side:
        left_out.append(LeftOut("rays into shadow edges", f"one ray a texel ({prepared.quality})"))
    if all(texture is None for texture in scene.textures):
        left_out.append(LeftOut("texture look-ups", f"none of {len(scene.textures)} materials has a texture"))
    return left_out


def _bounces(probe: _Probe) -> str:
    if probe.hit_share == 0:
        return "no surface sees another: none of the rays that were tried hit"
    return (
        f"light between surfaces was not asked for; {100 * probe.hit_share:.0f} % of the rays above a horizon hit one"
    )
