"""Meshes with a colour at each vertex, as files that other programs show: glTF binary and PLY."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._core import display

__all__ = ["save_mesh"]


def save_mesh(
    path: str | os.PathLike[str],
    position: NDArray[np.float32],
    normal: NDArray[np.float32],
    triangles: NDArray[np.uint32],
    colours: NDArray[np.float32],
    layers: Mapping[str, NDArray[np.float32]] | None = None,
    lights: Sequence[tuple[Mapping[str, Any], Mapping[str, Any]]] = (),
) -> None:
    """Writes a mesh of vertices (v, 3), unit normals (v, 3), triangles (t, 3) and linear colours (v, 3).

    A .glb may hold further layers of colours by their names, and lights of KHR_lights_punctual, each with what is said
    of its node.

    Raises
    ------
    ValueError
        If the name ends neither in .glb nor in .ply.
    OSError
        If the disk refuses; what was at `path` is then untouched.
    """
    target = Path(path)
    if target.suffix.lower() == ".glb":
        parts = _glb(position, normal, triangles, {"": colours, **(layers or {})}, lights)
    elif target.suffix.lower() == ".ply":
        parts = _ply(position, normal, triangles, colours)
    else:
        raise ValueError(f"expected a .glb or .ply file for vertex colours, got {target.name!r}")
    beside = target.with_name(f".{target.name}.{os.getpid()}.tmp")
    try:
        with open(beside, "wb") as file:
            for part in parts:
                file.write(part)
        beside.replace(target)
    finally:
        beside.unlink(missing_ok=True)


def _glb(
    position: NDArray[np.float32],
    normal: NDArray[np.float32],
    triangles: NDArray[np.uint32],
    layers: Mapping[str, NDArray[np.float32]],
    lights: Sequence[tuple[Mapping[str, Any], Mapping[str, Any]]],
) -> list[bytes]:
    """glTF 2.0 in one file: header, JSON, binary, each chunk a multiple of four bytes."""
    arrays = [
        ("POSITION", position, 5126, "VEC3", 34962),
        ("NORMAL", normal, 5126, "VEC3", 34962),
        *((f"COLOR_{k}", own.astype(np.float32), 5126, "VEC3", 34962) for k, own in enumerate(layers.values())),
        ("", triangles.reshape(-1), 5125, "SCALAR", 34963),
    ]
    views: list[dict[str, Any]] = []
    accessors: list[dict[str, Any]] = []
    start = 0
    for _, array, kind, shape, target in arrays:
        views.append({"buffer": 0, "byteOffset": start, "byteLength": array.nbytes, "target": target})
        accessors.append({"bufferView": len(accessors), "componentType": kind, "count": len(array), "type": shape})
        start += array.nbytes
    # Readers must know the extent of positions beforehand.
    accessors[0] |= {"min": position.min(axis=0).tolist(), "max": position.max(axis=0).tolist()}
    attributes = {name: number for number, (name, *_) in enumerate(arrays) if name}
    primitive = {"attributes": attributes, "indices": len(arrays) - 1, "material": 0, "mode": 4}
    mesh: dict[str, Any] = {"primitives": [primitive]}
    if len(layers) > 1:
        mesh["extras"] = {"lightGroups": list(layers)[1:]}
    document: dict[str, Any] = {
        "asset": {"version": "2.0", "generator": "deltalux"},
        # The light is in the colours.
        "extensionsUsed": ["KHR_materials_unlit"],
        "materials": [{"extensions": {"KHR_materials_unlit": {}}}],
        "meshes": [mesh],
        "nodes": [{"mesh": 0}],
        "scenes": [{"nodes": [0]}],
        "scene": 0,
        "buffers": [{"byteLength": start}],
        "bufferViews": views,
        "accessors": accessors,
    }
    if lights:
        # Each light in a node of its own, behind that of the mesh.
        document["extensionsUsed"].append("KHR_lights_punctual")
        document["extensions"] = {"KHR_lights_punctual": {"lights": [dict(light) for light, _ in lights]}}
        for number, (_, node) in enumerate(lights):
            document["nodes"].append({**node, "extensions": {"KHR_lights_punctual": {"light": number}}})
        document["scenes"][0]["nodes"] = list(range(len(document["nodes"])))
    text = json.dumps(document, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    binary = [np.ascontiguousarray(array).tobytes() for _, array, *_ in arrays]
    total = 12 + 8 + len(text) + 8 + start

    def words(*numbers: int) -> bytes:
        return np.array(numbers, "<u4").tobytes()

    return [b"glTF", words(2, total), words(len(text)), b"JSON", text, words(start), b"BIN\0", *binary]


def _ply(
    position: NDArray[np.float32],
    normal: NDArray[np.float32],
    triangles: NDArray[np.uint32],
    colours: NDArray[np.float32],
) -> list[bytes]:
    """Binary little-endian PLY with colours as programs that show it expect them: 8 bits, sRGB."""
    places = [(name, "<f4") for name in ("x", "y", "z", "nx", "ny", "nz")]
    shades = [(name, "u1") for name in ("red", "green", "blue")]
    vertices = np.zeros(len(position), np.dtype(places + shades))
    shown = display(np.ascontiguousarray(colours).reshape(-1), 1.0).reshape(-1, 3)
    for names, values in ((places[:3], position), (places[3:], normal), (shades, shown)):
        for k, (name, _) in enumerate(names):
            vertices[name] = values[:, k]
    faces = np.zeros(len(triangles), np.dtype([("count", "u1"), ("corners", "<u4", 3)]))
    faces["count"], faces["corners"] = 3, triangles
    properties = [f"property float {name}" for name, _ in places] + [f"property uchar {name}" for name, _ in shades]
    header = ["ply", "format binary_little_endian 1.0", "comment deltalux", f"element vertex {len(vertices)}"]
    header += [*properties, f"element face {len(faces)}", "property list uchar uint vertex_indices", "end_header", ""]
    return ["\n".join(header).encode(), vertices.tobytes(), faces.tobytes()]
