"""The plan as a record: the parts that are, or will be, computed, and what is left out and why.

It lies with the transport, which keeps it, and not with its maker: a file opens without a reader of meshes.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field, replace
from typing import Any

__all__ = ["Cost", "LeftOut", "Part", "Plan", "Solve"]


@dataclass(frozen=True)
class Cost:
    """What a part will cost, as a probe on the scene itself tells. A file does not keep it: machines differ.

    Attributes
    ----------
    rays
        Rays of the pass.
    bytes_on_disk, bytes_in_memory
        The finished part, and the peak of the run.
    seconds, least_seconds, most_seconds
        From the first ray of the pass to the finished file, and the range that most runs end in.
    threads
        That it was measured with.
    """

    rays: float
    bytes_on_disk: float
    bytes_in_memory: float
    seconds: float
    least_seconds: float
    most_seconds: float
    threads: int

    def __str__(self) -> str:
        return (
            f"{_duration(self.least_seconds)} to {_duration(self.most_seconds)} to go, "
            f"{_megabytes(self.bytes_on_disk)} MB on disk"
        )


@dataclass(frozen=True)
class Part:
    """One matrix of the product, and the pass that makes it: `precompute` runs part after part.

    Attributes
    ----------
    name
        What its files are called by.
    make
        The pass: "direct", "nodes" for light between surfaces, "emission" for what they give off; "representatives" and
        "weights" of clustered transport.
    rows, columns, column_count, bands
        Its shape, and what its columns are.
    channels
        Numbers for each row and column: 1, or 3 where colours have their own.
    factors
        Matrices that share its V.
    bounces
        Of light between surfaces; -1: all.
    why
        What in the scene and the request calls for it.
    cost
        What it will cost; None once it is done.
    """

    name: str
    make: str
    rows: int
    columns: str
    column_count: int
    bands: int
    channels: int
    factors: int
    bounces: int
    why: str
    cost: Cost | None = None

    def __str__(self) -> str:
        channels = "1 channel" if self.channels == 1 else f"{self.channels} channels"
        rows = "receivers" if self.make in ("direct", "weights", "emission") else self.make
        bounces = "all" if self.bounces < 0 else self.bounces
        return (
            f"{self.name}: {self.rows:,} {rows} x {self.column_count:,} columns ({self.columns}), "
            f"{self.bands} bands, {channels}, bounces: {bounces}, factors: {self.factors}; {self.why}"
        )


@dataclass(frozen=True)
class Solve:
    """How light between surfaces was solved.

    Attributes
    ----------
    method
        "Neumann" or "BiCGStab".
    nodes
        How many it was solved at.
    products
        With the form factors: the fewest, the median and the most of any column.
    residual
        No value of a column is further off than this share of its largest, proved; 0 where so many bounces were asked.
    shares
        Of each bounce in the norm of all indirect light at the nodes, under the light prior; of all but the first in
        one number where they were not told apart.
    gathering
        The share of receivers that gather from what their own rays meet, as nodes do not speak for them.
    lost
        The share of the nodes' rays that met a surface for which no node speaks.
    discretisation
        How far the indirect light of a receiver is from what 4,096 rays of its own gather from the same nodes, in the
        light of all (root mean square), under the light prior: median, 95th percentile and largest of 64 receivers. An
        estimate, which no bound includes.
    """

    method: str
    nodes: int
    products: tuple[int, int, int]
    residual: float
    shares: tuple[float, ...]
    gathering: float
    lost: float
    discretisation: tuple[float, float, float]

    def __str__(self) -> str:
        shares = " ".join(f"{100 * share:.1f}" for share in self.shares)
        proved = f", residual at most {self.residual:.1e}" if self.residual else ""
        fewest, median, most = self.products
        products = f"{median} products" if fewest == most else f"{fewest} to {most} products, {median} in the median"
        return (
            f"solved at {self.nodes:,} nodes by {self.method}: {products}{proved}; bounces are {shares} % of the "
            f"indirect light; {100 * self.lost:.2f} % of the nodes' rays met what no node speaks for; discretisation, "
            f"estimated and in no bound: {' / '.join(f'{100 * off:.2g}' for off in self.discretisation)} % of the "
            "receivers' light (median / p95 / most of 64)"
        )


@dataclass(frozen=True)
class LeftOut:
    """Something that this scene does not need, and what in it says so."""

    what: str
    why: str

    def __str__(self) -> str:
        return f"{self.what}: {self.why}" if self.why else self.what


@dataclass(frozen=True)
class Plan:
    """What will be computed, and what will not. It is the programme: `precompute` runs its parts.

    Attributes
    ----------
    scene
        Its name.
    triangles
        How many it has.
    picture
        (width, height) of the camera.
    quality, tolerance
        The preset, and the relative L2 error of the image that truncation may cause.
    parts
        What is computed, in this order.
    left_out
        What this scene does not need, each with its reason.
    notes
        What was found in the scene: degenerate and duplicate triangles, materials that were replaced.
    errors
        Relative L2 error of the picture by truncation, the worst that was measured under each of the built-in lights
        and under a sun; of a plan, on the rows of its probe. Empty in files before 0.3.
    without
        The same if all of the light went through the wavelets; empty where it does.
    solve
        How light between surfaces was solved; None where there is none, or not yet.
    ground
        The number of the material called "ground", which a picture may show the shadows on alone; None where there is
        none, as in files before 0.8.
    job
        What tells one request from another, scene and settings; "" where it is not known, as in files before 0.7.
    """

    scene: str
    triangles: int
    picture: tuple[int, int]
    quality: str
    tolerance: float
    parts: list[Part] = field(default_factory=list)
    left_out: list[LeftOut] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    errors: dict[str, float] = field(default_factory=dict)
    without: dict[str, float] = field(default_factory=dict)
    solve: Solve | None = None
    ground: int | None = None
    job: str = ""

    @property
    def rows(self) -> int:
        """Receivers: the rows of the first part, or of its weights where that is clustered."""
        return next((part.rows for part in self.parts if part.make == "weights"), self.parts[0].rows)

    @property
    def costs(self) -> list[Cost]:
        """What the parts will cost, as far as that is still to come."""
        return [part.cost for part in self.parts if part.cost is not None]

    @property
    def rays(self) -> float:
        """Rays of all parts; 0 once they are shot."""
        return sum(cost.rays for cost in self.costs)

    @property
    def bytes_on_disk(self) -> float:
        """Bytes of the finished transport."""
        return sum(cost.bytes_on_disk for cost in self.costs)

    @property
    def bytes_in_memory(self) -> float:
        """The peak of the run."""
        return max((cost.bytes_in_memory for cost in self.costs), default=0.0)

    @property
    def seconds(self) -> float:
        """From the first ray to the finished file."""
        return sum(cost.seconds for cost in self.costs)

    def __str__(self) -> str:
        width, height = self.picture
        lines = [f"{self.scene}: {self.triangles:,} triangles, {width} x {height} pixels"]
        lines += [f"  compute   {part}" for part in self.parts]
        lines.append(f"  quality   {self.quality}: truncated to {100 * self.tolerance:g} % {self._how()}")
        if self.errors:
            lines.append(f"  measured  {_errors(self.errors)}")
        if self.without:
            lines.append(f"            without texels {_errors(self.without)}")
        if self.costs:
            lines.append(f"  cost      {self._cost()}")
        lines += [f"  left out  {reason}" for reason in self.left_out]
        lines += [f"  note      {note}" for note in self.notes]
        return "\n".join(lines)

    def _how(self) -> str:
        return "of the picture, the worst that is measured" if self.without else "expected image error"

    def _cost(self) -> str:
        least, most = (sum(getattr(cost, name) for cost in self.costs) for name in ("least_seconds", "most_seconds"))
        return (
            f"about {_count(self.rays)} rays, {_duration(least)} to {_duration(most)} on "
            f"{self.costs[0].threads} threads, {_megabytes(self.bytes_on_disk)} MB on disk, "
            f"{_megabytes(self.bytes_in_memory)} MB in memory"
        )

    def done(
        self, notes: list[str], errors: dict[str, float], without: dict[str, float], solve: Solve | None = None
    ) -> Plan:
        """The plan as it was carried out, without what depends on the machine.

        Parameters
        ----------
        notes
            What was found while it ran.
        errors, without
            What was measured.
        solve
            How light between surfaces was solved.

        Returns
        -------
        Plan
        """
        parts = [replace(part, cost=None) for part in self.parts]
        return replace(self, parts=parts, notes=[*self.notes, *notes], errors=errors, without=without, solve=solve)

    def to_json(self) -> str:
        """The plan as text, which `from_json` reads, but for the cost: a file is read on other machines.

        Returns
        -------
        str
            A JSON object.
        """
        return json.dumps(asdict(self), sort_keys=True)

    @staticmethod
    def from_json(text: str) -> Plan:
        """The plan of a file, of whatever version.

        Parameters
        ----------
        text
            What `to_json` wrote, today or in version 0.1.

        Returns
        -------
        Plan

        Raises
        ------
        ValueError
            If the text is no plan.
        """
        try:
            found = json.loads(text)
            return _read(found if "parts" in found else _from_version1(found))
        except (KeyError, TypeError, AttributeError, RecursionError) as error:
            raise ValueError(f"expected a plan, but {type(error).__name__}: {error}") from None


# A type, what must hold of a value, and the words for it.
_Shape = tuple[Any, Callable[[Any], bool], str]
_COUNT: _Shape = (int, lambda value: 0 <= value < 1 << 63, "a count")
_TEXT: _Shape = (str, lambda value: True, "a text")
_SHARE: _Shape = ((int, float), lambda value: 0 <= value < 1, "a share")
_ERROR: _Shape = ((int, float), lambda value: 0 <= value <= sys.float_info.max, "an error")
_PART: dict[str, _Shape] = {
    **{name: _TEXT for name in ("name", "make", "columns", "why")},
    **{name: _COUNT for name in ("rows", "column_count", "bands", "channels", "factors")},
    "bounces": (int, lambda value: -1 <= value < 1 << 63, "a count, or -1 for all"),
}
_SHAPES: dict[type[Any], dict[str, _Shape]] = {
    Part: _PART,
    LeftOut: {"what": _TEXT, "why": _TEXT},
    Solve: {"method": _TEXT, "nodes": _COUNT, "residual": _ERROR, "gathering": _ERROR, "lost": _ERROR},
    Plan: {"scene": _TEXT, "quality": _TEXT, "triangles": _COUNT, "tolerance": _SHARE},
}


def _read(found: Mapping[str, Any]) -> Plan:
    """A file may come from anywhere: what the rest relies on is looked at, keys that are unknown are left alone."""
    width, height = (_checked("picture", size, _COUNT) for size in found["picture"])
    parts = [Part(**_known(Part, part)) for part in found["parts"]]
    if not parts:
        raise ValueError("expected a plan of at least one part, found none")
    left_out = [LeftOut(**_known(LeftOut, reason)) for reason in found["left_out"]]
    notes = [_checked("notes", note, _TEXT) for note in found["notes"]]
    return Plan(
        **_known(Plan, found),
        picture=(width, height),
        parts=parts,
        left_out=left_out,
        notes=notes,
        errors=_measured("errors", found.get("errors", {})),
        without=_measured("without", found.get("without", {})),
        solve=_solved(found.get("solve")),
        ground=None if found.get("ground") is None else _checked("ground", found["ground"], _COUNT),
        job=_checked("job", found.get("job", ""), _TEXT),
    )


def _solved(found: Mapping[str, Any] | None) -> Solve | None:
    """Plans before 0.4, and of direct light, have none."""
    if found is None:
        return None
    fewest, median, most = (_checked("products", number, _COUNT) for number in found["products"])
    shares = tuple(float(_checked("shares", share, _ERROR)) for share in found["shares"])
    middle, p95, worst = (float(_checked("discretisation", off, _ERROR)) for off in found["discretisation"])
    return Solve(
        **_known(Solve, found),
        products=(fewest, median, most),
        shares=shares,
        discretisation=(middle, p95, worst),
    )


def _measured(name: str, errors: Mapping[str, Any]) -> dict[str, float]:
    """Errors by the names of lights; plans before 0.3 have none."""
    return {light: float(_checked(f"{name} of {light}", error, _ERROR)) for light, error in errors.items()}


def _known(kind: type[Any], values: Mapping[str, Any]) -> dict[str, Any]:
    return {name: _checked(name, values[name], shape) for name, shape in _SHAPES[kind].items()}


def _checked(name: str, value: Any, shape: _Shape) -> Any:
    kind, holds, expected = shape
    if isinstance(value, bool) or not isinstance(value, kind) or not holds(value):
        raise ValueError(f"expected {expected} as the plan's {name}, found {value!r:.80}")
    return value


def _from_version1(found: Mapping[str, Any]) -> dict[str, Any]:
    """Plans of version 0.1 tell of one part, in keys of their own."""
    shape = ("rows", "columns", "column_count", "bands", "channels", "factors", "bounces")
    part = {name: found[name] for name in shape}
    part |= {"name": "direct", "make": "direct", "why": "light that arrives directly"}
    left_out = [dict(zip(("what", "why"), reason.partition(": ")[::2], strict=True)) for reason in found["left_out"]]
    return {**found, "parts": [part], "left_out": left_out}


def _errors(errors: Mapping[str, float]) -> str:
    """Percent, light by light."""
    return ", ".join(f"{name} {100 * error:.2g}" for name, error in errors.items()) + " %"


def _duration(seconds: float) -> str:
    """Two digits, in seconds or minutes."""
    if seconds < 10:
        return f"{seconds:.1f} s"
    return f"{seconds:.0f} s" if seconds < 600 else f"{seconds / 60:.0f} min"


def _count(number: float) -> str:
    """Two digits, or whole millions."""
    return f"{number / 1e6:,.0f} million" if number > 10e6 else f"{int(float(f'{number:.2g}')):,}"


def _megabytes(count: float) -> str:
    return f"{count / 1e6:,.1f}" if count < 10e6 else f"{count / 1e6:,.0f}"
