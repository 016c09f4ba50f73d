"""Surfaces that give off light: a term of its own, beside M, in every picture."""

from __future__ import annotations

import json
import struct

import deltalux as dl
import numpy as np
import oracles
import pytest

HAAR = dl.Haar(4)


def box(rho: float, emission, width: int = 12) -> dl.Scene:
    """A closed box that glows all over."""
    quad = oracles.quad
    vertices, triangles = oracles.merged(
        quad((-1, 0, -1), (2, 0, 0), (0, 0, 2)),
        quad((-1, 2, -1), (2, 0, 0), (0, 0, 2)),
        quad((-1, 0, -1), (2, 0, 0), (0, 2, 0)),
        quad((-1, 0, 1), (2, 0, 0), (0, 2, 0)),
        quad((-1, 0, -1), (0, 0, 2), (0, 2, 0)),
        quad((1, 0, -1), (0, 0, 2), (0, 2, 0)),
    )
    camera = dl.Camera((0.2, 1.0, 0.5), (0, 0.8, -1), vertical_fov=80, width=width, height=width)
    return dl.Scene.from_arrays(vertices, triangles, camera=camera, materials=[dl.Material(rho, emission=emission)])


def lamp(floor: dl.Material | None = None, emission=(8, 7, 5)) -> dl.Scene:
    """A lamp that stands upright behind a floor of some squares, before a wall."""
    at = np.linspace(-1, 1, 7)
    cells = [oracles.quad((x, 0, z), (1 / 3, 0, 0), (0, 0, 1 / 3)) for x in at[:-1] for z in at[:-1]]
    wall = oracles.quad((-1, 0, -1), (2, 0, 0), (0, 1.5, 0))
    light = oracles.quad((-0.3, 0.5, -0.5), (0.6, 0, 0), (0, 0.6, 0))
    vertices, triangles = oracles.merged(*cells, wall, light)
    material = np.repeat([0, 1, 2], [2 * len(cells), 2, 2])
    camera = dl.Camera((0.3, 1.6, 3.5), (0, 0.5, 0), vertical_fov=40, width=24, height=20)
    materials = {
        "floor": floor or dl.Material(0.6),
        "wall": dl.Material((0.7, 0.3, 0.2)),
        "lamp": dl.Material(0.1, emission=emission),
    }
    return dl.Scene.from_arrays(vertices, triangles, camera=camera, materials=materials, material=material)


def made(path, scene, **options):
    options = {"columns": HAAR, "progress": False, "quality": "preview"} | options
    return dl.precompute(scene, path, **options)


def dark(transport):
    """The picture under no light but the scene's own."""
    return transport.image(np.zeros((transport.shape[0], 3)))


@pytest.mark.parametrize("rho", [0.9])
def test_a_glowing_box_is_as_bright_as_its_series(rho, tmp_path):
    for bounces, expected in ((0, 1 + rho), (1, 1 + rho + rho**2), ("all", 1 / (1 - rho))):
        transport = made(tmp_path / "box.transport", box(rho, (1, 2, 3)), bounces=bounces, nodes=400)
        seen = dark(transport) / (1, 2, 3)
        assert seen.mean() == pytest.approx(expected, rel=3e-3)
        np.testing.assert_allclose(seen, expected, rtol=0.04)


def test_it_is_a_term_of_its_own(tmp_path):
    """M, B and its bound are those of the scene without it; pictures are the sum."""
    scene = lamp()
    plain = scene.with_material("lamp", dl.Material(0.1))
    assert plain.emission is None
    with_light = made(tmp_path / "a.transport", scene, bounces=1)
    without = made(tmp_path / "b.transport", plain, bounces=1)
    assert without.emitted is None and with_light.emitted.shape == (with_light.shape[0], 3)
    env = dl.Environment.builtin("hall")
    V = with_light.coefficients(env)
    np.testing.assert_array_equal(with_light.multiply(V), without.multiply(V))
    both, light = with_light.image(with_light.multiply(V), env), dark(with_light)
    np.testing.assert_allclose(both, without.image(without.multiply(V), env) + light, rtol=1e-5, atol=1e-6)
    assert light.max() == pytest.approx(8.0, rel=0.1) and (light > 0).mean() > 0.4
    frame = dl.Relighter(with_light, dl.PerBand(terms=20)).step(env)
    np.testing.assert_allclose(frame.image, both, rtol=1e-5, atol=1e-5)
    assert "emission" in str(with_light.plan) and "1 of 3 materials give off" in str(with_light.plan)
    assert [(tmp_path / name / "emission.safetensors").exists() for name in ("a.transport", "b.transport")] == [1, 0]


def test_emission_is_linear_and_bounces(tmp_path):
    one, two = (made(tmp_path / f"{k}.transport", lamp(emission=(k, k, k)), bounces=2) for k in (1, 2))
    np.testing.assert_allclose(two.emitted, 2 * one.emitted, rtol=1e-5)
    direct = made(tmp_path / "0.transport", lamp(emission=(1, 1, 1)))
    more = one.emitted - direct.emitted
    assert more.min() > -1e-6 and more.mean() > 0.02 * direct.emitted.mean()
    # The red wall colours what it throws on.
    assert more[:, 0].sum() > 1.05 * more[:, 2].sum()


