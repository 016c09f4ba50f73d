"""A data set of one model under many lights: pictures, the light vectors that made them, a mask and the albedo.

    python data_set.py model.glb set.npz sky.hdr hall.exr --count 1000 --size 128x128

Each picture is the exact product of the transport matrix and a light vector, eight of them in one pass over the matrix.
Lights are random turns of blends of the HDRIs. Without any, the built-in lights stand in. The archive holds

    images   (count, height, width, 3)  float32   linear radiance; black behind the model
    lights   (count, columns, 3)        float32   V: coefficients in the basis that `columns` names
    mask     (height, width)            float32   the share of each pixel that shows the model, 0 to 1
    albedo   (height, width, 3)         float32   diffuse reflectance, times the mask
    columns  ()                         str       the basis, such as "sh:10"

and for all of it images[i] is linear in lights[i]: sums and scales of lights give sums and scales of pictures.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import deltalux as dl
import numpy as np

BATCH = 8


def main() -> None:
    given = arguments()
    width, height = map(int, given.size.split("x"))
    scene = dl.Scene.load(given.model)
    scene = scene.with_camera(scene.camera.resized(width, height))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "model.transport"
        transport = dl.precompute(scene, path, columns=given.columns, quality=given.quality)

        rng = np.random.default_rng(given.seed)
        sources = [dl.Environment.load(path) for path in given.light]
        sources = sources or [dl.Environment.builtin(name) for name in ("sky", "studio", "hall")]
        lights = np.array([transport.coefficients(drawn(sources, rng)) for _ in range(given.count)])

        images = []
        for first in range(0, given.count, BATCH):
            products = transport.multiply(lights[first : first + BATCH])
            images += [transport.image(B) for B in products]

        # A response of 1 everywhere shows the albedo; a white light behind a black model, what is not the model.
        nothing = np.zeros((transport.shape[0], 3), np.float32)
        white = dl.Environment.from_cubemap(np.ones((6, 1, 1, 3), np.float32))
        np.savez_compressed(
            given.out,
            images=np.array(images),
            lights=lights.astype(np.float32),
            mask=1 - transport.image(nothing, white)[..., 0],
            albedo=transport.image(nothing + 1),
            columns=str(transport.columns),
        )
    print(f"{given.out}: {given.count} pictures of {width} x {height} under lights in {given.columns}")


def drawn(sources: list[dl.Environment], rng: np.random.Generator) -> dl.Environment:
    """A blend of two lights, each turned by any angle about the vertical, and the whole tilted a little."""
    a, b = (sources[k].rotated(rng.uniform(0, 360)) for k in rng.integers(len(sources), size=2))
    tilt = rng.normal(scale=10.0)
    return a.mixed(b, rng.uniform()).rotated(tilt, "x")


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("model", type=Path, help=".glb, .gltf, .obj, .ply or .stl")
    parser.add_argument("out", type=Path, help="the archive, .npz")
    parser.add_argument("light", type=Path, nargs="*", help=".hdr or .exr files")
    parser.add_argument("--count", type=int, default=200, help="how many pictures")
    parser.add_argument("--size", default="128x128", help="WIDTHxHEIGHT in pixels")
    parser.add_argument("--columns", default="sh:10", help='the basis of the lights: "sh:10", "haar:16", ...')
    parser.add_argument("--quality", default="publication", help="preview, publication or lossless")
    parser.add_argument("--seed", type=int, default=0)
    return parser.parse_args()


if __name__ == "__main__":
    main()
