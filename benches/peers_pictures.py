"""A picture under light that turns, beside a path tracer's: `python benches/peers_pictures.py`.

The plant, direct light of the hall. A reference of many samples a pixel is Mitsuba's own; against it
stand a whole product and frames of PBI-30 of a transport, the mean of four pixels of one twice as large (a
transport looks through the middle of a pixel alone), the same light in 25 harmonics, as transfer in harmonics of
fifth order would show it (Sloan et al. 2002), and Mitsuba with more and more samples. Errors are root mean
squares over the picture of a reference's root mean square; what the reference itself is off by is estimated from its
two halves, and taken out of all of them. Times are of all threads together (CPU), which other work on the machine
disturbs least, and of the clock. Mitsuba's is that of a warm scene: no loading, no tree.
"""

from __future__ import annotations

import argparse
import platform
import tempfile
import time
import warnings
from pathlib import Path

import deltalux as dl
import mitsuba as mi
import numpy as np
from numpy.typing import NDArray

SAMPLES = (1, 4, 16, 64)
DEGREES, FRAMES = 0.45, 100
"""A frame's turn, and how many of them are timed."""

Picture = NDArray[np.float64]


def directions(height: int = 1024) -> NDArray[np.float64]:
    """Of the pixels of a map as Mitsuba reads it: its first and last rows lie on the poles."""
    theta = np.pi * np.arange(height) / (height - 1)
    phi = np.pi * (np.arange(2 * height) + 0.5) / height
    theta, phi = np.meshgrid(theta, phi, indexing="ij")
    return np.stack([np.sin(theta) * np.sin(phi), np.cos(theta), -np.sin(theta) * np.cos(phi)], axis=-1)


def smoothed(env: dl.Environment) -> dl.Environment:
    """What 25 harmonics hold of a light; against it, no more of a row of M counts."""
    harmonics = dl.SphericalHarmonics(5)
    with warnings.catch_warnings():
        # Harmonics ring, and some of their light is negative.
        warnings.simplefilter("ignore")
        return dl.Environment.from_latlong(harmonics.evaluate(directions(256)) @ harmonics.coefficients(env))


class Peer:
    """The same scene in Mitsuba: a mesh for each material, and direct light by multiple importance sampling."""

    def __init__(self, scene: dl.Scene, env: dl.Environment) -> None:
        shapes = {f"m{k}": self._mesh(scene, k) for k in range(len(scene.albedo))}
        sky = {"type": "envmap", "bitmap": mi.Bitmap(env.radiance(directions()))}
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

    def picture(self, samples: int, seed: int) -> Picture:
        """So many samples a pixel."""
        found = mi.render(self._scene, sensor=self._sensor, integrator=self._integrator, spp=samples, seed=seed)
        return np.array(found).astype(np.float64)


class Watch:
    """Seconds of all threads and of the clock since it was made."""

    def __init__(self) -> None:
        self._start = time.process_time(), time.perf_counter()

    def __str__(self) -> str:
        cpu, clock = time.process_time() - self._start[0], time.perf_counter() - self._start[1]
        return f"{cpu:.2f} CPU-s, {clock:.2f} s"


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
    parts = [peer.picture(256, 7919 * (k + 1)) for k in range(max(asked.reference // 256, 2))]
    halves = [np.mean(parts[k::2], axis=0) for k in (0, 1)]
    truth = np.mean(parts, axis=0)
    noise = off(*halves) / 2
    print(f"{platform.processor() or platform.machine()}, {dl.threads()} threads; reference off by {100 * noise:.2f} %")

    with tempfile.TemporaryDirectory() as folder:
        watch = Watch()
        transport = dl.precompute(scene, asked.transport or Path(folder) / "plant.transport")
        print(f"deltalux: {transport}, made in {watch}")
        B = transport.multiply(transport.coefficients(env))
        print(f"  whole product: {100 * off(transport.image(B), truth, noise):.2f} % off")
        finer = scene.with_camera(scene.camera.resized(2 * asked.size, 2 * asked.size))
        twice = dl.precompute(finer, Path(folder) / "finer.transport")
        fine = twice.image(twice.multiply(twice.coefficients(env)))
        mean = fine.reshape(asked.size, 2, asked.size, 2, 3).mean(axis=(1, 3))
        print(f"  made twice as large, and the mean of four pixels: {100 * off(mean, truth, noise):.2f} % off")
        smooth = transport.image(transport.multiply(transport.coefficients(smoothed(env))))
        print(f"  in 25 harmonics: {100 * off(smooth, truth, noise):.2f} % off")
        relighter = dl.Relighter(transport, dl.PerBand(terms=30))
        lights = [env.rotated(DEGREES * (k - FRAMES)) for k in range(FRAMES + 1)]
        relighter.step(lights[0])
        watch = Watch()
        for light in lights[1:]:
            frame = relighter.step(light)
        said = str(watch)
        found = transport.image(frame.values)
        error = 100 * off(found, truth, noise)
        print(f"  PBI-30, frame {FRAMES}: {error:.2f} % off; {FRAMES} frames: {said}")

    peer.picture(1, 1)
    print(f"Mitsuba {mi.__version__}, {asked.variant}:")
    for samples in SAMPLES:
        watch = Watch()
        picture = peer.picture(samples, 2)
        print(f"  {samples:4} samples a pixel: {watch}; {100 * off(picture, truth, noise):.2f} % off")


if __name__ == "__main__":
    main()
