"""Fuzzing of the readers of files (the manifest and the tiles of transports, glTF, pictures), of calls and of meshes.

    python tests/fuzz/fuzz.py --target tile --files 100000 --seed 7

Small valid files are harmed a little and opened; calls of a relighter, and meshes with rays, are made of any bytes. A
file may be taken or refused (`FileError`, another `ValueError`, an `OSError`); any other exception, a panic, a crash,
more than a few seconds or more than half a gigabyte is a fault. It ends the run, and the file stays in a folder that
the last line names. Files are opened in a child process, which a crash may take along. File number n depends on target,
seed and n only: ``--first n --files 1`` makes it again.
"""

from __future__ import annotations

import argparse
import multiprocessing
import sys
import tempfile
import time
import warnings
from collections.abc import Callable
from multiprocessing.connection import Connection
from pathlib import Path
from random import Random
from typing import Any

import deltalux as dl
import numpy as np
from deltalux.transport.receivers import Pixels, Vertices

sys.path.insert(0, str(Path(__file__).parent))
import mutations as mu  # noqa: E402
import samples  # noqa: E402
import structured  # noqa: E402
from samples import Files  # noqa: E402

MANIFEST = "manifest.json"
SECONDS, MEGABYTES = 5.0, 512
"""What one file may take."""

Harm = Callable[[Files, Random], Files]
Use = Callable[[Path], None]


# What is harmed -------------------------------------------------------------------------------------------------------


def harmed_manifest(files: Files, rng: Random) -> Files:
    text = files[MANIFEST]
    text = mu.harm_bytes(text, rng) if rng.random() < 0.2 else mu.write(mu.harm_tree(mu.parse(text), rng)).encode()
    return files | {MANIFEST: mu.sealed(text) if rng.random() < 0.95 else text}


def harmed_tile(files: Files, rng: Random) -> Files:
    """One of the files with arrays; the manifest then tells its true size and checksum, or checks would end there."""
    name = rng.choice([name for name in files if name != MANIFEST])
    harmed = mu.harm_safetensors(files[name], rng)
    manifest = mu.parse(files[MANIFEST])
    if rng.random() < 0.95:
        mu.put_right(manifest, name, files[name], harmed)
    return files | {name: harmed, MANIFEST: mu.sealed(mu.write(manifest).encode())}


def harmed_gltf(files: Files, rng: Random) -> Files:
    kind = rng.randrange(10)
    if "scene.glb" not in files:
        name = "scene.gltf" if kind <= 6 else rng.choice(list(files))
        return files | {
            name: _harmed_text(files[name], rng) if name == "scene.gltf" else mu.harm_bytes(files[name], rng)
        }
    whole = files["scene.glb"]
    if kind == 0:
        return {"scene.glb": mu.harm_bytes(whole, rng)}
    length = int.from_bytes(whole[12:16], "little")
    text, binary = whole[20 : 20 + length], whole[28 + length :]
    if kind <= 7:
        text = _harmed_text(text, rng)
    else:
        binary = mu.harm_bytes(binary, rng)
    return {"scene.glb": samples.glb(text, binary)}


def _harmed_text(text: bytes, rng: Random) -> bytes:
    return mu.harm_bytes(text, rng) if rng.random() < 0.1 else mu.write(mu.harm_tree(mu.parse(text), rng)).encode()


def harmed_picture(files: Files, rng: Random) -> Files:
    return {name: mu.harm_bytes(data, rng) for name, data in files.items()}


def any_bytes(files: Files, rng: Random) -> Files:
    """Of a length like that of the sample."""
    return {name: rng.randbytes(rng.randrange(len(data) + 1)) for name, data in files.items()}


# What is done with it -------------------------------------------------------------------------------------------------


