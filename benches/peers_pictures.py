"""A picture under light that turns, beside a path tracer's: `python benches/peers_pictures.py`.

The plant, 256 x 256 pixels, direct light of the hall. A reference of many samples a pixel is Mitsuba's own; against it
stand a whole product and frames of PBI-30 of a transport, and Mitsuba with more and more samples. Errors are root mean
squares over the picture of a reference's root mean square; what the reference itself is off by is estimated from its
two halves, and taken out of all of them. Mitsuba's time is that of a warm scene: no loading, no compiling, no tree.
"""

from __future__ import annotations

import argparse
import platform
import tempfile
import time
from pathlib import Path

import deltalux as dl
import mitsuba as mi
import numpy as np
from numpy.typing import NDArray

SAMPLES = (1, 4, 16, 64)
DEGREES, FRAMES = 0.45, 100
"""A frame's turn, and how many of them are timed."""

Picture = NDArray[np.float64]


def latlong(env: dl.Environment, height: int = 1024) -> NDArray[np.float32]:
    """A light as Mitsuba reads a map: its first and last rows lie on the poles."""
    theta = np.pi * np.arange(height) / (height - 1)
    phi = np.pi * (np.arange(2 * height) + 0.5) / height
    theta, phi = np.meshgrid(theta, phi, indexing="ij")
    return env.radiance(np.stack([np.sin(theta) * np.sin(phi), np.cos(theta), -np.sin(theta) * np.cos(phi)], axis=-1))


class Peer:
    """The same scene in Mitsuba: a mesh for each material, and direct light by multiple importance sampling."""

    def __init__(self, scene: dl.Scene, env: dl.Environment) -> None:
        shapes = {f"m{k}": self._mesh(scene, k) for k in range(len(scene.albedo))}
        sky = {"type": "envmap", "bitmap": mi.Bitmap(latlong(env))}
        self._scene = mi.load_dict({"type": "scene", **shapes, "sky": sky})
        self._integrator = mi.load_dict({"type": "direct", "hide_emitters": True})
        camera = scene.camera
        film = {"type": "hdrfilm", "rfilter": {"type": "box"}, "pixel_format": "rgb"}
        self._sensor = mi.load_dict(
            {
                "type": "perspective",
                "fov": camera.vertical_fov,
                "fov_axis": "y",
                "to_world": mi.ScalarTransform4f().look_at(list(camera.position), list(camera.target), list(camera.up)),
                "film": film | {"width": camera.width, "height": camera.height},
            }
        )

    @staticmethod
    def _mesh(scene: dl.Scene, number: int) -> mi.Mesh:
        colour = {"type": "rgb", "value": scene.albedo[number].tolist()}
        own = mi.Properties()
        own["bsdf"] = mi.load_dict({"type": "twosided", "bsdf": {"type": "diffuse", "reflectance": colour}})
        triangles = scene.triangles[scene.material == number]
        mesh = mi.Mesh(f"m{number}", len(scene.vertices), len(triangles), props=own)
        parameters = mi.traverse(mesh)
        arrays = {"vertex_positions": scene.vertices.astype(np.float32), "faces": triangles.astype(np.uint32)}
        for key, array in arrays.items():
            parameters[key] = type(parameters[key])(array.ravel())
        parameters.update()
        return mesh

    def picture(self, samples: int, seed: int) -> tuple[Picture, float]:
        """So many samples a pixel, and the seconds that they take."""
        start = time.perf_counter()
        found = np.array(
            mi.render(self._scene, sensor=self._sensor, integrator=self._integrator, spp=samples, seed=seed)
        )
        return found.astype(np.float64), time.perf_counter() - start


def off(picture: Picture, truth: Picture, noise: float = 0.0) -> float:
    """The relative error of a picture, without the reference's own."""
    squared = np.mean((picture - truth) ** 2) / np.mean(truth**2) - noise**2
    return float(np.sqrt(max(squared, 0.0)))


def main() -> None:
    chosen = argparse.ArgumentParser(description=__doc__)
    chosen.add_argument("--size", type=int, default=256)
    chosen.add_argument("--reference", type=int, default=4096, help="samples a pixel of the reference")
    chosen.add_argument("--transport", type=Path, help="made by an earlier run, or to be kept")
    chosen.add_argument("--variant", default="scalar_rgb", help="of Mitsuba; llvm_ad_rgb may be faster, where it runs")
    asked = chosen.parse_args()
    mi.set_variant(asked.variant)

    scene, env = dl.Scene.builtin("plant"), dl.Environment.builtin("hall")
    scene = scene.with_camera(scene.camera.resized(asked.size, asked.size))
    peer = Peer(scene, env)
    parts = [peer.picture(256, 7919 * (k + 1))[0] for k in range(max(asked.reference // 256, 2))]
    halves = [np.mean(parts[k::2], axis=0) for k in (0, 1)]
    truth = np.mean(parts, axis=0)
    noise = off(*halves) / 2
    print(f"{platform.processor() or platform.machine()}, {dl.threads()} threads; reference off by {100 * noise:.2f} %")

    with tempfile.TemporaryDirectory() as folder:
        start = time.perf_counter()
        transport = dl.precompute(scene, asked.transport or Path(folder) / "plant.transport")
        print(f"deltalux: {transport}, made in {time.perf_counter() - start:.0f} s")
        B = transport.multiply(transport.coefficients(env))
        print(f"  whole product: {100 * off(transport.image(B), truth, noise):.2f} % off")
        relighter, seconds = dl.Relighter(transport, dl.PerBand(terms=30)), []
        for k in range(FRAMES + 1):
            frame = relighter.step(env.rotated(DEGREES * (k - FRAMES)))
            seconds.append(frame.seconds)
        median, p95 = (1e3 * float(np.quantile(seconds[1:], share)) for share in (0.5, 0.95))
        found = transport.image(frame.values)
        error = 100 * off(found, truth, noise)
        print(f"  PBI-30, frame {FRAMES}: {error:.2f} % off; {median:.1f} ms a frame, p95 {p95:.1f}")

    peer.picture(1, 1)
    print(f"Mitsuba {mi.__version__}, {asked.variant}:")
    for samples in SAMPLES:
        picture, took = peer.picture(samples, 2)
        print(f"  {samples:4} samples a pixel: {100 * off(picture, truth, noise):.2f} % off, {1e3 * took:.0f} ms")


if __name__ == "__main__":
    main()
