"""Measured materials, from the files of two laboratories."""

from __future__ import annotations

import hashlib
import os
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._core import MERL, FileError
from .._core import Measured as Core
from ..plain import read_plain
from ..rotation import unit_directions
from . import tensor_file
from .model import paired, rows, sampled

# A table of MERL has 35 MB.
_MOST_BYTES = 1 << 30
# MERL's scale of each colour.
_MERL_SCALE = (1.0 / 1500.0, 1.15 / 1500.0, 1.66 / 1500.0)
_MERL_HEADER = np.array(MERL, "<i4").tobytes()
# The fields of a material of EPFL's, and how many dimensions each has.
_RGL_FIELDS = {"phi_i": 1, "theta_i": 1, "ndf": 2, "sigma": 2, "vndf": 4, "luminance": 4, "rgb": 5}


@dataclass(frozen=True, eq=False)
class Measured:
    """A measured material: its reflectance in linear RGB, as a table.

    Unlike a model, which is one number under a colour of the user's, a measured material has its own colours, which
    differ from direction to direction: `evaluate` and `albedo` have a last axis of length 3. `sample` and `pdf` are one
    density for all colours, as for models.

    MERL (``.binary``, Matusik et al. 2003): isotropic, by half and difference angles, looked up as MERL's own program
    does, the value of the cell without interpolation. Reciprocal by construction. EPFL's laboratory (``.bsdf``, Dupuy
    and Jakob 2018): isotropic or anisotropic, interpolated over a grid that follows the visible facets; the table is
    parametrised by ``wo``, and reciprocal only as far as the measurement is: below 80 degrees, f(wi, wo) and f(wo, wi)
    of their white paper, golden yellow and ibiza sunset differ by 2, 14 and 26 % of their mean at the median. Neither
    promises to conserve energy; of these three no albedo at 0, 30, 60, 80 and 89 degrees is above 1.

    Attributes
    ----------
    description : str
        What the file says of the material, if it says something.
    clamped : int
        Numbers of the table that were negative, which no surface is, and were set to 0.
    digest : str
        Of the file, 64 hexadecimal digits (BLAKE2b): what tells materials apart.
    """

    _core: Core = field(repr=False)
    description: str
    clamped: int
    digest: str = field(default="", repr=False)

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Measured:
        """Reads a material; the content says which kind it is, not the name.

        Parameters
        ----------
        path
            A ``.binary`` of MERL, or a ``.bsdf`` of EPFL's laboratory in RGB (``*_rgb.bsdf``).

        Returns
        -------
        Measured
            The material.

        Raises
        ------
        FileError
            If it is neither, or truncated or damaged.
        OSError
            If it cannot be read.
        """
        data = read_plain(path, _MOST_BYTES)
        try:
            return cls(*_material(data), hashlib.blake2b(data, digest_size=32).hexdigest())
        except ValueError as error:
            raise FileError(f"{os.fspath(path)}: {error}") from None

    def core(self) -> Core:
        """The table as the core has it.

        Returns
        -------
        deltalux._core.Measured
            Checked.
        """
        return self._core

    def evaluate(self, wi: ArrayLike, wo: ArrayLike) -> NDArray[np.float64]:
        """f(wi, wo) in linear RGB, without the cosine.

        Parameters
        ----------
        wi, wo : (..., 3) real
            To the light and to the eye; broadcast against each other.

        Returns
        -------
        (..., 3) float64
            1 / sr, finite and never negative.

        Raises
        ------
        ValueError
            If a shape is wrong, or a direction is zero or not finite.
        """
        pairs = paired(wi, wo)
        return self._core.evaluate(*rows(*pairs)).reshape(pairs[0].shape)

    def pdf(self, wi: ArrayLike, wo: ArrayLike) -> NDArray[np.float64]:
        """The density with which `sample` gives wi for wo.

        Parameters
        ----------
        wi, wo : (..., 3) real
            To the light and to the eye; broadcast against each other.

        Returns
        -------
        (...) float64
            1 / sr.

        Raises
        ------
        ValueError
            If a shape is wrong, or a direction is zero or not finite.
        """
        pairs = paired(wi, wo)
        return self._core.pdf(*rows(*pairs)).reshape(pairs[0].shape[:-1])[()]

    def sample(self, wo: ArrayLike, u: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Directions to the light, about as dense as the table is bright.

        Parameters
        ----------
        wo : (..., 3) real
            To the eye.
        u : (..., 2) real
            Two numbers in [0, 1) for each sample; broadcast against ``wo``.

        Returns
        -------
        wi : (..., 3) float64
            Unit directions; (0, 0, 0) where there is none.
        pdf : (...) float64
            The density of each over solid angle; 0 there.

        Raises
        ------
        ValueError
            If a shape is wrong, a direction is zero or not finite, or a number is not in [0, 1).
        """
        return sampled(self._core, wo, u)

    def albedo(self, wo: ArrayLike) -> NDArray[np.float64]:
        """The directional albedo: the share of an even sky's light that is reflected to wo.

        The mean over 65536 samples, to about 1e-3.

        Parameters
        ----------
        wo : (..., 3) real
            To the eye.

        Returns
        -------
        (..., 3) float64
            The integral of f times the cosine of wi, in linear RGB.

        Raises
        ------
        ValueError
            If the shape is wrong, or a direction is zero or not finite.
        """
        eyes = unit_directions(wo)
        return self._core.albedo(eyes.reshape(-1, 3)).reshape(eyes.shape)


def _material(content: bytes) -> tuple[Core, str, int]:
    """The table of a file, what it says of itself, and how many of its numbers were negative."""
    if content.startswith(tensor_file.MAGIC):
        return _rgl(tensor_file.read(content))
    if content.startswith(_MERL_HEADER):
        return _merl(content)
    raise ValueError("expected a .binary of MERL or a .bsdf of EPFL, got neither")


def _merl(content: bytes) -> tuple[Core, str, int]:
    """Three tables of doubles behind three lengths, one for each colour."""
    cells = MERL[0] * MERL[1] * MERL[2]
    expected = len(_MERL_HEADER) + 3 * 8 * cells
    if len(content) != expected:
        raise ValueError(f"expected {expected} bytes of a MERL table, got {len(content)}")
    colours = np.frombuffer(content, "<f8", 3 * cells, len(_MERL_HEADER)).reshape(3, cells)
    table, clamped = _clamped("reflectance", colours.T * _MERL_SCALE)
    return Core.merl(table), "", clamped


def _rgl(fields: dict[str, np.ndarray]) -> tuple[Core, str, int]:
    """Tables by the names of the file, whose shapes must fit each other."""
    for name, dimensions in _RGL_FIELDS.items():
        field = fields.get(name)
        if field is None:
            raise ValueError(f"expected a field {name!r} as RGB materials have it, got {', '.join(fields)}")
        if field.dtype != np.float32 or field.ndim != dimensions:
            raise ValueError(f"expected {name} of float32 with {dimensions} axes, got {field.dtype} {field.shape}")
    angles = (fields["phi_i"].size, fields["theta_i"].size)
    for name, leading in {"vndf": angles, "luminance": angles, "rgb": (*angles, 3)}.items():
        if fields[name].shape[:-2] != leading:
            raise ValueError(f"expected {name} of shape {(*leading, 'y', 'x')}, got {fields[name].shape}")
    tables, clamped = {}, 0
    for name in ("ndf", "sigma", "vndf", "luminance", "rgb"):
        table, negative = _clamped(name, fields[name])
        tables[name] = (table.reshape(-1), table.shape[-2:])
        clamped += negative
    over_facets = bool(fields["jacobian"].any()) if "jacobian" in fields else False
    core = Core.rgl(phi_i=fields["phi_i"], theta_i=fields["theta_i"], jacobian=over_facets, **tables)
    description = fields.get("description", np.empty(0, "u1")).astype("u1").tobytes().decode("utf-8", "replace")
    return core, description.strip("\0 "), clamped


def _clamped(name: str, values: np.ndarray) -> tuple[NDArray[np.float32], int]:
    """The values with 0 for what is negative, and how many were; what is not finite is refused."""
    if not np.isfinite(values).all():
        raise ValueError(f"expected finite numbers of {name}, got NaN or infinity")
    return np.maximum(values, 0).astype(np.float32, order="C"), int((values < 0).sum())
