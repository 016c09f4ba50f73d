"""Layers for compositors and engines: multi-part EXR and glTF."""

from __future__ import annotations

import json

import deltalux as dl
import numpy as np
import pytest
from deltalux.command.cli import main
from deltalux.io import load_image

GROUPS = {"key": dl.Environment.builtin("studio"), "fill": 0.3 * dl.Environment.builtin("sky").rotated(60)}


def parts_of(path) -> dict[str, tuple[tuple[str, ...], np.ndarray]]:
    import OpenImageIO as oiio

    image, found = oiio.ImageInput.open(str(path)), {}
    while image.seek_subimage(len(found), 0):
        spec = image.spec()
        found[spec.getattribute("name") or spec.getattribute("oiio:subimagename")] = (
            tuple(spec.channelnames),
            image.read_image(len(found), 0, 0, spec.nchannels, "float"),
        )
    image.close()
    oiio.geterror()
    return found


def test_a_compositor_finds_layers_that_add_up(cornell, tmp_path):
    dl.save_layers(tmp_path / "a.exr", cornell, GROUPS)
    parts = parts_of(tmp_path / "a.exr")
    assert list(parts) == ["rgba", "key", "fill", "albedo", "normal", "position", "depth"]
    channels = [names for names, _ in parts.values()]
    assert channels[:2] == [("R", "G", "B", "A"), ("key.R", "key.G", "key.B")]
    assert channels[3:] == [
        ("albedo.R", "albedo.G", "albedo.B"), ("N.X", "N.Y", "N.Z"), ("P.X", "P.Y", "P.Z"), ("Z",),
    ]  # fmt: skip
    pixels = {name: own for name, (_, own) in parts.items()}
    for name, env in GROUPS.items():
        expected = cornell.image(cornell.multiply(cornell.coefficients(env)))
        np.testing.assert_allclose(pixels[name], expected, rtol=1e-6)
    np.testing.assert_allclose(pixels["rgba"][..., :3], pixels["key"] + pixels["fill"], rtol=1e-5, atol=1e-6)
    np.testing.assert_array_equal(pixels["rgba"][..., 3], cornell.aov("mask"))
    there = cornell.aov("mask") > 0
    np.testing.assert_array_equal(pixels["normal"], cornell.aov("normal"))
    np.testing.assert_array_equal(pixels["depth"][..., 0][there], cornell.aov("depth")[there])
    assert np.isfinite(pixels["position"]).all() and (pixels["depth"][..., 0][~there] == 1e10).all()
    # Whoever reads no layers sees the picture; and the groups come back as columns.
    np.testing.assert_array_equal(load_image(tmp_path / "a.exr")[0], pixels["rgba"][..., :3])
    back = dl.Transport.from_images(tmp_path / "a.exr", ["key", "fill"], tmp_path / "b.transport", progress=False)
    mixed = back.image(back.multiply(np.array([[1.0] * 3, [2.0] * 3])))
    np.testing.assert_allclose(mixed, pixels["key"] + 2 * pixels["fill"], atol=1e-3)
    dl.save_layers(tmp_path / "c.exr", back, half=True)
    np.testing.assert_allclose(parts_of(tmp_path / "c.exr")["fill"][1], pixels["fill"], atol=2e-3)


@pytest.fixture(scope="module")
def vertices(make):
    scene = dl.Scene.builtin("cornell")
    return make(scene.with_camera(scene.camera.resized(12, 12)), 2, receivers="vertices")


def document(path) -> tuple[dict, bytes]:
    data = path.read_bytes()
    length = int.from_bytes(data[12:16], "little")
    return json.loads(data[20 : 20 + length]), data[28 + length :]


def test_an_engine_finds_colours_by_group_and_lamps(vertices, tmp_path):
    peak = GROUPS["key"].peaks(1)[0]
    lamps = [peak, dl.PointLight((1, 2, 3), (2, 1, 0)), dl.Spot((0, 2, 0), (0, 0, 0), 5.0, angle=40, blend=0.25)]
    dl.save_layers(tmp_path / "a.glb", vertices, GROUPS, lamps=lamps)
    gltf, binary = document(tmp_path / "a.glb")
    mesh = gltf["meshes"][0]
    assert mesh["extras"] == {"lightGroups": ["key", "fill"]}

    def colours(k):
        accessor = gltf["accessors"][mesh["primitives"][0]["attributes"][f"COLOR_{k}"]]
        start = gltf["bufferViews"][accessor["bufferView"]]["byteOffset"]
        return np.frombuffer(binary, "<f4", 3 * accessor["count"], start).reshape(-1, 3)

    expected = [vertices.colours(vertices.multiply(vertices.coefficients(env))) for env in GROUPS.values()]
    for k, own in enumerate(expected, 1):
        np.testing.assert_allclose(colours(k), own, rtol=1e-6)
    np.testing.assert_allclose(colours(0), sum(expected), rtol=1e-5)
    lights = gltf["extensions"]["KHR_lights_punctual"]["lights"]
    assert [light["type"] for light in lights] == ["directional", "point", "spot"]
    assert lights[0]["intensity"] == pytest.approx(max(peak.flux)) and lights[1]["color"] == [1.0, 0.5, 0.0]
    assert lights[2]["spot"]["outerConeAngle"] == pytest.approx(np.radians(40))
    assert gltf["scenes"][0]["nodes"] == [0, 1, 2, 3] and gltf["nodes"][2]["translation"] == [1, 2, 3]
    # Lights shine along -z of their nodes: from the peak to the scene.
    x, y, z, w = gltf["nodes"][1]["rotation"]
    turned = (2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y))
    np.testing.assert_allclose(turned, peak.direction, atol=1e-9)
    # A scene reader takes it, whatever else is in it; of two sides of a wall it keeps one.
    assert len(dl.Scene.load(tmp_path / "a.glb").triangles) == 40


def test_from_the_command_line(vertices, tmp_path, capsys):
    words = ["render", str(vertices._path), "--group", "key=studio", "--group", "fill=sky", "--size", "8x8"]
    assert main([*words, "-o", str(tmp_path / "a.exr")]) == 0
    assert parts_of(tmp_path / "a.exr")["fill"][1].shape == (8, 8, 3)
    assert main([*words[:2], "--group", "studio", "-o", str(tmp_path / "b.exr")]) != 0
    assert "NAME=ENV" in capsys.readouterr().err


def test_what_makes_no_layers_is_refused(cornell, tmp_path):
    for groups, options, message in (
        (None, {}, "groups of light by name"),
        ({}, {}, "at least one"),
        ({"rgba": GROUPS["key"]}, {}, "none of rgba"),
        ({"a.b": GROUPS["key"]}, {}, "letters and digits"),
        (GROUPS, {"lamps": [dl.PointLight((0, 1, 0))]}, r"\.glb only"),
    ):
        with pytest.raises(ValueError, match=message):
            dl.save_layers(tmp_path / "a.exr", cornell, groups, **options)
    with pytest.raises(ValueError, match=r"expected an \.exr or a \.glb"):
        dl.save_layers(tmp_path / "a.png", cornell, GROUPS)
    with pytest.raises(ValueError, match="rows are pixels"):
        dl.save_layers(tmp_path / "a.glb", cornell, GROUPS)
    with pytest.raises(TypeError, match="expected lamps to be"):
        dl.save_layers(tmp_path / "a.exr", cornell, GROUPS, lamps=["lamp"])
    assert not list(tmp_path.iterdir())
