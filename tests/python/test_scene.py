"""Camera, Scene.from_arrays and scene files: what is refused, what is put right and counted, what comes out."""

import base64
import json
import struct
from pathlib import Path

import numpy as np
import pytest
from deltalux._core import FileError
from deltalux.camera import Camera
from deltalux.scene.checked import first_equal_row
from deltalux.scene.scene import Scene
from hypothesis import given, settings
from hypothesis import strategies as st

DATA = Path(__file__).parents[2] / "../shared/data/mesh"

SQUARE = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], float)
HALVES = np.array([[0, 1, 2], [0, 2, 3]])


# --- Camera


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"position": (0, 0, float("nan"))}, "position must be finite"),
        ({"target": (0, 0)}, "target must be three numbers"),
        ({"up": ("a", "b", "c")}, "up must be real numbers"),
        ({"target": (0, 0, 5)}, "position and target must differ"),
        ({"up": (0, 0, 0)}, "up must not be the zero vector"),
        ({"up": (0, 0, -2)}, "parallel to the view"),
        ({"vertical_fov": 0.0}, "vertical_fov must be in"),
        ({"vertical_fov": 180.0}, "vertical_fov must be in"),
        ({"vertical_fov": float("nan")}, "vertical_fov must be in"),
        ({"width": 0}, "width must be 1 to 16384 pixels, got 0"),
        ({"height": 16385}, "height must be 1 to 16384 pixels, got 16385"),
        ({"width": 12.5}, "whole number"),
    ],
)
def test_camera_refuses(change, message):
    with pytest.raises(ValueError, match=message):
        Camera(**{"position": (0, 0, 5), "target": (0, 0, 0), **change})


def test_directions_by_hand():
    # Looking along -z with a right angle of view, the middle of the top left of 2 x 2 pixels is at (-1/2, 1/2, -1).
    camera = Camera((0, 0, 0), (0, 0, -3), vertical_fov=90.0, width=2, height=2)
    right, up, forward = camera.basis()
    np.testing.assert_allclose([right, up, forward], [[1, 0, 0], [0, 1, 0], [0, 0, -1]], atol=1e-15)
    expected = np.array([-0.5, 0.5, -1.0]) / np.sqrt(1.5)
    np.testing.assert_allclose(camera.directions()[0, 0], expected, atol=1e-15)
    # Wider pictures show more to the sides, at the same height of a pixel.
    wide = camera.resized(4, 2).directions()
    assert wide.shape == (2, 4, 3)
    np.testing.assert_allclose(wide[:, 1:3], camera.directions(), atol=1e-15)


@given(
    st.lists(st.tuples(*[st.floats(-1e6, 1e6)] * 3), min_size=2, max_size=12),
    st.floats(10, 120),
    st.integers(1, 900),
    st.integers(1, 900),
)
@settings(deadline=None, max_examples=60)
def test_framing_shows_every_point(points, fov, width, height):
    points = np.array(points)
    if np.ptp(points, axis=0).max() < 1e-3:
        return
    camera = Camera.framing(points, vertical_fov=fov, width=width, height=height)
    right, up, forward = camera.basis()
    seen = points - camera.position
    depth = seen @ forward
    tangent = np.tan(np.radians(fov) / 2)
    assert (depth > 0).all()
    assert (np.abs(seen @ up) <= depth * tangent).all()
    assert (np.abs(seen @ right) <= depth * tangent * width / height).all()


