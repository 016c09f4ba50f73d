"""What scene files say beyond triangles and colours: each case stands for a kind of report about readers."""

from __future__ import annotations

import base64
import io
import json
import struct

import deltalux as dl
import numpy as np
import pytest
from deltalux._core import FileError
from deltalux.command.cli import main
from deltalux.scene.polygons import triangulated
from deltalux.surface.texture import bilinear, filtered
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

SQUARE = [(-1, 0, 1), (1, 0, 1), (1, 0, -1), (-1, 0, -1)]
HALVES = [(0, 1, 2), (0, 2, 3)]
UV = [(0, 1), (1, 1), (1, 0), (0, 0)]


class Gltf:
    """A small writer of .gltf files with their buffers inside."""

    def __init__(self):
        self.bytes = bytearray()
        lists = ("bufferViews", "accessors", "meshes", "nodes", "materials", "textures", "images", "samplers")
        self.tree = {"asset": {"version": "2.0"}, "scenes": [{"nodes": []}], **{name: [] for name in lists}}

    def view(self, raw):
        self.bytes += b"\0" * (-len(self.bytes) % 4)
        self.tree["bufferViews"].append({"buffer": 0, "byteOffset": len(self.bytes), "byteLength": len(raw)})
        self.bytes += raw
        return len(self.tree["bufferViews"]) - 1

    def accessor(self, array, component, kind, **more):
        view = self.view(np.ascontiguousarray(array).tobytes())
        own = {"bufferView": view, "componentType": component, "count": len(array), "type": kind, **more}
        self.tree["accessors"].append(own)
        return len(self.tree["accessors"]) - 1

    def vectors(self, array):
        array = np.asarray(array, np.float32)
        return self.accessor(array, 5126, f"VEC{array.shape[1]}")

    def mesh(self, points=SQUARE, faces=HALVES, uv=None, material=None, targets=None, **attributes):
        attributes["POSITION"] = self.vectors(points)
        if uv is not None:
            attributes["TEXCOORD_0"] = self.vectors(uv)
        own = {"attributes": attributes, "indices": self.accessor(np.array(faces, np.uint16).ravel(), 5123, "SCALAR")}
        own |= {} if material is None else {"material": material}
        self.tree["meshes"].append({"primitives": [own | ({} if targets is None else {"targets": targets})]})
        return len(self.tree["meshes"]) - 1

    def add(self, what, **fields):
        self.tree.setdefault(what, []).append(fields)
        return len(self.tree[what]) - 1

    def node(self, **fields):
        number = self.add("nodes", **fields)
        self.tree["scenes"][0]["nodes"].append(number)
        return number

    def material(self, **fields):
        return self.add("materials", **fields)

    def texture(self, pixels, **sampler):
        file = io.BytesIO()
        Image.fromarray(pixels).save(file, "PNG")
        source = self.add("images", bufferView=self.view(file.getvalue()), mimeType="image/png")
        own = {"sampler": self.add("samplers", **sampler)} if sampler else {}
        return self.add("textures", source=source, **own)

    def load(self, folder, **asked):
        uri = "data:application/octet-stream;base64," + base64.b64encode(bytes(self.bytes)).decode()
        self.tree["buffers"] = [{"byteLength": len(self.bytes), "uri": uri}]
        (folder / "s.gltf").write_text(json.dumps({key: own for key, own in self.tree.items() if own != []}))
        return dl.Scene.load(folder / "s.gltf", **asked)


def textured(pixels, uv=UV, transform=None, material=None, **sampler):
    """A square under a picture, (-1, -1) to (1, 1) in x and z."""
    g = Gltf()
    reference = {"index": g.texture(pixels, **sampler)}
    if transform is not None:
        reference["extensions"] = {"KHR_texture_transform": transform}
        g.tree["extensionsRequired"] = g.tree["extensionsUsed"] = ["KHR_texture_transform"]
    number = g.material(pbrMetallicRoughness={"baseColorTexture": reference}, **(material or {}))
    g.node(mesh=g.mesh(uv=uv, material=number))
    return g


