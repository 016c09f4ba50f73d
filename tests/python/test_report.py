"""The report and the demo, end to end on tiny transports; its measures against plain numpy."""

import csv
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import deltalux as dl
import numpy as np
import pytest
from deltalux.command import cli
from deltalux.light.motion import Motion, ease
from deltalux.pages import machine
from deltalux.relight.errors import relative_errors
from deltalux.report import METHODS, check_report, report
from deltalux.report.size_curve import size_curve
from hypothesis import given
from hypothesis import strategies as st

# Most of them look at one demo, which takes seven seconds.
pytestmark = pytest.mark.slow


def rows_of(path):
    with open(path, newline="") as file:
        return list(csv.DictReader(file))


@pytest.fixture(scope="module")
def demo(tmp_path_factory):
    """The demo, very small."""
    folder = tmp_path_factory.mktemp("demo") / "deltalux-demo"
    settings = ["--size", "44x36", "--columns", "haar:8", "--frames", "8", "--hold", "3"]
    assert cli.main(["demo", "-o", str(folder), *settings]) == 0
    return folder


def test_demo_leaves_everything_it_promises(demo):
    names = {path.name for path in demo.iterdir()}
    for env in ("1-sky", "2-hall"):
        kinds = (
            "animation.webp",
            "error-against-frame.png",
            "error-against-time.png",
            "resets.png",
            "strip.png",
            "terms.png",
        )
        assert {f"{env}-{kind}" for kind in kinds} <= names
        for suffix in (".png", ".exr"):
            assert len(list(demo.glob(f"{env}-frame-*-exact{suffix}"))) == 4
            assert len(list(demo.glob(f"{env}-frame-*-PBI-30{suffix}"))) == 4
    assert {
        "index.html",
        "frames.csv",
        "methods.csv",
        "bytes.csv",
        "error-against-bytes.png",
        "plant.transport",
    } <= names
    assert all(path.stat().st_size > 0 for path in demo.iterdir())
    assert (demo / "live" / "index.html").is_file()
    assert all(path.stat().st_size < 5_000_000 for path in demo.glob("*.webp"))
    assert not list(demo.glob("**/*.pickle")) and not list(demo.glob("**/*.pkl"))


def test_the_page_is_well_formed_self_contained_and_complete(demo):
    page = ElementTree.parse(demo / "index.html")
    linked = [node.get("src") or node.get("href") for node in page.iter() if node.get("src") or node.get("href")]
    files = {link for link in linked if not link.startswith("#")}
    assert files and all((demo / name).is_file() for name in files), files
    assert all((demo / f"{env}-animation.webp").name in files for env in ("1-sky", "2-hall"))
    anchors = {node.get("id") for node in page.iter() if node.get("id")}
    assert {link[1:] for link in linked if link.startswith("#")} <= anchors
    text = "".join(page.getroot().itertext())
    assert "release build" in text and "bit for bit" in text and "19,169,280" in text
    assert not any(node.tag in ("script", "link", "iframe") for node in page.iter())


def test_the_reference_has_no_error_and_the_rest_has(demo):
    rows = rows_of(demo / "frames.csv")
    assert len(rows) == 2 * len(METHODS) * 11
    errors = ("light_l1", "light_l2", "image_l1", "image_l2", "image_worst")
    first = [row for row in rows if row["method"] == METHODS[0].name]
    assert all(float(row[name]) == 0.0 for row in first for name in errors)
    turning = [row for row in rows if row["method"] == "NWA-10" and int(row["frame"]) > 0]
    assert all(float(row[name]) > 0.0 for row in turning for name in errors)
    assert all(row["within_bound"] == "True" for row in rows)
    assert all(float(row["seconds_1"]) > 0 and float(row["seconds_2"]) > 0 for row in rows)


def test_methods_are_ordered_and_summaries_are_means_of_frames(demo):
    rows, frames = rows_of(demo / "methods.csv"), rows_of(demo / "frames.csv")
    assert [row["method"] for row in rows[: len(METHODS)]] == [row.name for row in METHODS]
    for row in rows:
        own = [f for f in frames if (f["environment"], f["method"]) == (row["environment"], row["method"])]
        turning = [float(f["image_l2"]) for f in own if 0 < int(f["frame"]) <= 7]
        assert float(row["image_l2_mean"]) == pytest.approx(np.mean(turning))
        assert float(row["p50_ms_1"]) == pytest.approx(
            1e3 * np.median([float(f["seconds_1"]) for f in own[1:8]]), rel=1e-3
        )
        assert 0 < float(row["p50_ms_1"]) <= float(row["p95_ms_1"])
        assert int(row["transport_bytes"]) > 0 and int(row["relighter_bytes"]) > 0
    by_name = {row["method"]: row for row in rows[: len(METHODS)]}
    assert float(by_name["NWA-300"]["image_l2_mean"]) < float(by_name["NWA-10"]["image_l2_mean"])


