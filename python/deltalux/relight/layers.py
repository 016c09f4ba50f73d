"""Out to engines and compositors: light groups and what is seen besides, as layers of one file."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..camera import Camera
from ..columns.lamps import Lamps
from ..io import save_parts
from ..light.environment import Environment, Peak
from ..light.lamps import PointLight, Spot
from ..mistakes import described, instead_of
from ..transport.aov import aov
from ..transport.mesh import save_mesh
from ..transport.transport import Transport

__all__ = ["save_layers"]

_FARTHEST = np.float32(1e10)
"""The depth of what is not there, as compositors have it."""
_OWN = ("rgba", "albedo", "normal", "position", "depth", "emission")
"""Parts of our own, which no group may be called by."""

_Group = Environment | ArrayLike


def save_layers(
    path: str | os.PathLike[str],
    transport: Transport,
    groups: Mapping[str, _Group] | None = None,
    *,
    camera: Camera | None = None,
    lamps: Iterable[Peak | PointLight | Spot] = (),
    half: bool = False,
) -> None:
    """Writes each light group as a layer of its own, so that a compositor or an engine mixes them.

    Parameters
    ----------
    path
        An .exr: the part ``rgba`` with all light in R, G, B and A; a part for each group, with ``NAME.R``, ``NAME.G``
        and ``NAME.B``, which add up to it, with ``emission`` where surfaces give off light; and ``albedo.R`` to
        ``albedo.B``, ``N.X`` to ``N.Z``, ``P.X`` to ``P.Z`` and ``Z``, the distance from the eye (1e10 where nothing
        is). Or a .glb of a transport of vertices: ``COLOR_0`` with all light, ``COLOR_1`` and so on with a group each,
        whose names are in the mesh's ``extras.lightGroups``.
    transport
        M, of pixels or vertices.
    groups
        By name: an environment, or V itself. None: the lamps or groups that the columns are, each alone.
    camera
        Of vertices in an .exr; None: that of the transport.
    lamps
        What an engine is to shine besides, in a .glb by KHR_lights_punctual: peaks of an environment
        (`Environment.peaks`), which become directional lights of their irradiance, `PointLight` or `Spot`.
    half
        Colours in half floats, in an .exr.

    Raises
    ------
    TypeError
        If an argument is something else.
    ValueError
        If a name cannot be one, the file ends otherwise, or does not go with the transport.
    OSError
        If the disk refuses.
    """
    if not isinstance(transport, Transport):
        raise instead_of("Transport", transport)
    suffix, lights = Path(path).suffix.lower(), [_punctual(lamp) for lamp in lamps]
    if suffix not in (".exr", ".glb"):
        raise ValueError(f"expected an .exr or a .glb for layers, got {Path(path).name!r}")
    if lights and suffix == ".exr":
        raise ValueError("expected lamps with a .glb only: an .exr has no lights")
    products = _products(transport, _groups(transport, groups))
    if suffix == ".glb":
        _save_glb(path, transport, products, lights)
    else:
        _save_exr(path, transport, products, camera, half)


def _groups(transport: Transport, groups: Mapping[str, _Group] | None) -> Mapping[str, _Group]:
    if groups is None:
        columns = transport.columns
        if not isinstance(columns, Lamps):
            raise ValueError(f"expected groups of light by name: columns are {columns}")
        names = columns.names or [f"lamp{k + 1}" for k in range(columns.columns)]
        alone = np.eye(len(names))[:, :, None] * np.ones(3)
        groups = dict(zip(names, alone, strict=True))
    for name in groups:
        if not re.fullmatch(r"[A-Za-z][A-Za-z0-9_-]*", name) or name in _OWN:
            raise ValueError(f"expected names of letters and digits that are none of {', '.join(_OWN)}, got {name!r}")
    if not groups:
        raise ValueError("expected at least one group of light, got none")
    return groups


def _products(transport: Transport, groups: Mapping[str, _Group]) -> dict[str, NDArray[np.float32]]:
    """B of each group."""
    light = [transport.coefficients(own) if isinstance(own, Environment) else own for own in groups.values()]
    return dict(zip(groups, transport.multiply(np.stack([np.asarray(V, np.float64) for V in light])), strict=True))


def _save_exr(
    path: str | os.PathLike[str],
    transport: Transport,
    products: Mapping[str, NDArray[np.float32]],
    camera: Camera | None,
    half: bool,
) -> None:
    def picture(B: NDArray[np.float32]) -> NDArray[np.float32]:
        return transport.image(B) if camera is None else transport.render(camera, B)

    samples = transport.seen(next(iter(products.values())), camera).samples
    dark = picture(np.zeros((transport.shape[0], 3), np.float32))
    layers = {name: picture(B) - dark for name, B in products.items()}
    if transport.emitted is not None:
        layers["emission"] = dark
    alpha = aov(samples, None, "mask")[..., None]
    whole = np.concatenate([np.sum(list(layers.values()), axis=0), alpha], axis=2)
    there = alpha > 0
    depth = aov(samples, transport.camera if camera is None else camera, "depth")[..., None]
    number = "half" if half else "float"
    parts: list[tuple[str, Sequence[str], NDArray[Any], str]] = [("rgba", ("R", "G", "B", "A"), whole, number)]
    parts += [(name, tuple(f"{name}.{c}" for c in "RGB"), own, number) for name, own in layers.items()]
    parts += [
        ("albedo", ("albedo.R", "albedo.G", "albedo.B"), aov(samples, None, "albedo"), number),
        ("normal", ("N.X", "N.Y", "N.Z"), aov(samples, None, "normal"), "float"),
        ("position", ("P.X", "P.Y", "P.Z"), np.where(there, aov(samples, None, "position"), 0), "float"),
        ("depth", ("Z",), np.where(there, depth, _FARTHEST), "float"),
    ]
    save_parts(path, parts)


def _save_glb(
    path: str | os.PathLike[str],
    transport: Transport,
    products: Mapping[str, NDArray[np.float32]],
    lights: list[tuple[dict[str, Any], dict[str, Any]]],
) -> None:
    colours = {name: transport.colours(B) for name, B in products.items()}
    dark = transport.colours(np.zeros((transport.shape[0], 3), np.float32))
    layers = {name: own - dark for name, own in colours.items()}
    position, normal, triangles = transport.mesh()
    save_mesh(path, position, normal, triangles, dark + np.sum(list(layers.values()), axis=0), layers, lights)


def _punctual(lamp: Any) -> tuple[dict[str, Any], dict[str, Any]]:
    """A light of KHR_lights_punctual, and the node that it stands in: lights shine along -z."""
    if isinstance(lamp, Peak):
        return _light("directional", lamp.flux), {"rotation": _turn(np.asarray(lamp.direction))}
    if isinstance(lamp, Spot):
        axis = np.asarray(lamp.position, np.float64) - np.asarray(lamp.target, np.float64)
        outer = float(np.radians(lamp.angle))
        cone = {"innerConeAngle": outer * (1 - lamp.blend), "outerConeAngle": outer}
        where = {"translation": list(map(float, np.asarray(lamp.position))), "rotation": _turn(axis)}
        return {**_light("spot", lamp.intensity), "spot": cone}, where
    if isinstance(lamp, PointLight):
        return _light("point", lamp.intensity), {"translation": list(map(float, np.asarray(lamp.position)))}
    raise TypeError(f"expected lamps to be peaks of an environment, PointLight or Spot, got {described(lamp)}")


def _light(kind: str, power: ArrayLike) -> dict[str, Any]:
    colour = np.asarray(power, np.float64)
    most = float(colour.max())
    return {"type": kind, "intensity": most, "color": (colour / most if most > 0 else colour + 1).tolist()}


def _turn(axis: NDArray[np.float64]) -> list[float]:
    """The quaternion (x, y, z, w) that turns +z to an axis the shortest way."""
    x, y, z = axis / np.linalg.norm(axis)
    turn = np.array([-y, x, 0.0, 1.0 + z]) if z > -1 + 1e-12 else np.array([1.0, 0.0, 0.0, 0.0])
    return [float(part) for part in turn / np.linalg.norm(turn)]
