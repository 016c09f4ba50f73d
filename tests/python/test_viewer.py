"""The live view without a browser: what it sends, what it takes, and whom it lets in."""

import gc
import io
import json
import resource
import socket
import sys
import time
from pathlib import Path

import deltalux as dl
import numpy as np
import pytest
from deltalux.io import load_image, to_display
from deltalux.viewer.lights import Group, Lights
from deltalux.viewer.messages import packed
from deltalux.viewer.relit import Relit
from deltalux.viewer.wavelets import squares
from pages import page, welcomed

websockets = pytest.importorskip("websockets", reason="the live view needs websockets")
from websockets.exceptions import ConnectionClosed, InvalidStatus  # noqa: E402
from websockets.sync.client import connect  # noqa: E402


@pytest.fixture(scope="module")
def transport(tmp_path_factory):
    scene = dl.Scene.builtin("cornell")
    scene = scene.with_camera(scene.camera.resized(32, 24))
    path = tmp_path_factory.mktemp("view") / "cornell.transport"
    return dl.precompute(scene, path, columns=dl.Haar(8), progress=False)


@pytest.fixture
def view(transport):
    with dl.view(transport, browser=False, port=0) as view:
        yield view


def turned(light, degrees):
    half = np.radians(degrees) / 2
    groups = [{**light["groups"][0], "turn": [0.0, float(np.sin(half)), 0.0, float(np.cos(half))]}]
    return {**light, "groups": groups}


def test_a_page_shows_what_the_light_that_it_sets_gives(view, transport):
    with page(view) as own:
        light = welcomed(own)["state"]["light"]
        own.send(state={"light": turned(light, 40.0)})
        own.read(lambda header: header.get("kind") == "frame" and header["stats"] is not None)
        shown = own.still()
        env = dl.Environment.builtin("hall").rotated(40.0)
        exact = transport.image(transport.multiply(transport.coefficients(env)), env)
        assert np.abs(shown - exact).max() <= 2e-6 * exact.max()


def test_a_saved_exr_has_the_bits_of_the_product_of_the_light_as_applied(view, transport, tmp_path):
    with page(view) as own:
        light = welcomed(own)["state"]["light"]
        own.send(state={"light": turned(light, 20.0), "background": "none"})
        own.send(state={"light": turned(light, 60.0)})
        own.still()
        own.send(save={"kind": "exr"})
        header, parts = own.read(lambda header: header.get("kind") == "file")
        file = tmp_path / header["name"]
        file.write_bytes(parts["file"][0][1])
        _, relighter = view._stage.subject._relighters["a"]
        assert np.array_equal(load_image(file)[0], transport.image(transport.multiply(relighter.values)))


def test_moving_light_arrives_in_strips_and_says_how_wrong_it_is(view):
    with page(view) as own:
        light = welcomed(own)["state"]["light"]
        own.still()
        own.send(want={"layers": ["exact", "bound"], "maps": True})
        sent = []
        for degrees in range(3, 30, 3):
            own.send(state={"light": turned(light, float(degrees))})
            header, _ = own.read(lambda header: header.get("kind") == "frame" and header["stats"] is not None)
            stats = header["stats"]
            sent.append(len(stats["a"]["sent"]))
            assert stats["a"]["pending"] >= 0 and stats["a"]["truncation"] > 0
        own.still()
        while (own.stats.get("error") or 1.0) > 1e-4:
            own.read(lambda header: header.get("stats"))
        # A frame that is only looked at anew sends nothing.
        assert 0 < max(sent) <= 300
        assert {"maps", "strip"} <= set(own.kinds)
        difference = np.abs(own.layers["a"] - own.layers["exact"])
        assert (difference <= 2e-3 * own.layers["exact"].max()).all()
        assert own.layers["bound"].shape == own.layers["a"].shape


def test_no_more_than_two_messages_are_unanswered(view):
    with page(view) as own:
        light = welcomed(own)["state"]["light"]
        own.still()
        own.acks = False
        for degrees in range(5, 60, 5):
            own.send(state={"light": turned(light, float(degrees))})
            time.sleep(0.03)
        before = len(own.kinds)
        with pytest.raises(TimeoutError):
            own.read(lambda header: False, seconds=0.5)
        # The light beside them keeps no picture waiting: one strip, and maps where they are wanted.
        assert own.kinds[before:].count("frame") <= 2 and own.kinds[before:].count("strip") <= 1


