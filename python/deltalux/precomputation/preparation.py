"""What comes before a plan: the scene ready for rays, and the receivers that its camera shows."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from numbers import Real
from typing import Any

import numpy as np

from .._core import DirectPass, Emitters, Looked, Receivers
from ..brdf import Measured
from ..checks import count
from ..columns import Columns, Haar
from ..columns.parse import checked
from ..mistakes import near
from ..progress import SILENT
from ..scene.scene import Scene
from ..surface.material import Lobe, encoded
from ..transport.entry import TILE_ROWS
from .between import Between, KnownNodes, Nodes, PlacedNodes
from .factoring import Factored, factored
from .lights import lights
from .quality import QUALITIES, Quality
from .refining import refined
from .room import check_request

__all__ = ["BUNDLE", "COLUMNS", "QUANTUM", "Prepared", "Request", "Survey", "shaded", "surveyed_bundles"]

COLUMNS = "haar:64+texels"
"""The basis where none is asked for."""
QUANTUM = -24
"""Every value of M is an integer times 2^-24: below what an image can show, coarse enough for exact sums. (Groups with
rows too long for that have units of their own.)"""
BUNDLE = 64
"""Rows that a pass makes together."""

# Bundles that are looked at first, to choose the threshold for the stated error: one in twenty, but at least and at
# most so many.
_SURVEY = (8, 64)


def surveyed_bundles(rows: int) -> int:
    """How many bundles of so many rows are looked at to choose the threshold."""
    return min(max(rows // (20 * BUNDLE), _SURVEY[0]), _SURVEY[1])


@dataclass(frozen=True)
class Survey:
    """What a survey has found, and the worst error under each light: with peaks in texels, if any, and without."""

    looked: Looked
    errors: dict[str, float]
    without: dict[str, float]


@dataclass(frozen=True)
class Request:
    """What is asked of a scene.

    Attributes
    ----------
    columns, quality, tolerance, receivers, normals, gloss, factors, refine
        As for `precompute`.
    between
        Of light between surfaces; None: nothing.
    """

    columns: Columns | str = COLUMNS
    quality: str = "publication"
    tolerance: float | None = None
    receivers: str = "pixels"
    normals: str = "smooth"
    between: Between | None = None
    gloss: bool = True
    factors: int | str = "auto"
    refine: float | None = None

    def __post_init__(self) -> None:
        if self.refine is not None:
            if self.receivers != "vertices":
                raise ValueError('expected refine with receivers="vertices" only, got pixels')
            if isinstance(self.refine, bool) or not isinstance(self.refine, Real) or not 0 < self.refine < 1:
                raise ValueError(f"expected refine above 0 and below 1, got {self.refine!r}")
        if isinstance(self.factors, str):
            if self.factors != "auto":
                raise ValueError(f'expected factors to be "auto" or how many, got {self.factors!r}')
        elif count("factors", self.factors) < 1:
            raise ValueError(f"expected at least one factor, got {self.factors}")
        for name, words in (("receivers", ("pixels", "vertices")), ("normals", ("smooth", "flat"))):
            if getattr(self, name) not in words:
                known = " or ".join(f'"{word}"' for word in words)
                raise ValueError(f"expected {name} to be {known}, got {getattr(self, name)!r}")


class Prepared:
    """A scene and a request, checked; the receivers are found, and nothing is written.

    Parameters
    ----------
    scene
        Its surfaces and its camera.
    request
        What is asked of it.
    known
        Nodes of the same scene that are there already, whatever the request says of light between surfaces.
    step
        Is told by name of each thing that takes time.
    """

    clock: Callable[[], float] = staticmethod(time.perf_counter)

    def __init__(
        self,
        scene: Scene,
        request: Request,
        known: KnownNodes | None = None,
        step: Callable[[str], None] = SILENT.begin,
    ) -> None:
        columns = request.columns
        self.columns = checked(columns)
        self.quality, self.settings = request.quality, _settings(request.quality, request.tolerance)
        check_request(scene)
        _check_materials(scene)
        self.own_triangles = len(scene.triangles)
        if request.refine is not None:
            step("refining")
            scene = refined(scene, float(request.refine), request.normals)
        self.scene, self.request = scene, request
        self.glossy = request.gloss and bool(scene.models)
        self.texels_left_out = ""
        if self.glossy and self.texels:
            # A texel's column is made anew from cosines and models: factors are neither, and tables are not ours to
            # copy.
            if request.receivers == "vertices":
                self.texels_left_out = "factors of lobes are signed; suns reach glossy vertices through wavelets"
            elif scene.turned:
                self.texels_left_out = "tangents of lobes are not kept; suns reach their rows through wavelets"
            elif any(isinstance(model, Measured) for model in scene.models):
                self.texels_left_out = (
                    "tables of measured materials are not kept; suns reach their rows through wavelets"
                )
        if self.texels_left_out:
            self.columns = Haar(self.columns.face)
        step("receivers")
        self.core = scene.traced(scene.camera.position)
        self.factored: dict[int, Factored] = {}
        self.turns: np.ndarray | None = None
        self.camera = scene.camera.rays()
        self.rows = self._found()
        self.count = len(self.rows)
        if self.count == 0:
            raise ValueError(f"the camera sees nothing of {scene.name}: no pixel shows a surface")
        self.between: Nodes | None = known
        if known is None and request.between is not None:
            step("places of nodes")
            self.between = PlacedNodes(
                self.core, scene, self.rows, self.camera, self.settings, self.columns, request.between
            )
        self.emitters: Emitters | None = None
        if scene.emission is not None:
            self.emitters = Emitters(self.core, np.ascontiguousarray(scene.emission[scene.material]))
        # Drawn here, once: no clock that times a survey is to time this.
        step("lights to survey under")
        self.lights = lights(self.columns)
        self.direct = DirectPass(self.core, self.rows, columns=str(self.columns), edge_side=self.settings.edge_side)

    def _found(self) -> Receivers:
        scene = self.scene
        if self.request.receivers == "pixels":
            seen = self.core.receivers(self.camera, edges=self.settings.edges)
            rows = shaded(scene, seen, smooth=self.request.normals == "smooth", tangents=self.glossy)
            if not self.glossy:
                return rows
            lobes = [lobes_of(model) for model in scene.models]
            # A measured material holds all that it reflects, and black has nothing to add to a lobe.
            black = (scene.albedo == 0).all(axis=1)
            diffuse = [
                model is None or not (isinstance(model, Measured) or dark)
                for model, dark in zip(scene.models, black, strict=True)
            ]
            return rows.glossy(scene.material[rows.triangle], diffuse, lobes, scene.camera.position)
        rows = self.core.vertices(scene.triangles, shading=self.request.normals, normals=scene.normals)
        if not self.glossy:
            return rows
        for number, model in enumerate(scene.models):
            if model is not None:
                self.factored[number] = factored(model, self.request.factors)
        nothing = np.zeros((0, 1, 1), np.float32)
        tables = [
            self.factored[number].light if number in self.factored else nothing for number in range(len(scene.albedo))
        ]
        self.turns = scene.turns(rows.triangle, rows.barycentric, rows.normal)
        return rows.factored(scene.material[rows.triangle], tables, self.turns)

    def albedo(self) -> np.ndarray:
        """What the response of each row is multiplied by: the diffuse albedo, or the colour of its lobe."""
        scene, rows = self.scene, self.rows
        pixels = self.request.receivers == "pixels"
        albedo = scene.albedo_at(rows.triangle, rows.barycentric, scene.camera if pixels else None)
        lobe, material = rows.lobe, scene.material[rows.triangle]
        if scene.specular is not None:
            for number, model in enumerate(scene.models):
                # Of factors the eye has the colours of a measured lobe.
                own = self.factored.get(number)
                of = [_ONE] * own.count if own else lobe_colours(model)
                for place, colour in enumerate(of):
                    albedo[(material == number) & (lobe == place)] = scene.specular[number] * colour
                if isinstance(model, Measured):
                    albedo[(material == number) & (lobe < 0)] = 0
        return albedo

    def radiance(self) -> np.ndarray:
        """What the surface of each row gives off by itself, (rows, 3) float32: once, however many rows show it."""
        scene, lobe = self.scene, self.rows.lobe
        material = scene.material[self.rows.triangle]
        own = np.zeros((self.count, 3), np.float32)
        if scene.emission is not None:
            first = (lobe < 0) | ((lobe == 0) & ~np.isin(material, material[lobe < 0]))
            own[first] = scene.emission[material[first]]
        return own

    @property
    def kept(self) -> Scene:
        """The scene as the transport keeps it: at vertices, which it shows, factors stand for the tables of measured
        materials."""
        scene = self.scene
        measured = [isinstance(model, Measured) for model in scene.models]
        if self.request.receivers == "pixels" or not any(measured):
            return scene
        models = tuple(None if isinstance(model, Measured) else model for model in scene.models)
        # A measured material holds all that it reflects.
        albedo = np.where(np.array(measured)[:, None], np.float32(0), scene.albedo)
        return replace(scene, models=models, albedo=albedo)

    def beside(self) -> dict[str, np.ndarray]:
        """What shows vertices: the rows of triangles; and of glossy ones, what the eye makes of factors."""
        if self.request.receivers == "pixels":
            return {}
        rows = self.rows
        shown = {"corners": rows.corners, "shown": rows.shown}
        if not self.factored:
            return shown
        eyes = {f"eye.{number:05}": factors.eye for number, factors in self.factored.items()}
        turned = {} if self.turns is None else {"turn": self.turns[rows.base]}
        return shown | {"base": rows.base, "factor": rows.lobe.astype(np.uint32)} | eyes | turned

    @property
    def asked(self) -> dict[str, object]:
        """What a run is known by besides its scene, columns and settings, where it is not the plainest."""
        request = self.request
        asked: dict[str, object] = {} if request.between is None else {"between": asdict(request.between)}
        if isinstance(self.between, KnownNodes):
            asked |= {"nodes": self.between.name}
        asked |= {} if request.gloss else {"gloss": False}
        if request.receivers == "vertices":
            asked |= {"vertices": request.normals, "factors": request.factors}
        elif request.normals != "smooth":
            asked |= {"normals": request.normals}
        return asked

    @property
    def texels(self) -> bool:
        """Whether some columns are texels."""
        return isinstance(self.columns, Haar) and self.columns.texels

    @property
    def tiles(self) -> int:
        """Tiles of all rows."""
        return -(-self.count // TILE_ROWS)

    @property
    def bundles(self) -> int:
        """Bundles of all rows."""
        return -(-self.count // BUNDLE)

    @property
    def stored(self) -> int:
        """Columns that have entries: of texels rows keep bits."""
        return self.columns.wavelets if isinstance(self.columns, Haar) else self.columns.columns

    def survey(self, bundles: int, progress: Callable[[int], None] | None = None) -> Survey:
        """Looks at some bundles: by which threshold the tolerance is kept, and what follows from it."""
        found = self.direct.survey(
            bundles,
            tolerance=self.settings.tolerance,
            quantum=QUANTUM,
            width=self.settings.width,
            lights=[(light.decides, light.truncated, light.whole) for light in self.lights],
            progress=progress,
        )
        errors: dict[str, float] = {}
        without: dict[str, float] = {}
        for light, error in zip(self.lights, found.errors, strict=True):
            of = without if light.peaks == 0 else errors
            of[light.name] = max(error, of.get(light.name, 0.0))
        return Survey(found, errors, without)


def shaded(scene: Scene, rows: Receivers, *, smooth: bool = True, tangents: bool = True) -> Receivers:
    """The rows of pixels with the normals that a scene brings, and tangents for lobes that ask for them.

    Parameters
    ----------
    scene
        Seen by its camera; of its materials only the models matter.
    rows
        Of pixels, with the normals of their triangles.
    smooth
        Whether to take normals of vertices, and pictures of them.
    tangents
        Whether to take tangents.

    Returns
    -------
    Receivers
    """
    at, normals = (rows.triangle, rows.barycentric), None
    if smooth and len(rows):
        normals = scene.shading_normals(*at, rows.normal, scene.camera)
    turns = scene.turns(*at, rows.normal if normals is None else normals) if tangents else None
    return rows if normals is None and turns is None else rows.shaded(normals, turns)


_MOST_MATERIALS = 65_535


def _check_materials(scene: Scene) -> None:
    """Refuses what rows cannot tell apart."""
    if len(scene.albedo) > _MOST_MATERIALS:
        raise ValueError(f"expected at most {_MOST_MATERIALS:,} materials, got {len(scene.albedo):,}")


_ONE = np.ones(3, np.float32)


def lobes_of(model: Lobe | None) -> list[Any]:
    """The lobes that rows of a material have, as the core takes them: of a measured one each of its colours."""
    if model is None:
        return []
    if isinstance(model, Measured):
        return [(model.core(), channel) for channel in range(3)]
    stored = encoded([model])
    return [(int(stored["models"][0]), stored["parameters"][0].tolist())]


def lobe_colours(model: Lobe | None) -> list[np.ndarray]:
    """What each of them is a share of."""
    if model is None:
        return []
    return list(np.eye(3, dtype=np.float32)) if isinstance(model, Measured) else [_ONE]


def _settings(quality: str, tolerance: float | None) -> Quality:
    if not isinstance(quality, str) or quality not in QUALITIES:
        raise ValueError(f"expected a quality of {', '.join(QUALITIES)}, got {quality!r}{near(quality, QUALITIES)}")
    chosen = QUALITIES[quality]
    if tolerance is None:
        return chosen
    if not isinstance(tolerance, Real) or not 0 <= tolerance < 1:
        raise ValueError(f"expected a tolerance from 0 to 1 (0.01 is 1 % image error), got {tolerance!r}")
    return replace(chosen, tolerance=float(tolerance))