def albedo(scene, x, z):
    """Of the square at a place of its first triangle, x >= -z."""
    up = (1 - z) / 2
    return scene.albedo_at([0], [[(x + 1) / 2 - up, up]])[0]


def area(scene):
    a, b, c = scene.vertices[scene.triangles].transpose(1, 0, 2)
    return 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum()


LEFT_BLACK = np.repeat(np.array([[0, 0, 255, 255]], np.uint8)[:, :, None], 3, axis=2).repeat(4, axis=0)

# --- glTF


def test_the_diffuse_colour_of_specular_glossiness(tmp_path):
    g = Gltf()
    glossy = {"diffuseFactor": [0.2, 0.4, 0.6, 1]}
    g.node(mesh=g.mesh(material=g.material(extensions={"KHR_materials_pbrSpecularGlossiness": glossy})))
    np.testing.assert_allclose(g.load(tmp_path).albedo, [[0.2, 0.4, 0.6]], rtol=1e-6)


def test_gpu_instances_stand_where_each_is_placed(tmp_path):
    g = Gltf()
    turn = [(0, 0, 0, 1), (0, np.sqrt(0.5), 0, np.sqrt(0.5)), (0, 0, 0, 1)]
    attributes = {
        "TRANSLATION": g.vectors([(0, 0, 0), (5, 0, 0), (0, 0, 5)]),
        "ROTATION": g.vectors(turn),
        "SCALE": g.vectors([(1, 1, 1), (1, 1, 2), (3, 1, 1)]),
    }
    g.node(mesh=g.mesh(), translation=[0, 1, 0], extensions={"EXT_mesh_gpu_instancing": {"attributes": attributes}})
    g.tree["extensionsUsed"] = ["EXT_mesh_gpu_instancing"]
    scene = g.load(tmp_path)
    low, high = (of(scene.vertices.reshape(3, 4, 3), axis=1) for of in (np.min, np.max))
    # The second is twice as long along its z, which is turned into x.
    np.testing.assert_allclose(low, [(-1, 1, -1), (3, 1, -1), (-3, 1, 4)], atol=1e-6)
    np.testing.assert_allclose(high, [(1, 1, 1), (7, 1, 1), (3, 1, 6)], atol=1e-6)
    assert scene.warnings == ()


def test_a_skin_stands_as_its_joints_do(tmp_path):
    g = Gltf()
    # Corner 0 and 3 hang on a joint 3 above, 1 and 2 on half of that and half of one 1 to the right, out of the scene.
    weights = np.float32([(1, 0, 0, 0), (0.5, 0.5, 0, 0), (0.5, 0.5, 0, 0), (1, 0, 0, 0)])
    joints = g.accessor(np.tile(np.uint8([0, 1, 0, 0]), (4, 1)), 5121, "VEC4")
    mesh = g.mesh(JOINTS_0=joints, WEIGHTS_0=g.vectors(weights), NORMAL=g.vectors([(0, 1, 0)] * 4))
    inverse = g.accessor(np.tile(np.eye(4, dtype=np.float32).ravel(), (2, 1)), 5126, "MAT4")
    joint, other = g.node(translation=[0, 3, 0]), g.add("nodes", translation=[1, 3, 0])
    g.add("skins", joints=[joint, other], inverseBindMatrices=inverse)
    g.node(mesh=mesh, skin=0, translation=[100, 0, 0], scale=[100, 100, 100])
    scene = g.load(tmp_path)
    np.testing.assert_allclose(scene.vertices, [(-1, 3, 1), (1.5, 3, 1), (1.5, 3, -1), (-1, 3, -1)])
    np.testing.assert_allclose(scene.normals, [(0, 1, 0)] * 4)


