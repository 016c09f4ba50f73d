"""The pictures of the slides on diffuse precomputed radiance transfer (Sloan, Lehtinen and Kautz 2005), on any scene.

Without shadows, with shadows, and with light between surfaces; the image of the scene under one basis function at a
time, which is a column of M; and one transfer vector for all colours against one for each. Lights of several sizes at
several orders, another picture of the slides, are the study `blocker`.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ...columns import Haar
from ...light.environment import Environment
from ...progress import Progress
from ...relight.errors import relative_errors
from ...scene.scene import Scene
from ...sphere import face_points
from ...transport.transport import Transport
from ...update.approximation import Approximation
from ...update.methods import Nonlinear
from ..case import Case, Light
from ..harmonics.projection import HarmonicView
from ..shape import Study
from ..sheet import Sheet
from . import slide_pictures
from .basis_images import error_of_sum, haar_images, harmonic_images
from .slide_claims import BOUNCES, TERMS, Transfers, claims
from .tracing import tracing

__all__ = ["STUDY", "unshadowed"]

_TEXELS = 64
"""Along a face, for light without shadows."""
_TOGETHER = 1024
"""Receivers whose light without shadows is summed in one product."""


def run(case: Case, sheet: Sheet, progress: Progress) -> None:
    """Three transports: direct light, bounces, and bounces between surfaces without colour."""
    assert case.scene is not None
    runs = ((case.scene, 0), (case.scene, BOUNCES), (_grey(case.scene), BOUNCES))
    with tracing(progress, len(runs)) as traced:
        transports = [traced(scene, columns=case.columns, bounces=bounces).transport for scene, bounces in runs]
        direct, bounced, one = transports
        V = direct.coefficients(case.env)
        view = HarmonicView.of(direct, round(max(TERMS) ** 0.5))
        harmonics, wavelets = harmonic_images(direct, view), haar_images(direct)
        found = Transfers(
            unshadowed=unshadowed(case.env, direct.receivers.normal),
            shadowed=direct.multiply(V),
            bounced=bounced.multiply(V),
            one=one.multiply(V),
            albedo=direct.albedo,
            channels=(direct.channels, bounced.channels, one.channels),
            nbytes=(direct.nbytes, bounced.nbytes, one.nbytes),
            few=_few(direct, view, V),
            sum_error=error_of_sum(direct, V, [image for band in wavelets for image in band]),
        )
        slide_pictures.transfers(sheet, direct, found)
        sheet.heading("The scene under one basis function at a time")
        slide_pictures.harmonics(sheet, harmonics)
        slide_pictures.wavelets(sheet, wavelets)
        sheet.heading("One transfer vector for all colours, and one for each")
        slide_pictures.channels(sheet, direct, found)
    _tables(sheet, case, found)
    sheet.claims(claims(found))


def unshadowed(env: Environment, normals: NDArray[np.float32]) -> NDArray[np.float32]:
    """B of surfaces that see all of the sky above them, (rows, 3): the integral of L max(n s, 0) / pi."""
    points = face_points(_TEXELS).reshape(-1, 3)
    distance = np.linalg.norm(points, axis=1, keepdims=True)
    # A point of a face of the cube [-1, 1]^3 stands for a solid angle of 1 / distance^3.
    angle = 4 * np.pi * distance**-3 / (distance**-3).sum()
    flux = env.cubemap(_TEXELS).reshape(-1, 3) * angle / np.pi
    directions = points / distance
    starts = range(0, len(normals), _TOGETHER)
    parts = [np.maximum(normals[start : start + _TOGETHER] @ directions.T, 0) @ flux for start in starts]
    return np.concatenate(parts).astype(np.float32)


def _grey(scene: Scene) -> Scene:
    """Every surface as bright as before, and without colour."""
    textures = tuple(None if texture is None else _mean(texture) for texture in scene.textures)
    return replace(scene, albedo=_mean(scene.albedo), textures=textures)


def _mean(colours: NDArray[np.float32]) -> NDArray[np.float32]:
    mean = colours.mean(axis=-1, keepdims=True, dtype=np.float32)
    return np.ascontiguousarray(np.broadcast_to(mean, colours.shape))


def _few(transport: Transport, view: HarmonicView, V: Light) -> dict[str, float]:
    """The picture's error with few terms of either basis; of wavelets the largest, weighted by area."""
    exact, c = transport.image(transport.multiply(V)), view.light(V)
    errors = {}
    for terms in TERMS:
        errors[f"harmonics, {terms} terms"] = relative_errors(transport.image(view.multiply(c[:terms])), exact)[1]
    for terms in TERMS:
        chosen = Approximation(transport.columns, Nonlinear(terms))
        chosen.step(V)
        errors[f"Haar, {terms} terms"] = relative_errors(transport.image(transport.multiply(chosen.values)), exact)[1]
    return errors


def _tables(sheet: Sheet, case: Case, found: Transfers) -> None:
    all_light, bounced = found.one_error
    errors = ("0 %", f"{100 * all_light:.2g} %")
    of_bounced = ("0 %", f"{100 * bounced:.2g} %")
    sheet.text(
        f"Light in {case.columns}, {BOUNCES} bounces. One channel: light bounces between surfaces of the same "
        "brightness without colour, and only the receiver's own albedo is coloured."
    )
    sheet.table(
        ("Transfer", "Channels", "MB of M", "Off by, of the picture", "Of bounced light"),
        [
            (what, str(channels), f"{size / 1e6:.2f}", error, of)
            for what, channels, size, error, of in zip(
                ("shadows", "bounces, each colour", "bounces, one for all"),
                found.channels,
                found.nbytes,
                ("-", *errors),
                ("-", *of_bounced),
                strict=True,
            )
        ],
    )
    lines = [{"what": name, "image_l2": f"{error:.6g}"} for name, error in found.few.items()]
    lines.append({"what": "one channel for all colours", "image_l2": f"{all_light:.6g}"})
    sheet.csv("slides.csv", lines)


STUDY = Study(
    title="The slides on diffuse transfer",
    intro="What the slides of Sloan, Lehtinen and Kautz (SIGGRAPH 2005) show of a model in natural light, made of this "
    "scene: how shadows and light between surfaces change it, what it looks like in the light of a single basis "
    "function, and when one transfer vector is not enough. Lights of several sizes at several orders of harmonics are "
    "the study blocker, harmonics against wavelets in motion the study harmonics.",
    run=run,
    scene_files=("transfers.png", "harmonics.png", "wavelets.png", "channels.png", "slides.csv"),
    traces="still-life",
    columns=Haar(32),
)