# --- Arrays


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((SQUARE, np.empty((0, 3), int)), "no triangles"),
        ((SQUARE, [[0, 0, 0], [1, 1, 2]]), "all 2 have no area"),
        ((SQUARE, [[0, 1, 4], [0, 1, 2]]), r"corners must be in \[0, 4\), but 1 of 2 .* triangle 0 = \(0, 1, 4\)"),
        ((SQUARE, [[0, 1, 2], [-1, 1, 2]]), "triangle 1"),
        ((SQUARE, [[0.0, 1.0, 2.0]]), "triangles must be integers, got dtype float64"),
        ((SQUARE, [[0, 1, 2, 3]]), r"triangles must have shape \(t, 3\), got \(1, 4\)"),
        ((SQUARE[:, :2], HALVES), r"vertices must have shape \(v, 3\), got \(4, 2\)"),
        ((SQUARE * [1, np.nan, 1], HALVES), "4 of 4 are not; the first is vertex 0"),
        ((SQUARE * 1e31, HALVES), "coordinates must be within"),
        ((SQUARE.astype(complex), HALVES), "real numbers, got dtype complex128"),
        ((SQUARE, HALVES, (0.5, 0.5)), "albedo must have shape"),
        ((SQUARE, HALVES, (0.5, 1.5, 0.5)), r"albedo must be in \[0, 1\], but 1 values are not; the first is 1.5"),
        ((SQUARE, HALVES, (0.5, np.nan, 0.5)), "the first is nan"),
    ],
)
def test_arrays_refused(arguments, message):
    with pytest.raises(ValueError, match=message):
        Scene.from_arrays(*arguments)


def test_untidy_triangles_are_dropped_and_counted():
    # Corners by position: vertex 4 is vertex 0 again. The third and fourth repeat the first, one wound the other way.
    vertices = np.vstack([SQUARE, SQUARE[:1], [[0.5, 0.5, 0.0]]])
    triangles = [[0, 1, 2], [0, 1, 4], [4, 1, 2], [2, 1, 0], [0, 5, 2], [0, 2, 3]]
    scene = Scene.from_arrays(vertices, triangles)
    assert scene.triangles.tolist() == [[0, 1, 2], [0, 2, 3]]
    assert scene.counts == {"degenerate triangles": 2, "duplicate triangles": 2}


@pytest.mark.parametrize(("scale", "offset"), [(1.0, 1e6), (1e-5, 0.0), (1e6, -1e6), (1e-200, 0.0)])
def test_scales_keep_their_triangles(scale, offset):
    scene = Scene.from_arrays(SQUARE * scale + offset, HALVES, camera=Camera((0, 0, 5), (0, 0, 0)))
    assert len(scene.triangles) == 2 and sum(scene.counts.values()) == 0


def test_equal_albedos_are_one_material_and_arrays_are_frozen():
    triangles = np.array([[0, 1, 2], [0, 2, 3], [0, 1, 3]])
    given = SQUARE.copy()
    scene = Scene.from_arrays(given, triangles, [[0.1, 0.2, 0.3], [0.9, 0.9, 0.9], [0.1, 0.2, 0.3]])
    assert scene.albedo.shape == (2, 3) and scene.albedo.dtype == np.float32
    colours = scene.albedo[scene.material]
    np.testing.assert_allclose(colours, [[0.1, 0.2, 0.3], [0.9, 0.9, 0.9], [0.1, 0.2, 0.3]], rtol=1e-6)
    assert (scene.vertices.dtype, scene.triangles.dtype, scene.material.dtype) == (np.float64, np.uint32, np.uint32)
    given[0] = 7.0
    assert scene.vertices[0].tolist() == [0, 0, 0]
    with pytest.raises(ValueError, match="read-only"):
        scene.vertices[0] = 1.0


def test_content_hash_sees_every_part():
    camera = Camera((0, 0, 5), (0, 0, 0))
    base = Scene.from_arrays(SQUARE, HALVES, camera=camera)
    others = [
        Scene.from_arrays(SQUARE * (1 + 1e-15), HALVES, camera=camera),
        Scene.from_arrays(SQUARE, HALVES[::-1], camera=camera),
        Scene.from_arrays(SQUARE, HALVES, (0.5, 0.5, 0.50001), camera=camera),
        base.with_camera(camera.resized(511, 512)),
    ]
    hashes = {scene.content_hash() for scene in [base, *others]}
    assert len(hashes) == 5
    assert base.content_hash() == Scene.from_arrays(SQUARE, HALVES, camera=camera, name="other").content_hash()


