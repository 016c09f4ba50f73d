"""Data sets for PyTorch that relight as they are read: no picture is ever a file.

Import it as ``dl.torch``; deltalux needs PyTorch for nothing else.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import torch  # pyright: ignore[reportMissingImports]
from torch.utils.data import Dataset  # pyright: ignore[reportMissingImports]

from .datasets.encoding import PICTURES
from .datasets.lights import LightRecipe, LightRule, sources_of
from .datasets.run import LAYERS
from .datasets.shards import camera_layers, lit
from .mistakes import instead_of
from .relight.backdrop import Backdrop
from .transport.transport import Transport

__all__ = ["RelitDataset"]


class RelitDataset(Dataset[dict[str, Any]]):
    """A transport under many lights, a picture an index.

    What an index holds follows from the lights and the number alone: workers, by fork or by spawn, and batches leave
    the same bits. Indices that a loader asks for together go through M together.

    Parameters
    ----------
    transport
        Of pixels, in a file: a worker opens it by its path.
    lights
        The rule that draws them, or a list of them.
    count
        How many the rule draws.
    seed
        Of the rule.
    layers
        As of `dataset`: ``"mask"``, ``"albedo"``, ``"normal"``, ``"depth"``, ``"position"``, ``"material"``,
        ``"direct"``, ``"indirect"``.
    background
        As of `Backdrop`.

    Raises
    ------
    TypeError, ValueError
        If an argument cannot be used.
    """

    def __init__(
        self,
        transport: Transport,
        lights: LightRule | Sequence[LightRecipe] | None = None,
        count: int = 1000,
        *,
        seed: int = 0,
        layers: Sequence[str] = ("mask",),
        background: str = "env",
    ) -> None:
        if not isinstance(transport, Transport):
            raise instead_of("Transport", transport)
        unknown = [name for name in layers if name not in LAYERS]
        if unknown:
            raise ValueError(f"expected layers of {', '.join(LAYERS)}, got {unknown[0]!r}")
        lights = LightRule() if lights is None else lights
        self.recipes = lights.recipes(count, seed) if isinstance(lights, LightRule) else list(lights)
        self._transport, self._layers, self._background = transport, tuple(layers), background
        self._sources = sources_of(self.recipes)
        self._backdrop = Backdrop(transport, background)

    def __getstate__(self) -> dict[str, Any]:
        # A worker makes its own of what hangs on the transport.
        return {name: value for name, value in vars(self).items() if name not in ("_backdrop", "_still")}

    def __setstate__(self, state: dict[str, Any]) -> None:
        for name, value in state.items():
            setattr(self, name, value)
        self._backdrop = Backdrop(self._transport, self._background)

    def __len__(self) -> int:
        return len(self.recipes)

    def __getitem__(self, index: int) -> dict[str, Any]:
        """One picture: "picture", (3, h, w) float32 of linear radiance (4 with alpha), "number", and the layers."""
        return self.__getitems__([index])[0]

    def __getitems__(self, indices: Sequence[int]) -> list[dict[str, Any]]:
        """Several, in one product for each few of them; what loaders of PyTorch ask for."""
        numbers = [range(len(self))[int(index)] for index in indices]
        lights = [self.recipes[number].light(self._sources) for number in numbers]
        still = {name: _tensor(array) for name, array in camera_layers(self._transport, self._layers).items()}
        asked = [name for name in PICTURES if name == "picture" or name in self._layers]
        made = lit(self._transport, self._backdrop, lights, self._layers, 0.0)
        return [
            {"number": number, **{name: _tensor(one.arrays[name]) for name in asked}, **still}
            for number, one in zip(numbers, made, strict=True)
        ]


def _tensor(array: Any) -> Any:
    """A tensor with channels first, as PyTorch has pictures."""
    found = torch.from_numpy(array)  # pyright: ignore[reportAttributeAccessIssue]
    return found.permute(2, 0, 1).contiguous() if found.ndim == 3 else found