def test_the_page_begins_with_the_light_under_which_methods_differ_most(demo):
    rows = rows_of(demo / "methods.csv")
    means = {(row["environment"], row["method"]): float(row["image_l2_mean"]) for row in rows}
    spans = {}
    for env in dict.fromkeys(row["environment"] for row in rows):
        errors = [means[env, method] for method in ("NWA-30", "BI-30", "PBI-30")]
        spans[env] = max(errors) - min(errors)
    assert len(spans) == 2 and list(spans.values()) == sorted(spans.values(), reverse=True)


def test_bytes_fall_and_errors_rise_with_truncation(demo):
    rows = rows_of(demo / "bytes.csv")
    curve, own = rows[:-1], rows[-1]
    megabytes = [float(row["megabytes"]) for row in curve]
    assert megabytes == sorted(megabytes) and len(set(megabytes)) == len(megabytes) > 3
    assert curve[-1]["truncation"] == "lossless"
    for name in ("image_l2_sky", "image_l2_hall", "sun_l2_mean", "sun_l2_worst"):
        assert float(curve[-1][name]) == 0.0 < float(curve[0][name])
    assert own["extrapolated"] == "False"
    assert float(own["megabytes"]) * 1e6 == pytest.approx(dl.Transport.open(demo / "plant.transport").nbytes)


def test_size_curve_without_an_audit_is_empty(demo):
    class Bare:
        audit = None

    assert size_curve(Bare, [], Motion()) == []


def test_a_report_may_be_written_again_but_not_over_others(demo, tmp_path):
    transport = dl.Transport.open(demo / "plant.transport")
    env = dl.Environment.builtin("studio")
    settings = {"frames": 4, "hold": 1, "progress": False}
    page = report(transport, env, tmp_path / "new", **settings)
    assert page == tmp_path / "new" / "index.html"
    check_report(env, tmp_path / "new", Motion(frames=4, hold=1))
    (tmp_path / "theirs").mkdir()
    (tmp_path / "theirs" / "index.html").write_text("mine")
    with pytest.raises(OSError, match=r"index\.html"):
        report(transport, env, tmp_path / "theirs", **settings)
    assert (tmp_path / "theirs" / "index.html").read_text() == "mine"


def test_a_debug_build_is_refused(monkeypatch, tmp_path, demo):
    monkeypatch.setattr(machine, "DEBUG_BUILD", True)
    with pytest.raises(ValueError, match="release build"):
        report(dl.Transport.open(demo / "plant.transport"), dl.Environment.builtin("sky"), tmp_path / "x")
    assert not (tmp_path / "x").exists()


def test_progress_stops_the_report(demo, tmp_path):
    def stop(done, total):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        report(
            dl.Transport.open(demo / "plant.transport"), dl.Environment.builtin("sky"), tmp_path / "x", progress=stop
        )
    assert not (tmp_path / "x" / "index.html").exists()


@given(st.integers(1, 60), st.integers(0, 9), st.floats(-720, 720))
def test_motion_starts_at_rest_ends_at_rest_and_holds(frames, hold, rotate):
    angles = Motion(rotate, frames, hold).angles
    assert len(angles) == frames + hold and angles[0] == 0.0
    assert angles[-1] == (rotate if frames > 1 else 0.0) and len(set(angles[frames - 1 :])) == 1
    assert np.all(np.diff(angles) * np.sign(rotate) >= 0)


def test_ease_is_the_published_profile():
    t = np.linspace(0, 1, 11)
    assert [ease(float(x)) for x in t] == pytest.approx(list(3 * t**2 - 2 * t**3))


def test_relative_errors_by_hand():
    # |d| = 1, 0, 2; |exact| sums to 6; squares: 5 of 14; the root mean square of exact is sqrt(14 / 3).
    found, exact = np.array([2.0, 2.0, 1.0]), np.array([1.0, 2.0, 3.0])
    assert relative_errors(found, exact) == pytest.approx((3 / 6, np.sqrt(5 / 14), 2 / np.sqrt(14 / 3)))
    assert relative_errors(exact, exact) == (0.0, 0.0, 0.0)
    assert relative_errors(np.zeros(3), np.zeros(3)) == (0.0, 0.0, 0.0)
    assert relative_errors(exact, np.zeros(3))[0] == np.inf


def test_every_file_of_the_package_is_free_of_pickle():
    package = Path(dl.__file__).parent
    assert not [path.name for path in package.glob("*.py") if "pickle" in path.read_text()]
