"""Receivers at vertices, pictures of them from any camera, and other cameras for transports of pixels."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path

import deltalux as dl
import numpy as np
import oracles
import pytest
import trimesh
from deltalux.io import to_display
from deltalux.precomputation.refining import refined

HAAR = dl.Haar(8)


def flat(n: int, size: float = 2.0):
    """A square of n x n cells in the plane y = 0."""
    at = np.linspace(-size / 2, size / 2, n + 1)
    x, z = np.meshgrid(at, at)
    vertices = np.stack([x, np.zeros_like(x), z], -1).reshape(-1, 3)
    corner = np.arange((n + 1) ** 2).reshape(n + 1, n + 1)
    a, b, c, d = corner[:-1, :-1], corner[:-1, 1:], corner[1:, :-1], corner[1:, 1:]
    return vertices, np.concatenate([np.stack([a, c, d], -1).reshape(-1, 3), np.stack([a, d, b], -1).reshape(-1, 3)])


def scene(n: int = 40, pixels: int = 32) -> dl.Scene:
    """A finely divided square under a smaller one that hovers over it, seen from above the side."""
    ground = flat(n)
    lid = (np.array(oracles.quad((-0.4, 0.5, -0.4), (0.8, 0, 0), (0, 0, 0.8))[0]), np.array([[0, 1, 2], [0, 2, 3]]))
    vertices, triangles = oracles.merged(ground, lid)
    camera = dl.Camera((1.2, 1.6, 2.0), (0, 0.1, 0), vertical_fov=45, width=pixels, height=pixels)
    return dl.Scene.from_arrays(vertices, triangles, (0.5, 0.4, 0.3), camera, name="lid")


def made(path: Path, asked: dl.Scene, **options) -> dl.Transport:
    options = {"columns": HAAR, "quality": "lossless", "progress": False, **options}
    return dl.precompute(asked, path, **options)


@pytest.fixture(scope="module")
def vertices(tmp_path_factory):
    return made(tmp_path_factory.mktemp("vertices") / "a.transport", scene(), receivers="vertices")


@pytest.fixture(scope="module")
def pixels(tmp_path_factory):
    return made(tmp_path_factory.mktemp("pixels") / "a.transport", scene(), bounces=2)


def response(transport: dl.Transport, env: str = "sky") -> np.ndarray:
    return transport.multiply(transport.coefficients(dl.Environment.builtin(env)))


def white() -> dl.Environment:
    return dl.Environment.from_cubemap(np.ones((6, 8, 8, 3), np.float32))


# --- what the rows are ------------------------------------------------------------------------------------------------


def test_each_side_of_each_vertex_is_a_row(vertices):
    assert vertices.receivers.kind == "vertices" and len(vertices.receivers) == 2 * (41 * 41 + 4)
    assert not vertices.receivers.buried.any()
    # Nothing is above the upper side of the lid: a white sky gives 1, as well as 8 x 8 texels a face can tell.
    B = vertices.multiply(vertices.coefficients(white()))
    lid = (vertices.receivers.position[:, 1] > 0.4) & (vertices.receivers.normal[:, 1] > 0.5)
    assert lid.sum() == 4
    np.testing.assert_allclose(B[lid], 1.0, atol=6e-3)
    assert (B < 1.006).all() and B.min() < 0.7


def test_the_plan_says_so(vertices):
    assert "one view" not in str(vertices.plan) and "samples of pixel edges" not in str(vertices.plan)


def test_normals_are_those_that_the_scene_brings(tmp_path):
    square, triangles = flat(1)
    lean = np.tile([0.6, 0.8, 0.0], (len(square), 1))
    camera = dl.Camera((1, 2, 3), (0, 0, 0), width=8, height=8)
    given = dl.Scene.from_arrays(square, triangles, camera=camera, normals=5 * lean)
    smooth = made(tmp_path / "smooth.transport", given, receivers="vertices")
    flat_ = made(tmp_path / "flat.transport", given, receivers="vertices", normals="flat")
    above = smooth.receivers.normal[:, 1] > 0
    np.testing.assert_allclose(smooth.receivers.normal[above], lean, atol=1e-6)
    np.testing.assert_allclose(smooth.receivers.normal[~above], -lean, atol=1e-6)
    np.testing.assert_allclose(np.abs(flat_.receivers.normal), [[0, 1, 0]] * 8, atol=1e-6)
    assert given.content_hash() != dl.Scene.from_arrays(square, triangles, camera=camera).content_hash()


@pytest.mark.parametrize("bad", [np.zeros((4, 3)), np.ones((3, 3)), np.full((4, 3), np.nan)])
def test_normals_that_are_none_are_refused(bad):
    with pytest.raises(ValueError, match="normals must"):
        dl.Scene.from_arrays(*flat(1), normals=bad)


@pytest.mark.parametrize("options", [{"receivers": "faces"}, {"receivers": None}, {"normals": "round"}])
def test_other_words_are_refused(tmp_path, options):
    with pytest.raises(ValueError, match="expected (receivers|normals) to be"):
        made(tmp_path / "a.transport", scene(1), **options)


# --- pictures ---------------------------------------------------------------------------------------------------------


def test_a_picture_of_fine_vertices_is_that_of_pixels(tmp_path, vertices, pixels):
    """A mesh of about one triangle a pixel, direct light: within one percent (TRANSPORT 8)."""
    direct = made(tmp_path / "direct.transport", scene())
    env = dl.Environment.builtin("hall")
    theirs, ours = direct.image(response(direct, "hall"), env), vertices.image(response(vertices, "hall"), env)
    assert theirs.shape == ours.shape
    assert np.abs(ours - theirs).mean() < 0.01 * theirs.mean()


def test_any_camera_sees_the_same_light(vertices):
    env, B = white(), response(vertices, "hall")
    camera = dl.Camera((-2, 0.9, 0.3), (0, 0.2, 0), vertical_fov=50, width=24, height=18)
    first = vertices.render(camera, B, env)
    assert first.shape == (18, 24, 3) and np.array_equal(first, vertices.render(camera, B, env))
    # The albedo is that of the surface: twice the light, twice the picture.
    black = vertices.render(camera, B)
    np.testing.assert_allclose(vertices.render(camera, 2 * B), 2 * black, rtol=1e-5)
    assert (first >= black - 1e-6).all() and (first[0] > black[0]).any()
    # From below one sees the backs.
    below = dl.Camera((0.3, -3, 0.1), (0, 0, 0), up=(0, 0, 1), vertical_fov=30, width=9, height=9)
    under = vertices.receivers.normal[:, 1] < 0
    only = np.repeat(under[:, None], 3, axis=1).astype(np.float32)
    np.testing.assert_allclose(vertices.render(below, only)[4, 4], [0.5, 0.4, 0.3], rtol=1e-5)
    assert vertices.render(replace(camera, position=(0.1, 5, 0.1), target=(0.9, 0, 0.9)), only)[9, 12].max() == 0


def test_frames_of_vertices(vertices):
    env = dl.Environment.builtin("sky")
    frame = dl.Relighter(vertices, dl.PerBand(terms=30)).step(env)
    np.testing.assert_array_equal(frame.image, vertices.image(frame.values, env))
    np.testing.assert_array_equal(frame.colours, vertices.albedo * frame.values)
    camera = dl.Camera((2, 1, 0), (0, 0, 0), width=8, height=6)
    np.testing.assert_array_equal(frame.render(camera), vertices.render(camera, frame.values, env))


def test_bounces_reach_vertices(tmp_path, vertices):
    lit = made(tmp_path / "two.transport", scene(), receivers="vertices", bounces=2)
    assert lit.nodes > 20 and lit.bounces == 2
    direct, both = response(vertices), response(lit)
    assert (both >= direct - 1e-4).all()
    # Under the lid light comes from the ground.
    lid_below = (lit.receivers.position[:, 1] > 0.4) & (lit.receivers.normal[:, 1] < 0)
    assert (both[lid_below] > direct[lid_below] + 0.05).all()


@pytest.mark.parametrize("suffix", [".glb", ".ply"])
def test_colours_are_written_and_read_elsewhere(tmp_path, vertices, suffix):
    B, path = response(vertices), tmp_path / f"a{suffix}"
    vertices.save_colours(path, B, exposure=-1)
    mesh = trimesh.load(path, force="mesh", process=False)
    assert len(mesh.vertices) == len(B) and len(mesh.faces) == 2 * (2 * 40 * 40 + 2)
    np.testing.assert_allclose(mesh.vertices, vertices.receivers.position, atol=1e-6)
    # Each side is wound as it is seen.
    normals = vertices.receivers.normal[mesh.faces].mean(axis=1)
    assert (np.einsum("fk,fk->f", normals, mesh.face_normals) > 0.9).all()
    if suffix == ".ply":
        shown = to_display(vertices.colours(B) / 2)
        np.testing.assert_array_equal(mesh.visual.vertex_colors[:, :3], shown)
    else:
        length = int.from_bytes(path.read_bytes()[12:16], "little")
        document = json.loads(path.read_bytes()[20 : 20 + length])
        view = document["bufferViews"][document["meshes"][0]["primitives"][0]["attributes"]["COLOR_0"]]
        data = path.read_bytes()[28 + length + view["byteOffset"] :][: view["byteLength"]]
        np.testing.assert_array_equal(np.frombuffer(data, "<f4").reshape(-1, 3), vertices.colours(B) / 2)
    assert [entry.name for entry in tmp_path.iterdir()] == [path.name]


def test_other_files_are_refused(tmp_path, vertices):
    with pytest.raises(ValueError, match=r"\.glb or \.ply"):
        vertices.save_colours(tmp_path / "a.obj", response(vertices))
    with pytest.raises(ValueError, match="expected B of shape"):
        vertices.colours(np.zeros((3, 3)))
    with pytest.raises(FileNotFoundError):
        vertices.save_colours(tmp_path / "no" / "a.ply", response(vertices))
    assert list(tmp_path.iterdir()) == []


def test_what_is_buried_keeps_its_place_in_the_mesh(tmp_path):
    """A post that stands in a block: its foot is inside, shows the light above, and stays where it is."""

    def box(low, high):
        x = np.array([[i, j, k] for i in (0, 1) for j in (0, 1) for k in (0, 1)]) * (np.array(high) - low) + low
        sides = [(0, 1, 3, 2), (4, 5, 7, 6), (0, 1, 5, 4), (2, 3, 7, 6), (0, 2, 6, 4), (1, 3, 7, 5)]
        return x, [t for a, b, c, d in sides for t in ((a, b, c), (a, c, d))]

    points, triangles = oracles.merged(box((-1, -1, -1), (1, 0, 1)), box((-0.2, -0.5, -0.2), (0.2, 1.5, 0.2)))
    camera = dl.Camera((3, 2, 4), (0, 0.3, 0), vertical_fov=40, width=24, height=24)
    both = dl.Scene.from_arrays(points, triangles, camera=camera)
    transport = made(tmp_path / "a.transport", both, receivers="vertices")
    assert transport.receivers.buried.sum() == 12 and "12 buried vertices" in str(transport.plan)
    B = response(transport)
    transport.save_colours(tmp_path / "a.ply", B)
    mesh = trimesh.load(tmp_path / "a.ply", process=False)
    assert mesh.area == pytest.approx(triangle_areas(both).sum(), rel=1e-5)
    assert (transport.colours(B) > 0).all()
    with pytest.raises(ValueError, match="exposure"):
        transport.save_colours(tmp_path / "a.ply", B, exposure=2000)
    with pytest.raises(TypeError, match=r"expected a Camera, got 'front'; dl\.Camera"):
        transport.render("front", B)


def test_the_inside_of_what_is_closed_is_dark(tmp_path):
    box = trimesh.creation.box((2, 2, 2))
    inside = dl.Camera((0, 0, 0), (0, 0, -1), width=8, height=8)
    closed = dl.Scene.from_arrays(box.vertices, box.faces, camera=inside)
    transport = made(tmp_path / "a.transport", closed, receivers="vertices")
    assert len(transport.receivers) == 24
    B = response(transport)
    assert transport.image(B).max() == 0
    assert transport.render(dl.Camera((4, 3, 5), (0, 0, 0), width=8, height=8), B).max() > 0


# --- other cameras ----------------------------------------------------------------------------------------------------


def test_the_same_camera_gives_the_same_bits(tmp_path, pixels):
    again = pixels.for_camera(pixels.camera, tmp_path / "a.transport", progress=False)
    np.testing.assert_array_equal(response(again), response(pixels))
    assert again.nodes == pixels.nodes and again.bounces == 2 and again.plan.tolerance == pixels.plan.tolerance
    # And again from there.
    third = again.for_camera(pixels.camera, tmp_path / "b.transport", progress=False)
    np.testing.assert_array_equal(response(third), response(pixels))


def test_another_camera_is_near_what_is_made_for_it(tmp_path, pixels):
    camera = dl.Camera((-1.0, 1.4, 1.9), (0, 0.2, 0), vertical_fov=40, width=28, height=20)
    ours = pixels.for_camera(camera, tmp_path / "a.transport", progress=False)
    fresh = made(tmp_path / "b.transport", scene().with_camera(camera), bounces=2)
    env = dl.Environment.builtin("hall")
    a, b = ours.image(response(ours, "hall"), env), fresh.image(response(fresh, "hall"), env)
    assert a.shape == (20, 28, 3)
    direct = made(tmp_path / "c.transport", scene().with_camera(camera))
    indirect = b - direct.image(response(direct, "hall"), env)
    assert np.abs(a - b).mean() < 0.1 * np.abs(indirect).mean()


def test_runs_over_other_nodes_are_not_mixed(tmp_path, pixels, monkeypatch):
    """An interrupted run over the nodes of one transport leaves nothing to that over another one's."""
    more = made(tmp_path / "more.transport", scene(), bounces=6)
    camera = dl.Camera((-1.0, 1.4, 1.9), (0, 0.2, 0), vertical_fov=40, width=20, height=20)

    def stop(self, plan):
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr("deltalux.precomputation.run._Run.finish", stop)
        with pytest.raises(KeyboardInterrupt):
            pixels.for_camera(camera, tmp_path / "a.transport", progress=False)
    resumed = more.for_camera(camera, tmp_path / "a.transport", progress=False)
    fresh = more.for_camera(camera, tmp_path / "b.transport", progress=False)
    np.testing.assert_array_equal(response(resumed), response(fresh))


