"""Lamps as columns: light stacks, in which each picture is taken under one of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._core import column_bands
from ..checks import read_only
from ..mistakes import instead_of
from ..sphere import face_directions, texel_solid_angles
from .bands import bands_and_areas

if TYPE_CHECKING:
    from ..light.environment import Environment

__all__ = ["Lamps"]

_FEW = 128
"""Up to so many lamps, cells are drawn on faces of 32 texels, of more on 64."""
_TOGETHER = 512
"""Directions whose cells are looked at at once."""


class Lamps:
    """Lamps far away, or groups of lights, each a column of its own; V is how bright each is.

    Of a lamp V is the irradiance of a surface that faces it. An environment is shared out between them by natural
    neighbours: light from a direction goes to the lamps whose Voronoi cells on the sphere a lamp there would take from,
    by how much it would take of each. So light that turns passes from lamp to lamp without a jump, and what lamps get
    adds up to what there is. Light from further than `reach` from every lamp was measured by none, and is left out.

    Groups have no directions, and no environment is shared out between them: V is their gains.

    Parameters
    ----------
    directions
        (n, 3): towards the lamps, of any length; None of groups.
    names
        Of groups; of lamps if you like.
    reach
        Degrees; None: twice the largest angle from a lamp to the one next to it.

    Raises
    ------
    ValueError
        If there are no lamps, two stand in one place, or a number cannot be used.

    Notes
    -----
    Sibson, A brief description of natural neighbour interpolation (1981); cells are those of the texels of a cubemap.
    """

    def __init__(
        self, directions: ArrayLike | None, names: Sequence[str] | None = None, reach: float | None = None
    ) -> None:
        self.names = None if names is None else tuple(str(name) for name in names)
        self.directions, self.reach = None, None
        if directions is not None:
            self.directions = read_only(_unit(directions))
            self.reach = _reach(self.directions, reach)
        elif self.names is None:
            raise ValueError("expected directions of lamps, or names of groups")
        self._count = len(self.names or ()) if self.directions is None else len(self.directions)
        if self.names is not None and len(set(self.names)) != self._count:
            raise ValueError(f"expected {self._count} different names, got {', '.join(self.names)}")
        column_bands(str(self))

    def __str__(self) -> str:
        return f"lamps:{self._count}"

    def __repr__(self) -> str:
        what = "groups" if self.directions is None else "lamps"
        return f"<Lamps: {self._count} {what}>"

    @property
    def columns(self) -> int:
        """How many columns there are."""
        return self._count

    @property
    def bands(self) -> NDArray[np.intp]:
        """The band of every column, all of them 0: (columns,), read-only."""
        return bands_and_areas(str(self))[0]

    @property
    def areas(self) -> NDArray[np.float64]:
        """1 of every column: (columns,) float64, read-only."""
        return bands_and_areas(str(self))[1]

    @property
    def band_names(self) -> tuple[str, ...]:
        """The one band."""
        return ("groups",) if self.directions is None else ("lamps",)

    @property
    def band_label(self) -> str:
        """What the names of bands are, as the label of an axis."""
        return "Columns"

    def shared_out(self, directions: ArrayLike) -> NDArray[np.float64]:
        """How light from some directions is shared out between the lamps.

        Parameters
        ----------
        directions
            (k, 3), of any length.

        Returns
        -------
        (k, columns) float64
            From 0 to 1; 1 in all for each, or 0 where it is out of reach.

        Raises
        ------
        ValueError
            If a direction is none, or the columns are groups.
        """
        lamps, asked = self._lamps(), _unit(directions)
        own, areas, cells, nearest = self._cells
        shares = np.zeros((len(asked), self._count))
        for first in range(0, len(asked), _TOGETHER):
            some = asked[first : first + _TOGETHER]
            # What of the lamps' cells is nearer to the direction than to its lamp.
            row, texel = np.nonzero(some @ own.T > nearest)
            place = row * self._count + cells[texel]
            taken = np.bincount(place, areas[texel], len(some) * self._count).reshape(len(some), -1)
            total = taken.sum(axis=1, keepdims=True)
            cosines = some @ lamps.T
            alone = np.eye(self._count)[cosines.argmax(axis=1)]
            found = np.where(total > 0, taken / np.where(total > 0, total, 1), alone)
            shares[first : first + _TOGETHER] = found * (cosines.max(axis=1) >= self._least_cosine)[:, None]
        return shares

    @cached_property
    def solid_angles(self) -> NDArray[np.float64]:
        """What of the sphere each lamp stands for, steradians: (columns,); ValueError of groups."""
        return np.asarray(self._matrix.sum(axis=1))

    @property
    def covered(self) -> float:
        """What share of the sphere is within reach; ValueError of groups."""
        return float(self.solid_angles.sum() / (4 * np.pi))

    def coefficients(self, env: Environment) -> NDArray[np.float64]:
        """V: what each lamp gets of an environment.

        Parameters
        ----------
        env
            The light.

        Returns
        -------
        (columns, 3) float64
            The integral of radiance times the lamp's share.

        Raises
        ------
        TypeError
            If it is no environment.
        ValueError
            If the columns are groups.
        """
        if not hasattr(env, "_haar"):
            raise instead_of("Environment", env)
        return self._matrix @ env.cubemap(self._face).reshape(-1, 3).astype(np.float64)

    @cached_property
    def _matrix(self) -> NDArray[np.float64]:
        """(columns, texels): from the radiance of texels to V."""
        return self.shared_out(face_directions(self._face).reshape(-1, 3)).T * texel_solid_angles(self._face)

    @property
    def _face(self) -> int:
        return 32 if self._count <= _FEW else 64

    @property
    def _least_cosine(self) -> float:
        return float(np.cos(np.radians(min(self.reach or 0.0, 180.0)))) - 1e-12

    @cached_property
    def _cells(self) -> tuple[NDArray[Any], ...]:
        """Of the texels within reach their directions, solid angles, lamps, and the cosine of the angle to those."""
        directions = face_directions(self._face).reshape(-1, 3)
        cosines = directions @ self._lamps().T
        cells, nearest = cosines.argmax(axis=1), cosines.max(axis=1)
        own = nearest >= self._least_cosine
        return directions[own], texel_solid_angles(self._face)[own], cells[own], nearest[own]

    def _lamps(self) -> NDArray[np.float64]:
        if self.directions is None:
            raise ValueError(
                "expected lamps with directions to share light out between, but these are groups: V is gains"
            )
        return self.directions

    def arrays(self) -> dict[str, NDArray[Any]]:
        """As a transport keeps them beside M.

        Returns
        -------
        dict
            Arrays of float64 and uint32 by their names.
        """
        arrays: dict[str, NDArray[Any]] = {}
        if self.directions is not None:
            arrays |= {"directions": self.directions, "reach": np.array([np.radians(self.reach or 0.0)])}
        for k, name in enumerate(self.names or ()):
            arrays[f"name.{k:05d}"] = np.array([ord(letter) for letter in name], np.uint32)
        return arrays

    @staticmethod
    def restored(count: int, arrays: Mapping[str, NDArray[Any]]) -> Lamps:
        """From what `arrays` gave.

        Parameters
        ----------
        count
            How many there are.
        arrays
            By their names.

        Returns
        -------
        Lamps

        Raises
        ------
        ValueError
            If the arrays are not those of so many lamps.
        """
        directions, reach = arrays.get("directions"), arrays.get("reach")
        names = None
        if any(name.startswith("name.") for name in arrays):
            names = [_text(arrays.get(f"name.{k:05d}")) for k in range(count)]
        if directions is not None and (reach is None or directions.shape != (count, 3) or reach.shape != (1,)):
            raise ValueError(f"expected directions of shape ({count}, 3) and a reach")
        if directions is None and names is None:
            names = [str(k + 1) for k in range(count)]
        return Lamps(directions, names, None if reach is None else float(np.degrees(reach[0])))


def _text(letters: NDArray[Any] | None) -> str:
    if letters is None or letters.dtype != np.uint32 or letters.ndim != 1 or (letters > 0x10FFFF).any():
        raise ValueError("expected the name of each lamp in code points")
    return "".join(map(chr, letters.tolist()))


def _unit(directions: ArrayLike) -> NDArray[np.float64]:
    array = np.array(directions, np.float64)
    if array.ndim != 2 or array.shape[1:] != (3,) or not len(array):
        raise ValueError(f"expected directions of shape (n, 3), got {array.shape}")
    lengths = np.linalg.norm(array, axis=1, keepdims=True)
    if not (np.isfinite(array).all() and (lengths > 0).all()):
        raise ValueError("expected finite directions that are not zero")
    return np.asarray(array / lengths)


def _reach(directions: NDArray[np.float64], reach: float | None) -> float:
    """Degrees."""
    cosines = directions @ directions.T
    np.fill_diagonal(cosines, -1.0)
    next_to = np.degrees(np.arccos(np.clip(cosines.max(axis=1), -1, 1)))
    if len(directions) > 1 and next_to.min() < 1e-3:
        raise ValueError(
            f"expected lamps in different places, but lamp {int(next_to.argmin())} stands where another does"
        )
    if reach is None:
        return float(min(2 * next_to.max(), 180.0)) if len(directions) > 1 else 180.0
    if not 0 < reach <= 180:
        raise ValueError(f"expected a reach above 0 and at most 180 degrees, got {reach}")
    return float(reach)