def test_morph_weights_move_places_and_normals(tmp_path):
    g = Gltf()
    raised, turned = g.vectors([(0, 2, 0)] * 4), g.vectors([(2, 0, 0)] * 4)
    mesh = g.mesh(NORMAL=g.vectors([(0, 1, 0)] * 4), targets=[{"POSITION": raised, "NORMAL": turned}, {}])
    g.tree["meshes"][mesh]["weights"] = [1.0, 0.0]
    g.node(mesh=mesh)
    g.node(mesh=mesh, weights=[0.5, 0.0])
    scene = g.load(tmp_path)
    assert scene.vertices[:, 1].tolist() == [2.0] * 4 + [1.0] * 4
    np.testing.assert_allclose(scene.normals[4], np.array([1, 1, 0]) / np.sqrt(2), atol=1e-6)


def test_cameras_and_scenes_are_chosen_by_name(tmp_path, capsys):
    g = Gltf()
    g.add("cameras", type="perspective", perspective={"yfov": 1.0, "aspectRatio": 2.0, "znear": 0.1})
    square = g.mesh()
    g.node(mesh=square)
    g.node(camera=0, name="Front", translation=[0, 0, 7])
    g.node(camera=0, name="Top", translation=[0, 7, 0], rotation=[-np.sqrt(0.5), 0, 0, np.sqrt(0.5)])
    g.tree["scenes"].append({"nodes": [g.add("nodes", mesh=square, scale=[3, 3, 3])], "name": "Large"})
    scene = g.load(tmp_path)
    assert scene.camera.position == (0, 0, 7) and scene.counts["scenes ignored"] == 1
    top = dl.Scene.load(tmp_path / "s.gltf", camera="Top").camera
    np.testing.assert_allclose(top.basis()[2], [0, -1, 0], atol=1e-9)
    assert dl.Scene.load(tmp_path / "s.gltf", scene="Large").vertices.max() == 3
    assert dl.Scene.load(tmp_path / "s.gltf", scene=1).vertices.max() == 3
    request = ["precompute", str(tmp_path / "s.gltf"), "--plan", "--size", "8x8", "--columns", "haar:4", "--scene"]
    for name in ("Large", "1"):
        assert main([*request, name]) == 0 and "scenes ignored" not in capsys.readouterr().out
    with pytest.raises(FileError, match=r"name of a camera \(Front, Top\), got 'Side'"):
        dl.Scene.load(tmp_path / "s.gltf", camera="Side")
    with pytest.raises(FileError, match=r"name of a scene \(Large\) or a number below 2, got 'Small'"):
        dl.Scene.load(tmp_path / "s.gltf", scene="Small")
    with pytest.raises(FileError, match=r"no scene 2: the file has 2"):
        dl.Scene.load(tmp_path / "s.gltf", scene=2)
    (tmp_path / "a.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    with pytest.raises(FileError, match="a .glb or a .gltf to choose a scene of"):
        dl.Scene.load(tmp_path / "a.obj", scene=0)


def test_extensions_are_matched_exactly_and_noted(tmp_path):
    g = Gltf()
    g.node(mesh=g.mesh())
    g.tree["extensionsUsed"] = ["KHR_materials_clearcoat", "KHR_texture_transform", "VENDOR_thing"]
    g.tree["extensionsRequired"] = ["KHR_materials_clearcoat"]
    assert sorted(g.load(tmp_path).counts) == [
        "KHR_materials_clearcoat", "VENDOR_thing", "degenerate triangles", "duplicate triangles",
        "meshes without material",
    ]  # fmt: skip
    for name in ("KHR_texture_basisu", "KHR_materials_", "EXT_texture_astc"):
        g.tree["extensionsRequired"] = [name]
        with pytest.raises(FileError, match=f"requires {name}, which is not supported"):
            g.load(tmp_path)


def test_vertex_colours_of_gltf_are_linear_factors(tmp_path):
    g = Gltf()
    colours = g.accessor(np.array([[128, 64, 32, 255]] * 4, np.uint8), 5121, "VEC4", normalized=True)
    white = g.material(pbrMetallicRoughness={"baseColorFactor": [1, 0.5, 1, 1]})
    g.node(mesh=g.mesh(material=white, COLOR_0=colours))
    np.testing.assert_allclose(albedo(g.load(tmp_path), 0.5, 0.5), np.array([128, 32, 32]) / 255, rtol=1e-6)


def test_texture_transforms_scale_turn_and_move(tmp_path):
    small = np.array(UV) / 16
    scene = textured(LEFT_BLACK, small, {"scale": [16.0, 16.0]}).load(tmp_path)
    assert albedo(scene, -0.5, 0.9)[0] == 0 and albedo(scene, 0.5, 0.9)[0] == 1
    # By the extension's own matrix, T R S: a quarter turn brings v, downwards, to u.
    scene = textured(LEFT_BLACK, UV, {"rotation": np.pi / 2, "offset": [0.0, 1.0]}).load(tmp_path)
    assert albedo(scene, 0.5, -0.3)[0] == 0 and albedo(scene, 0.0, 0.5)[0] == 1
    scene = textured(LEFT_BLACK, UV, {"offset": [0.5, 0.0]}).load(tmp_path)
    assert albedo(scene, -0.5, 0.9)[0] == 1 and albedo(scene, 0.5, 0.9)[0] == 0


@pytest.mark.parametrize(("wrap", "expected"), [(10497, [1, 0, 1, 0]), (33071, [0, 0, 1, 1]), (33648, [1, 0, 1, 0])])
def test_samplers_wrap(tmp_path, wrap, expected):
    # Left black, right white, four times as wide as the square: u from -1 to 2.
    uv = (np.array(UV) - (1 / 3, 0)) * (3, 1)
    scene = textured(LEFT_BLACK, uv, wrapS=wrap, wrapT=33071, magFilter=9728).load(tmp_path)
    us = np.array([-0.25, 0.25, 0.75, 1.25])
    if wrap == 33648:
        us, expected = np.array([-0.75, 0.25, 1.25, 1.75]), [1, 0, 1, 0]
    found = [albedo(scene, 2 * (u + 1) / 3 - 1, 0.99)[0] for u in us]
    assert found == expected


def test_the_nearest_texel_speaks_alone(tmp_path):
    scene = textured(LEFT_BLACK, magFilter=9728).load(tmp_path)
    assert [albedo(scene, x, 0.9)[0] for x in (-0.01, 0.01)] == [0, 1]
    assert 0 < albedo(textured(LEFT_BLACK).load(tmp_path), 0.01, 0.9)[0] < 1


def test_sixteen_bits_are_not_clipped(tmp_path):
    scene = textured(np.full((4, 4), 0x4000, np.uint16)).load(tmp_path)
    assert albedo(scene, 0.5, 0.5)[0] == pytest.approx(((0.25 + 0.055) / 1.055) ** 2.4, rel=1e-3)


def test_a_second_set_of_coordinates(tmp_path):
    g = Gltf()
    base = {"index": g.texture(LEFT_BLACK), "texCoord": 1}
    number = g.material(pbrMetallicRoughness={"baseColorTexture": base})
    g.node(mesh=g.mesh(uv=UV, material=number, TEXCOORD_1=g.vectors(1.0 - np.array(UV))))
    scene = g.load(tmp_path)
    assert albedo(scene, -0.5, 0.9)[0] == 1 and albedo(scene, 0.5, 0.9)[0] == 0


def test_files_lie_in_folders_near_the_scene(tmp_path):
    """In a folder beside the scene's own, and behind a link that lies there; not in the folder above."""
    folder, beside = tmp_path / "work" / "mesh", tmp_path / "work" / "textures"
    for own in (folder, beside, tmp_path / "cache"):
        own.mkdir(parents=True)
    Image.new("RGB", (2, 2), (255, 0, 0)).save(beside / "red.png")
    Image.new("RGB", (2, 2), (0, 255, 0)).save(tmp_path / "cache" / "blob.png")
    (folder / "green.png").symlink_to(tmp_path / "cache" / "blob.png")

    def seen(uri):
        g = Gltf()
        g.add("images", uri=uri)
        base = {"index": g.add("textures", source=0)}
        g.node(mesh=g.mesh(uv=UV, material=g.material(pbrMetallicRoughness={"baseColorTexture": base})))
        return albedo(g.load(folder), 0, 0.5).tolist()

    assert seen("../textures/red.png") == [1, 0, 0] and seen("green.png") == [0, 1, 0]
    for uri in ("../red.png", "../../cache/blob.png", "%2e%2e/%2e%2e/cache/blob.png"):
        with pytest.raises(FileError, match="outside the scene's folder and those beside it"):
            seen(uri)


# --- OBJ

SHEET = "v -1 0 1\nv 1 0 1\nv 1 0 -1\nv -1 0 -1\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n"
FACE = "f 1/1 2/2 3/3 4/4\n"


def obj(folder, text, **files):
    for name, content in files.items():
        (folder / f"{name}.mtl").write_text(content)
    (folder / "a.obj").write_text(text)
    return dl.Scene.load(folder / "a.obj")


@given(st.integers(0, 7), st.booleans(), st.sampled_from([(0, 1, 2), (2, 0, 1), (1, 2, 0)]))
@settings(deadline=None, max_examples=20)
def test_concave_polygons_are_cut_right(turn, mirrored, axes):
    """A C of area 7, from any corner, of either sense, along any axis: triangles of its area, wound as it is."""
    corners = np.array([(0, 0, 0), (3, 0, 0), (3, 1, 0), (1, 1, 0), (1, 2, 0), (3, 2, 0), (3, 3, 0), (0, 3, 0)], float)
    polygon = np.roll(corners[::-1] if mirrored else corners, turn, axis=0)[:, axes]
    triangles, owner = triangulated(polygon, np.array([8]))
    a, b, c = polygon[triangles].transpose(1, 0, 2)
    along = np.cross(b - a, c - a) / 2
    newell = np.cross(polygon, np.roll(polygon, -1, axis=0)).sum(axis=0) / 2
    np.testing.assert_allclose(along.sum(axis=0), newell, atol=1e-12)
    assert np.linalg.norm(along, axis=1).sum() == pytest.approx(7) and (owner == 0).all()


def test_obj_polygons_of_several_sizes_keep_their_order():
    points = np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (5, 0, 0), (6, 0, 0), (5, 1, 0)], float)
    triangles, owner = triangulated(points, np.array([4, 3]))
    assert triangles.tolist() == [[0, 1, 2], [0, 2, 3], [4, 5, 6]] and owner.tolist() == [0, 0, 1]


