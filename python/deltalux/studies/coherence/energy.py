"""Energy of moving light in space and time: spatial Haar, then Haar over frames (Overbeck 2006, Fig. 5.4; EGSR 5)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ...columns import Haar
from ...pages.verdict import Verdict
from ...progress import Progress
from ..case import Case, Light, band_starts, lights
from ..shape import Study
from ..sheet import Sheet

__all__ = ["STUDY", "spatio_temporal", "temporal_haar"]

_FRAMES = 128


@dataclass(frozen=True)
class Coherence:
    """Shares of energy, spatial bands down (coarse to fine) and temporal bands across (128 frames to 2)."""

    shares: NDArray[np.float64]
    """Of each spatial band: rows sum to 1."""
    norms: NDArray[np.float64]

    @property
    def frames(self) -> NDArray[np.float64]:
        """log2 of frames under the wavelets that hold each spatial band, a mean weighted by energy."""
        return self.shares @ _octaves(self.shares.shape[1])

    @property
    def diagonal(self) -> float:
        """Correlation of the logarithms of size in space and in time under these shares: 1 is a diagonal, 0 is none."""
        space, time = -np.arange(float(len(self.shares))), _octaves(self.shares.shape[1])
        x = space - space.mean()
        y = time - self.frames.mean()
        weight = self.shares / len(self.shares)
        covariance = float(np.einsum("ij,i,j->", weight, x, y))
        spread = float(np.sqrt((weight.sum(axis=1) @ x**2) * (weight.sum(axis=0) @ y**2)))
        # Where all energy lies in one temporal band there is no diagonal.
        return covariance / spread if spread > 1e-12 else 0.0


def _octaves(bands: int) -> NDArray[np.float64]:
    return np.arange(bands, 0, -1, dtype=np.float64)


def temporal_haar(frames: NDArray[np.float64]) -> list[NDArray[np.float64]]:
    """The orthonormal Haar transform along the first axis, a power of two long: details of 2, 4, ..., then the mean."""
    details = []
    while len(frames) > 1:
        even, odd = frames[0::2], frames[1::2]
        details.append((even - odd) * np.sqrt(0.5))
        frames = (even + odd) * np.sqrt(0.5)
    return [*details, frames]


def spatio_temporal(columns: Haar, frames: list[Light]) -> Coherence:
    """Energies of all pairs of a spatial and a temporal band; the temporal mean counts with the coarsest."""
    starts = band_starts(columns)
    *details, mean = temporal_haar(np.stack(frames))
    energy = [np.add.reduceat(np.square(detail).sum(axis=(0, 2)), starts) for detail in details]
    energy[-1] = energy[-1] + np.add.reduceat(np.square(mean).sum(axis=(0, 2)), starts)
    table = np.stack(energy[::-1], axis=1)
    return Coherence(table / np.maximum(table.sum(axis=1, keepdims=True), np.finfo(float).tiny), np.sqrt(table))


def run(case: Case, sheet: Sheet, progress: Progress) -> None:
    """128 frames of the rotation, at the speed asked for."""
    degrees = case.motion.rotate * _FRAMES / case.motion.frames
    motion = replace(case.motion, rotate=degrees, frames=_FRAMES, hold=0)
    progress(0, 2)
    frames = lights(case.env, motion, case.columns)
    progress(1, 2)
    found = spatio_temporal(case.columns, frames)
    progress(2, 2)

    names = case.columns.band_names
    times = [str(2**k) for k in range(found.shares.shape[1], 0, -1)]
    caption = (
        "Energy per band in space (down) and time (across). Shares of each spatial band's energy; a dot marks the mean "
        "time that its wavelets live."
    )
    with sheet.plot("energy.png", caption, 1, 1, (8.2, 4.6)) as (figure, axes):
        axes.imshow(100 * found.shares, cmap="viridis", aspect="auto", vmin=0, vmax=100)
        for row, shares in enumerate(found.shares):
            for column, share in enumerate(shares):
                colour = "black" if share > 0.6 else "white"
                style = {"ha": "center", "va": "center", "color": colour, "fontsize": 9}
                axes.text(column, row - 0.22, f"{100 * share:.1f} %", **style)
        axes.plot(len(times) - found.frames, range(len(names)), "o-", color="#D55E00", markersize=5)
        axes.set_xticks(range(len(times)), times)
        axes.set_yticks(range(len(names)), names)
        axes.set(xlabel="Frames under a temporal wavelet (the mean with the longest)", ylabel=case.columns.band_label)
        axes.grid(False)
        figure.suptitle(f"{case.env.name}: {motion.rotate:g} degrees in {_FRAMES} frames", fontsize=11)
    sheet.heading("Norm of every pair of bands")
    lines = [(name, *(f"{norm:.4g}" for norm in norms)) for name, norms in zip(names, found.norms, strict=True)]
    sheet.table(("Texels", *(f"{time} frames" for time in times)), lines)
    sheet.csv(
        "energy.csv",
        [
            {"texels": name, "frames": time, "norm": f"{norm:.6g}", "share": f"{share:.6g}"}
            for name, norms, shares in zip(names, found.norms, found.shares, strict=True)
            for time, norm, share in zip(times, norms, shares, strict=True)
        ],
    )
    sheet.claims(_claims(found))


def _claims(found: Coherence) -> list[Verdict]:
    lives = 2**found.frames
    falls = bool(np.all(np.diff(found.frames) <= 0))
    return [
        Verdict(
            "Energy lies along a diagonal: coarse wavelets live long, fine ones briefly.",
            falls and found.diagonal > 0.3,
            f"correlation of log sizes {found.diagonal:.2f}; mean life per band, coarse to fine: "
            f"{', '.join(f'{life:.0f}' for life in lives)} frames",
            "Every finer band lives more briefly than the one before."
            if falls
            else "A light of a single texel moves through all bands at once: its coarse wavelets change as soon as its "
            "fine ones.",
        ),
        Verdict(
            "The coarsest spatial band lies almost wholly in the temporal size of 128 frames.",
            bool(found.shares[0, 0] >= 0.95),
            f"{100 * found.shares[0, 0]:.1f} % of its energy",
            "It holds the mean of each face, which a rotation moves slowly."
            if found.shares[0, 0] >= 0.95
            else "A few bright lights that pass from face to face carry the mean of the faces with them.",
        ),
    ]


STUDY = Study(
    title="Energy of the light in space and time",
    intro="The light's Haar coefficients over the first 128 frames, transformed once more along time. Energy on the "
    "diagonal is what per-band incremental updates live from: the coarser a band, the longer what it holds stays true.",
    run=run,
    light_files=("energy.png", "energy.csv"),
)