def test_questions_to_the_wrong_rows(tmp_path, pixels, vertices):
    B = response(pixels)
    for ask in (lambda: pixels.colours(B), lambda: pixels.render(pixels.camera, B)):
        with pytest.raises(ValueError, match="its rows are pixels"):
            ask()
    with pytest.raises(ValueError, match="its rows are vertices"):
        vertices.for_camera(pixels.camera, tmp_path / "a.transport")
    assert list(tmp_path.iterdir()) == []


def test_a_truncated_transport_keeps_its_scene(tmp_path, vertices):
    less = vertices.truncated(tmp_path / "less.transport", 0.05)
    camera = dl.Camera((2, 1, 0), (0, 0, 0), width=8, height=6)
    B = response(vertices)
    np.testing.assert_array_equal(less.render(camera, B), vertices.render(camera, B))


def test_a_file_from_before_has_no_scene():
    old = dl.Transport.open(Path(__file__).parent / "stored" / "version1.transport")
    with pytest.raises(ValueError, match="made before 0.5"):
        _ = old.surface


def test_another_scene_beside_it_is_refused(tmp_path, vertices, pixels):
    folder = tmp_path / "a.transport"
    one = made(folder, scene(3), receivers="vertices")
    other = made(tmp_path / "b.transport", scene(2), receivers="vertices")
    assert one.surface.arrays().keys() == other.surface.arrays().keys()
    # Whole by its checksum, but not what the manifest was made of.
    shutil.copy(tmp_path / "b.transport" / "scene.safetensors", folder)
    manifests = [json.loads((path / "manifest.json").read_text()) for path in (folder, tmp_path / "b.transport")]
    manifests[0]["beside"] = manifests[1]["beside"]
    # As before version 2.2, which gave a manifest a digest of its own.
    manifests[0]["version"] = [2, 1]
    del manifests[0]["digest"]
    (folder / "manifest.json").write_text(json.dumps(manifests[0]))
    forged = dl.Transport.open(folder)
    with pytest.raises(dl.FileError, match="scene"):
        forged.image(np.zeros((forged.shape[0], 3)))