def open_transport(folder: Path) -> None:
    """What was taken for whole must also bear use."""
    transport = dl.Transport.open(folder)
    rows, columns = transport.shape
    factors = transport._core.factors
    mix = np.ones((rows, factors)) if factors > 1 else None
    product = transport.multiply(np.ones((columns, 3)), mix=mix)
    _ = transport.column_norms, transport.audit, transport.columns, transport.second_columns
    dl.Relighter(transport, dl.PerBand(terms=3), mix=mix).step(np.ones((columns, 3)))
    if isinstance(transport.receivers, Pixels):
        transport.image(product)
        transport.row(0)
        _ = str(transport.plan), transport.camera
    elif isinstance(transport.receivers, Vertices) and transport._core.beside("scene") is not None:
        transport.render(dl.Camera((0.3, 1.0, 0.7), (0, 0, 0), width=6, height=5), product)


def load_scene(folder: Path) -> None:
    scene = dl.Scene.load(next(path for path in folder.iterdir() if path.stem == "scene" and path.suffix in _SUFFIXES))
    scene.content_hash()
    scene.albedo_at(np.arange(len(scene.triangles)), np.full((len(scene.triangles), 2), 1 / 3))


def load_picture(folder: Path) -> None:
    for path in folder.iterdir():
        dl.Environment.load(path, repair="zero").cubemap(4)


_SUFFIXES = (".glb", ".gltf")

TARGETS: dict[str, tuple[Harm, Use]] = {
    "manifest": (harmed_manifest, open_transport),
    "tile": (harmed_tile, open_transport),
    "gltf": (harmed_gltf, load_scene),
    "picture": (harmed_picture, load_picture),
    "calls": (any_bytes, structured.play_calls),
    "mesh": (any_bytes, structured.trace_mesh),
}


def bases_of(targets: list[str], folder: Path) -> dict[str, list[Files]]:
    """What the files of some targets begin as."""
    transports = samples.transports(folder) if {"manifest", "tile"} & set(targets) else []
    made = {
        "manifest": transports,
        "tile": transports,
        "gltf": samples.scenes(),
        "picture": samples.pictures(folder),
        "calls": [{structured.CALLS: bytes(range(72))}],
        "mesh": [{structured.MESH: bytes(range(0, 252, 2)) + bytes(range(1, 235))}],
    }
    return {target: made[target] for target in targets}


def make(target: str, bases: list[Files], seed: int, number: int) -> Files:
    """File number `number`: the same for the same target, seed and number."""
    rng = Random(f"{target}/{seed}/{number}")
    return TARGETS[target][0](rng.choice(bases), rng)


def fault(use: Use, folder: Path) -> tuple[str, bool]:
    """What is wrong with how a file was treated, or nothing; and whether the file was taken."""
    try:
        use(folder)
    except (ValueError, OSError) as error:
        # Readers turn whatever a parser raises into a refusal; memory that ran out is none.
        short = [cause for cause in (error.__cause__, error.__context__) if isinstance(cause, MemoryError)]
        return ("memory ran out" if short else ""), False
    except BaseException as error:
        return f"raised {type(error).__name__}: {error}", False
    return "", True


# The child, which opens, and the parent, which watches ----------------------------------------------------------------


def child(
    target: str,
    bases: list[Files],
    numbers: tuple[int, int, int],
    seconds: float,
    use: Use,
    state: Any,
    tell: Connection,
) -> None:
    """Opens file after file; `state` says which (and how many were taken), `tell` the fault that ended it."""
    warnings.simplefilter("ignore")
    # However many processors there are: each thread's own reserves would count against the limit below.
    dl.set_threads(2)
    seed, first, stop = numbers
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        before: Files = {}
        # What the libraries take for themselves is not the file's fault.
        for base in bases:
            before = put(folder, before, base)
            use(folder)
        started, least = time.monotonic(), peak()
        limit_memory()
        for number in range(first, stop):
            if time.monotonic() - started > seconds:
                break
            state[0], state[1] = number, time.monotonic()
            before = put(folder, before, make(target, bases, seed, number))
            what, taken = fault(use, folder)
            state[2] += taken
            state[3] += 1
            if not what and peak() - least > MEGABYTES:
                what = f"took {peak() - least} MB"
            if what:
                tell.send(what)
                return


