"""The studies of light between surfaces and of the slides on transfer: what they measure, against what is known."""

from __future__ import annotations

import deltalux as dl
import numpy as np
import oracles
import pytest
from deltalux.command import cli
from deltalux.light.motion import Motion
from deltalux.studies import study
from deltalux.studies.harmonics.projection import HarmonicView
from deltalux.studies.interreflection import furnaces, slides
from deltalux.studies.interreflection.basis_images import error_of_sum, haar_images, harmonic_images
from deltalux.studies.interreflection.bounce_claims import claims
from deltalux.studies.interreflection.bounce_findings import Findings, Shot
from deltalux.studies.interreflection.furnaces import Furnace
from deltalux.studies.interreflection.tracing import tracing
from deltalux.transport.plan import Solve

HALL = dl.Environment.builtin("hall")
WHITE = dl.Environment.from_cubemap(np.ones((6, 2, 2, 3), np.float32))
SHORT = Motion(rotate=20.0, frames=8, hold=0)


def silent(done, total):
    assert 0 <= done <= total


# --- Light without shadows.


def test_light_without_shadows_is_what_a_surface_that_sees_the_sky_receives(make):
    """A floor alone casts no shadow, and under a constant sky every surface receives 1."""
    floor = oracles.quad((-1, 0, -1), (2, 0, 0), (0, 0, 2))
    camera = dl.Camera((0.2, 3, 0.3), (0, 0, 0), vertical_fov=30, width=6, height=6)
    transport = make(dl.Scene.from_arrays(*floor, (0.5, 0.5, 0.5), camera), 16)
    found = slides.unshadowed(HALL, transport.receivers.normal)
    np.testing.assert_allclose(found, transport.multiply(transport.coefficients(HALL)), rtol=5e-3)
    around = np.random.default_rng(3).normal(size=(2000, 3)).astype(np.float32)
    around /= np.linalg.norm(around, axis=1, keepdims=True)
    np.testing.assert_allclose(slides.unshadowed(WHITE, around), 1, rtol=1e-3)


# --- Images of single basis functions.


def test_images_of_basis_functions_are_columns_of_the_transport(cornell):
    view = HarmonicView.of(cornell, 4)
    degrees = harmonic_images(cornell, view)
    assert [len(line) for line in degrees] == [1, 3, 5, 7]
    assert [image.column for line in degrees for image in line] == list(range(16))
    surface = cornell.pixels.background < 1
    for image in (degrees[0][0], degrees[2][1]):
        wanted = cornell.image(np.repeat(view.rows[:, [image.column]], 3, axis=1)).mean(axis=2)
        np.testing.assert_allclose(image.picture[surface], wanted[surface], rtol=1e-5, atol=1e-7)
        assert np.isnan(image.picture[~surface]).all()
    # Y_1 is sqrt(3 / 4 pi) (y, z, x): light from above, which a box under the sky receives from one side only.
    up = degrees[1][0].function
    assert (up[2] > 0).all() and (up[3] < 0).all() and np.nanmax(degrees[1][0].picture) > 0


def test_wavelets_that_are_shown_are_the_strongest_of_three_faces(cornell):
    norms, bands = cornell.column_norms, haar_images(cornell)
    assert len(bands) == 3 and all(len(band) == 3 for band in bands)
    for number, band in enumerate(bands):
        columns = [image.column for image in band]
        assert (cornell.columns.bands[columns] == number).all()
        faces = [int(np.square(image.function).sum(axis=(1, 2)).argmax()) for image in band]
        assert len(set(faces)) == 3
        own = cornell.columns.bands == number
        if number:
            assert norms[columns[0]] == norms[own].max()
        assert (np.diff(norms[columns]) <= 0).all()
    assert all((band[0].function != 0).sum() <= 64 >> 2 * max(k - 1, 0) for k, band in enumerate(bands))


def test_a_picture_is_the_sum_of_its_basis_images(cornell):
    images = [image for band in haar_images(cornell) for image in band]
    V = cornell.coefficients(HALL)
    assert error_of_sum(cornell, V, images) < 1e-6
    # One image the wrong way round is another picture.
    wrong = [images[0]._replace(picture=-images[0].picture), *images[1:]]
    assert error_of_sum(cornell, V, wrong) > 0.1


# --- Rooms that light hardly leaves.


@pytest.mark.slow
def test_a_furnace_is_proved_and_a_sphere_is_as_on_paper(monkeypatch):
    monkeypatch.setattr(furnaces, "ALBEDOS", (0.9,))
    with tracing(silent, 4) as traced:
        (room,) = furnaces.measure(traced, "corridor 1:16")
        assert 0 < room.error <= room.solve.residual <= 1e-3 and room.solve.method == "BiCGStab"
        half, bright = furnaces.measure_ball(traced)
    # E = h / (1 - (1 - h) rho), of a cap above 0.9 of the radius: h = (1 - 0.9) / 2.
    for ball in (half, bright):
        assert ball.known == pytest.approx(0.05 / (1 - 0.95 * ball.albedo), rel=0.02) and ball.error < 0.02


# --- What is said of bounces.


