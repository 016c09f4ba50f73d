"""Small valid files to begin with: transports as `precompute` leaves them, and glTF with a little of everything."""

from __future__ import annotations

import io
import json
import struct
from pathlib import Path

import deltalux as dl
import numpy as np

Files = dict[str, bytes]

QUAD = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], np.float32)


def transports(folder: Path) -> list[Files]:
    """Three directories: untruncated wavelets, truncated harmonics, and two tiles of a few columns."""
    scene = dl.Scene.builtin("cornell")
    made = []
    for k, (size, columns, quality) in enumerate(((6, "haar:2", "lossless"), (8, "sh:3", "publication"))):
        seen = scene.with_camera(scene.camera.resized(size, size))
        path = folder / f"{k}.transport"
        dl.precompute(seen, path, columns=columns, quality=quality, progress=False)
        made.append(contents(path))
    floor = dl.Scene.from_arrays(QUAD - 0.5, [[0, 1, 2], [0, 2, 3]], camera=dl.Camera((0, 0, 0.4), (0, 0, 0)))
    floor = floor.with_camera(floor.camera.resized(96, 96))
    dl.precompute(floor, folder / "tiles.transport", columns="haar:1", quality="preview", progress=False)
    return [*made, contents(folder / "tiles.transport")]


def contents(folder: Path) -> Files:
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir())}


def scenes() -> list[Files]:
    """The same glTF twice, as one file and as three."""
    tree, binary, picture = _gltf()
    whole = json.loads(json.dumps(tree))
    whole["bufferViews"].append({"buffer": 0, "byteOffset": len(binary), "byteLength": len(picture)})
    whole["images"] = [{"bufferView": len(whole["bufferViews"]) - 1, "mimeType": "image/png"}]
    whole["buffers"] = [{"byteLength": len(binary) + len(picture)}]
    apart = json.loads(json.dumps(tree))
    apart["images"] = [{"uri": "scene.png"}]
    apart["buffers"] = [{"byteLength": len(binary), "uri": "scene.bin"}]
    return [
        {"scene.glb": glb(json.dumps(whole).encode(), binary + picture)},
        {"scene.gltf": json.dumps(apart).encode(), "scene.bin": binary, "scene.png": picture},
    ]


def glb(text: bytes, binary: bytes) -> bytes:
    """A header of twelve bytes, then chunks of length, type and content, padded to four bytes."""
    text, binary = text + b" " * (-len(text) % 4), binary + b"\0" * (-len(binary) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(binary), b"BIN\0") + binary
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def _gltf() -> tuple[dict, bytes, bytes]:
    """A textured square, a strip without indices, and points that a sparse accessor puts in their places."""
    from PIL import Image

    encoded = io.BytesIO()
    Image.fromarray(np.arange(48, dtype=np.uint8).reshape(4, 4, 3)).save(encoded, "png")
    arrays = [
        QUAD, np.array([0, 1, 2, 0, 2, 3], np.uint16), (QUAD[:, :2] * 65535).astype(np.uint16),
        np.array([1, 2], np.uint16), np.array([[1, 0, 0], [0, 1, 0]], np.float32),
    ]  # fmt: skip
    views, binary = [], b""
    for array in arrays:
        views.append({"buffer": 0, "byteOffset": len(binary), "byteLength": array.nbytes})
        binary += array.tobytes() + b"\0" * (-array.nbytes % 4)
    tree = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0, 3]}],
        "nodes": [
            {"children": [1, 2], "rotation": [0, 0, 0, 1], "scale": [1, 2, 1], "translation": [0, 0, 1]},
            {"mesh": 0, "matrix": [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0.5, 0, 0, 1]},
            {"mesh": 1},
            {"camera": 0, "translation": [0.5, 0.5, 5]},
        ],
        "cameras": [{"type": "perspective", "perspective": {"yfov": 0.7, "aspectRatio": 1.5, "znear": 0.1}}],
        "meshes": [
            {"primitives": [{"attributes": {"POSITION": 0, "TEXCOORD_0": 2}, "indices": 1, "material": 0}]},
            {"primitives": [{"attributes": {"POSITION": 0}, "mode": 5}, {"attributes": {"POSITION": 3}}]},
        ],
        "materials": [
            {"pbrMetallicRoughness": {"baseColorFactor": [1, 0.5, 0.2, 1], "baseColorTexture": {"index": 0}}}
        ],
        "textures": [{"source": 0}],
        "bufferViews": views,
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3"},
            {"bufferView": 1, "componentType": 5123, "count": 6, "type": "SCALAR"},
            {"bufferView": 2, "componentType": 5123, "count": 4, "type": "VEC2", "normalized": True},
            {
                "componentType": 5126, "count": 3, "type": "VEC3",
                "sparse": {
                    "count": 2,
                    "indices": {"bufferView": 3, "componentType": 5123},
                    "values": {"bufferView": 4},
                },
            },
        ],
    }  # fmt: skip
    return tree, binary, encoded.getvalue()
