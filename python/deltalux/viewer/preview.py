"""A scene that is seen at once: a small transport first, and finer ones in its place while one plays.

Finer transports are made by a process of their own with a low priority: threads of this one would keep frames waiting.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable, Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np

from .._core import FileError
from ..camera import Camera
from ..columns.haar import Haar
from ..precomputation.run import precompute
from ..progress import Progress
from ..scene.scene import Scene
from ..surface.surface import Surface
from ..transport.transport import Transport

__all__ = ["Refinement", "resized", "small"]

_SMALL, _SMALL_COLUMNS = 96, 16
"""Pixels along the longer edge of the first picture, and texels along a face: seconds."""
_MIDDLE, _MIDDLE_COLUMNS = 256, 32
_COLUMNS = 64
_ARRAYS, _SETTINGS = "scene.npz", "settings.json"


def small(scene: Scene, progress: bool | Progress) -> Transport:
    """The transport of a scene in a few seconds, kept in memory's stead in a folder that goes with it."""
    seen = scene.with_camera(resized(scene.camera, _SMALL))
    # A file that is open stands until it is closed, wherever its name has gone.
    with tempfile.TemporaryDirectory(prefix="deltalux-view-") as folder:
        path = Path(folder) / "small.transport"
        return precompute(seen, path, columns=Haar(_SMALL_COLUMNS), quality="preview", progress=progress)


def resized(camera: Camera, longer: int) -> Camera:
    """No larger than it is."""
    share = min(1.0, longer / max(camera.width, camera.height))
    return camera.resized(max(1, round(camera.width * share)), max(1, round(camera.height * share)))


class Refinement:
    """Finer transports of a scene, one after the other.

    Parameters
    ----------
    scene
        As it is seen in the end.
    output
        Where the finest one goes and stays; None: nowhere.
    made
        Told of each one, in a thread of its own.
    progress
        Told how far the next one is, from 0 to 1.

    Raises
    ------
    ValueError
        If a material is measured: its tables cannot be given to another process.
    """

    def __init__(
        self,
        scene: Scene,
        output: Path | None,
        made: Callable[[Transport], None],
        progress: Callable[[str, float], None],
    ) -> None:
        arrays = scene.arrays()
        if not arrays:
            raise ValueError("expected a scene without measured materials for a preview: make its transport first")
        self._made, self._progress = made, progress
        self._folder = tempfile.TemporaryDirectory(prefix="deltalux-view-")
        folder = Path(self._folder.name)
        np.savez(folder / _ARRAYS, **arrays)  # type: ignore[arg-type]
        middle, whole = resized(scene.camera, _MIDDLE), scene.camera
        steps = [(middle, _MIDDLE_COLUMNS, folder / "middle.transport")] if middle != whole else []
        steps.append((whole, _COLUMNS, folder / "whole.transport" if output is None else output.absolute()))
        settings = {
            "name": scene.name,
            # Arrays have none; by its name the ground is known.
            "names": scene.names,
            "steps": [{"camera": asdict(camera), "columns": own, "path": str(path)} for camera, own, path in steps],
        }
        (folder / _SETTINGS).write_text(json.dumps(settings), encoding="utf-8")
        self._process = subprocess.Popen(
            [sys.executable, "-m", __name__, str(folder)],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            # Ctrl-C ends the view, which then ends this one.
            start_new_session=True,
        )
        self._thread = threading.Thread(target=self._follow, daemon=True)
        self._thread.start()

    def _follow(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            words: Mapping[str, Any] = json.loads(line)
            if "share" in words:
                self._progress(words["what"], words["share"])
            elif "made" in words:
                try:
                    transport = Transport(words["made"])
                except (FileError, OSError):
                    return  # The view has ended, and its folder with it.
                self._made(transport)
            elif "problem" in words:
                self._progress(f"no finer picture: {words['problem']}", 1.0)

    def end(self) -> None:
        """Stops, and removes what was not asked for."""
        if self._process.poll() is None:
            self._process.terminate()
            try:
                self._process.wait(5.0)
            except subprocess.TimeoutExpired:
                self._process.kill()
                self._process.wait()
        self._thread.join(5.0)
        for pipe in (self._process.stdout, self._process.stderr):
            if pipe is not None:
                pipe.close()
        self._folder.cleanup()


def _refine(folder: Path) -> None:
    """The other process: each step of the settings, told line by line."""
    # Frames come first.
    os.nice(10)
    settings = json.loads((folder / _SETTINGS).read_text(encoding="utf-8"))
    with np.load(folder / _ARRAYS, allow_pickle=False) as arrays:
        surface = Surface.restored({name: arrays[name] for name in arrays.files})
    for number, step in enumerate(settings["steps"]):
        camera = Camera(**step["camera"])
        what = f"refining, {camera.width} x {camera.height}"
        say = _throttled(what, len(settings["steps"]), number)
        scene = replace(Scene.of_surface(surface, camera, settings["name"]), names=tuple(settings["names"]))
        precompute(scene, step["path"], columns=Haar(step["columns"]), progress=say)
        print(json.dumps({"made": step["path"]}), flush=True)


def _throttled(what: str, steps: int, number: int) -> Progress:
    shown = [-1]

    def say(done: int, total: int) -> None:
        percent = 100 * done // max(total, 1)
        if percent != shown[0]:
            shown[0] = percent
            print(json.dumps({"what": f"{what} ({number + 1} of {steps})", "share": percent / 100}), flush=True)

    return say


if __name__ == "__main__":
    try:
        _refine(Path(sys.argv[1]))
    except (ValueError, OSError, MemoryError) as error:
        print(json.dumps({"problem": " ".join(str(error).split())}), flush=True)
