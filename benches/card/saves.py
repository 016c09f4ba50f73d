"""What is saved, for the rows that kill and starve whoever saves: each over something that is there already."""

from __future__ import annotations

import re
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import deltalux as dl
import numpy as np
import test_curves
import test_file
import test_precompute
from deltalux import _core
from deltalux.command.cli import main

Contents = dict[str, bytes]


@dataclass(frozen=True)
class Save:
    """Something that is written into a folder.

    `work(folder, variant)`: the same variant makes the same bytes, another replaces them. Where the file `manifest` is
    there, all files are of one variant; without one, each file is of one. `kept`: what was there is never lost.
    """

    work: Callable[[Path, int], None]
    manifest: str | None = None
    kept: bool = True


def _shards(folder: Path, variant: int) -> None:
    tiles = _core.Transport.from_dense(test_file.dense_rows(400, seed=variant), columns="haar:2", tile_rows=16).tiles()
    writer = _core.TransportWriter(folder / "a.transport", str(variant))
    for number in range(0, len(tiles), 4):
        if number // 4 not in writer.finished("direct"):
            writer.write_shard("direct", number // 4, tiles[number : number + 4])
    writer.finish(**test_file.describe(400))


def _precomputed(folder: Path, variant: int) -> None:
    dl.precompute(
        test_precompute.room(), folder / "a.transport", **test_precompute.OPTIONS, tolerance=0.1 + 0.4 * variant
    )


@cache
def _hall() -> dl.Environment:
    return dl.Environment.builtin("hall")


def _curves(folder: Path, variant: int) -> None:
    scene, materials = test_curves.plane_scene(6 + 2 * variant), {"pearl": test_curves.PEARL}
    dl.precompute_curves(
        scene, folder / "a.curves", env=_hall(), materials=materials, quality="preview", progress=False
    )


def _picture(folder: Path, variant: int) -> None:
    dl.write(folder / "a.exr", np.full((64, 64, 3), 0.25 + variant, np.float32))


@cache
def _cornell(folder: Path) -> Path:
    scene = dl.Scene.builtin("cornell")
    path = folder.parent / "cornell.transport"
    dl.precompute(scene.with_camera(scene.camera.resized(16, 16)), path, columns="haar:4", progress=False)
    return path


def _film(folder: Path, variant: int) -> None:
    path = _cornell(folder)
    words = f"relight {path} --env hall --frames {2 + variant} --exposure {variant} -o {folder / 'frames'}"
    if main(words.split()) != 0:
        raise OSError("relight failed")


SAVES = {
    "shards": Save(_shards, "a.transport/manifest.json"),
    "precompute": Save(_precomputed, "a.transport/manifest.json"),
    "curves": Save(_curves, "a.curves/curves.json", kept=False),
    "picture": Save(_picture),
    "relight": Save(_film),
}


def contents(folder: Path) -> Contents:
    """All files below a folder, but for the seconds that something took."""
    files = sorted(path for path in folder.rglob("*") if path.is_file() and path.suffix != ".csv")
    read = {str(path.relative_to(folder)): path.read_bytes() for path in files}
    return {file: re.sub(rb'"seconds": [0-9.e-]+', b"", data) for file, data in read.items()}


@cache
def expected(name: str, folder: Path) -> tuple[Contents, Contents]:
    """What both variants leave, where nothing happens to them."""
    made = []
    for variant in range(2):
        own = folder / f"{name}-expected"
        shutil.rmtree(own, ignore_errors=True)
        own.mkdir(parents=True)
        SAVES[name].work(own, variant)
        made.append(contents(own))
    return made[0], made[1]


def beginning(name: str, folder: Path) -> Path:
    """A folder with variant 0."""
    own = folder / name
    shutil.rmtree(own, ignore_errors=True)
    for file, data in expected(name, folder)[0].items():
        (own / file).parent.mkdir(parents=True, exist_ok=True)
        (own / file).write_bytes(data)
    return own


def half_done(path: str) -> bool:
    """Whether a file is one of a run in progress, which nobody takes for a result; or what such a run was about to
    remove when it had published all."""
    name = Path(path).name
    left = name in ("lock", "job.json") or re.fullmatch(r"tiles-.*\.json", name) is not None
    return ".partial/" in path or ".old/" in path or name.startswith(".") or left


def wrong(name: str, folder: Path, ended: bool) -> str:
    """What is wrong with a folder after variant 1 was saved over variant 0, to its end or not; or nothing."""
    before, after = expected(name, folder.parent)
    found = contents(folder)
    manifest, left = SAVES[name].manifest, {file: data for file, data in found.items() if not half_done(file)}
    if ended:
        after = {file: data for file, data in after.items() if not half_done(file)}
        return "" if left == after else f"{sorted(left)} after all, expected {sorted(after)}"
    if manifest is None or manifest in left:
        known = [made for made in (before, after) if manifest is None or made[manifest] == left[manifest]]
        torn = [file for file, data in left.items() if all(made.get(file) != data for made in known)]
        missing = [file for made in known[:1] for file in made if manifest is not None and file not in left]
        return f"torn: {torn}, missing: {missing}" if torn or missing else ""
    # Between two renames a transport stands beside its place, whole.
    if SAVES[name].kept and not any(".old/" in file for file in found):
        return f"lost: {sorted(found)}"
    return ""