def solved(residual=1e-3):
    return Solve("Neumann", 100, (3, 4, 5), residual, (0.7, 0.3), 0.1, 0.0, (0.05, 0.1, 0.3))


def findings(pictures, furnace_error=1e-4):
    """Made by hand: one value of a pixel for each number of bounces."""
    whole = pictures["all"]
    shots = {
        bounces: Shot(np.full((1, 1, 3), value, np.float32), abs(value / whole - 1), 1 - value / whole, 1.0, 100, None)
        for bounces, value in pictures.items()
    }
    rooms = [Furnace("cube", 0.9, solved(), furnace_error)]
    return Findings(shots, [], [1.0, 1.05], [0.2, 0.1], rooms, [furnaces.Ball(0.5, 0.0962, 0.0962)])


def test_shares_of_bounces():
    found = findings({0: 4.0, 1: 6.0, 2: 7.0, 6: 7.9, "all": 8.0})
    assert [name for name, _ in found.steps()] == ["1", "2", "3 to 6", "beyond 6"]
    assert [share for _, share in found.steps()] == pytest.approx([0.5, 0.25, 0.225, 0.025])


def test_verdicts_follow_the_figures():
    good = {0: 4.0, 1: 6.0, 2: 7.0, 6: 7.95, "all": 8.0}
    assert [claim.holds for claim in claims(findings(good))] == [True] * 5
    slow = findings({**good, 6: 7.0}, furnace_error=2e-3)
    verdicts = claims(slow)
    assert [claim.holds for claim in verdicts] == [True, True, False, False, True]
    assert "from all on" in verdicts[2].figures and all(claim.why for claim in verdicts)


# --- The studies on small scenes.


def room(colours):
    """A floor and a wall."""
    vertices, triangles = oracles.merged(
        oracles.quad((-1, 0, -1), (2, 0, 0), (0, 0, 2)), oracles.quad((-1, 0, -1), (2, 0, 0), (0, 2, 0))
    )
    camera = dl.Camera((3, 2.5, 4), (-0.3, 0.7, -0.3), vertical_fov=40, width=12, height=12)
    return dl.Scene.from_arrays(vertices, triangles, np.repeat(colours, 2, axis=0), camera, name="room")


def verdict_of(page, words):
    """The table's line whose claim begins like this."""
    (line,) = [line for line in page.read_text().split("<tr>") if f"<td>{words}" in line]
    return line


def test_grey_scenes_need_one_channel(tmp_path):
    given = {"motion": SHORT, "columns": dl.Haar(4), "progress": False}
    grey = study("slides", tmp_path / "grey", HALL, scene=room([(0.6, 0.6, 0.6), (0.3, 0.3, 0.3)]), **given)
    line = verdict_of(grey, "For shadows one transfer vector")
    assert "does not hold" in line and "is off by 0 %" in line
    red = study("slides", tmp_path / "red", HALL, scene=room([(0.6, 0.6, 0.6), (0.7, 0.1, 0.1)]), **given)
    assert ">holds<" in verdict_of(red, "For shadows one transfer vector")
    for page in (grey, red):
        assert ">holds<" in verdict_of(page, "Shadows only take light away")
        assert ">holds<" in verdict_of(page, "A picture is the sum")


def test_a_scene_that_does_not_see_itself_has_no_bounces(tmp_path):
    floor = oracles.quad((-1, 0, -1), (2, 0, 0), (0, 0, 2))
    camera = dl.Camera((0, 3, 0.1), (0, 0, 0), vertical_fov=40, width=8, height=8)
    scene = dl.Scene.from_arrays(*floor, (0.5, 0.5, 0.5), camera, name="floor")
    with pytest.raises(ValueError, match="none of floor sees another"):
        study("bounces", tmp_path / "out", HALL, scene=scene, motion=SHORT, columns=dl.Haar(2), progress=False)


def test_from_the_command_line(tmp_path, capsys):
    out, scene = tmp_path / "out", room([(0.6, 0.6, 0.6), (0.7, 0.1, 0.1)])
    corners = "".join(f"v {x} {y} {z}\n" for x, y, z in scene.vertices)
    faces = "".join(f"f {a} {b} {c}\n" for a, b, c in scene.triangles + 1)
    (tmp_path / "room.obj").write_text(corners + faces)
    settings = ["--columns", "haar:4", "--frames", "8", "--hold", "0", "--size", "16x12"]
    assert cli.main(["study", "slides", "--scene", str(tmp_path / "room.obj"), *settings, "-o", str(out)]) == 0
    assert {"1-hall-on-room-transfers.png", "index.html"} <= {path.name for path in out.iterdir()}
    # It traces into a folder that is gone when it ends.
    assert not list(out.glob("*.transport"))
    capsys.readouterr()
    (tmp_path / "a.transport").mkdir()
    for scene, message in ((str(tmp_path / "a.transport"), "expected a scene, got the transport"), ("no", "got 'no'")):
        assert cli.main(["study", "slides", "--scene", scene, "-o", str(tmp_path / "none")]) == 2
        assert message in capsys.readouterr().err
    assert not (tmp_path / "none").exists()
