"""Everything at once: `python tests/python/stress.py --seconds 60 --threads 8 --seed 1`.

Threads share one of every public object and make random calls on them, short ones and long ones; progress callbacks
raise in between. Meanwhile processes without work keep the machine busy, children are forked off that compute on their
own, and Ctrl-C interrupts the main thread in long work. Where any thread stands still for a minute, all stacks are
printed and the process ends. The last line says how many calls were made.
"""

from __future__ import annotations

import argparse
import contextlib
import faulthandler
import multiprocessing
import os
import signal
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from pathlib import Path

import deltalux as dl
import numpy as np
import test_curves
import test_studio
from deltalux import _core

STILL = 60.0
"""Seconds after which a thread that has made no call is said to hang."""
PATIENCE = 45.0
"""Seconds that a child may take, which is less than a thread may stand still."""
COLUMNS = dl.Haar(8)

Call = Callable[[np.random.Generator], object]


class Stop(Exception):
    """Raised by a progress callback."""


def tiled(rows: int = 512, seed: int = 0) -> _core.Transport:
    rng = np.random.default_rng(seed)
    M = 0.05 * rng.normal(size=(rows, COLUMNS.columns)) * (rng.random((rows, COLUMNS.columns)) < 0.2)
    return _core.Transport.from_dense(M, columns=str(COLUMNS), tile_rows=64)


class Loudest(dl.Method):
    """A method of one's own."""

    def choose(self, state):
        return dl.Choice(columns=np.argsort(-state.worth(), kind="stable"))


def small_scene() -> dl.Scene:
    scene = dl.Scene.builtin("cornell")
    return scene.with_camera(scene.camera.resized(16, 16))


def calls(folder: Path) -> dict[str, Call]:
    """What threads do, by name, each over objects that all share."""
    transport, joined = dl.Transport(tiled()), dl.Transport(_core.Transport.join([tiled(), tiled(seed=1)]))
    lights = list(np.random.default_rng(1).normal(size=(8, COLUMNS.columns, 3)))
    mixes = np.random.default_rng(2).normal(size=(4, 512, 2)).astype(np.float32)
    relighters = [dl.Relighter(transport, method) for method in (dl.PerBand(terms=50), dl.Full(), Loudest(terms=50))]
    mixed = dl.Relighter(joined, dl.PerBand(terms=50), mix=mixes[0])
    # Whoever is first may mix what has not been stepped.
    mixed.step(lights[0])
    approximation, env = dl.Approximation(COLUMNS, dl.PerBand(terms=50)), dl.Environment.builtin("hall")
    scene, model = small_scene(), dl.brdf.GGX(0.2)
    made = dl.precompute(scene, folder / "shared.transport", columns="haar:4", quality="preview", progress=False)
    pearl = {"pearl": test_curves.PEARL}
    options = {"quality": "preview", "progress": False}
    curves = dl.precompute_curves(test_curves.plane_scene(6), folder / "a.curves", env=env, materials=pearl, **options)
    editor = dl.BrdfEditor(curves, dl.Incremental(terms=20))
    room = dl.precompute_studio(
        test_studio.box(), folder / "a.studio", families=test_studio.families(), gather=64, nodes=64, **options
    )
    studio = dl.Studio(room)
    studio.set_lights([test_studio.LAMP])
    ways = np.random.default_rng(3).normal(size=(200, 3))
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    up = ways * np.sign(ways[:, 2:])

    def raising(rng: np.random.Generator) -> None:
        """Long work whose progress raises, at a random moment."""
        after = rng.random()

        def progress(done: float, total: float) -> None:
            if done > after * total:
                raise Stop

        path = folder / f"{threading.get_ident()}.transport"
        with contextlib.suppress(Stop):
            dl.precompute(scene, path, columns="haar:4", quality="preview", progress=progress, again=True)

    return {
        "step": lambda rng: rng.choice(relighters).step(lights[rng.integers(8)]),
        "bytes": lambda rng: [(r.nbytes, r.values.shape) for r in relighters],
        "mix": lambda rng: mixed.mix(mixes[rng.integers(4)]) if rng.random() < 0.5 else mixed.step(lights[0]),
        "multiply": lambda rng: transport.multiply(np.stack(lights)),
        "norms": lambda rng: (transport.column_norms, transport.column_bytes, transport.row(5)),
        "sparse": lambda rng: (transport.to_scipy(), transport.rmatmat(np.ones(512))),
        "fresh": lambda rng: dl.Relighter(transport, dl.Incremental(terms=5)).step(lights[0]),
        "approximation": lambda rng: approximation.step(lights[rng.integers(8)]),
        "light": lambda rng: made.coefficients(env.rotated(360 * rng.random())),
        "picture": lambda rng: made.image(made.multiply(made.coefficients(env)), env),
        "open": lambda rng: dl.Transport.open(folder / "shared.transport").multiply(np.ones((96, 3))),
        "brdf": lambda rng: (model.evaluate(up, up), model.pdf(up, up), model.albedo(up[:4])),
        "rays": lambda rng: scene.traced().receivers(scene.camera.rays(), edges=True),
        "edit": lambda rng: (editor.set("pearl", sigma=rng.uniform(0.1, 0.4)), editor.step()),
        "studio": lambda rng: (studio.set_lights([test_studio.LAMP, test_studio.SPOT]), studio.step()),
        "precompute": raising,
    }


