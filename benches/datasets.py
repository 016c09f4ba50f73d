"""What a picture of a data set costs, step by step, and what a file of it costs beside that.

    python benches/datasets.py [--size 128x128] [--columns haar:32] [--transport a.transport]

CPU-milliseconds of this process, the best of several rounds, in which all steps take turns: other work on the machine
disturbs all alike. Lights are those of `LightRule`; products are of one light, and of many in one pass over M.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import deltalux as dl
import numpy as np
from deltalux.datasets.encoding import FORMATS, Format

ROUNDS = 7
TOGETHER = 32


def timed(steps: dict[str, tuple[int, Callable[[], object]]]) -> dict[str, float]:
    """Of each step, which is so many pictures, the milliseconds of one."""
    best = dict.fromkeys(steps, np.inf)
    for _ in range(ROUNDS):
        for name, (pictures, step) in steps.items():
            started = time.process_time()
            step()
            best[name] = min(best[name], 1e3 * (time.process_time() - started) / pictures)
    return best


def main() -> None:
    chosen = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    chosen.add_argument("--scene", default="plant")
    chosen.add_argument("--size", default="128x128")
    chosen.add_argument("--columns", default="haar:32")
    chosen.add_argument("--transport", type=Path, help="made already, in the place of a scene's")
    chosen.add_argument("--threads", type=int, default=1)
    asked = chosen.parse_args()
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        transport = made(asked, folder)
        dl.set_threads(asked.threads)
        recipes = dl.LightRule().recipes(TOGETHER)
        lights = [recipe.light() for recipe in recipes]
        V = np.stack([transport.coefficients(light) for light in lights])
        B = transport.multiply(V[0])
        picture = transport.image(B, lights[0])
        stops = dl.io.auto_exposure(picture)
        steps: dict[str, tuple[int, Callable[[], object]]] = {
            "light to coefficients": (8, lambda: [transport.coefficients(light) for light in lights[:8]]),
            "product, one light": (4, lambda: [transport.multiply(one) for one in V[:4]]),
            f"product, {TOGETHER} lights together": (TOGETHER, lambda: transport.multiply(V)),
            "picture": (1, lambda: transport.image(B, lights[0])),
        }
        for kind in FORMATS:
            for level in (0, 1, 6):
                form = Format(kind, compression=level)
                steps[f"file, {kind}, level {level}"] = (
                    1,
                    lambda form=form: form.write(folder, "a", {"picture": picture}, stops),
                )
        found = timed(steps)
    print(f"{transport}, {picture.shape[1]}x{picture.shape[0]}, {dl.threads()} threads")
    for name, milliseconds in found.items():
        print(f"{name:<32}{milliseconds:8.2f} CPU-ms")


def made(asked: argparse.Namespace, folder: Path) -> dl.Transport:
    """The transport that is measured."""
    if asked.transport is not None:
        return dl.Transport(asked.transport)
    scene = dl.Scene.builtin(asked.scene)
    scene = scene.with_camera(scene.camera.resized(*map(int, asked.size.split("x"))))
    return dl.precompute(scene, folder / "a.transport", columns=asked.columns)


if __name__ == "__main__":
    main()
