"""An HDRI turns over a model, frame by frame.

    python relight_hdri.py model.glb sky.hdr frames/ --size 640x480 --frames 90

The transport of the model is traced once, into a directory beside the frames, and kept: the next light, method or
number of frames starts at once. Each frame then sends only the coefficients of the light that have changed most, and
comes with a bound that no receiver's error exceeds. When the light stands still, the last frames are exact.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import deltalux as dl
from deltalux.io import auto_exposure, save_image, to_display


def main() -> None:
    given = arguments()
    given.out.mkdir(parents=True, exist_ok=True)
    width, height = map(int, given.size.split("x"))

    # M, once. A run that is stopped goes on where it was; one that is through is only opened.
    scene = dl.Scene.load(given.model)
    scene = scene.with_camera(scene.camera.resized(width, height))
    path = given.out / f"{given.model.stem}-{given.size}-{given.quality}.transport"
    if path.exists():
        transport = dl.Transport.open(path)
    else:
        transport = dl.precompute(scene, path, columns=given.columns, quality=given.quality)

    # V, in every frame. The light eases in and out of its turn, and then rests for a few frames.
    light = dl.Environment.load(given.light)
    relighter = dl.Relighter(transport, dl.PerBand(terms=given.terms))
    exposure = None
    for number, env in enumerate(dl.sequences.rotation(light, given.degrees, given.frames, hold=given.hold)):
        frame = relighter.step(env)
        # One exposure for all, or the picture would flicker where only the light moves.
        exposure = auto_exposure(frame.image) if exposure is None else exposure
        name = given.out / f"frame-{number:04d}"
        if given.exr:
            save_image(name.with_suffix(".exr"), frame.image)
        else:
            save_image(name.with_suffix(".png"), to_display(frame.image, exposure))
        state = "exact" if frame.converged else f"within {frame.bound:.3g}"
        print(f"{name.name}: {1000 * frame.seconds:.1f} ms, {len(frame.columns)} columns sent, {state}")


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "model", type=Path, help=".glb, .gltf, .obj, .ply or .stl; seen by its own camera if it has one"
    )
    parser.add_argument("light", type=Path, help=".hdr or .exr, lat-long or another layout that is recognised")
    parser.add_argument("out", type=Path, help="folder for the frames and the transport")
    parser.add_argument("--size", default="512x512", help="WIDTHxHEIGHT in pixels")
    parser.add_argument("--columns", default="haar:64", help="what the light is measured in")
    parser.add_argument("--quality", default="preview", help="preview, publication or lossless")
    parser.add_argument("--degrees", type=float, default=180.0, help="the whole turn, about the vertical")
    parser.add_argument("--frames", type=int, default=90)
    parser.add_argument("--hold", type=int, default=15, help="frames of rest at the end")
    parser.add_argument("--terms", type=int, default=100, help="coefficients that a frame may send")
    parser.add_argument("--exr", action="store_true", help="linear radiance in EXR files instead of PNG")
    return parser.parse_args()


if __name__ == "__main__":
    main()