@given(st.lists(st.tuples(*[st.sampled_from([0.0, -0.0, 1.0, 1e-300, 2.0])] * 3), min_size=1, max_size=40))
@settings(deadline=None, max_examples=60)
def test_first_equal_row_against_a_dictionary(rows):
    first = {}
    expected = [first.setdefault(tuple(value + 0.0 for value in row), index) for index, row in enumerate(rows)]
    assert first_equal_row(np.array(rows)).tolist() == expected


# --- Files


def glb(tree, binary=b""):
    """The bytes of a .glb file."""
    text = json.dumps({"asset": {"version": "2.0"}, **tree}).encode()
    text += b" " * (-len(text) % 4)
    binary += b"\0" * (-len(binary) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(binary), b"BIN\0") + binary
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def square_tree(**more):
    """A unit square, 4 positions, 4 texture coordinates and 6 indices, as (tree, binary)."""
    binary = SQUARE.astype("<f4").tobytes() + HALVES.astype("<u2").tobytes() + SQUARE[:, :2].astype("<f4").tobytes()
    tree = {
        "buffers": [{"byteLength": len(binary)}],
        "bufferViews": [
            {"buffer": 0, "byteOffset": 0, "byteLength": 48},
            {"buffer": 0, "byteOffset": 48, "byteLength": 12},
            {"buffer": 0, "byteOffset": 60, "byteLength": 32},
        ],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3"},
            {"bufferView": 1, "componentType": 5123, "count": 6, "type": "SCALAR"},
            {"bufferView": 2, "componentType": 5126, "count": 4, "type": "VEC2"},
        ],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "TEXCOORD_0": 2}, "indices": 1, "material": 0}]}],
        "materials": [{"pbrMetallicRoughness": {"baseColorFactor": [0.003, 0.25, 0.5, 1.0]}}],
        "nodes": [{"mesh": 0}],
        "scenes": [{"nodes": [0]}],
        **more,
    }
    return tree, binary


def load_glb(folder, *, edit=None, **more):
    tree, binary = square_tree(**more)
    if edit:
        edit(tree)
    path = folder / "square.glb"
    path.write_bytes(glb(tree, binary))
    return Scene.load(path)


def test_gltf_instances_transforms_and_float_colours(tmp_path):
    quarter_turn_about_z = [0.0, 0.0, np.sqrt(0.5), np.sqrt(0.5)]
    nodes = [
        {"children": [1, 2], "translation": [10, 0, 0]},
        {"mesh": 0, "rotation": quarter_turn_about_z, "scale": [2, 1, 1]},
        {"mesh": 0, "matrix": [-1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 5, 1]},
    ]
    scene = load_glb(tmp_path, nodes=nodes)
    expected = [[10, 0, 0], [10, 2, 0], [9, 2, 0], [9, 0, 0], [10, 0, 5], [9, 0, 5], [9, 1, 5], [10, 1, 5]]
    np.testing.assert_allclose(scene.vertices, expected, atol=1e-12)
    assert len(scene.triangles) == 4
    # An 8-bit detour would make 0.0039 of 0.003.
    np.testing.assert_allclose(scene.albedo, [[0.003, 0.25, 0.5]], rtol=1e-6)


def test_gltf_camera_follows_its_parent(tmp_path):
    lens = {"type": "perspective", "perspective": {"yfov": np.pi / 3, "aspectRatio": 2.0, "znear": 0.1}}
    # The parent is turned 90 degrees about +y, so that the camera at its origin looks along -x.
    nodes = [
        {"mesh": 0},
        {"children": [2], "rotation": [0, np.sqrt(0.5), 0, np.sqrt(0.5)]},
        {"camera": 0, "translation": [0, 0, 7]},
    ]
    scene = load_glb(tmp_path, nodes=nodes, scenes=[{"nodes": [0, 1]}], cameras=[lens])
    camera = scene.camera
    np.testing.assert_allclose(camera.position, [7, 0, 0], atol=1e-12)
    np.testing.assert_allclose(camera.basis()[2], [-1, 0, 0], atol=1e-12)
    assert (camera.width, camera.height, round(camera.vertical_fov, 9)) == (512, 256, 60.0)
    ours = Camera((0, 0, 9), (0, 0, 0))
    assert Scene.load(tmp_path / "square.glb", camera=ours).camera == ours