def test_other_views_have_it(tmp_path):
    scene = lamp()
    first = made(tmp_path / "a.transport", scene, bounces=1)
    again = first.for_camera(scene.camera, tmp_path / "b.transport", progress=False)
    np.testing.assert_array_equal(dark(again), dark(first))
    other = first.for_camera(dl.Camera((2, 1, 3), (0, 0.5, 0), width=16, height=16), tmp_path / "c", progress=False)
    assert dark(other).max() > 6


def test_vertices_and_clusters_have_it(tmp_path):
    scene = lamp()
    pixels = dark(made(tmp_path / "p.transport", scene, bounces=1))
    vertices = made(tmp_path / "v.transport", scene, bounces=1, receivers="vertices")
    B = np.zeros((vertices.shape[0], 3))
    seen = vertices.render(scene.camera, B)
    # On the floor, whose cells are small; the wall has only its corners.
    floor = np.s_[12:16, 8:16]
    assert np.abs(seen[floor] - pixels[floor]).mean() < 0.08 * pixels[floor].mean()
    np.testing.assert_allclose(vertices.colours(B).max(axis=0), (8, 7, 5), rtol=0.05)
    grey = lamp().with_material("wall", dl.Material(0.5))
    plain = made(tmp_path / "d.transport", grey)
    clustered = plain.clustered(tmp_path / "k.transport", clusters=6, representatives=3, progress=False)
    np.testing.assert_array_equal(dark(clustered), dark(plain))


def test_lobes_reflect_it(tmp_path):
    """A narrow lobe shows the lamp on the floor; the bright spot is where the mirror image is."""
    shiny = made(tmp_path / "a.transport", lamp(dl.Material(0.0, 1.0, dl.brdf.GGX(0.03))))
    matt = made(tmp_path / "b.transport", lamp(dl.Material(0.0)))
    extra = dark(shiny) - dark(matt)
    assert extra.max() == pytest.approx(8.0, rel=0.15)
    rows = np.flatnonzero((extra[..., 0] > 4).any(axis=1))
    camera = lamp().camera
    # Where the eye's mirror image under the floor sees the lamp's middle.
    eye, target = np.array(camera.position), np.array([0, 0.8, -0.5])
    ways = camera.directions().reshape(20, 24, 3)
    at = eye + (target * (1, -1, 1) - eye) * (eye[1] / (eye[1] + target[1]))
    to = (at - eye) / np.linalg.norm(at - eye)
    row = np.unravel_index((ways @ to).argmax(), (20, 24))[0]
    assert rows.min() <= row <= rows.max()


def test_materials_have_names():
    scene = lamp()
    assert scene.names == ("floor", "wall", "lamp")
    assert scene.with_material("wall", dl.Material(0.1)).materials[1].albedo == pytest.approx((0.1, 0.1, 0.1))
    assert dl.Scene.builtin("cornell").names == ("white", "red", "green")
    with pytest.raises(ValueError, match="or the name of one \\('floor', 'wall', 'lamp'\\), got 'door'"):
        scene.with_material("door", dl.Material(0.1))
    with pytest.raises(ValueError, match="expected a dl.Material"):
        scene.with_material("wall", 0.5)
    with pytest.raises(ValueError, match="none has a name"):
        box(0.5, 1).with_material("wall", dl.Material(0.1))


@pytest.mark.parametrize("emission", [-1, (1, 2), float("nan"), 1e13, "bright"])
def test_emission_is_checked(emission):
    with pytest.raises(ValueError, match="emission"):
        dl.Material(0.5, emission=emission)


def test_files_bring_it(tmp_path):
    """glTF: emissiveFactor times its strength, and the names of materials; OBJ: Ke."""
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], np.float32)
    tree = {
        "asset": {"version": "2.0"},
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "material": 0}]}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"}],
        "bufferViews": [{"buffer": 0, "byteLength": 36}],
        "buffers": [{"byteLength": 36}],
        "materials": [
            {
                "name": "lamp",
                "emissiveFactor": [1.0, 0.5, 0.25],
                "extensions": {"KHR_materials_emissive_strength": {"emissiveStrength": 4.0}},
            }
        ],
    }
    text = json.dumps(tree).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<II", len(text), 0x4E4F534A) + text + struct.pack("<II", 36, 0x004E4942) + points.tobytes()
    (tmp_path / "a.glb").write_bytes(struct.pack("<III", 0x46546C67, 2, 12 + len(chunks)) + chunks)
    scene = dl.Scene.load(tmp_path / "a.glb")
    assert scene.names == ("lamp",)
    np.testing.assert_allclose(scene.emission, [[4, 2, 1]])
    (tmp_path / "b.mtl").write_text("newmtl glow\nKd 0.2 0.2 0.2\nKe 3 2 1\n")
    (tmp_path / "b.obj").write_text("mtllib b.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl glow\nf 1 2 3\n")
    scene = dl.Scene.load(tmp_path / "b.obj")
    np.testing.assert_allclose(scene.emission, [[3, 2, 1]])
    assert scene.names == ("glow",)
