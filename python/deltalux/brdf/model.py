"""What all analytic models share: directions in, numbers out, by one call into the core."""

from __future__ import annotations

from dataclasses import fields

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._core import Brdf, Measured
from ..rotation import unit_directions


class Model:
    """An analytic model of reflectance: one number for all colours, which are factors outside.

    Models are frozen and compare by their parameters.

    Raises
    ------
    ValueError
        If a parameter is out of its range.
    """

    def __post_init__(self) -> None:
        for parameter in fields(self):  # type: ignore[arg-type]
            object.__setattr__(self, parameter.name, _plain(parameter.name, getattr(self, parameter.name)))
        self.core()

    def core(self) -> Brdf:
        """The model as the core has it.

        Returns
        -------
        deltalux._core.Brdf
            With these parameters.

        Raises
        ------
        NotImplementedError
            Where a model does not say which it is.
        """
        raise NotImplementedError

    def evaluate(self, wi: ArrayLike, wo: ArrayLike) -> NDArray[np.float64]:
        """f(wi, wo), without the cosine.

        Parameters
        ----------
        wi, wo : (..., 3) real
            To the light and to the eye; broadcast against each other.

        Returns
        -------
        (...) float64
            1 / sr, finite and never negative; a number for one pair.

        Raises
        ------
        ValueError
            If a shape is wrong, or a direction is zero or not finite.
        """
        pairs = paired(wi, wo)
        return self.core().evaluate(*rows(*pairs)).reshape(pairs[0].shape[:-1])[()]

    def pdf(self, wi: ArrayLike, wo: ArrayLike) -> NDArray[np.float64]:
        """The density with which `sample` gives wi for wo.

        Parameters
        ----------
        wi, wo : (..., 3) real
            To the light and to the eye; broadcast against each other.

        Returns
        -------
        (...) float64
            1 / sr. Its integral over the hemisphere is 1 less the share of samples that are lost.

        Raises
        ------
        ValueError
            If a shape is wrong, or a direction is zero or not finite.
        """
        pairs = paired(wi, wo)
        return self.core().pdf(*rows(*pairs)).reshape(pairs[0].shape[:-1])[()]

    def sample(self, wo: ArrayLike, u: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Directions to the light, as dense as the model's own lobe.

        The light from a sample counts ``evaluate(wi, wo) * wi[..., 2] / pdf``. Neighbouring numbers give neighbouring
        directions, so stratified numbers give stratified directions.

        Parameters
        ----------
        wo : (..., 3) real
            To the eye.
        u : (..., 2) real
            Two numbers in [0, 1) for each sample; broadcast against ``wo``.

        Returns
        -------
        wi : (..., 3) float64
            Unit directions; (0, 0, 0) where the lobe goes below the horizon.
        pdf : (...) float64
            The density of each over solid angle; 0 there.

        Raises
        ------
        ValueError
            If a shape is wrong, a direction is zero or not finite, or a number is not in [0, 1).
        """
        return sampled(self.core(), wo, u)

    def albedo(self, wo: ArrayLike) -> NDArray[np.float64]:
        """The directional albedo: the share of an even sky's light that is reflected to wo.

        By adaptive quadrature to about 1e-6: milliseconds a direction.

        Parameters
        ----------
        wo : (..., 3) real
            To the eye.

        Returns
        -------
        (...) float64
            The integral of f times the cosine of wi.

        Raises
        ------
        ValueError
            If the shape is wrong, or a direction is zero or not finite.
        """
        eyes = unit_directions(wo)
        return self.core().albedo(eyes.reshape(-1, 3)).reshape(eyes.shape[:-1])[()]


def paired(wi: ArrayLike, wo: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Unit directions of one shape."""
    lights, eyes = unit_directions(wi), unit_directions(wo)
    try:
        lights, eyes = np.broadcast_arrays(lights, eyes)
    except ValueError:
        raise ValueError(f"expected wi and wo that broadcast, got shapes {lights.shape} and {eyes.shape}") from None
    return lights, eyes


def rows(*directions: NDArray[np.float64]) -> list[NDArray[np.float64]]:
    """Vectors one below the other, in C order."""
    return [np.ascontiguousarray(array.reshape(-1, array.shape[-1])) for array in directions]


def sampled(core: Brdf | Measured, wo: ArrayLike, u: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """`Model.sample`."""
    eyes, numbers = unit_directions(wo), np.asarray(u, np.float64)
    if numbers.ndim == 0 or numbers.shape[-1] != 2 or not np.all((numbers >= 0) & (numbers < 1)):
        raise ValueError(f"expected u of shape (..., 2) in [0, 1), got shape {numbers.shape} or other numbers")
    try:
        shape = np.broadcast_shapes(eyes.shape[:-1], numbers.shape[:-1])
    except ValueError:
        raise ValueError(f"expected wo and u that broadcast, got shapes {eyes.shape} and {numbers.shape}") from None
    wi, pdf = core.sample(*rows(np.broadcast_to(eyes, (*shape, 3)), np.broadcast_to(numbers, (*shape, 2))))
    return wi.reshape(*shape, 3), pdf.reshape(shape)[()]


def or_same(along_y: float | None, along_x: float) -> float:
    """The parameter along y, which is that along x where none is given."""
    return along_x if along_y is None else along_y


def _plain(name: str, value: object) -> object:
    """A parameter as plain numbers: None stays, a sequence becomes a tuple."""
    if value is None:
        return None
    try:
        if np.ndim(value) == 1:  # type: ignore[arg-type]
            return tuple(float(x) for x in value)  # type: ignore[attr-defined]
        return float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError):
        raise ValueError(f"expected {name} to be a number, got {value!r}") from None
