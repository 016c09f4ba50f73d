"""Precomputation of BRDF curves: what materials show of a light that stands still, whatever curve they take."""

from __future__ import annotations

import hashlib
import json
import os
import time
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from .._core import CURVE_FACE, Behind, CurvePass, Looked, Receivers, TileData, TransportWriter, __version__
from ..brdf import Measured, Model
from ..brdf.curves import curve_of, kind_of
from ..checks import Vector, as_vector
from ..light.environment import Environment
from ..progress import Progress, reporter
from ..scene.scene import Scene
from ..surface.material import Material, encoded
from ..transport.curves import FOLDER, CurveTransport
from ..transport.entry import TILE_ROWS, TILES_PER_SHARD
from ..transport.plan import Part, Plan
from .edited import Edited, edited
from .preparation import Prepared, Request, shaded, surveyed_bundles
from .room import check_folder_of, claim

__all__ = ["light_digest", "made_again", "precompute_curves"]

QUANTUM = -40
"""Rows of curves begin far below those of light: near a highlight a node holds the light of a few thousandths of a
steradian, and curves there are in the thousands. (Groups whose rows are long take units of their own.)"""
_FINER = (1, 2, 4, 8)
_COLUMNS, _CURVE = "haar:64", "curve"
# Bundles that are looked at first, at most: rows of curves take longer than rows of light.
_SURVEY = 16
_Tell = Callable[[int], None]


def precompute_curves(
    scene: Scene,
    path: str | os.PathLike[str],
    *,
    env: Environment,
    materials: Mapping[str, Model | Measured],
    fresnel: str | Mapping[str, str] = "auto",
    quality: str = "publication",
    tolerance: float | None = None,
    progress: bool | Progress = True,
) -> CurveTransport:
    """Ray traces what some materials show under a light, for every curve that they may take, into a directory.

    Direct light alone, as in Ben-Artzi et al. (2006). A run that is interrupted resumes where it stopped when it is
    called again with the same arguments.

    Parameters
    ----------
    scene
        Geometry, materials and camera.
    path
        Directory to make. A transport of curves that is there is replaced; anything else is not.
    env
        The light.
    materials
        The lobes that are edited, by the names of the scene's materials (`Scene.names`): models with a lobe, over the
        diffuse albedo and under the specular colour of the material (white where it has none), or a measured material
        in its place. An anisotropic model is edited at one ratio of its two widths, Beckmann's and GGX's masking stay
        as they are now.
    fresnel
        "auto": what the model says of Fresnel's reflectance is edited: nothing, the reflectance at normal incidence
        (a rank of 2), the index of a dielectric (3) or of a metal (5; dielectrics as well). "fixed": nothing, with a
        third to a fifth of the bytes. "dielectric" and "metal" prepare for more than the model is now. Of all
        materials, or by their names.
    quality
        "preview", "publication" or "lossless" (`QUALITIES`).
    tolerance
        Relative L2 error of the picture that truncation may cause, the worst that is measured under highlights of 34
        kinds down to a roughness of 0.01, at the reflectance that the model has (default: the quality's).
    progress
        True: a bar on standard error. A callable: progress(rows done, rows in all).

    Returns
    -------
    CurveTransport
        Opened from `path`.

    Raises
    ------
    ValueError
        If an argument cannot be used, a material is not in the scene, or no pixel shows it; before any long work.
    FileExistsError
        If something else is at `path`.
    OSError
        If the disk refuses; what was finished is kept for the next run.
    """
    asked = _Asked(quality, tolerance, fresnel)
    return _Curves(scene, env, materials, asked, progress).run(Path(path))


def light_digest(env: Environment) -> str:
    """What tells lights apart: a digest of the map on a cubemap.

    Parameters
    ----------
    env
        The light.

    Returns
    -------
    str
        64 hexadecimal digits (BLAKE2b).
    """
    return hashlib.blake2b(np.ascontiguousarray(env.cubemap(2 * CURVE_FACE)).data, digest_size=32).hexdigest()


def made_again(transport: CurveTransport, scene: Scene, env: Environment) -> CurveTransport:
    """A transport in its place under another light, from the scene that a file does not keep.

    Parameters
    ----------
    transport
        Opened from a file.
    scene
        What it was made of.
    env
        The light.

    Returns
    -------
    CurveTransport

    Raises
    ------
    ValueError
        If the scene is another, or a material is measured: files do not keep those.
    """
    if not isinstance(scene, Scene):
        raise ValueError(f"expected the scene as a dl.Scene, got {scene!r}")
    materials = {part.name: part.model for part in transport.parts.values() if part.model is not None}
    measured = [name for name in transport.parts if name not in materials]
    if measured:
        raise ValueError(f"expected models, but {', '.join(measured)} is measured, which a file does not keep")
    first = next(iter(transport.parts.values())).transport
    if first._core.scene != scene.content_hash():
        raise ValueError(f"expected the scene that {transport.path} was made of, got {scene.name}, or another camera")
    prepared = ("fixed", "dielectric", "metal")
    fresnel = {part.name: part.kind if part.kind in prepared else "auto" for part in transport.parts.values()}
    asked = _Asked(first.plan.quality, first.plan.tolerance, fresnel)
    return _Curves(scene, env, materials, asked, True).run(transport.path)


