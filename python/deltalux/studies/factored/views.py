"""Light that moves, or the eye: rotating, interpolating, the view alone (thesis, Fig. 7.2; EGSR 2006, Fig. 11)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ... import brdf
from ...camera import Camera
from ...columns import Haar
from ...io import auto_exposure
from ...light.environment import Environment
from ...pages.verdict import Verdict
from ...progress import Progress
from ...relight.errors import relative_errors
from ...relight.relighter import Relighter
from ...rotation import rotation_matrix
from ...surface.material import Material
from ...transport.transport import Transport
from ...update.methods import Full, Method, Nonlinear, PerBand
from ..case import Case, Light
from ..interreflection.tracing import tracing
from ..pictures import label, show
from ..shape import Study
from ..sheet import Sheet

if TYPE_CHECKING:
    from ...scene.scene import Scene

__all__ = ["STUDY"]

_METHODS: dict[str, Method] = {
    "NWA-30": Nonlinear(terms=30),
    "PBI-30": PerBand(terms=30),
    "NWA-100": Nonlinear(terms=100),
}
_ROTATING, _INTERPOLATING, _VIEW = "rotating", "interpolating", "view only"
_FRAMES, _DEGREES = 16, 45.0
_FACTORS = 4
"""That the papers show."""


class _Moment(NamedTuple):
    """One frame of a movement."""

    light: Light
    camera: Camera


class _Seen(NamedTuple):
    """What a method shows at the end of a movement, and what it was off by and took on the way."""

    picture: NDArray[np.float32]
    error: float
    seconds: float


_Found = dict[tuple[str, str], _Seen]


def run(case: Case, sheet: Sheet, progress: Progress) -> None:
    """One transport of vertices with four factors, and three movements over it."""
    assert case.scene is not None
    scene = _shining(case.scene)
    with tracing(progress, 1) as traced:
        options = {"receivers": "vertices", "factors": _FACTORS, "columns": case.columns}
        transport = traced(scene, **options).transport
        found: _Found = {}
        for name, moments in _movements(case.env, transport, scene.camera).items():
            found |= {(method, name): seen for method, seen in _followed(transport, moments).items()}
        rows, factors = len(transport.receivers), _FACTORS
    names = list(dict.fromkeys(movement for _, movement in found))
    sheet.text(
        f"{rows:,} rows of vertices and of {factors} factors at those that shine. Errors: relative L2 of the picture "
        f"in the mean over {_FRAMES} frames; times are medians of what a frame takes, without drawing the vertices."
    )
    lines = []
    for method in _METHODS:
        own = [found[method, name] for name in names]
        lines.append((method, *(f"{100 * seen.error:.2g} %, {1e3 * seen.seconds:.2f} ms" for seen in own)))
    sheet.table(["Method", *names], lines)
    caption = "The last frame of each movement (Fig. 7.2): what each method shows, and its error there."
    with sheet.plot("views.png", caption, len(_METHODS), len(names), (9.0, 8.0)) as (_, grid):
        stops = auto_exposure(found["PBI-30", _VIEW].picture)
        for line, method in zip(grid, _METHODS, strict=True):
            label(line[0], method)
            for panel, name in zip(line, names, strict=True):
                panel.set_title(name, fontsize=9)
                show(panel, found[method, name].picture, stops, f"{100 * found[method, name].error:.2g} %")
    sheet.csv(
        "views.csv",
        [
            {"method": method, "movement": name, "error": f"{own.error:.5g}", "ms": f"{1e3 * own.seconds:.4g}"}
            for (method, name), own in found.items()
        ],
    )
    sheet.claims(list(_claims(found)))


def _shining(scene: Scene) -> Scene:
    """As it is, or where nothing in it shines, with its largest material made to."""
    if any(model is not None for model in scene.models or ()):
        return scene
    number = int(np.bincount(scene.material).argmax())
    albedo = scene.materials[number].albedo
    return scene.with_material(number, Material(albedo=albedo, specular=0.3, model=brdf.GGX(0.4)))


def _movements(env: Environment, transport: Transport, camera: Camera) -> dict[str, list[_Moment]]:
    """Of a light that turns, of one that becomes another, and of an eye that goes around."""
    shares = np.linspace(0, 1, _FRAMES)
    start = transport.coefficients(env)
    other = transport.coefficients(Environment.builtin("studio" if env.name == "hall" else "hall"))
    # As bright, so that what moves is where light comes from.
    other *= np.linalg.norm(start) / max(float(np.linalg.norm(other)), 1e-300)
    return {
        _ROTATING: [_Moment(transport.coefficients(env.rotated(_DEGREES * share)), camera) for share in shares],
        _INTERPOLATING: [_Moment((1 - share) * start + share * other, camera) for share in shares],
        _VIEW: [_Moment(start, _around(camera, _DEGREES * share)) for share in shares],
    }


def _around(camera: Camera, degrees: float) -> Camera:
    """Turned about the vertical through its target."""
    away = np.subtract(camera.position, camera.target)
    x, y, z = (float(value) for value in np.add(camera.target, rotation_matrix(degrees, "y") @ away))
    return replace(camera, position=(x, y, z))


def _followed(transport: Transport, moments: list[_Moment]) -> dict[str, _Seen]:
    """All methods frame by frame: a camera's rays are traced once."""
    whole = Relighter(transport, Full())
    following = {name: Relighter(transport, method) for name, method in _METHODS.items()}
    told: dict[str, list[_Seen]] = {name: [] for name in _METHODS}
    for light, camera in moments:
        exact = whole.step(light).render(camera)
        for name, relighter in following.items():
            frame = relighter.step(light)
            picture = frame.render(camera)
            told[name].append(_Seen(picture, relative_errors(picture, exact)[1], frame.seconds))
    return {name: _at_the_end(own) for name, own in told.items()}


def _at_the_end(frames: list[_Seen]) -> _Seen:
    # The first frame of all sends everything.
    rest = frames[1:]
    seconds = float(np.median([own.seconds for own in rest]))
    return _Seen(frames[-1].picture, float(np.mean([own.error for own in rest])), seconds)


def _claims(found: _Found) -> Iterator[Verdict]:
    still = found["PBI-30", _VIEW].error
    yield Verdict(
        claim="A view that moves alone leaves the picture of PBI exact (Fig. 7.2, right)",
        holds=still == 0.0,
        figures=f"{100 * still:.2g} % off, beside {100 * found['NWA-30', _VIEW].error:.2g} % of NWA-30",
        why="" if still == 0.0 else "What was applied is not all of the light.",
    )
    for name in (_ROTATING, _INTERPOLATING):
        few, many = found["PBI-30", name].error, found["NWA-100", name].error
        yield Verdict(
            claim=f"PBI-30 is as good as NWA-100, {name} (Fig. 7.2)",
            holds=few <= many,
            figures=f"{100 * few:.2g} beside {100 * many:.2g} %",
            why=""
            if few <= many
            else "Where few lamps are all of the light, 100 terms hold it; and fast light is far.",
        )


STUDY = Study(
    title="Views: light that moves, and an eye that does",
    intro="A scene at its vertices, with four factors where it shines, is seen from anywhere: an update is sent once "
    "to all factors. The light turns; one light becomes another; and the eye alone goes around: nothing is sent.",
    run=run,
    scene_files=("views.png", "views.csv"),
    traces="still-life",
    columns=Haar(32),
)
