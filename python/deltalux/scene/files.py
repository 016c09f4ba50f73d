"""Scene files: .glb and .gltf by `gltf`, .obj by `obj`, .ply by `ply`; .stl by trimesh, imported here alone and only
when needed.

A file becomes a `Content`: pieces in world space, materials, perhaps cameras. trimesh is told not to merge or drop
vertices (`process=False`), so that what is wrong with a file is found by our own checks. Whatever a broken file makes a
parser raise comes out as a `FileError` that names the file.
"""

from __future__ import annotations

import io
import os
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from .._core import FileError
from .content import DEFAULT_ALBEDO, Content, Piece
from .gltf import read as read_gltf
from .obj import read as read_obj
from .ply import read as read_ply


def read(path: str | os.PathLike[str], scene: int | str | None = None) -> Content:
    """What a scene file holds, or one of its scenes; see `Scene.load`."""
    path = Path(path)
    kind = path.suffix.lower()
    if kind not in _READERS and not path.is_dir():
        raise FileError(f"{path}: expected one of {', '.join(_READERS)}, got {path.suffix or 'no suffix'!r}")
    content = Content(path.stem)
    data = content.read(path)
    if scene is not None and _READERS[kind] is not read_gltf:
        raise FileError(f"{path}: expected a .glb or a .gltf to choose a scene of, others hold one alone")
    with blaming(path):
        content.wanted = scene
        _READERS[kind](content, path.parent.resolve(), data, kind[1:])
        if not content.pieces:
            raise ValueError("the file has no triangles")
    return content


@contextmanager
def blaming(path: str | os.PathLike[str]) -> Iterator[None]:
    """What goes wrong inside is the fault of this file: it becomes a `FileError` that names it."""
    try:
        yield
    except (OSError, FileError):
        raise
    except Exception as error:
        # Parsers answer broken files with any exception (IndexError, KeyError, struct.error, RecursionError...).
        reason = str(error) if isinstance(error, ValueError) else f"broken file ({type(error).__name__}: {error})"
        raise FileError(f"{os.fspath(path)}: {reason}") from error


def _read_stl(content: Content, folder: Path, data: bytes, kind: str) -> None:
    """STL through trimesh."""
    import trimesh

    with warnings.catch_warnings():
        # numpy only warns, for now, where text that should be numbers is not: without this it would be cut off there.
        warnings.filterwarnings("error", message="string or file could not be read")
        loaded = trimesh.load_scene(io.BytesIO(data), file_type=kind, process=False)

    for node in loaded.graph.nodes_geometry:
        transform, name = loaded.graph[node]
        mesh = loaded.geometry[name]
        if not isinstance(mesh, trimesh.Trimesh):
            content.leave_out("geometries without triangles", "points and lines are not shown")
        elif len(mesh.faces):
            grey = content.add_material(DEFAULT_ALBEDO)
            piece = Piece(np.asarray(mesh.vertices, np.float64), np.asarray(mesh.faces), None, grey)
            content.add_piece(piece.placed(np.asarray(transform)))


_READERS: dict[str, Callable[[Content, Path, bytes, str], None]] = {
    ".glb": read_gltf,
    ".gltf": read_gltf,
    ".obj": read_obj,
    ".ply": read_ply,
    ".stl": _read_stl,
}
"""By suffix: each fills the content from the bytes of a file, and looks for others where `nearby` lets it."""
