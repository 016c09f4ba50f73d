"""Moving light: what each sequence does, lazily and the same every time."""

import itertools

import deltalux as dl
import numpy as np
import pytest
from deltalux import Environment, Haar
from deltalux.light import sequences

HALL, STUDIO = Environment.builtin("hall"), Environment.builtin("studio")


def test_ease_is_at_rest_at_both_ends():
    t = np.linspace(0, 1, 1001)
    way = np.array([sequences.ease(float(time)) for time in t])
    assert way[0] == 0 and way[-1] == 1 and np.all(np.diff(way) > 0)
    np.testing.assert_allclose(way + way[::-1], 1, atol=1e-15)
    speed = np.gradient(way, t)
    assert speed[0] < 0.01 and speed[-1] < 0.01 and speed.max() == pytest.approx(1.5, rel=1e-4)


@pytest.mark.parametrize("name", sequences.SEQUENCES)
def test_every_sequence(name):
    """As many frames as asked for, deterministic, lazy, each an environment of finite, positive light that moves."""
    frames = list(sequences.make(name, STUDIO, 4))
    assert len(frames) == 4 and all(isinstance(env, Environment) for env in frames)
    cubemaps = [env.cubemap(16) for env in frames]
    for first, second in itertools.pairwise(cubemaps):
        assert np.all(np.isfinite(second)) and np.all(second >= 0) and not np.array_equal(first, second)
    again = [env.cubemap(16) for env in sequences.make(name, STUDIO, 4)]
    np.testing.assert_array_equal(cubemaps, again)
    assert len(list(itertools.islice(sequences.make(name, STUDIO, 10**6), 1))) == 1
    assert len(list(sequences.make(name, STUDIO, 1))) == 1
    for frames in (0, -1, 2.5):
        with pytest.raises(ValueError, match="frame"):
            sequences.make(name, STUDIO, frames)


def test_rotation_and_rest():
    frames = list(sequences.rotation(HALL, 90.0, 5, axis="x", hold=2))
    assert len(frames) == 7
    expected = [HALL.rotated(90.0 * sequences.ease(k / 4), "x").cubemap(16) for k in range(5)]
    for env, cubemap in zip(frames, expected + [expected[-1]] * 2, strict=True):
        np.testing.assert_array_equal(env.cubemap(16), cubemap)


def test_interpolation_begins_and_ends_with_its_lights():
    frames = list(sequences.interpolation(HALL, STUDIO, 3))
    np.testing.assert_allclose(frames[0].cubemap(16), HALL.cubemap(16), rtol=1e-6)
    np.testing.assert_allclose(frames[1].cubemap(16), (HALL.cubemap(16) + STUDIO.cubemap(16)) / 2, rtol=1e-5)
    np.testing.assert_allclose(frames[2].cubemap(16), STUDIO.cubemap(16), rtol=1e-6)


def test_area_light_adds_its_flux_and_changes_few_coefficients():
    """Of a disc of radius r: 2 pi (1 - cos r) sr. Wavelets that it does not meet stand still, bit for bit."""
    columns = Haar(64)
    frames = list(sequences.area_light(STUDIO, 5, radiance=(2.0, 1.0, 0.5)))
    still = columns.coefficients(STUDIO)
    added = [columns.coefficients(env) - still for env in frames]
    # The integral over the sphere is that over the six scaling functions, each sqrt(6 / 4 pi) on its face.
    for flux, radius in zip([V[:6].sum(axis=0) * np.sqrt(4 * np.pi / 6) for V in added[::4]], (4, 16), strict=True):
        disc = 2 * np.pi * (1 - np.cos(np.radians(radius)))
        np.testing.assert_allclose(flux, disc * np.array([2.0, 1.0, 0.5]), rtol=0.01)
    changed = np.any(columns.coefficients(frames[1]) != columns.coefficients(frames[0]), axis=1).sum()
    assert 0 < changed < 0.1 * columns.columns


def test_area_light_converges_in_a_few_frames():
    columns = Haar(64)
    lights = [columns.coefficients(env) for env in sequences.area_light(STUDIO, 5, hold=5)]
    follow = dl.Approximation(columns, dl.PerBand(terms=300), initial=lights[0])
    errors = []
    for V in lights:
        follow.step(V)
        errors.append(np.abs(V - follow.values).sum() / np.abs(V).sum())
    assert errors[-1] < 0.02 < max(errors) * 10


def test_the_sun_rises_and_sets():
    """Its height follows its circle; light grows until noon; low suns are red, and red light is what dusk has left."""
    columns, frames = Haar(16), list(sequences.sunrise(9, noon=60.0))
    maps = [env.cubemap(16) for env in frames]
    light = [columns.coefficients(env)[:6].sum() for env in frames]
    assert np.all(np.diff(light[:5]) > 0) and np.all(np.diff(light[4:]) < 0)
    np.testing.assert_allclose(light, light[::-1], rtol=0.05)
    noon = frames[4].radiance([[0, np.sin(np.radians(60)), -np.cos(np.radians(60))], [0, np.sin(1), np.cos(1)]])
    assert noon[0].min() > 1e3 * noon[1].max()
    # The sun stands 18 degrees along its circle in frame 1, at noon in frame 4.
    colour = [maps[k].reshape(-1, 3)[maps[k].sum(axis=-1).argmax()] for k in (1, 4)]
    assert colour[0][0] / colour[0][2] > 1.3 * colour[1][0] / colour[1][2]
    assert maps[0].max() < 1e-2 * maps[4].max() and maps[0].max() > 0


def test_the_sun_of_the_built_in_sky_is_where_it_was():
    from deltalux.light import skies

    sky = skies.sky()
    row, column = np.unravel_index(sky.sum(axis=-1).argmax(), sky.shape[:2])
    assert abs(90 - (row + 0.5) * 180 / 512 - 38) < 0.5 and abs((column + 0.5) * 360 / 1024 - 55) < 0.5


def test_painting_leaves_what_is_painted():
    frames = [env.cubemap(32) for env in sequences.painting(STUDIO, 6, hold=1)]
    for before, after in itertools.pairwise(frames):
        assert np.all(after >= before * (1 - 1e-6))
    np.testing.assert_array_equal(frames[-1], frames[-2])
    added = frames[-1] - STUDIO.cubemap(32)
    assert 0.005 < np.mean(added > 0.1) < 0.2
    # One dab in the middle of a stroke, by hand.
    dot = list(sequences.painting(STUDIO, 1, strokes=[[(90, 0), (90, 0)]], radiance=(3, 3, 3)))[-1]
    np.testing.assert_allclose(dot.radiance([1.0, 0, 0]) - STUDIO.radiance([1.0, 0, 0]), 3, rtol=1e-5)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: sequences.make("storm", HALL, 5), "rotation, interpolation.*got 'storm'"),
        (lambda: sequences.rotation(HALL, np.nan, 5), "finite angle"),
        (lambda: sequences.rotation(HALL, 5, 5, hold=-1), "hold"),
        (lambda: sequences.area_light(HALL, 5, start=(0, 0, 0)), "radius above 0"),
        (lambda: sequences.area_light(HALL, 5, radiance=(1, 2)), "three finite numbers"),
        (lambda: sequences.sunrise(5, noon=0), "got 0"),
        (lambda: sequences.painting(HALL, 5, strokes=[[(0, 0)]]), "two or more places"),
        (lambda: sequences.painting(HALL, 5, radius=0), "radius between"),
    ],
)
def test_refusals_come_at_the_call(make, message):
    with pytest.raises(ValueError, match=message):
        make()
