"""A pinhole camera: where the eye is, what it looks at, and how many pixels it has."""

from __future__ import annotations

import math
import operator
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from ._core import Camera as Rays
from .checks import Vector, as_vector, real_array
from .mistakes import suggests_keywords

LARGEST_PICTURE = 16_384
# Squares of lengths must stay finite in float64, and in what the tracer makes of them after scaling.
LARGEST_COORDINATE = 1e30
_MARGIN = 1.08


@suggests_keywords
@dataclass(frozen=True)
class Camera:
    """A pinhole camera; pixel (0, 0) is at the top left.

    Parameters
    ----------
    position, target : three floats
        Where the eye is and what is in the middle of the picture, in scene units.
    up : three floats
        The direction that points upwards in the picture; need not be perpendicular to the view.
    vertical_fov : float
        Full vertical field of view in degrees, in (0, 180).
    width, height : int
        Pixels, 1 to 16384.

    Raises
    ------
    ValueError
        If a number is not finite, the camera looks nowhere (position equals target), `up` is parallel to the view,
        or the field of view or the size is out of range.
    """

    position: Vector
    target: Vector
    up: Vector = (0.0, 1.0, 0.0)
    vertical_fov: float = 40.0
    width: int = 512
    height: int = 512

    def __post_init__(self) -> None:
        for name in ("position", "target", "up"):
            object.__setattr__(self, name, _vector(name, getattr(self, name)))
        object.__setattr__(self, "vertical_fov", _field_of_view(self.vertical_fov))
        for name in ("width", "height"):
            object.__setattr__(self, name, _size(name, getattr(self, name)))
        self._check_frame()

    def _check_frame(self) -> None:
        """Refuse the positions, targets and ups that leave the picture plane undefined."""
        view = np.subtract(self.target, self.position)
        distance, up_length = np.linalg.norm(view), np.linalg.norm(self.up)
        if distance == 0.0:
            raise ValueError(f"camera: position and target must differ, both are {self.position}")
        if up_length == 0.0:
            raise ValueError("camera: up must not be the zero vector")
        if np.linalg.norm(np.cross(view / distance, np.divide(self.up, up_length))) < 1e-6:
            raise ValueError(f"camera: up {self.up} must not be parallel to the view direction {as_vector(view)}")

    @classmethod
    def framing(
        cls, points: npt.ArrayLike, *, vertical_fov: float = 40.0, width: int = 512, height: int = 512
    ) -> Camera:
        """The camera that shows all points from a three-quarter view, slightly above.

        The points fill the picture up to a margin: their outline touches two of its sides 7 % from the edge.

        Parameters
        ----------
        points : (n, 3) real
            In scene units.
        vertical_fov : float
            Full vertical field of view in degrees, in (0, 180).
        width, height : int
            Pixels, 1 to 16384.

        Returns
        -------
        Camera
            It looks at the middle of their outline, +Y up.

        Raises
        ------
        ValueError
            If all points lie at one place, or a number is out of range.
        """
        points = np.asarray(points, dtype=np.float64).reshape(-1, 3)
        low, high = points.min(axis=0), points.max(axis=0)
        centre = 0.5 * (low + high)
        azimuth, elevation = math.radians(32.0), math.radians(22.0)
        toward_eye = np.array(
            [math.sin(azimuth) * math.cos(elevation), math.sin(elevation), math.cos(azimuth) * math.cos(elevation)]
        )

        # A point (x, y, z) in the camera's frame, z towards the eye, is seen if |x - c| <= (distance - z) tan(fov / 2),
        # where c is what the middle of the picture is moved by: least where both sides ask for the same distance.
        probe = cls(as_vector(toward_eye), (0.0, 0.0, 0.0), vertical_fov=vertical_fov, width=width, height=height)
        right, up, forward = probe.basis()
        tangent = math.tan(0.5 * math.radians(probe.vertical_fov)) / _MARGIN
        relative, distance = points - centre, 0.0
        nearness = -relative @ forward
        for axis, slope in ((right, tangent * width / height), (up, tangent)):
            ends = [float(np.max(side * (relative @ axis) / slope + nearness)) for side in (1.0, -1.0)]
            distance = max(distance, 0.5 * (ends[0] + ends[1]))
            centre = centre + 0.5 * (ends[0] - ends[1]) * slope * axis
        distance += 0.01 * float(np.linalg.norm(high - low))
        if not distance > 0.0:
            raise ValueError(f"camera: cannot frame points that all lie at {as_vector(centre)}; give a camera")
        return replace(probe, position=as_vector(centre + distance * toward_eye), target=as_vector(centre))

    def resized(self, width: int, height: int) -> Camera:
        """The same camera with another picture size; the vertical field of view stays.

        Parameters
        ----------
        width, height : int
            Pixels, 1 to 16384.

        Returns
        -------
        Camera
            A new one.

        Raises
        ------
        ValueError
            If a size is out of range.
        """
        return replace(self, width=width, height=height)

    def basis(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The orthonormal axes of the picture in the scene.

        Returns
        -------
        right, up, forward : (3,) float64
            Unit vectors; forward is away from the eye.
        """
        forward = np.subtract(self.target, self.position)
        forward /= np.linalg.norm(forward)
        right = np.cross(forward, self.up)
        right /= np.linalg.norm(right)
        return right, np.cross(right, forward), forward

    def rays(self) -> Rays:
        """The camera as the core shoots its rays.

        Returns
        -------
        Rays
            What receivers and nodes of a scene are found by.
        """
        right, up, forward = self.basis()
        return Rays(
            position=self.position,
            right=as_vector(right),
            up=as_vector(up),
            forward=as_vector(forward),
            half_height=float(np.tan(np.radians(self.vertical_fov) / 2)),
            width=self.width,
            height=self.height,
        )

    def directions(self) -> np.ndarray:
        """Directions through the pixel centres.

        Returns
        -------
        (height, width, 3) float64
            Unit vectors away from the eye; row 0 is the top of the picture.
        """
        right, up, forward = self.basis()
        tangent = math.tan(0.5 * math.radians(self.vertical_fov))
        x = tangent * (2.0 * np.arange(self.width) + 1.0 - self.width) / self.height
        y = tangent * (self.height - 1.0 - 2.0 * np.arange(self.height)) / self.height
        rays = x[None, :, None] * right + y[:, None, None] * up + forward
        return np.asarray(rays / np.linalg.norm(rays, axis=2, keepdims=True))


def _vector(name: str, values: Sequence[float]) -> Vector:
    array = real_array(f"camera: {name}", values, np.float64)
    if array.shape != (3,):
        raise ValueError(f"camera: {name} must be three numbers, got {values!r}")
    if not (np.abs(array) <= LARGEST_COORDINATE).all():
        raise ValueError(f"camera: {name} must be finite and within +-{LARGEST_COORDINATE:g}, got {values!r}")
    return as_vector(array)


def _field_of_view(degrees: float) -> float:
    array = real_array("camera: vertical_fov", degrees, np.float64)
    if array.shape != () or not 0.0 < array < 180.0:
        raise ValueError(f"camera: vertical_fov must be in (0, 180) degrees, got {degrees!r}")
    return float(array)


def _size(name: str, pixels: int) -> int:
    try:
        count = operator.index(pixels)
    except TypeError:
        raise ValueError(f"camera: {name} must be a whole number of pixels, got {pixels!r}") from None
    if not 1 <= count <= LARGEST_PICTURE:
        raise ValueError(f"camera: {name} must be 1 to {LARGEST_PICTURE} pixels, got {count}")
    return count