def test_frozen_light_waits_for_steps(view):
    with page(view) as own:
        light = welcomed(own)["state"]["light"]
        own.still()
        own.send(state={"frozen": True, "light": turned(light, 90.0)})
        number = view._stage.shot.number
        time.sleep(0.2)
        assert view._stage.shot.number == number
        own.send(step=1)
        header, _ = own.read(lambda header: (header.get("stats") or {}).get("number", 0) == number + 1)
        assert header["stats"]["a"]["columns"] == 30
        time.sleep(0.1)
        assert view._stage.shot.number == number + 1


def test_two_pages_share_one_state_and_one_that_dies_harms_nobody(view):
    with page(view) as one, page(view) as two:
        light = welcomed(one)["state"]["light"]
        welcomed(two)
        two.socket.socket.shutdown(socket.SHUT_RDWR)
        one.send(state={"light": turned(light, 12.0)})
        assert one.still().max() > 0
        with page(view) as three:
            assert welcomed(three)["state"]["light"]["groups"][0]["turn"][1] == pytest.approx(np.sin(np.radians(6.0)))
            one.send(state={"light": turned(light, 80.0)})
            header, _ = three.read(lambda header: "state" in header)
            assert header["by"] == 1
            found = header["state"]["light"]["groups"][0]
            assert found["turn"] == pytest.approx(turned(light, 80.0)["groups"][0]["turn"])


BAD = [
    {"state": {"light": {"groups": [{"id": "x", "kind": "moon"}]}}},
    {"state": {"light": {"groups": [{"id": "a/b", "kind": "paint"}]}}},
    {"state": {"light": {"groups": [{"id": "a", "kind": "environment", "source": "/etc/passwd"}]}}},
    {"state": {"light": {"groups": [{"id": "a", "kind": "lamp", "azimuth": 1e99, "elevation": 0, "radius": 1}]}}},
    {"state": {"light": {"blend": {"source": "nowhere", "t": 0.5}}}},
    {"state": {"light": {"groups": "all"}}},
    {"state": {"method": {"a": {"name": "pbi", "budget": "terms", "amount": -3}}}},
    {"state": {"method": {"a": {"name": "__class__"}}}},
    {"state": {"background": "file"}},
    {"state": {"frozen": "yes"}},
    {"state": {"unheard": 1}},
    {"state": []},
    {"paint": {"id": "light", "points": [[0, 0]], "radius": 3, "colour": [1, 1, 1]}},
    {"look": [1e9, 2]},
    {"look": [-5, 2]},
    {"save": {"kind": "exe"}},
    {"save": {"kind": "png", "exposure": None}},
    {"open": {"format": "another"}},
    {"want": {"layers": ["secret"]}},
    {"curve": "x"},
    {"run": "rm -rf /"},
    [],
    {"state": {"light": {"groups": [{"id": "a", "kind": "paint", "gain": {"a": [[[[[[[[[[[[1]]]]]]]]]]]]}}]}}},
]


@pytest.mark.parametrize("bad", BAD, ids=[json.dumps(bad)[:60] for bad in BAD])
def test_what_cannot_be_done_is_a_sentence_and_changes_nothing(view, bad):
    with page(view) as own:
        welcomed(own)
        before = view._stage.state()
        own.socket.send(json.dumps(bad))
        header, _ = own.read(lambda header: "problem" in header)
        assert header["problem"].strip() and "Traceback" not in header["problem"]
        assert view._stage.state() == before
        # And all goes on.
        own.send(save={"kind": "python"})
        own.read(lambda header: "text" in header)