def test_gltf_texture_is_linear_and_upright(tmp_path):
    # Two texels: the upper one sRGB 188 (linear 0.503), the lower one black.
    from PIL import Image

    Image.fromarray(np.array([[[188] * 3], [[0] * 3]], np.uint8)).save(tmp_path / "two.png")
    scene = load_glb(
        tmp_path,
        images=[{"uri": "two.png"}],
        textures=[{"source": 0}],
        materials=[{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}, "baseColorFactor": [1, 0.5, 0, 1]}}],
    )
    # A texture measures v downwards, and positions equal texture coordinates: the square's foot shows the upper texel.
    foot, head = 0.25, 0.75
    level = ((188 / 255 + 0.055) / 1.055) ** 2.4
    # On triangle (0, 1, 2) the point with weights (b1, b2) is (b1 + b2, b2).
    albedo = scene.albedo_at([0, 0], [[0.9 - foot, foot], [0.9 - head, head]])
    np.testing.assert_allclose(albedo, [[level, level / 2, 0], [0, 0, 0]], rtol=1e-6)
    middle = scene.albedo_at([0], [[0.2, 0.5]])
    np.testing.assert_allclose(middle, [[level / 2, level / 4, 0]], rtol=1e-6)


def test_gltf_sparse_normalised_and_strided(tmp_path):
    # Positions are bytes with a stride of 4, normalised; the third corner is corrected to (1, 1, 1).
    rows = b"".join(struct.pack("<bbbx", *row) for row in [(0, 0, 0), (127, 0, 0), (0, 0, 0)])
    binary = rows + struct.pack("<Hxxbbbx", 2, 127, 127, 127)
    where = {"bufferView": 1, "componentType": 5123}
    tree = {
        "buffers": [{"uri": "data:application/octet-stream;base64," + base64.b64encode(binary).decode()}],
        "bufferViews": [
            {"buffer": 0, "byteLength": 12, "byteStride": 4},
            {"buffer": 0, "byteOffset": 12, "byteLength": 4},
            {"buffer": 0, "byteOffset": 16, "byteLength": 4},
        ],
        "accessors": [
            {"bufferView": 0, "componentType": 5120, "count": 3, "type": "VEC3", "normalized": True,
             "sparse": {"count": 1, "indices": where, "values": {"bufferView": 2}}},
        ],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "mode": 5}]}],
        "nodes": [{"mesh": 0}],
    }  # fmt: skip
    path = tmp_path / "sparse.gltf"
    path.write_text(json.dumps({"asset": {"version": "2.0"}, **tree}))
    scene = Scene.load(path)
    assert scene.vertices.tolist() == [[0, 0, 0], [1, 0, 0], [1, 1, 1]]
    assert scene.counts["meshes without material"] == 1


