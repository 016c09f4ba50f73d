"""The targets of `guided.py` that are Python: glTF and pictures, any bytes of which may be taken or refused."""

from __future__ import annotations

import sys
import tempfile
import warnings
from pathlib import Path

import atheris

sys.path.insert(0, str(Path(__file__).parents[1]))
with atheris.instrument_imports(include=["deltalux"]):
    import deltalux as dl
import fuzz  # noqa: E402
import samples  # noqa: E402

FOLDER = Path(tempfile.mkdtemp())


def gltf(data: bytes) -> None:
    """JSON, a zero, and the binary: the frame of a .glb, which hides them from the fuzzer, is made here."""
    text, _, binary = data.partition(b"\0")
    (FOLDER / "scene.glb").write_bytes(samples.glb(text, binary))
    _expect_whole_or_refused(fuzz.load_scene)


def picture(data: bytes) -> None:
    """A byte for the kind of file, then the file."""
    for path in FOLDER.iterdir():
        path.unlink()
    (FOLDER / ("light.hdr" if data[:1] and data[0] % 2 else "light.exr")).write_bytes(data[1:])
    _expect_whole_or_refused(fuzz.load_picture)


def _expect_whole_or_refused(use: fuzz.Use) -> None:
    what, _ = fuzz.fault(use, FOLDER)
    if what:
        raise AssertionError(what)


if __name__ == "__main__":
    warnings.simplefilter("ignore")
    dl.set_threads(1)
    target = {"gltf": gltf, "picture": picture}[sys.argv.pop(1)]
    atheris.Setup(sys.argv, target)
    atheris.Fuzz()
