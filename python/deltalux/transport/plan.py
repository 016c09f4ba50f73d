"""The plan as a record: what was, or will be, computed, what is left out and why, and what it costs.

It lies with the transport, which keeps it, and not with its maker: a file opens without a reader of meshes.
"""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, field


@dataclass(frozen=True)
class Plan:
    """What will be computed, and what will not.

    Attributes
    ----------
    rows, columns, bands, channels, bounces, factors
        The shape of M. Before the receivers are found, `rows` is the most that the picture can need.
    rays
        Estimated rays of the pass.
    bytes_on_disk, bytes_in_memory
        Estimates: the finished transport, and the peak of the run.
    seconds
        Estimated time, with `threads` threads.
    left_out
        What this scene does not need, each with its reason.
    notes
        What was found in the scene: degenerate and duplicate triangles, materials that were replaced.
    """

    scene: str
    triangles: int
    picture: tuple[int, int]
    rows: int
    columns: str
    column_count: int
    bands: int
    channels: int
    bounces: int
    factors: int
    quality: str
    tolerance: float
    rays: float
    bytes_on_disk: float
    bytes_in_memory: float
    seconds: float
    threads: int
    left_out: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)

    def __str__(self) -> str:
        width, height = self.picture
        lines = [
            f"{self.scene}: {self.triangles:,} triangles, {width} x {height} pixels",
            f"  compute   M of up to {self.rows:,} receivers x {self.column_count:,} columns ({self.columns}), "
            f"{self.bands} bands, {self.channels} channel, bounces: {self.bounces}, factors: {self.factors}",
            f"  quality   {self.quality}: truncated to {100 * self.tolerance:g} % expected image error",
            f"  cost      about {self.rays / 1e6:,.0f} million rays, {self.seconds:,.0f} s on {self.threads} threads, "
            f"{self.bytes_on_disk / 1e6:,.0f} MB on disk, {self.bytes_in_memory / 1e6:,.0f} MB in memory",
        ]
        lines += [f"  left out  {reason}" for reason in self.left_out]
        lines += [f"  note      {note}" for note in self.notes]
        return "\n".join(lines)

    def to_json(self) -> str:
        return json.dumps(asdict(self), sort_keys=True)

    @staticmethod
    def from_json(text: str) -> Plan:
        known = {name for name in Plan.__dataclass_fields__}
        fields = {name: value for name, value in json.loads(text).items() if name in known}
        fields["picture"] = tuple(fields["picture"])
        return Plan(**fields)
