"""Transport of BRDF curves: a matrix for each material that is edited, and the picture of all else."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._core import CURVE
from ..brdf import Model
from ..brdf.curves import COSINES, KINDS, Reflectances
from ..camera import Camera
from ..checks import Vector, as_vector
from ..columns import Daubechies4
from ..surface.material import decoded
from .folder import Folder, array
from .transport import Transport

__all__ = ["FOLDER", "CurvePart", "CurveTransport"]

FOLDER = Folder("a transport of curves", "curves.json", 2)


@dataclass(frozen=True, eq=False)
class CurvePart:
    """What one material shows, for every curve that it may take.

    Attributes
    ----------
    name
        Of the material.
    transport
        T': a row for each pixel that shows it, `Daubechies4` columns, each colour its own.
    model
        As it was when T' was made; None of a measured material.
    curve
        (256, 3): the curve then, of a measured material that which `separated` found.
    specular
        What its lobe is multiplied by.
    kind
        What of Fresnel's reflectance is edited: a word of `deltalux.brdf.curves.KINDS`.
    reflectances
        What that is a sum of.
    albedo
        (factors, 256, 3): what each node of a curve reflects of an even sky to the normal.
    unexplained
        Of a measured material the share of its look that curve and Fresnel's term do not say; None of a model.
    """

    name: str
    transport: Transport
    model: Model | None
    curve: NDArray[np.float64]
    specular: Vector
    kind: str
    reflectances: Reflectances
    albedo: NDArray[np.float64]
    unexplained: float | None

    @property
    def columns(self) -> Daubechies4:
        """The basis that V is measured in."""
        return Daubechies4(len(self.reflectances.functions))

    def __str__(self) -> str:
        rows, columns = self.transport.shape
        megabytes = self.transport.nbytes / 1e6
        what = f"{self.name}: {rows:,} rows x {columns} columns, {megabytes:.1f} MB, Fresnel {self.kind}"
        if self.unexplained is None:
            return what
        return f"{what}; curve and Fresnel's term leave {100 * self.unexplained:.1f} % of it unexplained"


@dataclass(frozen=True, eq=False)
class CurveTransport:
    """The transport of a still scene under a light that stands still, for materials whose curves are edited.

    Made by `precompute_curves` and opened by `CurveTransport.open`; `BrdfEditor` edits. Nothing in it changes.

    Attributes
    ----------
    path : Path
        The directory.
    parts : mapping of str to CurvePart
        By the names of materials.
    base : (height, width, 3) float32
        All that is not edited: diffuse light, other materials, and the light behind the scene.
    camera : Camera
        Whose pixels the rows are.
    light : str
        A digest of the light that is in it.
    seconds : float
        That it took to make: what another light takes.
    """

    path: Path
    parts: Mapping[str, CurvePart]
    base: NDArray[np.float32]
    camera: Camera
    light: str
    seconds: float
    _again: Callable[..., CurveTransport] | None = field(default=None, repr=False)

    @property
    def nbytes(self) -> int:
        """Bytes of all matrices."""
        return sum(part.transport.nbytes for part in self.parts.values())

    @staticmethod
    def open(path: str | os.PathLike[str]) -> CurveTransport:
        """Opens a directory that `precompute_curves` made.

        Parameters
        ----------
        path
            The directory.

        Returns
        -------
        CurveTransport

        Raises
        ------
        FileError
            (a ValueError) If it holds something else, or a file is damaged.
        OSError
            If a file cannot be read.
        """
        path = Path(path)
        with FOLDER.opened(path) as (about, stored):
            camera = Camera(**about["camera"])
            base = array(stored, "base", np.float32, (camera.height, camera.width, 3))
            parts = {own["name"]: _part(path, own, number, stored) for number, own in enumerate(about["materials"])}
            return CurveTransport(path, parts, base, camera, str(about["light"]), float(about["seconds"]))

    def __repr__(self) -> str:
        return f"<CurveTransport of {', '.join(self.parts)}, {self.nbytes / 1e6:.1f} MB>"


def _part(folder: Path, about: Mapping[str, Any], number: int, stored: Mapping[str, NDArray[Any]]) -> CurvePart:
    """One material of a manifest, whoever wrote it."""
    kind = about["kind"]
    if kind not in KINDS:
        raise ValueError(f"expected what is edited of Fresnel's reflectance as one of {', '.join(KINDS)}, got {kind!r}")

    def own(name: str, *shape: int) -> NDArray[np.float64]:
        return array(stored, f"{name}.{number}", np.float64, shape)

    # What was drawn stands behind the functions of its kind.
    factors = len(stored[f"functions.{number}"])
    if not KINDS[kind] <= factors <= KINDS[kind] + 3:
        raise ValueError(f"expected {KINDS[kind]} functions of a reflectance, or up to 3 more, found {factors}")
    kinds, numbers = stored[f"model.{number}"].astype(np.uint32), stored[f"parameters.{number}"].astype(np.float64)
    part = CurvePart(
        name=str(about["name"]),
        transport=Transport.open(folder / f"part-{number}"),
        model=decoded(kinds, numbers)[0],
        curve=own("curve", CURVE, 3),
        specular=as_vector(own("specular", 3)),
        kind=kind,
        reflectances=Reflectances(own("functions", factors, len(COSINES))),
        albedo=own("albedo", factors, CURVE, 3),
        unexplained=None if about["unexplained"] is None else float(about["unexplained"]),
    )
    if str(part.transport.columns) != str(part.columns):
        raise ValueError(f"expected a part over {part.columns}, got {part.transport.columns}")
    return part
