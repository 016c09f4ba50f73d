"""Small valid files to begin with: transports as `precompute` leaves them, and glTF with a little of everything."""

from __future__ import annotations

import io
import json
import struct
from pathlib import Path

import deltalux as dl
import numpy as np
from deltalux import _core

Files = dict[str, bytes]

QUAD = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], np.float32)


def transports(folder: Path) -> list[Files]:
    """Directories: untruncated wavelets, truncated harmonics, two tiles of a few columns, factors, lobes under texels,
    a stack of pictures; and one for every link."""
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
    glossy = floor.with_material(0, dl.Material(0.2, 0.5, dl.brdf.Phong(20)))
    options = {"columns": "haar:1", "quality": "preview", "receivers": "vertices", "bounces": 1, "factors": 2}
    dl.precompute(glossy, folder / "glossy.transport", progress=False, **options)
    options = {"columns": "haar:2+texels", "quality": "preview", "progress": False}
    dl.precompute(glossy.with_camera(glossy.camera.resized(8, 8)), folder / "lobes.transport", **options)
    pictures = np.random.default_rng(2).random((3, 4, 5, 3))
    stack = folder / "stack.transport"
    dl.Transport.from_images(pictures, dl.Lamps(np.eye(3), "abc"), stack, progress=False)
    whole = [contents(folder / f"{name}.transport") for name in ("tiles", "glossy", "lobes", "stack")]
    return [*made, *whole, *linked(folder)]


def linked(folder: Path) -> list[Files]:
    """Three colours and nodes by weights; gather samples, a tree and vertices; clusters of two factors."""
    rng = np.random.default_rng(1)

    def stored(rows: int, columns: str, count: int, *channels: int) -> _core.Transport:
        return _core.Transport.from_dense(rng.normal(size=(rows, count, *channels)), columns=columns, tile_rows=16)

    surface = {name: rng.random((20, 3)).astype(np.float32) for name in ("albedo", "position", "normal")}
    number = np.arange(20, dtype=np.uint32)
    receivers = [
        _core.ReceiverTable.gather(area=np.ones(20, np.float32), **surface),
        _core.ReceiverTable.vertices(vertex=number, buried=np.zeros(20, np.uint8), **surface),
        _core.ReceiverTable.vertices(
            vertex=number, buried=np.ones(20, np.uint8), material=np.zeros(20, np.uint16), **surface
        ),
    ]
    starts, weights = np.arange(21, dtype=np.uint32), np.full(20, 9, np.uint16)
    chains: list[tuple[list[_core.Transport], _core.Link, list[_core.Transport]]] = [
        ([stored(20, "haar:1", 6, 3), stored(5, "haar:1", 6)],
         _core.Link.weights(starts, number % 5, weights, exponent=-4, node_count=5), []),
        ([stored(6, "haar:1", 6)], _core.Link.tree(np.arange(6.0)), [stored(20, "tree:6", 8)]),
        ([stored(6, "haar:1", 6) for _ in range(2)],
         _core.Link.representatives([(rng.random((20, 1, 1)), rng.random((20, 1, 1))) for _ in range(2)]),
         [stored(20, "representatives:2x2", 6) for _ in range(2)]),
    ]  # fmt: skip
    made = []
    for table, (first, link, then) in zip(receivers, chains, strict=True):
        path = folder / f"{table.kind}-{len(made)}.transport"
        writer, parts = _core.TransportWriter(path, "{}"), []
        for k, part in enumerate([*first, *then]):
            writer.write_shard(f"part_{k}", 0, part.tiles())
            parts.append((f"part_{k}", part.columns, part.shape[0], part.channels, -24, part.width, part.tile_rows))
        writer.finish(parts=parts, receivers=table, plan="{}", scene="0", first=len(first), link=link)
        made.append(contents(path))
    return made


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


def pictures(folder: Path) -> list[Files]:
    """A light in each format that is read as one."""
    light = np.random.default_rng(0).random((8, 16, 3)).astype(np.float32)
    for name in ("light.exr", "light.hdr"):
        dl.write(folder / name, light)
    return [{name: (folder / name).read_bytes()} for name in ("light.exr", "light.hdr")]


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
