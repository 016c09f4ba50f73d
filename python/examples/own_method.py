"""A method of one's own beside those of the package: errors and times of each under one turning light.

    python own_method.py model.glb sky.hdr --terms 30

`Energy` resets a band where that leaves less energy to send, and sends first what carries the most. Whatever a method
chooses, every frame of it is the exact product of what has been sent, comes with a bound on its error, and is exact
once the light stands still. The command line takes it too:

    deltalux relight model.transport --env sky.hdr -o frames/ --method own_method.py:Energy
"""

from __future__ import annotations

import argparse
from pathlib import Path
from tempfile import TemporaryDirectory

import deltalux as dl
import numpy as np


class Energy(dl.Method):
    """By squared change over all colours, where the package weighs the sum of absolute changes."""

    def choose(self, state: dl.State) -> dl.Choice:
        """Bands in which the light is nearer to black than to our copy start anew."""
        left = state.weights * np.square(state.change).sum(axis=1)
        anew = state.weights * np.square(state.target).sum(axis=1)
        nearer = np.bincount(state.bands, anew) < np.bincount(state.bands, left)
        worth = np.where(nearer[state.bands], anew, left)
        # A budget sends as many of these as it allows, from the front.
        return dl.Choice(resets=np.flatnonzero(nearer), columns=np.argsort(-worth, kind="stable"))


def main() -> None:
    given = arguments()
    width, height = map(int, given.size.split("x"))
    scene = dl.Scene.load(given.model)
    scene = scene.with_camera(scene.camera.resized(width, height))
    methods = [method(terms=given.terms) for method in (dl.Nonlinear, dl.Incremental, dl.PerBand, Energy)]
    with TemporaryDirectory() as folder:
        path = Path(folder) / "model.transport"
        transport = dl.precompute(scene, path, columns=given.columns, quality="preview", progress=False)
        rows = dl.compare(transport, dl.Environment.load(given.light), methods)
    print(f"{'':24} {'image error':>12} {'light error':>12} {'ms a frame':>11} {'MB a frame':>11}  bound holds")
    for row in rows:
        print(
            f"{row.method:24} {row.image_l2:12.3%} {row.light_l1:12.3%} {row.milliseconds:11.2f} "
            f"{row.streamed_bytes / 1e6:11.3f}  {'yes' if row.within_bound else 'NO'}"
        )


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "model", type=Path, help=".glb, .gltf, .obj, .ply or .stl; seen by its own camera if it has one"
    )
    parser.add_argument("light", type=Path, help=".hdr or .exr")
    parser.add_argument("--size", default="256x256", help="WIDTHxHEIGHT in pixels")
    parser.add_argument("--columns", default="haar:64", help="what the light is measured in")
    parser.add_argument("--terms", type=int, default=30, help="coefficients that a frame may send")
    return parser.parse_args()


if __name__ == "__main__":
    main()