def test_paint_and_lamps_are_light(view, transport):
    with page(view) as own:
        welcomed(own)
        before = own.still().max()
        groups = [
            {"id": "s", "kind": "lamp", "azimuth": 30.0, "elevation": 50.0, "radius": 8.0, "gain": 2.0},
            {"id": "p", "kind": "paint", "tint": [1.0, 0.5, 0.25]},
        ]
        own.send(state={"light": {"groups": groups}, "background": "none"})
        own.send(paint={"id": "p", "points": [[0, 40], [4, 41]], "radius": 5, "colour": [3, 3, 3]})
        shown = own.still()
        env = dl.Environment.disc(30.0, 50.0, 8.0) * 4.0
        dabs = [(0.0, 40.0, 5.0, (3.0, 3.0, 3.0)), (4.0, 41.0, 5.0, (3.0, 3.0, 3.0))]
        env += dl.Environment.painted(dabs) * (1.0, 0.5, 0.25)
        exact = transport.image(transport.multiply(transport.coefficients(env)))
        # The brighter light before has left the last bits of itself (`Relighter(steady=)`).
        assert np.abs(shown - exact).max() <= 2e-6 * before and exact.max() > 1e3 * 2e-6 * before


def test_a_session_is_opened_again(view, transport):
    with page(view) as own:
        light = welcomed(own)["state"]["light"]
        groups = [*turned(light, 33.0)["groups"], {"id": "p", "kind": "paint", "gain": 1.0}]
        own.send(state={"light": {"groups": groups}})
        own.send(paint={"id": "p", "points": [[10, 20]], "radius": 5, "colour": [3, 2, 1]})
        own.still()
        own.send(save={"kind": "session", "view": {"exposure": 1.5}})
        _, parts = own.read(lambda header: header.get("kind") == "file")
        session = json.loads(parts["file"][0][1])
    with dl.view(transport, browser=False, port=0) as other, page(other) as own:
        welcomed(own)
        own.send(open=session)
        header, _ = own.read(lambda header: "view" in header)
        assert header["view"] == {"exposure": 1.5}
        assert other._stage.subject.lights == view._stage.subject.lights


def test_copied_programs_make_the_picture(view, transport, tmp_path, monkeypatch):
    with page(view) as own:
        light = welcomed(own)["state"]["light"]
        lamp = {"id": "s", "kind": "lamp", "azimuth": 30.0, "elevation": 50.0, "radius": 8.0, "gain": 1.0}
        own.send(state={"light": {"groups": [*turned(light, 25.0)["groups"], lamp]}, "method": {"a": {"name": "full"}}})
        own.still()
        own.send(save={"kind": "python", "exposure": 0.5, "tone": "srgb"})
        program = own.read(lambda header: "text" in header)[0]["text"]["text"]
    monkeypatch.chdir(tmp_path)
    exec(compile(program, "copied", "exec"), {})
    view.snapshot("snapshot.png", exposure=0.5)
    assert np.array_equal(load_image("view.png")[0], load_image("snapshot.png")[0])


def test_a_copied_command_renders_what_is_seen(view, transport, tmp_path, monkeypatch):
    import shlex

    from deltalux.command.cli import main

    with page(view) as own:
        light = welcomed(own)["state"]["light"]
        own.send(state={"light": turned(light, 25.0)})
        own.still()
        own.send(save={"kind": "command", "exposure": 0.5, "tone": "srgb"})
        command = own.read(lambda header: "text" in header)[0]["text"]["text"]
        own.send(state={"light": {"groups": [{**light["groups"][0], "gain": 1.0}]}})
        own.send(save={"kind": "command"})
        assert "copy it as Python" in own.read(lambda header: "problem" in header)[0]["problem"]
        own.send(state={"light": turned(light, 25.0)})
        own.still()
        view.snapshot(tmp_path / "snapshot.png", exposure=0.5)
    monkeypatch.chdir(tmp_path)
    assert main(shlex.split(command)[1:]) == 0
    seen, saved = (np.asarray(load_image(name)[0], np.float32) for name in ("view.png", "snapshot.png"))
    assert np.abs(seen - saved).max() <= 2 / 255