def put(folder: Path, before: Files, files: Files) -> Files:
    """Makes the folder hold these files; those that have not changed stay."""
    for name in before.keys() - files.keys():
        (folder / name).unlink()
    for name, data in files.items():
        if before.get(name) != data:
            (folder / name).write_bytes(data)
    return files


def peak() -> int:
    """The most memory that this process has held, in MB; 0 where the system does not say."""
    try:
        import resource
    except ImportError:
        return 0
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // (1024 if sys.platform == "linux" else 1 << 20)


def limit_memory() -> None:
    """Beyond four times what a file may take, allocations fail, so that a fault does not take the machine along."""
    if sys.platform == "linux":
        import resource

        pages = int(Path("/proc/self/statm").read_text().split()[0])
        most = pages * resource.getpagesize() + (4 * MEGABYTES << 20)
        resource.setrlimit(resource.RLIMIT_AS, (most, resource.getrlimit(resource.RLIMIT_AS)[1]))


def run(
    target: str,
    bases: list[Files],
    seed: int,
    first: int,
    files: int | None,
    seconds: float,
    keep: Path,
    use: Use | None = None,
    most: float | None = None,
) -> bool:
    """Whether a child opened all files, or files for so many seconds, without a fault."""
    context = multiprocessing.get_context("spawn")
    # Number of the file, when it was begun, how many were taken, how many were opened.
    state = context.Array("d", [first, 0.0, 0.0, 0.0], lock=False)
    ours, theirs = context.Pipe(duplex=False)
    stop = first + (files if files is not None else 1 << 60)
    started, most = time.monotonic(), SECONDS if most is None else most
    arguments = (target, bases, (seed, first, stop), seconds, use or TARGETS[target][1], state, theirs)
    worker = context.Process(target=child, args=arguments)
    worker.start()
    what = ""
    while worker.is_alive() and not what:
        worker.join(0.1)
        if state[1] and worker.is_alive() and time.monotonic() - state[1] > most:
            what = f"took more than {most:g} s"
    if what:
        worker.kill()
        worker.join()
    elif ours.poll():
        what = ours.recv()
    elif worker.exitcode:
        what = f"ended the process with {worker.exitcode}"
    number = int(state[0])
    took = time.monotonic() - started
    print(f"{target}: {state[3]:.0f} files of seed {seed}, {state[2]:.0f} of them taken, in {took:.1f} s")
    if what:
        left = keep / f"{target}-{seed}-{number}"
        left.mkdir(parents=True, exist_ok=True)
        put(left, {}, make(target, bases, seed, number))
        print(f"FAULT: {what}\n  --target {target} --seed {seed} --first {number} --files 1; it is in {left}")
    return not what


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--target", nargs="+", choices=TARGETS, default=list(TARGETS), help="by default all")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--first", type=int, default=0, help="number of the first file")
    parser.add_argument("--files", type=int, help="how many of each target; by default as many as the time allows")
    parser.add_argument("--seconds", type=float, help="time for each target; 10 where --files does not say enough")
    parser.add_argument("--keep", type=Path, default=Path("fuzz-faults"), help="where a file that shows a fault is put")
    parser.add_argument(
        "--most", type=float, default=SECONDS, help="seconds that a file may take; default: %(default)s"
    )
    given = parser.parse_args(arguments)
    seconds = given.seconds if given.seconds is not None else 10.0 if given.files is None else 1e9
    with tempfile.TemporaryDirectory() as folder:
        bases = bases_of(given.target, Path(folder))
    how = (given.seed, given.first, given.files, seconds, given.keep)
    done = [run(target, bases[target], *how, most=given.most) for target in given.target]
    return 0 if all(done) else 1


if __name__ == "__main__":
    sys.exit(main())