def test_surfaces_come_back_as_they_were(tmp_path):
    picture = np.random.default_rng(1).random((4, 6, 3)).astype(np.float32)
    base = scene(2)
    uv = np.random.default_rng(2).random((len(base.vertices), 2)).astype(np.float32)
    textured = replace(base, textures=(picture,), uv=uv)
    transport = made(tmp_path / "a.transport", textured, receivers="vertices")
    assert transport.surface.digest(repr(base.camera)) == textured.content_hash()
    np.testing.assert_array_equal(transport.surface.textures[0], picture)
    at = ([0, 1], [[0.2, 0.3], [0.1, 0.6]])
    np.testing.assert_array_equal(transport.surface.albedo_at(*at), textured.albedo_at(*at))


# --- refinement -------------------------------------------------------------------------------------------------------


def test_refinement_splits_where_a_shadow_falls(tmp_path):
    coarse = scene(2)
    fine = refined(coarse, 0.004, "smooth")
    assert 200 < len(fine.triangles) < 20_000
    # The same surface: no area is lost, no corner hangs on a neighbour's edge, materials stay.
    area = [triangle_areas(s).sum() for s in (coarse, fine)]
    assert area[0] == pytest.approx(area[1], rel=1e-12)
    ground = fine.triangles[(fine.vertices[fine.triangles][:, :, 1] == 0).all(axis=1)]
    places = np.unique(fine.vertices, axis=0, return_inverse=True)[1].reshape(-1)[ground]
    edges = np.sort(np.stack([places, np.roll(places, -1, axis=1)], -1).reshape(-1, 2), axis=1)
    edges, count = np.unique(edges, axis=0, return_counts=True)
    corners = np.unique(fine.vertices, axis=0)[edges]
    border = (np.abs(corners[:, :, [0, 2]]) == 1.0).all(axis=1).any(axis=1)
    assert (count[~border] == 2).all() and (count[border] == 1).all()
    # Finest near the lid's shadow, coarse at the rim.
    middle = fine.vertices[ground].mean(axis=1)
    near = np.linalg.norm(middle[:, [0, 2]], axis=1) < 0.6
    assert np.mean(triangle_areas(fine)[: len(ground)][near]) < 0.5 * np.mean(
        triangle_areas(fine)[: len(ground)][~near]
    )
    plain = made(tmp_path / "a.transport", coarse, receivers="vertices")
    better = made(tmp_path / "b.transport", coarse, receivers="vertices", refine=0.004)
    truth = made(tmp_path / "c.transport", coarse)
    pictures = [t.image(response(t)) for t in (plain, better, truth)]
    off = [np.abs(picture - pictures[2]).mean() for picture in pictures[:2]]
    assert off[1] < 0.3 * off[0] and "triangles of refinement" in str(better.plan)


def triangle_areas(of: dl.Scene) -> np.ndarray:
    p = of.vertices[of.triangles]
    return 0.5 * np.linalg.norm(np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]), axis=1)


@pytest.mark.parametrize("refine", [0, -1.0, 2.0, "fine", True, float("nan")])
def test_refinement_is_checked(tmp_path, refine):
    with pytest.raises(ValueError, match="refine"):
        made(tmp_path / "a.transport", scene(1), receivers="vertices", refine=refine)


def test_pixels_are_not_refined(tmp_path):
    with pytest.raises(ValueError, match="refine with receivers"):
        made(tmp_path / "a.transport", scene(1), refine=0.1)
