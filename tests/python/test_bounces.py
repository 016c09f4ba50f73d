"""Light between surfaces, as a user meets it: how much of it there is, that it stays exact, and what is said of it."""

from __future__ import annotations

import subprocess
import sys

import deltalux as dl
import numpy as np
import oracles
import pytest
from deltalux import _core

HAAR = dl.Haar(8)


def room(albedo=((0.7, 0.7, 0.7), (0.6, 0.1, 0.1)), width=20):
    """Two walls and a floor, open above and in front."""
    floor = oracles.quad((-1, 0, -1), (2, 0, 0), (0, 0, 2))
    back = oracles.quad((-1, 0, -1), (2, 0, 0), (0, 2, 0))
    side = oracles.quad((-1, 0, -1), (0, 0, 2), (0, 2, 0))
    vertices, triangles = oracles.merged(floor, back, side)
    camera = dl.Camera((3, 2.5, 4), (-0.3, 0.7, -0.3), vertical_fov=40, width=width, height=width)
    scene = dl.Scene.from_arrays(vertices, triangles, albedo[0], camera, name="room")
    if len(albedo) == 1:
        return scene
    from dataclasses import replace

    material = np.where(np.arange(len(triangles)) >= len(triangles) - 2, 1, 0).astype(np.uint32)
    return replace(scene, material=material, albedo=np.array(albedo, np.float32), textures=(None, None))


@pytest.fixture(scope="module")
def rooms(tmp_path_factory):
    """The room with 0, 1, 2 and 6 bounces, and with all."""
    folder = tmp_path_factory.mktemp("rooms")
    return {
        bounces: dl.precompute(
            room(), folder / f"{bounces}.transport", columns=HAAR, quality="lossless", bounces=bounces, progress=False
        )
        for bounces in (0, 1, 2, 6, "all")
    }


def picture(transport, env):
    return transport.multiply(transport.coefficients(env)).astype(np.float64)


# --- how much ---------------------------------------------------------------------------------------------------------


def test_every_bounce_adds_light(rooms):
    env = dl.Environment.builtin("hall")
    zero, one, two, six, every = (picture(rooms[bounces], env) for bounces in (0, 1, 2, 6, "all"))
    least = 1e-4 * zero.mean()
    assert (one >= zero - least).all() and (one > zero + least).mean() > 0.9
    for less, more in ((one, two), (two, six), (six, every)):
        assert (more >= less - least).all()
    # A geometric series: what two bounces add to one is a share of what one adds.
    first, second = (one - zero).sum(), (two - one).sum()
    assert 0.05 < second / first < 0.6
    assert (every - six).sum() < 0.01 * (every - zero).sum()


def test_it_says_what_it_holds(rooms):
    assert [rooms[b].bounces for b in (0, 1, 2, 6, "all")] == [0, 1, 2, 6, -1]
    assert rooms[0].nodes == 0 and rooms[0].solve is None and rooms[0].channels == 1
    solve = rooms[6].solve
    assert rooms[6].nodes == solve.nodes > 50 and rooms[6].channels == 3
    assert solve.products == (6, 6, 6) and solve.residual == 0 and solve.method == "Neumann"
    assert len(solve.shares) == 6 and sum(solve.shares) == pytest.approx(1)
    assert all(a > b for a, b in zip(solve.shares, solve.shares[1:], strict=False))
    assert 0 < rooms["all"].solve.residual <= 1e-3
    middle, p95, worst = solve.discretisation
    assert 0 < middle < p95 <= worst < 0.3 and middle < 0.05
    assert "nodes" in str(rooms[6].plan) and "bounces: 6" in str(rooms[6].plan)
    assert "bounces: all" in str(rooms["all"].plan) and "residual at most" in str(rooms["all"].plan)


def test_colours_bleed(rooms):
    """The floor beside the red wall is redder than the floor far from it."""
    transport = rooms[2]
    receivers = transport.receivers
    white = dl.Environment.from_cubemap(np.ones((6, 8, 8, 3), np.float32))
    B = picture(transport, white)
    floor = receivers.normal[:, 1] > 0.9
    redness = B[:, 0] / B[:, 1]
    near, far = floor & (receivers.position[:, 0] < -0.7), floor & (receivers.position[:, 0] > 0.5)
    assert redness[near].mean() > 1.05 * redness[far].mean() > 1.0


def test_grey_rooms_hold_one_channel(tmp_path):
    transport = dl.precompute(
        room(albedo=((0.7, 0.7, 0.7),)), tmp_path / "g.transport", columns=HAAR, bounces=2, progress=False
    )
    assert transport.channels == 1 and "grey" in str(transport.plan)
    B = transport.multiply(transport.coefficients(dl.Environment.from_cubemap(np.ones((6, 8, 8, 3), np.float32))))
    assert (B[:, 0] == B[:, 1]).all() and (B[:, 1] == B[:, 2]).all()


def test_what_sees_nothing_needs_no_bounces(tmp_path):
    vertices, triangles = oracles.quad((-1, 0, -1), (2, 0, 0), (0, 0, 2))
    camera = dl.Camera((0, 3, 0.1), (0, 0, 0), vertical_fov=40, width=12, height=12)
    scene = dl.Scene.from_arrays(vertices, triangles, (0.5, 0.5, 0.5), camera)
    transport = dl.precompute(scene, tmp_path / "f.transport", columns=HAAR, bounces=3, progress=False)
    assert transport.bounces == 0 and len(transport.plan.parts) == 1
    assert "no surface sees another" in str(transport.plan)