def alone() -> None:
    """What a child computes, with nothing of its parent's."""
    transport = dl.Transport(tiled(seed=3))
    dl.Relighter(transport, dl.PerBand(terms=50)).step(np.ones((COLUMNS.columns, 3)))
    dl.Environment.from_latlong(np.ones((16, 32, 3))).cubemap(8)


def fork(patience: float) -> str:
    """A child of all these threads; what went wrong with it."""
    child = os.fork()
    if not child:
        # No watchdog here: the thread of the parent's is gone, and arming another waits for it.
        try:
            alone()
            os._exit(0)
        finally:
            os._exit(1)
    until = time.monotonic() + PATIENCE * patience
    while time.monotonic() < until:
        process, status = os.waitpid(child, os.WNOHANG)
        if process:
            return "" if status == 0 else f"a forked child ended with {os.waitstatus_to_exitcode(status)}"
        time.sleep(0.01)
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    return "a forked child hangs"


def interrupted(folder: Path, rng: np.random.Generator) -> str:
    """Ctrl-C while the main thread is at long work; what went wrong."""
    timer = threading.Timer(0.3 * rng.random(), os.kill, (os.getpid(), signal.SIGINT))
    try:
        timer.start()
        while True:
            path = folder / "interrupted.transport"
            dl.precompute(small_scene(), path, columns="haar:8", quality="preview", progress=False, again=True)
    except KeyboardInterrupt:
        return ""
    except BaseException as error:
        return f"Ctrl-C came out as {type(error).__name__}: {error}"


def spin(seconds: float) -> None:
    until = time.monotonic() + seconds
    while time.monotonic() < until:
        pass


def run(
    folder: Path, seconds: float, threads: int, seed: int, spawn: bool, patience: float
) -> tuple[dict[str, int], list[str]]:
    """How often each call was made, and what went wrong."""
    all_calls, context = calls(folder), multiprocessing.get_context("spawn")
    end, wrong, made = time.monotonic() + seconds, [], [dict.fromkeys(all_calls, 0) for _ in range(threads)]

    def work(k: int) -> None:
        rng, names = np.random.default_rng((seed, k)), list(all_calls)
        while time.monotonic() < end and not wrong:
            name = names[rng.integers(len(names))]
            try:
                all_calls[name](rng)
            except BaseException as error:
                wrong.append(f"{name}: {type(error).__name__}: {error}")
            made[k][name] += 1

    busy = [context.Process(target=spin, args=(seconds,)) for _ in range(2)] if spawn else []
    running = [threading.Thread(target=work, args=(k,), daemon=True) for k in range(threads)]
    for one in [*busy, *running]:
        one.start()
    rng, before = np.random.default_rng((seed, 99)), -1
    faulthandler.dump_traceback_later(STILL * patience, exit=True)
    while time.monotonic() < end and not wrong:
        wrong += [what for what in (fork(patience), interrupted(folder, rng)) if what]
        if (now := min(sum(own.values()) for own in made)) > before:
            before = now
            faulthandler.dump_traceback_later(STILL * patience, exit=True)
    for one in [*running, *busy]:
        one.join(STILL * patience)
    faulthandler.cancel_dump_traceback_later()
    return {name: sum(own[name] for own in made) for name in all_calls}, wrong


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--threads", type=int, default=8)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--no-spawn", action="store_true", help="no other processes that keep the machine busy")
    parser.add_argument("--patience", type=float, default=1.0, help="times as long until something is said to hang")
    given = parser.parse_args()
    # A shell that runs things in the background has them ignore Ctrl-C, for ever.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    with tempfile.TemporaryDirectory() as folder:
        made, wrong = run(Path(folder), given.seconds, given.threads, given.seed, not given.no_spawn, given.patience)
    for what in wrong:
        print(f"FAULT: {what}")
    print(f"{sum(made.values())} calls: {', '.join(f'{name} {count}' for name, count in made.items())}")
    return int(bool(wrong))


if __name__ == "__main__":
    sys.exit(main())