def test_obj_tabs_relative_numbers_and_lines_that_go_on(tmp_path):
    assert area(obj(tmp_path, (SHEET + FACE).replace(" ", "\t"))) == 4
    text = "v 0 0 0\nv 1 0 0\nv 0 0 1\nf -3 -2 -1\nv 5 0 0\nv 6 0 0\nv 5 0 1\nf -3 -2 \\\n -1\n"
    assert area(obj(tmp_path, text)) == 1


def test_obj_normals_colours_and_several_libraries(tmp_path):
    text = "mtllib a.mtl b.mtl\nv 0 0 0 0 0 0\nv 1 0 0 1 1 1\nv 0 0 -1 0 0 0\nvn 0 1 0\nvn 1 1 0\n"
    scene = obj(tmp_path, text + "usemtl b\nf 1//1 2//2 3//1\n", a="newmtl a\nKd 1 0 0\n", b="newmtl b\nKd 0 1 0\n")
    assert scene.albedo.tolist() == [[0, 1, 0]] and scene.warnings == ()
    np.testing.assert_allclose(scene.normals[1], np.array([1, 1, 0]) / np.sqrt(2), rtol=1e-6)
    np.testing.assert_allclose(scene.albedo_at([0], [[0.5, 0.0]]), [[0, 0.5, 0]])


