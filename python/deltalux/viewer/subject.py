"""What is looked at: all that the loop, the clients and the page ask of a transport, whatever moves over it."""

from __future__ import annotations

import warnings
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Set
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._core import half_floats

__all__ = ["Exact", "Shot", "Subject", "halves"]

Layer = NDArray[np.float32]


@dataclass(eq=False)
class Shot:
    """One frame as it is shown."""

    layers: Mapping[str, Layer]
    """By name, (height, width, 3) or (vertices, 3)."""
    stats: dict[str, Any]
    converged: bool
    of: Any
    """What the subject wants to know of it afterwards."""
    number: int = 0
    _halves: dict[str, NDArray[np.float16]] = field(default_factory=dict, repr=False)

    def half(self, name: str) -> NDArray[np.float16]:
        """A layer in half floats, made once for all clients."""
        if name not in self._halves:
            self._halves[name] = halves(self.layers[name])
        return self._halves[name]


@dataclass(frozen=True, eq=False)
class Exact:
    """What a shot is off."""

    layer: Layer
    error: float
    error_b: float | None
    at: float
    """When its light was asked for, on the clock of `time.monotonic`."""
    number: int = 0


def halves(values: Layer) -> NDArray[np.float16]:
    """Half floats; what is brighter than they can hold is their largest."""
    flat = np.ascontiguousarray(values, np.float32).reshape(-1)
    return half_floats(flat).view(np.float16).reshape(values.shape)


class Subject(ABC):
    """A transport under a light or materials that move. `take` comes from any thread, `step` from one."""

    kind: str
    name: str
    """What programs and commands call the transport by: its path."""
    remark: Callable[[str], None] = staticmethod(lambda text: None)
    """Told what is worth knowing of something that was set all the same."""

    @contextmanager
    def _remarking(self) -> Iterator[None]:
        """Warnings become remarks: nobody reads a terminal beside a page."""
        with warnings.catch_warnings(record=True) as found:
            warnings.simplefilter("always")
            yield
        for one in found:
            self.remark(str(one.message))

    @abstractmethod
    def about(self) -> dict[str, Any]:
        """What the page is told of it at the start."""

    @abstractmethod
    def state(self) -> dict[str, Any]:
        """All that can be set, as it is set."""

    @abstractmethod
    def take(self, patch: Mapping[str, Any]) -> dict[str, Any]:
        """Sets parts of the state, all or none, and gives them back as they are now; ValueError where one is wrong."""

    @abstractmethod
    def step(self, layers: Set[str], rests: bool) -> Shot:
        """One frame towards what is set, with what else is looked at; all of what is left once nothing moves."""

    def exact(self, shot: Shot) -> Exact | None:
        """What the whole product shows for the light of a shot; None where every frame is exact."""
        return None

    def maps(self, shot: Shot) -> dict[str, Layer]:
        """The light asked for and applied, over the cubemap; none where it has no columns on one."""
        return {}

    def strip(self) -> Layer | None:
        """The light asked for as a lat-long picture."""
        return None

    def mesh(self) -> Mapping[str, NDArray[Any]] | None:
        """Of vertices, what a page draws them with."""
        return None

    def still(self, shot: Shot) -> tuple[Layer, dict[str, Any]] | None:
        """Of vertices, the exact picture of a shot as its camera sees it, and that camera."""
        return None

    def look(self, x: int, y: int) -> tuple[Layer, int]:
        """What a unit of radiance from each texel does to a pixel, and how many rows it shows."""
        raise ValueError("expected a transport under a Haar basis to ask why a pixel is dark")

    @abstractmethod
    def picture(self, shot: Shot) -> Layer:
        """The picture of a shot, as it is saved."""

    @abstractmethod
    def python(self, view: Mapping[str, Any]) -> str:
        """A program that makes the picture that is seen."""

    def command(self, view: Mapping[str, Any]) -> str:
        """A command line that does, where there is one."""
        raise ValueError("there is no command line for this; copy it as Python")
