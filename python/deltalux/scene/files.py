"""Scene files: .glb and .gltf by `gltf`; .obj, .ply and .stl by trimesh, imported here alone and only when needed.

A file becomes a `Content`: pieces in world space, materials, perhaps a camera. trimesh is told not to merge or drop
vertices (`process=False`), so that what is wrong with a file is found by our own checks; its 8-bit copies of colours
are not used. Whatever a broken file makes a parser raise comes out as a `FileError` that names the file.
"""

from __future__ import annotations

import io
import os
import re
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from .._core import FileError
from .content import DEFAULT_ALBEDO, Content, Piece
from .gltf import read as read_gltf
from .texture import linear_texture


def read(path: str | os.PathLike[str]) -> Content:
    """What a scene file holds; see `Scene.load`."""
    path = Path(path)
    data = path.read_bytes()
    kind = path.suffix.lower()
    if kind not in _READERS:
        raise FileError(f"{path}: expected one of {', '.join(_READERS)}, got {path.suffix or 'no suffix'!r}")
    content = Content(path.stem)
    with blaming(path):
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


def _read_obj(content: Content, folder: Path, data: bytes, kind: str) -> None:
    """Wavefront OBJ: what trimesh does not tell is looked up in the text first."""
    declared: set[str] = set()
    for name in _values("mtllib", data):
        library = (folder / name).resolve()
        if library.is_relative_to(folder) and library.is_file():
            text = library.read_bytes()
            declared |= set(_values("newmtl", text))
            for picture in _values("map_Kd", text):
                _check_picture(content, folder, picture)
        else:
            content.leave_out("missing material files", f"{name} is not beside the mesh")
    for name in sorted(set(_values("usemtl", data)) - declared):
        content.leave_out("missing materials", f"{name} is not defined; shown in grey")

    # trimesh counts relative indices from the end of the file, which is right only behind the last vertex.
    relative = re.search(rb"^f\s[^\n]*-", data, re.MULTILINE)
    if relative and re.search(rb"^v[tn]?\s", data[relative.end() :], re.MULTILINE):
        raise ValueError("relative (negative) indices before the last vertex are not supported")
    _read_mesh(content, folder, data, kind)


def _values(keyword: str, text: bytes) -> list[str]:
    """What follows a keyword at the beginning of a line."""
    found = re.findall(rb"^[ \t]*" + keyword.encode() + rb"[ \t]+(.+?)\s*$", text, re.MULTILINE | re.IGNORECASE)
    return [os.fsdecode(value) for value in found]


def _check_picture(content: Content, folder: Path, name: str) -> None:
    """trimesh passes over pictures that it cannot read, and those outside the scene's folder; say so."""
    from PIL import Image

    path = (folder / name).resolve()
    # What is outside is not even opened: a device or a pipe may never answer.
    if path.is_relative_to(folder) and path.is_file():
        try:
            with Image.open(path):
                return
        except OSError:
            pass
    content.leave_out("textures ignored", f"{name} cannot be read")


def _read_mesh(content: Content, folder: Path, data: bytes, kind: str) -> None:
    """Any format through trimesh: per-geometry meshes, placed by the scene graph's transforms."""
    import trimesh
    from trimesh.resolvers import FilePathResolver

    resolver = FilePathResolver(str(folder))
    with warnings.catch_warnings():
        # numpy only warns, for now, where text that should be numbers is not: without this it would be cut off there.
        warnings.filterwarnings("error", message="string or file could not be read")
        loaded = trimesh.load_scene(io.BytesIO(data), file_type=kind, resolver=resolver, process=False)

    materials: dict[int, int] = {}
    for node in loaded.graph.nodes_geometry:
        transform, name = loaded.graph[node]
        mesh = loaded.geometry[name]
        if not isinstance(mesh, trimesh.Trimesh):
            content.leave_out("geometries without triangles", "points and lines are not shown")
            continue
        if len(mesh.faces) == 0:
            continue
        # The material's identity, not its name, is the key: names need not be unique.
        visual: Any = mesh.visual
        material = getattr(visual, "material", None)
        if id(material) not in materials:
            materials[id(material)] = _material(content, material)
        if visual.kind in ("vertex", "face"):
            content.leave_out("meshes with vertex colours", "shown in grey")
        uv = getattr(visual, "uv", None)
        content.add_piece(
            Piece(
                vertices=np.asarray(mesh.vertices) @ transform[:3, :3].T + transform[:3, 3],
                triangles=np.asarray(mesh.faces),
                uv=None if uv is None or len(uv) != len(mesh.vertices) else np.asarray(uv, dtype=np.float64)[:, :2],
                material=materials[id(material)],
            )
        )


def _material(content: Content, material: Any) -> int:
    """An OBJ material: Kd in floats, times its texture."""
    stated = getattr(material, "kwargs", None) or {}
    image = getattr(material, "image", None)
    texture = None
    # Where a file has none, trimesh puts a picture of its own, which no file path marks.
    if image is not None and "file_path" in image.info:
        try:
            texture = linear_texture(image)
        except (OSError, ValueError) as error:
            content.leave_out("textures ignored", str(error))
    albedo = stated.get("kd", DEFAULT_ALBEDO if texture is None else (1.0, 1.0, 1.0))
    emission, name = np.broadcast_to(stated.get("ke", 0.0), 3), str(getattr(material, "name", None) or "")
    return content.add_material(np.broadcast_to(albedo, 3), texture, emission, name)


_READERS: dict[str, Callable[[Content, Path, bytes, str], None]] = {
    ".glb": read_gltf,
    ".gltf": read_gltf,
    ".obj": _read_obj,
    ".ply": _read_mesh,
    ".stl": _read_mesh,
}
"""By suffix: each fills the content from the bytes of a file, and looks for others in its folder only."""