# --- exactness --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("columns", [HAAR, dl.Haar(8, texels=True)], ids=str)
def test_followers_end_where_a_fresh_product_is(tmp_path, columns):
    options = {"columns": columns, "quality": "lossless", "bounces": 2, "progress": False}
    transport = dl.precompute(room(), tmp_path / "r.transport", tolerance=0.02, **options)
    exact = dl.precompute(room(), tmp_path / "e.transport", **options)
    assert transport.nbytes < 0.5 * exact.nbytes
    env = dl.Environment.builtin("studio")
    relighter = dl.Relighter(transport, dl.PerBand(terms=40))
    for k in range(12):
        V = transport.coefficients(env.rotated(3 * k))
        frame = relighter.step(V)
        assert (frame.values == transport.multiply(relighter.values)).all()
    while not frame.converged:
        frame = relighter.step(V)
    assert (frame.values == transport.multiply(relighter.values)).all()
    # The same receivers and nodes, untruncated: no receiver is further off than its bound.
    off = np.abs(frame.values.astype(float) - exact.multiply(V))
    bounds = relighter.bounds(frame)
    assert off.max() > 0 and (off <= bounds + 1e-3 * frame.values).all()
    assert (bounds <= frame.bound * 1.0001).all()


def test_texels_and_wavelets_bring_the_same_light(tmp_path):
    plain, both = (
        dl.precompute(
            room(), tmp_path / f"{k}.transport", columns=columns, quality="lossless", bounces=2, progress=False
        )
        for k, columns in enumerate((HAAR, dl.Haar(8, texels=True)))
    )
    env = dl.Environment.builtin("studio")
    V = both.coefficients(env)
    assert np.abs(V[384:]).sum() > 0
    a = plain.multiply(both.columns.without_texels(V)).astype(float)
    b = both.multiply(V).astype(float)
    # Nodes take the very same light; receivers' texels are centres where their wavelets have edges.
    assert np.linalg.norm(a - b) < 0.05 * np.linalg.norm(a)


def test_threads_and_resumed_runs_leave_the_same_bits(tmp_path):
    def run(name, threads):
        _core.set_threads(threads)
        dl.precompute(room(), tmp_path / name, columns=HAAR, quality="preview", bounces=2, progress=False)
        return {file.name: file.read_bytes() for file in sorted((tmp_path / name).glob("*.safetensors"))}

    one, two = run("1.transport", 1), run("2.transport", 2)
    assert one == two and "link.safetensors" in one and "tiles-nodes-00000.safetensors" in one

    class Stop(Exception):
        pass

    def stop(done, total):
        if done > 0.8 * total:
            raise Stop

    with pytest.raises(Stop):
        dl.precompute(room(), tmp_path / "3.transport", columns=HAAR, quality="preview", bounces=2, progress=stop)
    assert not (tmp_path / "3.transport").exists()
    assert run("3.transport", 2) == one


# --- what is refused, and the command line ----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"bounces": -1}, "bounces"),
        ({"bounces": 1.5}, "bounces"),
        ({"bounces": "many"}, '"all"'),
        ({"bounces": 2000}, "at most 1,000"),
        ({"bounces": "all", "residual": 0}, "residual"),
        ({"bounces": "all", "residual": 2}, "residual"),
        ({"bounces": 1, "nodes": 0}, "node"),
        ({"bounces": 1, "nodes": "few"}, '"auto"'),
    ],
)
def test_bad_requests_are_refused_before_any_work(tmp_path, options, message):
    with pytest.raises(ValueError, match=message):
        dl.precompute(room(), tmp_path / "x.transport", progress=False, **options)
    assert not list(tmp_path.iterdir())


def test_light_that_never_fades_is_refused(tmp_path):
    with pytest.raises(ValueError, match="below 1"):
        dl.precompute(
            room(albedo=((1.0, 1.0, 1.0),)), tmp_path / "w.transport", columns=HAAR, bounces="all", progress=False
        )


def test_nodes_keep_to_their_number(tmp_path):
    transport = dl.precompute(
        room(), tmp_path / "n.transport", columns=HAAR, quality="preview", bounces=1, nodes=60, progress=False
    )
    assert 20 < transport.nodes <= 60


def test_operators_refuse_colours_of_their_own(rooms):
    with pytest.raises(ValueError, match="one channel"):
        rooms[1].matmat(np.zeros(384))
    with pytest.raises(ValueError, match="several parts"):
        rooms[1].row(0)


def test_the_command_line(tmp_path):
    command = [sys.executable, "-m", "deltalux"]
    path = str(tmp_path / "c.transport")
    options = [
        "--size",
        "16x16",
        "--columns",
        "haar:4",
        "--quality",
        "preview",
        "--bounces",
        "all",
        "--residual",
        "0.01",
    ]
    done = subprocess.run([*command, "precompute", "cornell", *options, "-o", path], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert "nodes" in done.stdout + done.stderr and "residual at most" in done.stdout + done.stderr + str(
        dl.Transport.open(path).plan
    )
    wrong = subprocess.run(
        [*command, "precompute", "cornell", "--bounces", "lots", "-o", path], capture_output=True, text=True
    )
    assert wrong.returncode == 2 and "number of bounces" in wrong.stderr