@pytest.mark.parametrize(
    ("edit", "message"),
    [
        (lambda tree: tree["buffers"].__setitem__(0, {"uri": "../secret.bin"}), "outside the scene's folder"),
        (lambda tree: tree["buffers"].__setitem__(0, {"uri": "/etc/passwd"}), "outside the scene's folder"),
        (lambda tree: tree["buffers"].__setitem__(0, {"uri": "%2e%2e/secret.bin"}), "outside the scene's folder"),
        (lambda tree: tree["buffers"].__setitem__(0, {"uri": "http://a.b/c"}), "outside the scene's folder"),
        (lambda tree: tree.update(images=[{"uri": "../a.png"}], textures=[{"source": 0}], materials=[
            {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}]), "outside the scene's folder"),
        (lambda tree: tree["accessors"][0].update(count=5), "passes the end of buffer view 0"),
        (lambda tree: tree["accessors"][0].update(count=10**12), "elements, more than"),
        (lambda tree: tree["accessors"][0].update(count=-1), "whole number"),
        (lambda tree: tree["accessors"][0].update(type="VEC2"), "must be VEC3"),
        (lambda tree: tree["bufferViews"][0].update(byteLength=10**9), "passes the end of its buffer"),
        (lambda tree: tree["accessors"][1].update(componentType=5121, count=12), r"corners must be in \[0, 4\)|area"),
        (lambda tree: tree["nodes"][0].update(children=[0]), "two parents or is its own ancestor"),
        (lambda tree: tree["nodes"][0].update(mesh=3), "there is no mesh 3"),
        (lambda tree: tree["nodes"][0].update(translation=[0, float("nan"), 0]), "vertices must be finite"),
        (lambda tree: tree.update(extensionsRequired=["KHR_draco_mesh_compression"]), "KHR_draco_mesh_compression"),
        (lambda tree: tree["asset"].update(version="1.0") if "asset" in tree else tree.update(
            asset={"version": "1.0"}), "expected version 2"),
        (lambda tree: tree["meshes"][0]["primitives"][0].update(mode=1), "no triangles"),
        (lambda tree: tree.pop("bufferViews"), "there is no buffer view 0"),
        (lambda tree: tree["accessors"][0].pop("count"), "broken file"),
    ],
)  # fmt: skip
def test_gltf_refused(tmp_path, edit, message):
    folder = tmp_path / "scene"
    folder.mkdir()
    (tmp_path / "secret.bin").write_bytes(bytes(100))
    with pytest.raises(FileError, match=message) as failure:
        load_glb(folder, edit=edit)
    assert "square.glb" in str(failure.value)


def test_every_truncation_of_a_glb_is_refused(tmp_path):
    data = glb(*square_tree())
    path = tmp_path / "cut.glb"
    for length in range(0, len(data) - 1, 7):
        path.write_bytes(data[:length])
        with pytest.raises(FileError):
            Scene.load(path)


OBJ = "mtllib {library}\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nusemtl red\nf 1 2 3\nusemtl blue\nf 1 3 4\n"


def test_obj_materials_are_floats(tmp_path):
    (tmp_path / "m.mtl").write_text("newmtl red\nKd 0.003 0.1 0.2\nnewmtl blue\nKd 0.1 0.1 0.8\n")
    (tmp_path / "a.obj").write_text(OBJ.format(library="m.mtl"))
    scene = Scene.load(tmp_path / "a.obj")
    rows = sorted(scene.albedo[scene.material].tolist())
    np.testing.assert_allclose(rows, [[0.003, 0.1, 0.2], [0.1, 0.1, 0.8]], rtol=1e-6)
    assert scene.warnings == () and scene.name == "a"


def test_obj_without_its_materials_is_grey_and_says_so(tmp_path):
    (tmp_path / "a.obj").write_text(OBJ.format(library="gone.mtl"))
    scene = Scene.load(tmp_path / "a.obj")
    assert (scene.albedo == 0.5).all()
    assert scene.counts["missing material files"] == 1 and scene.counts["missing materials"] == 2
    assert any("gone.mtl" in sentence for sentence in scene.warnings)


