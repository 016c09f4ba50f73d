"""Edits of a highlight, timed: `python benches/curves.py [FOLDER]`, on a machine that does nothing else.

A pearl that fills the picture: its rows are those of an object on a tenth of 512 x 512 pixels (`--side 512`: of all).
First BI-30 behind a roughness that moves in every frame, and how many frames it takes to the exact product once it
stands still; then what a row takes to be made, rays included, in CPU time on all threads.
"""

from __future__ import annotations

import argparse
import os
import tempfile
import time
from pathlib import Path

import deltalux as dl
import numpy as np
from deltalux._core import CurvePass, Quotient
from deltalux.brdf.curves import reflectance_of_model
from deltalux.scene.builtin.shapes import join, quad, sphere

MODELS = {
    "Cook-Torrance": dl.brdf.CookTorrance(0.1, 1.5),
    "GGX": dl.brdf.GGX(0.1),
    "A-S": dl.brdf.AshikhminShirley(200),
}
PEARL = MODELS["Cook-Torrance"]


def pearl(side: int) -> dl.Scene:
    shapes = [sphere((0.0, 0.5, 0.0), 0.5, 96), quad((-9, 0, -9), (0, 0, 18), (18, 0, 0))]
    vertices, triangles = join(*shapes)
    return dl.Scene.from_arrays(
        vertices,
        triangles,
        camera=dl.Camera((0.0, 1.3, 3.0), (0.0, 0.5, 0.0), vertical_fov=12.0, width=side, height=side),
        materials={"pearl": dl.Material(), "cloth": dl.Material()},
        material=np.repeat([0, 1], [len(corners) for _, corners in shapes]),
    )


def rows_are_made(env: dl.Environment) -> None:
    """CPU time of a row, model by model."""
    scene = pearl(48)
    core, eye = scene.traced(), scene.camera.position
    seen = core.receivers(scene.camera.rays(), edges=False)
    rows = seen.glossy(scene.material[seen.triangle], [True, False], [[], []], eye)
    light = [env.cubemap(64 * finer) for finer in (1, 2, 4, 8)]
    for name, model in MODELS.items():
        quotient, factors = Quotient.of_model(model.core()), reflectance_of_model(model)[None]
        work = CurvePass(core, rows, quotient, eye=eye, factors=factors, light=light, edge_side=3)
        started = time.process_time()
        work.respond(np.ones((256, 3)))
        print(f"{name:16}{1e3 * (time.process_time() - started) / len(rows):8.2f} CPU-ms a row")


def frames(transport: dl.CurveTransport, count: int) -> None:
    editor = dl.BrdfEditor(transport, dl.Incremental(terms=30))
    editor.step()
    taken = []
    for sigma in np.geomspace(0.3, 0.03, count):
        editor.set("pearl", sigma=float(sigma))
        taken.append(1e3 * editor.step().seconds)
    still = 1
    while not editor.step().converged:
        still += 1
    p50, p95 = np.percentile(taken, [50, 95])
    print(f"BI-30 over {transport.parts['pearl'].transport.shape[0]:,} rows, {transport.nbytes / 1e6:.1f} MB:", end=" ")
    print(f"p50 {p50:.2f} ms, p95 {p95:.2f} ms, least {min(taken):.2f} ms; exact {still + 1} frames after the edit")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", nargs="?", help="keeps the transport for another run")
    parser.add_argument("--side", type=int, default=162, help="pixels along a side of the picture")
    parser.add_argument("--frames", type=int, default=300)
    args = parser.parse_args()
    env = dl.Environment.builtin("hall")
    with tempfile.TemporaryDirectory() as folder:
        path = Path(args.folder or folder) / f"pearl-{args.side}.curves"
        path.parent.mkdir(parents=True, exist_ok=True)
        transport = dl.precompute_curves(
            pearl(args.side), path, env=env, materials={"pearl": PEARL}, fresnel="fixed", quality="preview"
        )
        frames(transport, args.frames)
    rows_are_made(env)
    print(f"load {os.getloadavg()[0]:.1f}, {os.cpu_count()} cores")


if __name__ == "__main__":
    main()
