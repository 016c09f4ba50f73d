"""The built-in scenes: sound geometry, the same every time, and in view of their cameras."""

import numpy as np
import pytest
from deltalux.camera import Camera
from deltalux.scene.scene import Scene

# Triangles from and to, and materials at least.
EXPECTED = {"plant": (60_000, 90_000, 10), "cornell": (40, 40, 3), "still-life": (20_000, 80_000, 10),
            "street": (20_000, 90_000, 10)}  # fmt: skip


@pytest.fixture(scope="module", params=EXPECTED)
def scene(request):
    return Scene.builtin(request.param)


def test_geometry_is_sound(scene):
    low, high, materials = EXPECTED[scene.name]
    assert low <= len(scene.triangles) <= high and len(scene.albedo) >= materials
    assert np.isfinite(scene.vertices).all()
    assert sum(scene.counts.values()) == 0 and scene.warnings == ()
    # No triangle thinner than what a float32 tracer can tell from a line.
    p0, p1, p2 = scene.vertices[scene.triangles].transpose(1, 0, 2)
    area = np.linalg.norm(np.cross(p1 - p0, p2 - p0), axis=1)
    assert area.min() > 1e-10
    assert np.unique(scene.material).tolist() == list(range(len(scene.albedo)))
    assert scene.albedo.min() > 0.01 and scene.albedo.max() < 0.9


def test_same_every_time(scene):
    again = Scene.builtin(scene.name)
    assert again is not scene and again.content_hash() == scene.content_hash()
    # On the grid the last bits of a processor's sines do not matter.
    assert (scene.vertices * 2.0**20 == np.round(scene.vertices * 2.0**20)).all()


def test_camera_sees_the_scene(scene):
    """Most triangles lie inside the picture, and spread over most of it."""
    camera = scene.camera
    right, up, forward = camera.basis()
    seen = scene.vertices[scene.triangles].mean(axis=1) - camera.position
    depth = seen @ forward * np.tan(np.radians(camera.vertical_fov) / 2)
    x, y = seen @ right / depth, seen @ up / depth
    inside = (depth > 0) & (np.abs(x) < camera.width / camera.height) & (np.abs(y) < 1)
    assert inside.mean() > 0.6
    cells = {(int(a), int(b)) for a, b in zip(x[inside] * 2 // 1, y[inside] * 2 // 1, strict=True)}
    assert len(cells) >= 10
    assert (camera.width, camera.height) == (512, 512)


def test_another_camera_and_another_name():
    camera = Camera((0, 1, 3), (0, 1, 0))
    assert Scene.builtin("cornell", camera).camera == camera
    with pytest.raises(ValueError, match="expected a built-in scene of plant, cornell, still-life, street"):
        Scene.builtin("plants")


def test_cornell_lets_light_in():
    """The front and the skylight are open: no triangle covers the middle of either."""
    scene = Scene.builtin("cornell")
    corners = scene.vertices[scene.triangles]
    assert not (corners[:, :, 2] == 1.0).all(axis=1).any()
    ceiling = corners[(corners[:, :, 1] == 2.0).all(axis=1)]
    area = np.linalg.norm(np.cross(ceiling[:, 1] - ceiling[:, 0], ceiling[:, 2] - ceiling[:, 0]), axis=1).sum() / 2
    assert area == pytest.approx(4.0 - 1.0)