@dataclass(frozen=True)
class _Asked:
    """How closely, and what of Fresnel's reflectance is edited."""

    quality: str
    tolerance: float | None
    fresnel: str | Mapping[str, str]
    drawn: Mapping[str, NDArray[np.float64]] = field(default_factory=dict)
    """Reflectances that were drawn of some materials, (m, 512) each."""

    def kind(self, name: str, model: Model | Measured) -> str:
        """The word of `KINDS` for a material."""
        word = self.fresnel if isinstance(self.fresnel, str) else self.fresnel.get(name, "auto")
        own = "none" if isinstance(model, Measured) else kind_of(model)
        if word == "auto" or (word == "fixed" and own == "none"):
            return own
        fits = {"fixed": True, "dielectric": own == "dielectric", "metal": own in ("dielectric", "metal")}
        if word not in fits:
            raise ValueError(f'expected fresnel "auto", "fixed", "dielectric" or "metal", got {word!r}')
        if not fits[word]:
            raise ValueError(f"expected fresnel={word!r} of a model whose index is given (n=, k=), got {model!r}")
        return word


class _Curves:
    """One request: materials checked and their rows found, then the run."""

    def __init__(
        self,
        scene: Scene,
        env: Environment,
        materials: Mapping[str, Model | Measured],
        asked: _Asked,
        progress: bool | Progress,
    ) -> None:
        if not isinstance(env, Environment):
            raise ValueError(f"expected the light as a dl.Environment, got {env!r}")
        if not materials:
            raise ValueError("expected at least one material to edit, got none")
        if scene.emission is not None:
            raise ValueError("expected a scene whose surfaces give off no light: it is not in pictures of curves")
        numbers = {name: scene.numbered(name) for name in materials}
        if not isinstance(asked.fresnel, str) and not set(asked.fresnel) <= set(materials):
            raise ValueError(f"expected fresnel of {', '.join(materials)}, got {', '.join(asked.fresnel)}")
        kinds = {name: asked.kind(name, _checked(model)) for name, model in materials.items()}
        self.env, self.scene, self.materials, self.asked = env, scene, dict(materials), asked
        self.progress, self.tell = progress, reporter(progress, f"curves of {scene.name}")
        self.light = light_digest(env)
        plain = scene
        for name, number in numbers.items():
            albedo = (0.0, 0.0, 0.0) if isinstance(materials[name], Measured) else scene.materials[number].albedo
            plain = plain.with_material(number, Material(albedo))
        # What is not edited is made as light is: diffuse rows, and lobes of the other materials.
        self.prepared = Prepared(plain, Request(_COLUMNS, asked.quality, asked.tolerance), step=self.tell.begin)
        self.settings = self.prepared.settings
        seen = self.prepared.core.receivers(self.prepared.camera, edges=self.settings.edges)
        shown = scene
        for name, number in numbers.items():
            shown = shown.with_material(number, Material(model=materials[name]))
        seen = shaded(shown, seen)
        self.rows = {name: self._rows(number, seen) for name, number in numbers.items()}
        unseen = [name for name, rows in self.rows.items() if len(rows) == 0]
        if unseen:
            raise ValueError(f"expected materials that the camera sees, but no pixel shows {', '.join(unseen)}")
        self.tell.begin("reflectances")
        given = {name: scene.materials[number] for name, number in numbers.items()}
        self.edited = [
            edited(name, model, _specular(given[name]), kinds[name], asked.drawn.get(name))
            for name, model in materials.items()
        ]

    def _rows(self, number: int, seen: Receivers) -> Receivers:
        """The receivers of one material."""
        own = [place == number for place in range(len(self.scene.albedo))]
        return seen.glossy(self.scene.material[seen.triangle], own, [[] for _ in own], self.scene.camera.position)

    def run(self, path: Path) -> CurveTransport:
        """Part after part, then the picture of all else, and last what says that all is there."""
        started = time.perf_counter()
        check_folder_of(path)
        job = self._job()
        claim(path, "a transport of curves", job)
        total = self.prepared.count + sum(map(len, self.rows.values()))
        tell, done = self.tell, 0
        light = [self.env.cubemap(CURVE_FACE * finer) for finer in _FINER]
        for number, own in enumerate(self.edited):
            tell.step(own.name)
            if not (path / f"part-{number}").exists():
                self._part(path / f"part-{number}", own, light, tell.after(done, total))
            done += len(self.rows[own.name])
        tell.step("all else")
        base = self._base(tell.after(done, total))
        self._finish(path, base, time.perf_counter() - started)
        tell(total, total)
        return replace(CurveTransport.open(path), _again=partial(self._again, path))

    def _again(
        self, path: Path, env: Environment | None = None, drawn: Mapping[str, NDArray[np.float64]] | None = None
    ) -> CurveTransport:
        """The same under another light, or with reflectances that were drawn since."""
        asked = replace(self.asked, drawn={**self.asked.drawn, **(drawn or {})})
        return _Curves(self.scene, env or self.env, self.materials, asked, self.progress).run(path)

    def _job(self) -> str:
        """What a run is known by."""
        about = {
            "scene": self.scene.content_hash(),
            "light": self.light,
            "materials": [[own.name, own.kind, own.digest] for own in self.edited],
            "version": __version__,
            **asdict(self.settings),
        }
        return json.dumps(about, sort_keys=True)

    def _part(self, path: Path, own: Edited, light: list[NDArray[np.float32]], tell: _Tell) -> None:
        """The rows of one material: a survey for the threshold, then tile after tile."""
        scene, settings, rows = self.scene, self.settings, self.rows[own.name]
        count, columns = len(rows), own.columns
        work = CurvePass(
            self.prepared.core,
            rows,
            own.quotient,
            eye=scene.camera.position,
            factors=own.reflectances.functions,
            light=light,
            edge_side=settings.edge_side,
        )
        weights = own.weights()

        def survey(width: str) -> Looked:
            return work.survey(
                min(surveyed_bundles(count), _SURVEY),
                tolerance=settings.tolerance,
                weights=weights,
                quantum=QUANTUM,
                width=width,
                curves=own.measured(),
            )

        # Rows of a group share their units: where they differ much, eight bits are not enough.
        width, looked = settings.width, survey(settings.width)
        if looked.error > settings.tolerance and width != "i16":
            width, looked = "i16", survey("i16")

        def made(tile: int) -> TileData:
            first = tile * TILE_ROWS
            data, *_ = work.tile(
                first,
                min(TILE_ROWS, count - first),
                threshold=looked.threshold,
                weights=weights,
                quantum=QUANTUM,
                width=width,
                progress=lambda done: tell(first + done),
            )
            return data

        writer = TransportWriter(path, self._job() + own.name)
        tiles, finished = range(-(-count // TILE_ROWS)), set(writer.finished(_CURVE))
        for shard in range(-(-len(tiles) // TILES_PER_SHARD)):
            if shard not in finished:
                numbers = tiles[shard * TILES_PER_SHARD : (shard + 1) * TILES_PER_SHARD]
                writer.write_shard(_CURVE, shard, [made(tile) for tile in numbers])
        error = 100 * max(looked.errors)
        bands = int(columns.bands[-1]) + 1
        part = Part(_CURVE, _CURVE, count, str(columns), columns.columns, bands, 3, 1, 0, f"the curve of {own.name}")
        plan = Plan(
            scene.name,
            len(scene.triangles),
            (scene.camera.width, scene.camera.height),
            self.asked.quality,
            settings.tolerance,
            [part],
            notes=[
                f"truncated at {looked.threshold:.3g}: {error:.2g} % under the worst of {len(looked.errors)} curves"
            ],
        )
        writer.finish(
            parts=[(_CURVE, str(columns), count, 3, QUANTUM, width, TILE_ROWS)],
            receivers=rows.table(np.ones((count, 3), np.float32), scene.material[rows.triangle].astype(np.uint16)),
            camera=json.dumps(asdict(scene.camera)),
            plan=plan.to_json(),
            scene=scene.content_hash(),
        )

    def _base(self, tell: _Tell) -> NDArray[np.float32]:
        """The picture of all that is not edited, untruncated, and what lies behind."""
        prepared = self.prepared
        response = prepared.direct.respond(prepared.columns.coefficients(self.env), progress=tell)
        material = prepared.scene.material[prepared.rows.triangle].astype(np.uint16)
        table = prepared.rows.table(prepared.albedo(), material)
        picture = table.resolve(response)
        self.env._behind(Behind(table.background, self.scene.camera.directions()), picture)
        return picture

    def _finish(self, path: Path, base: NDArray[np.float32], seconds: float) -> None:
        """The arrays, then the manifest: it stands for a whole directory, so it comes last."""
        arrays: dict[str, np.ndarray] = {"base": base}
        for number, own in enumerate(self.edited):
            model = encoded([own.model])
            arrays |= {
                f"curve.{number}": own.curve,
                f"functions.{number}": np.asarray(own.reflectances.functions),
                f"albedo.{number}": own.albedo(),
                f"specular.{number}": np.array(own.specular, np.float64),
                f"model.{number}": model["models"],
                f"parameters.{number}": model["parameters"],
            }
        about = {
            "light": self.light,
            "seconds": seconds,
            "camera": asdict(self.scene.camera),
            "materials": [{"name": own.name, "kind": own.kind, "unexplained": own.unexplained} for own in self.edited],
        }
        FOLDER.write(path, about, arrays)


def _checked(model: Model | Measured) -> Model | Measured:
    """Refuses what has no curve."""
    if isinstance(model, Model):
        curve_of(model)
    elif not isinstance(model, Measured):
        raise ValueError(f"expected a model of dl.brdf such as dl.brdf.CookTorrance(sigma=0.1), got {model!r}")
    return model


def _specular(material: Material) -> Vector:
    """What a material's lobe is multiplied by: white where it has none."""
    return as_vector(np.broadcast_to(np.asarray(material.specular if material.model else 1.0, np.float64), 3))