@pytest.mark.parametrize(
    "line", [r"textures\red.png", "-s 1 1 1 textures/red.png", "-clamp on textures/red.png", r"C:\Users\me\red.png",
             "-o 0 0 0 -s 1 1 1 -mm 0 1 textures/red.png", "textures/dark red.png"]
)  # fmt: skip
def test_maps_of_windows_and_with_options(tmp_path, line):
    (tmp_path / "textures").mkdir()
    red = Image.new("RGB", (2, 2), (255, 0, 0))
    for name in ("red.png", "textures/red.png", "textures/dark red.png"):
        red.save(tmp_path / name)
    scene = obj(tmp_path, f"mtllib a.mtl\n{SHEET}usemtl a\n{FACE}", a=f"newmtl a\n\tKd 1 1 1\n\tmap_Kd {line}\n")
    assert scene.albedo_at([0], [[0.3, 0.3]]).tolist() == [[1, 0, 0]]


def test_map_options_scale_and_move(tmp_path):
    Image.fromarray(LEFT_BLACK).save(tmp_path / "half.png")
    scene = obj(tmp_path, f"mtllib a.mtl\n{SHEET}usemtl a\n{FACE}", a="newmtl a\nmap_Kd -o 0.5 -s 0.5 1 half.png\n")
    assert scene.albedo_at([0], [[0.5, 0.1]]).tolist() == [[1, 1, 1]]
    assert scene.uv.min(axis=0).tolist() == [0.5, 0] and scene.uv.max(axis=0).tolist() == [1, 1]


