"""What carries diffuse light between the surfaces of a studio: nodes, or its gather samples as published.

nodes      E = E_d + F rho E, ..        few, each with what its own rays meet; rows of the view take by weights
samples    L = L_d + rho M_s L, D L     as Nguyen 2010 has it: matrices over the tree of all samples
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._core import NodeFactors, NodeWeights
from .folder import array
from .transport import Transport

__all__ = ["NODES", "Gathered", "StudioNodes"]

NODES = "nodes.npz"
"""The file that nodes are kept in."""


@dataclass(frozen=True, eq=False)
class Gathered:
    """D and M_s of Nguyen 2010.

    Attributes
    ----------
    diffuse : Transport
        D: what each row of the view receives from gather samples.
    bounces : Transport
        M_s: what each sample receives from the others.
    """

    diffuse: Transport
    bounces: Transport

    @property
    def sizes(self) -> tuple[int, int]:
        """Bytes of what the view takes by, and of what samples do."""
        return self.diffuse.nbytes, self.bounces.nbytes


@dataclass(frozen=True, eq=False)
class StudioNodes:
    """Nodes, and who takes from them.

    Attributes
    ----------
    factors : NodeFactors
        How light passes between them.
    albedo : (nodes, 3) float32
        Diffuse reflectances, in the mean of their cells.
    material : (nodes,) uint16
        Whose they are.
    view, samples : NodeWeights
        How rows of the view and gather samples take from them.
    """

    factors: NodeFactors
    albedo: NDArray[np.float32]
    material: NDArray[np.uint16]
    view: NodeWeights
    samples: NodeWeights

    def __len__(self) -> int:
        return len(self.factors)

    @property
    def sizes(self) -> tuple[int, int]:
        """Bytes of what the view takes by, and of all else."""
        return self.view.nbytes, self.samples.nbytes + sum(own.nbytes for own in self.factors.arrays())

    def save(self, path: Path, points: Mapping[str, NDArray[Any]]) -> None:
        """Keeps them in a directory, whole or not at all, with the points of their cells."""
        arrays: dict[str, NDArray[Any]] = {"albedo": self.albedo, "material": self.material, **points}
        sparse: dict[str, NodeFactors | NodeWeights] = {
            "factors": self.factors,
            "view": self.view,
            "samples": self.samples,
        }
        for name, own in sparse.items():
            each: list[NDArray[Any]] = [*own.arrays()]
            arrays |= {f"{name}_{what}": numbers for what, numbers in zip(_SPARSE, each, strict=True)}
        arrays["exponents"] = np.array([self.factors.rays, self.view.exponent, self.samples.exponent], np.int64)
        beside = path / f".{NODES}"
        with open(beside, "wb") as file:
            np.savez(file, **arrays)  # type: ignore[arg-type]
        beside.replace(path / NODES)

    @staticmethod
    def of_arrays(stored: Mapping[str, NDArray[Any]], rows: int, samples: int) -> StudioNodes:
        """From the arrays of a file, whoever wrote it: of so many rows of the view and samples.

        Raises
        ------
        ValueError
            If they are something else.
        """
        nodes = len(stored["material"])
        rays, *exponents = (int(x) for x in array(stored, "exponents", np.int64, (3,)))
        if not 1 <= rays <= 1 << 16 or max(map(abs, exponents)) > 64:
            raise ValueError(f"expected rays of nodes and exponents of weights, found {rays} and {exponents}")
        starts, others, numbers = _sparse(stored, "factors", nodes)
        factors = NodeFactors(starts, others, numbers, rays)
        taking = []
        for name, count, exponent in zip(("view", "samples"), (rows, samples), exponents, strict=True):
            starts, others, numbers = _sparse(stored, name, count)
            taking.append(NodeWeights(starts, others, numbers, exponent, 2 * nodes))
        albedo = array(stored, "albedo", np.float32, (nodes, 3))
        material = array(stored, "material", np.uint16, (nodes,))
        if not (albedo >= 0).all():
            raise ValueError("expected albedos of at least 0")
        return StudioNodes(factors, albedo, material, *taking)


_SPARSE = ("starts", "nodes", "numbers")


def _sparse(
    stored: Mapping[str, NDArray[Any]], name: str, rows: int
) -> tuple[NDArray[np.uint32], NDArray[np.uint32], NDArray[np.uint16]]:
    """Starts of rows, and a node and a number each."""
    count = len(stored[f"{name}_numbers"])
    starts, nodes, numbers = (f"{name}_{what}" for what in _SPARSE)
    return (
        array(stored, starts, np.uint32, (rows + 1,)),
        array(stored, nodes, np.uint32, (count,)),
        array(stored, numbers, np.uint16, (count,)),
    )
