"""What the plan foretells of a precomputation against what it takes, on the four built-in scenes.

    python benches/plan.py [--size 512x512] [--quality preview] [--columns haar:64] [SCENE ...]

The machine must be idle. For each scene: the range of seconds in the plan, what the bar says first, what the run took
from its plan to the finished file, and by how much the plan was off; then the same for bytes on disk.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path

import deltalux as dl
from deltalux.precomputation.preparation import Request
from deltalux.precomputation.run import Precomputation


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="*", metavar="SCENE", default=["cornell", "still-life", "plant", "street"])
    parser.add_argument("--size", default="512x512")
    parser.add_argument("--columns", default="haar:64")
    parser.add_argument("--quality", default="preview")
    given = parser.parse_args()
    width, height = map(int, given.size.split("x"))
    print(
        f"{'scene':12} {'range, s':>15} {'plan, s':>8} {'took, s':>8} {'off':>6} {'plan, MB':>9} {'MB':>7} {'off':>6}"
    )
    with tempfile.TemporaryDirectory() as folder:
        for name in given.scenes:
            scene = dl.Scene.builtin(name)
            scene = scene.with_camera(scene.camera.resized(width, height))
            asked = Precomputation(scene, Request(given.columns, given.quality))
            plan = asked.plan
            started = time.perf_counter()
            # The bar's first estimate is `plan.seconds`: it is given nothing else.
            transport = asked.run(Path(folder) / f"{name}.transport", progress=False)
            took = time.perf_counter() - started
            (cost,) = plan.costs
            megabytes = sum(size for _, size in transport.files) / 1e6
            expected = plan.bytes_on_disk / 1e6
            print(
                f"{name:12} {cost.least_seconds:7.1f}{cost.most_seconds:8.1f} {plan.seconds:8.1f} {took:8.1f} "
                f"{plan.seconds / took - 1:6.0%} {expected:9.1f} {megabytes:7.1f} {expected / megabytes - 1:6.0%}"
            )


if __name__ == "__main__":
    main()