def test_opacity_of_obj(tmp_path):
    Image.fromarray(np.array([[0, 255]], np.uint8)).save(tmp_path / "leaf.png")
    for stated, opacity, cutoff in (("d 0.25", 0.25, None), ("Tr 0.25", 0.75, None), ("map_d leaf.png", 1, 0.5)):
        (own,) = obj(tmp_path, f"mtllib a.mtl\n{SHEET}usemtl a\n{FACE}", a=f"newmtl a\nKd 1 1 1\n{stated}\n").cutouts
        assert (own.opacity, own.cutoff) == (opacity, cutoff)
    assert own.picture.tolist() == [[0, 1]]


# --- PLY


def test_ply_colours_normals_and_mixed_polygons(tmp_path):
    names = [*("float x", "float y", "float z", "float nx", "float ny", "float nz"), *("uchar red", "uchar green")]
    head = "".join(f"property {name}\n" for name in (*names, "uchar blue"))
    rows = b"".join(struct.pack(">6f3B", *p, 0, 2, 0, 188, 188, 0) for p in SQUARE)
    faces = struct.pack(">B3iB4i", 3, 0, 1, 2, 4, 0, 1, 2, 3)
    text = f"ply\nformat binary_big_endian 1.0\nelement vertex 4\n{head}element face 2\n"
    text += "property list uchar int vertex_indices\nend_header\n"
    (tmp_path / "a.ply").write_bytes(text.encode() + rows + faces)
    scene = dl.Scene.load(tmp_path / "a.ply")
    # Whole numbers are sRGB.
    np.testing.assert_allclose(scene.albedo_at([0], [[0.3, 0.3]]), [[0.5029, 0.5029, 0]], atol=1e-4)
    assert (scene.normals == (0, 1, 0)).all() and scene.counts["duplicate triangles"] == 1 and area(scene) == 4
    (tmp_path / "b.ply").write_bytes(text.encode() + rows + faces[:-1])
    with pytest.raises(FileError, match="truncated"):
        dl.Scene.load(tmp_path / "b.ply")