def test_a_dark_pixel_says_which_directions_light_it(view, transport):
    with page(view) as own:
        welcomed(own)
        pixels = transport.pixels
        pixel = int(pixels.pixel[len(pixels.pixel) // 2])
        own.send(look=[pixel % 32, pixel // 32])
        header, parts = own.read(lambda header: header.get("kind") == "row")
        found = parts["row"][0][1].reshape(6, 8, 8, 3)
        rows = np.flatnonzero(pixels.pixel == pixel)
        from deltalux._core import haar_inverse

        whole = sum(pixels.weight[k] * pixels.albedo[k] * transport.row(int(k))[:, None] for k in rows)
        expected = haar_inverse(8, np.asarray(whole, np.float64))
        assert header["rows"] == len(rows)
        np.testing.assert_allclose(found, expected, atol=1e-3 * np.abs(expected).max())


@pytest.mark.parametrize("kind", ["pixels", "vertices"])
def test_so_it_does_through_bounces_and_at_vertices(tmp_path, kind):
    """What each texel does to the pixel, and the light that there is, make the pixel."""
    scene = dl.Scene.builtin("cornell")
    scene = scene.with_camera(scene.camera.resized(12, 12))
    made = dl.precompute(
        scene, tmp_path / "a.transport", columns=dl.Haar(4), bounces=2, receivers=kind, progress=False, nodes=64
    )
    env = dl.Environment.builtin("sky")
    expected = made.image(made.multiply(made.coefficients(env)))[8, 6]
    found, rows = Relit(made, Lights({}, ()), dl.Full(), {}, "a").look(6, 8)
    areas = made.columns.solid_angles.reshape(6, 4, 4, 1)
    assert rows > 0
    np.testing.assert_allclose((found * env.cubemap(4) * areas).sum(axis=(0, 1, 2)), expected, rtol=1e-4)


def test_the_handle_sets_and_reads(view, transport, tmp_path):
    view.env = dl.Environment.builtin("sky").rotated(15)
    view.method = dl.Incremental(terms=50)
    frame = view.frame
    while not frame.converged:
        frame = view.frame
    env = dl.Environment.builtin("sky").rotated(15)
    exact = transport.multiply(transport.coefficients(env))
    assert np.abs(frame.values - exact).max() <= 1e-5 * exact.max()
    view.snapshot(tmp_path / "view.exr")
    assert load_image(tmp_path / "view.exr")[0].shape == (24, 32, 3)
    assert view.url in view._repr_html_()
    with pytest.raises(TypeError):
        view.env = "sky"
    with pytest.raises(ValueError, match="update method"):
        view.method = "pbi"
    view.close()
    view.close()
    assert "closed" in repr(view)


# Who is let in (a socket is not covered by the same-origin rule).


@pytest.mark.parametrize("origin", ["http://evil.example", "null", "https://127.0.0.1:1", None])
def test_a_foreign_origin_is_refused(view, origin):
    with pytest.raises(InvalidStatus) as refused, page(view, origin=origin):
        pass
    assert refused.value.response.status_code == 403


def test_a_foreign_host_is_refused(view):
    port = view._server.port
    for path in ("/", "/live", "/main.js"):
        answer = _http(port, f"GET {path} HTTP/1.1\r\nHost: evil.example:{port}\r\n\r\n")
        assert answer.startswith("HTTP/1.1 403")


@pytest.mark.parametrize("token", ["", "wrong", 5, None, ["x"]])
def test_a_wrong_token_sees_nothing(view, token):
    address = view.url.partition("/#")[0]
    with connect(address.replace("http", "ws", 1) + "/live", origin=address) as socket:
        socket.send(json.dumps({"hello": token}))
        with pytest.raises(ConnectionClosed) as closed:
            socket.recv(timeout=10)
    assert closed.value.rcvd.code == 4401


def test_a_large_message_closes_the_socket(view):
    with page(view) as own:
        welcomed(own)
        own.socket.send(json.dumps({"open": "x" * 10_000_000}))
        with pytest.raises(ConnectionClosed) as closed:
            own.read(lambda header: False)
    assert closed.value.rcvd.code == 1009


def test_a_flood_closes_the_socket(view):
    with page(view) as own:
        welcomed(own)
        with pytest.raises(ConnectionClosed) as closed:
            for _ in range(2000):
                own.send(step=0)
            own.read(lambda header: False)
    assert closed.value.rcvd.code == 1008


def test_it_listens_on_this_machine_alone(view):
    addresses = {info[4][0] for info in socket.getaddrinfo(socket.gethostname(), None, socket.AF_INET)}
    for address in addresses - {"127.0.0.1", "127.0.1.1"}:
        with pytest.raises(OSError):
            socket.create_connection((address, view._server.port), timeout=1).close()


@pytest.mark.parametrize("host", ["0.0.0.0", "::", ""])
def test_all_addresses_at_once_are_refused(view, host):
    with pytest.raises(ValueError, match="one address of this machine"):
        dl.View(view._stage.subject, "x", host=host, port=0)


def test_without_its_package_a_sentence_says_how_to_get_it(transport, monkeypatch, capsys):
    from deltalux.command.cli import main

    monkeypatch.setitem(sys.modules, "websockets.sync.server", None)
    with pytest.raises(ModuleNotFoundError, match=r"deltalux\[view\]"):
        dl.view(dl.Scene.builtin("plant"), browser=False)
    assert main(["view", str(transport._path), "--no-browser"]) == 2
    assert "pip install 'deltalux[view]'" in capsys.readouterr().err


def test_the_page_and_nothing_else_is_served(view):
    port = view._server.port
    answer = _http(port, f"GET / HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\n\r\n")
    head, _, body = answer.partition("\r\n\r\n")
    assert head.startswith("HTTP/1.1 200") and "Content-Security-Policy: default-src 'none'" in head
    assert "Access-Control-Allow-Origin" not in head and view._server.token not in answer
    assert "<script" in body and "onclick" not in body and " style=" not in body
    for path in ("/../handle.py", "/%2e%2e/handle.py", "/.hidden", "/main.js/..", "//etc/passwd", "/page/main.js"):
        assert _http(port, f"GET {path} HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\n\r\n").startswith("HTTP/1.1 404")


def _http(port, request):
    with socket.create_connection(("127.0.0.1", port), timeout=10) as own:
        own.sendall(request.encode())
        data = b""
        while more := own.recv(65536):
            data += more
        return data.decode("utf-8", "replace")


def test_a_port_that_is_taken_is_refused_where_it_was_asked_for(view, transport):
    with pytest.raises(OSError):
        dl.view(transport, browser=False, port=view._server.port)


# Pieces.


def test_squares_lie_where_their_wavelets_do():
    columns = dl.Haar(16)
    rng = np.random.default_rng(3)
    from deltalux._core import haar_inverse

    for column in rng.choice(columns.columns, 40, replace=False):
        V = np.zeros((columns.columns, 3))
        V[column] = 1.0
        lit = np.argwhere(np.abs(haar_inverse(16, V)[..., 0]) > 0)
        face, y, x = lit.min(axis=0)
        edge = lit[:, 1].max() - y + 1
        assert squares(columns, np.array([column], np.uint32), 9) == [[face, x, y, edge, columns.bands[column]]]


def test_messages_begin_their_payloads_where_numbers_may():
    message = packed({"n": 1}, [({"name": "a"}, b"12345"), ({"name": "b"}, np.arange(3.0))])
    size = int.from_bytes(message[:4], "little")
    start = -(-(4 + size) // 8) * 8
    parts = json.loads(message[4 : 4 + size])["parts"]
    assert [part["offset"] % 8 for part in parts] == [0, 0]
    assert np.frombuffer(message[start + parts[1]["offset"] :][:24]).tolist() == [0.0, 1.0, 2.0]


def test_solo_mute_and_blend():
    sources = {name: dl.Environment.builtin(name) for name in ("hall", "sky")}
    hall, sky = Group("a", "environment", source="hall"), Group("b", "environment", source="sky", gain=1.0)
    columns = dl.Haar(4)

    def V(lights):
        return columns.coefficients(lights.environment)

    of = {name: columns.coefficients(env) for name, env in sources.items()}
    np.testing.assert_allclose(V(Lights(sources, (hall, sky))), of["hall"] + 2 * of["sky"], rtol=1e-5, atol=1e-6)
    muted = Lights(sources, (hall, Group("b", "environment", source="sky", mute=True)))
    assert np.array_equal(V(muted), of["hall"])
    alone = Lights(sources, (hall, Group("b", "environment", source="sky", solo=True)))
    assert np.array_equal(V(alone), of["sky"])
    half = Lights(sources, (hall,), blend=("sky", 0.5))
    np.testing.assert_allclose(V(half), (of["hall"] + of["sky"]) / 2, rtol=1e-5, atol=1e-6)
    assert not V(Lights(sources, ())).any()


# What else is looked at: curves and studios where they are tested (`test_curves.py`, `test_studio.py`).


def test_vertices_are_drawn_as_a_mesh_and_seen_by_the_camera(tmp_path):
    scene = dl.Scene.builtin("cornell")
    scene = scene.with_camera(scene.camera.resized(24, 18))
    made = dl.precompute(scene, tmp_path / "v.transport", columns=dl.Haar(4), receivers="vertices", progress=False)
    with dl.view(made, browser=False, port=0) as view, page(view) as own:
        assert welcomed(own)["kind"] == "vertices"
        own.draws = False
        _, parts = own.read(lambda header: header.get("kind") == "mesh")
        assert len(parts["position"][0][1]) == len(parts["normal"][0][1]) == 3 * len(made._views.shown)
        camera = {"position": [0.0, 1.0, 3.5], "target": [0.1, 0.9, 0.0], "fov": 45.0}
        own.send(state={"camera": camera})
        header, parts = own.read(lambda header: header.get("kind") == "still" and header["camera"]["fov"] == 45.0)
        env = dl.Environment.builtin("hall")
        B = made.multiply(made.coefficients(env))
        # Cameras of scenes may be small: 22 times as large, it fills a page.
        seen = dl.Camera((0.0, 1.0, 3.5), (0.1, 0.9, 0.0), vertical_fov=45.0, width=22 * 24, height=22 * 18)
        wanted = made.render(seen, B, env)
        found = parts["still"][0][1].reshape(22 * 18, 22 * 24, 3)
        assert np.abs(found - wanted).max() <= 2e-3 * wanted.max()


@pytest.mark.slow
def test_a_scene_is_seen_at_once_and_grows_finer(tmp_path):
    scene = dl.Scene.builtin("cornell")
    scene = scene.with_camera(scene.camera.resized(120, 90))
    with dl.view(scene, browser=False, port=0) as view, page(view) as own:
        first = welcomed(own)
        assert first["width"] == 96 and first["columns"]["size"] == 16
        own.send(state={"background": "none"})
        own.read(lambda header: "progress" in header, seconds=120)
        replaced = own.read(lambda header: "replaced" in header, seconds=240)[0]["replaced"]
        assert replaced["width"] == 120 and replaced["columns"]["size"] == 64
        assert replaced["state"]["background"] == "none"
        own.layers.clear()
        assert own.still().shape == (90, 120, 3)


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="needs /proc")
def test_memory_does_not_grow_while_the_light_turns(view):
    """A short soak; `benches/view.py --soak` is the long one."""

    def resident():
        return int(Path("/proc/self/statm").read_text().split()[1]) * resource.getpagesize()

    with page(view) as own:
        light = welcomed(own)["state"]["light"]
        own.send(want={"layers": ["exact", "bound"], "maps": True})
        sizes = []
        for k in range(600):
            own.send(state={"light": turned(light, 3.0 * k)})
            own.read(lambda header: header.get("kind") == "frame")
            own.kinds.clear()
            own.words.clear()
            if k % 200 == 199:
                gc.collect()
                sizes.append(resident())
        assert sizes[-1] - sizes[0] < 8e6


def test_a_slow_link_gets_jpegs_while_the_light_moves_and_numbers_at_rest(view, transport):
    from PIL import Image

    with page(view) as own:
        light = welcomed(own)["state"]["light"]
        own.still()
        own.send(want={"quality": "jpeg", "exposure": -1.0, "tone": "agx"}, state={"light": turned(light, 1.0)})
        header, parts = own.read(lambda header: any(part.get("type") == "jpeg" for part in header.get("parts", [])))
        shown = np.asarray(Image.open(io.BytesIO(parts["a"][0][1])), np.float64)
        env = dl.Environment.builtin("hall").rotated(1.0)
        wanted = to_display(transport.image(transport.multiply(transport.coefficients(env)), env), -1.0, "agx")
        assert np.abs(shown - wanted).mean() < 8
        exact = transport.image(transport.multiply(transport.coefficients(env)), env)
        assert np.abs(own.still() - exact).max() <= 2e-6 * exact.max()