def test_obj_textures(tmp_path):
    from PIL import Image

    Image.fromarray(np.full((2, 2, 3), 255, np.uint8)).save(tmp_path / "white.png")
    (tmp_path / "m.mtl").write_text(
        "newmtl red\nKd 0.5 0.25 0.125\nmap_Kd white.png\nnewmtl blue\nKd 0.1 0.1 0.8\nmap_Kd gone.png\n"
    )
    text = OBJ.format(library="m.mtl").replace("usemtl red", "vt 0 0\nvt 1 0\nvt 1 1\nusemtl red")
    (tmp_path / "a.obj").write_text(text.replace("f 1 2 3", "f 1/1 2/2 3/3"))
    scene = Scene.load(tmp_path / "a.obj")
    rows = sorted(scene.albedo_at([0, 1], [[0.3, 0.3]] * 2).tolist())
    np.testing.assert_allclose(rows, [[0.1, 0.1, 0.8], [0.5, 0.25, 0.125]], rtol=1e-6)
    assert scene.counts["textures ignored"] == 1 and "gone.png" in scene.warnings[0]


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("a.obj", "", "no triangles"),
        ("a.obj", "v 0 0 0\nv 1 0 0\n", "no triangles"),
        ("a.obj", "v 0 0 0\nv 1 0 0\nv 0 nan 0\nf 1 2 3\n", "vertices must be finite"),
        ("a.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n", "a.obj"),
        ("a.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf -4 -2 -1\nv 4 4 4\n", "relative number leads before"),
        ("a.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 x\n", "a.obj"),
        ("a.ply", "ply\nformat ascii 1.0\nelement vertex 3\n", "a.ply"),
        ("a.ply", "ply\nformat binary_little_endian 1.0\nelement vertex 999999999999\nproperty float x\n"
                  "property float y\nproperty float z\nend_header\n", "a.ply"),
        ("a.stl", "nothing", "a.stl"),
        ("a.gltf", "{", "a.gltf"),
        ("a.gltf", "[" * 100_000, "a.gltf"),
        ("a.glb", "", "not a GLB file"),
        ("a.fbx", "", "expected one of .glb"),
        ("a", "", "expected one of .glb"),
    ],
)  # fmt: skip
def test_broken_files(tmp_path, name, content, message):
    (tmp_path / name).write_text(content)
    with pytest.raises(FileError, match=message):
        Scene.load(tmp_path / name)


def test_missing_files_and_folders(tmp_path):
    with pytest.raises(FileNotFoundError):
        Scene.load(tmp_path / "gone.obj")
    with pytest.raises(IsADirectoryError):
        Scene.load(tmp_path)


@pytest.mark.parametrize("kind", ["ply", "stl", "glb", "obj"])
def test_what_trimesh_writes_comes_back(tmp_path, kind):
    import trimesh

    ball = trimesh.creation.icosphere(subdivisions=2)
    path = tmp_path / f"ball.{kind}"
    ball.export(path)
    scene = Scene.load(path)
    expected = np.sort(ball.triangles.reshape(-1, 9), axis=0)
    found = np.sort(scene.vertices[scene.triangles].reshape(-1, 9), axis=0)
    np.testing.assert_allclose(found, expected, atol=1e-6)


MESSY = {
    "delft.obj": 36_259, "trimesh_busted.STL": 3878, "trimesh_joined_tetrahedra.obj": 7, "trimesh_nancolor.obj": 12,
    "trimesh_negative_indices.obj": 12, "trimesh_notenoughindices.obj": 1, "trimesh_polygonfaces.obj": 3,
    "trimesh_soup.stl": 100, "zurich_lod2.obj": 5142, "trimesh_empty.obj": 0, "trimesh_points_emptyface.ply": 0,
}  # fmt: skip


@pytest.mark.parametrize(("name", "triangles"), MESSY.items())
def test_messy_files(name, triangles):
    path = DATA / "messy" / name
    if not path.exists():
        pytest.skip("optional data")
    if triangles == 0:
        with pytest.raises(FileError, match="no triangles"):
            Scene.load(path)
    else:
        assert len(Scene.load(path).triangles) == triangles


@pytest.mark.parametrize(
    ("name", "triangles", "textures"),
    [("chess_still_life.glb", 20_472, 0), ("tea_set/tea_set_posed.gltf", 33_960, 1), ("spot_low.obj", 1654, 0)],
)
def test_real_files(name, triangles, textures):
    if not (DATA / name).exists():
        pytest.skip("optional data")
    scene = Scene.load(DATA / name)
    assert len(scene.triangles) == triangles
    assert sum(texture is not None for texture in scene.textures) == textures
    colours = scene.albedo_at(np.arange(triangles), np.full((triangles, 2), 1 / 3))
    assert colours.dtype == np.float32 and (colours >= 0).all() and (colours <= 1).all()