def test_ply_textures_by_corner(tmp_path):
    Image.new("RGB", (2, 2), (0, 0, 255)).save(tmp_path / "blue.png")
    text = "ply\nformat ascii 1.0\ncomment TextureFile blue.png\nelement vertex 4\nproperty float x\nproperty float y\n"
    text += "property float z\nelement face 1\nproperty list uchar int vertex_indices\n"
    text += "property list uchar float texcoord\nend_header\n"
    text += "".join(f"{x} {y} {z}\n" for x, y, z in SQUARE) + "4 0 1 2 3 8 0 0 1 0 1 1 0 1\n"
    (tmp_path / "a.ply").write_text(text)
    scene = dl.Scene.load(tmp_path / "a.ply")
    assert scene.albedo_at([0], [[0.3, 0.3]]).tolist() == [[0, 0, 1]]
    assert sorted(scene.uv.tolist()) == [[0, 0], [0, 1], [1, 0], [1, 1]]


# --- All of them


def test_z_up_is_turned_to_y_up(tmp_path):
    scene = obj(tmp_path, "v 0 0 0\nv 1 0 0\nv 0 0 2\nvn 0 1 0\nf 1//1 2//1 3//1\n")
    turned = dl.Scene.load(tmp_path / "a.obj", up="z")
    assert scene.vertices[2].tolist() == [0, 0, 2] and turned.vertices[2].tolist() == [0, 2, 0]
    assert turned.normals[0].tolist() == [0, 0, -1]
    with pytest.raises(ValueError, match="expected up to be one of 'y', 'z', got 'x'"):
        dl.Scene.load(tmp_path / "a.obj", up="x")


def test_a_stray_triangle_does_not_shrink_the_picture():
    near, far = np.array(SQUARE, float), 1e5 + np.array(SQUARE[:3], float)
    scene = dl.Scene.from_arrays(np.vstack([near, far]), [*HALVES, (4, 5, 6)])
    assert np.linalg.norm(scene.camera.position) < 10 and scene.warnings[0].startswith("framing: 1 triangles far")


def test_ground_lies_under_the_scene():
    scene = dl.Scene.builtin("cornell")
    grounded = scene.with_ground((0.2, 0.3, 0.4))
    assert len(grounded.triangles) == len(scene.triangles) + 2 and grounded.names[-1] == "ground"
    below = grounded.vertices[-4:]
    assert (below[:, 1] < scene.vertices[:, 1].min()).all() and grounded.materials[-1].albedo == pytest.approx(
        (0.2, 0.3, 0.4)
    )


# --- Textures


@given(st.integers(1, 40), st.integers(1, 40), st.integers(0, 2**32 - 1))
@settings(deadline=None, max_examples=30)
def test_a_footprint_as_large_as_the_picture_sees_its_mean(height, width, seed):
    texture = np.random.default_rng(seed).random((height, width, 3))
    whole = np.array([[[1.0, 0.0], [0.0, 1.0]]]) * 64
    found = filtered(texture, np.array([[0.3, 0.7]]), whole)
    np.testing.assert_allclose(found[0], texture.mean(axis=(0, 1)), atol=1e-6)


def test_what_is_magnified_is_looked_up_as_before():
    rng = np.random.default_rng(3)
    texture, uv = rng.random((5, 7, 3)), rng.random((50, 2)) * 3 - 1
    steps = np.tile(np.array([[0.1, 0.0], [0.0, 0.1]]), (50, 1, 1))
    assert (filtered(texture, uv, steps) == bilinear(texture, uv)).all()


def test_long_footprints_are_not_wider_than_they_are():
    """Stripes across the short side of a footprint stay, those along its long side are evened out."""
    texture = np.zeros((64, 64, 1))
    texture[:, ::2] = 1
    uv = np.array([[(20.5) / 64, 0.5]])
    along = filtered(texture, uv, np.array([[[0.0, 0.2], [1 / 64, 0.0]]]))
    across = filtered(texture, uv, np.array([[[0.2, 0.0], [0.0, 1 / 64]]]))
    assert along[0, 0] > 0.9 and abs(across[0, 0] - 0.5) < 0.05
