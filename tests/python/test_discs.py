"""Discs and paint as light: their place, their flux, and that tints share maps."""

import deltalux as dl
import numpy as np
import pytest
from deltalux.light.skies import toward
from deltalux.sphere import face_directions
from hypothesis import given, settings
from hypothesis import strategies as st

FACE = 64


def flux(env):
    """Where an environment's light comes from and how much there is of it, summed over a cubemap."""
    directions = face_directions(FACE)
    angles = (2.0 / FACE) ** 2 * np.abs(directions).max(axis=-1) ** 3
    weighted = env.cubemap(FACE)[..., 0] * angles
    return weighted.sum(), (directions * weighted[..., None]).sum(axis=(0, 1, 2)) / weighted.sum()


@settings(max_examples=12, deadline=None)
@given(st.floats(-180, 180), st.floats(-90, 90), st.sampled_from([0.27, 2.0, 8.0, 30.0]))
def test_a_disc_gives_the_light_of_its_solid_angle_from_where_it_stands(azimuth, elevation, radius):
    amount, middle = flux(dl.Environment.disc(azimuth, elevation, radius))
    assert amount == pytest.approx(2 * np.pi * (1 - np.cos(np.radians(radius))), rel=3e-3)
    # Of an even disc the mean direction is shorter by half of what its edge leaves of the axis.
    expected = toward(*np.radians((azimuth, elevation))) * (1 + np.cos(np.radians(radius))) / 2
    # To half a texel of the cubemap that it is measured on.
    assert np.abs(middle - expected).max() < np.pi / 4 / FACE


def test_discs_of_one_radius_share_a_map():
    a, b = dl.Environment.disc(0, 0, 5.0), dl.Environment.disc(90, 45, 5.0)
    assert a._layers[0][1] is b._layers[0][1]


def test_paint_is_the_brighter_where_dabs_cross():
    one, two = (10.0, 20.0, 6.0, (1.0, 2.0, 3.0)), (13.0, 20.0, 6.0, (2.0, 1.0, 1.0))
    both = dl.Environment.painted([one, two]).cubemap(128)
    apart = [dl.Environment.painted([own]).cubemap(128) for own in (one, two)]
    np.testing.assert_allclose(both, np.maximum(*apart), rtol=1e-5)


def test_a_tint_shares_the_map_and_is_what_a_tinted_map_would_be():
    hall, tint = dl.Environment.builtin("hall").rotated(17), np.float32((0.9, 0.5, 0.2))
    tinted = hall * tint
    assert tinted._layers[0][1] is hall._layers[0][1]
    np.testing.assert_allclose(tinted.cubemap(16), hall.cubemap(16) * tint, rtol=1e-5)
    np.testing.assert_allclose(
        dl.Haar(8).coefficients(tinted), dl.Haar(8).coefficients(hall) * tint, rtol=1e-5, atol=1e-6
    )
    directions = np.eye(3)
    np.testing.assert_allclose(tinted.radiance(directions), hall.radiance(directions) * tint, rtol=1e-5)


@pytest.mark.parametrize("bad", [(np.nan, 0, 1), (0, np.inf, 1), (0, 0, 0), (0, 0, 91)])
def test_no_disc(bad):
    with pytest.raises(ValueError, match="expected finite degrees and a radius"):
        dl.Environment.disc(*bad)


@pytest.mark.parametrize("bad", [(0, 0, 0, (1, 1, 1)), (0, 0, 5, (1, 1)), (0, np.nan, 5, (1, 1, 1))])
def test_no_dab(bad):
    with pytest.raises(ValueError, match="expected dabs of azimuth"):
        dl.Environment.painted([bad])
