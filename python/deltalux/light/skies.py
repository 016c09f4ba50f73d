"""Procedural environments: lat-long images (512, 1024, 3) of linear radiance, the same on every machine."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float32]

HEIGHT, WIDTH = 512, 1024

SUN_RADIUS = np.radians(0.53 / 2)
"""Angular radius of the sun."""
_SUN_ELEVATION, _SUN_AZIMUTH = np.radians(38.0), np.radians(55.0)
_SUN_LUMINANCE = 1.2e6
"""Of the sun's disc through a clear atmosphere at this elevation, in kcd/m^2 (1.6e6 outside)."""
_TURBIDITY = 2.5
_WAVELENGTHS = np.array([0.65, 0.55, 0.45])
"""Of red, green and blue, in micrometres."""
_EXPOSURE = 0.1
"""Radiance per kcd/m^2: a clear sky is then about 0.5."""


def _directions(height: int = HEIGHT, width: int = WIDTH) -> tuple[Floats, Floats, Floats]:
    """x, y, z of the pixel centres: u = atan2(x, -z) / 2π, v = acos(y) / π."""
    v = (np.arange(height, dtype=np.float32) + 0.5) * np.float32(np.pi / height)
    u = (np.arange(width, dtype=np.float32) + 0.5) * np.float32(2 * np.pi / width)
    flat = np.sin(v)[:, None]
    return flat * np.sin(u), np.broadcast_to(np.cos(v)[:, None], (height, width)), -flat * np.cos(u)


def toward(azimuth: float, elevation: float) -> NDArray[np.float64]:
    """The unit vector at an azimuth from -Z towards +X and an elevation above the horizon."""
    flat = np.cos(elevation)
    return np.array([flat * np.sin(azimuth), np.sin(elevation), -flat * np.cos(azimuth)])


def _block_mean(image: Floats, times: int) -> Floats:
    height, width, channels = image.shape
    blocks = image.reshape(height // times, times, width // times, times, channels)
    return np.asarray(blocks.mean(axis=(1, 3), dtype=np.float32))


# --- sky -------------------------------------------------------------------------------------------------------------


def sky(azimuth: float = _SUN_AZIMUTH, elevation: float = _SUN_ELEVATION, height: int = HEIGHT) -> Floats:
    """A clear sky (Preetham, Shirley and Smits 1999) over gray ground, with the sun's disc of 0.53 degrees.

    (height, 2 height, 3); the sun stands at an azimuth from -Z towards +X and an elevation, in radians.
    """
    x, y, z = _directions(height, 2 * height)
    sun = toward(azimuth, elevation)
    to_sun = np.arccos(np.clip(x * sun[0] + y * sun[1] + z * sun[2], -1, 1))
    above = _preetham(np.maximum(y, 0.01), to_sun, np.pi / 2 - max(elevation, 0.0))
    # Twilight: from 400 lux at sunset to 3.4 at 6 degrees below the horizon.
    above *= np.float32((400 / 3.4) ** (np.degrees(min(elevation, 0.0)) / 6))

    # The disc by its coverage of each pixel: 16 x 16 points in the few pixels about it.
    sunlight = np.array([1.0, 0.93, 0.82]) * _SUN_LUMINANCE * _transmittance(elevation) / _transmittance(_SUN_ELEVATION)
    above = above + _sun_coverage(sun, height)[..., None] * sunlight.astype(np.float32)

    # The ground reflects the light that falls on it (albedo 0.2, a little brown), and meets the sky in a soft horizon.
    area = (np.pi**2 / height**2) * np.sqrt(np.maximum(1 - y * y, 0))
    irradiance = np.einsum("ijc,ij->c", above, np.maximum(y, 0) * area)
    ground = irradiance / np.pi * np.array([0.22, 0.20, 0.17])
    share = np.clip(0.5 + y / 0.02, 0, 1)[..., None]
    return np.asarray(_EXPOSURE * (share * above + (1 - share) * ground), np.float32)


def _transmittance(elevation: float) -> NDArray[np.float64]:
    """The share of sunlight that air lets through, red, green and blue (Preetham et al., appendix A.1)."""
    zenith = 90 - np.degrees(max(elevation, 0.0))
    mass = 1 / (np.cos(np.radians(zenith)) + 0.15 * (93.885 - zenith) ** -1.253)
    rayleigh = 0.008735 * _WAVELENGTHS**-4.08
    aerosol = (0.04608 * _TURBIDITY - 0.04586) * _WAVELENGTHS**-1.3
    return np.asarray(np.exp(-mass * (rayleigh + aerosol)))


def _preetham(cosine: Floats, to_sun: Floats, sun_zenith: float) -> Floats:
    """Sky radiance in kcd/m^2 as linear sRGB, from cos(zenith angle) and the angle to the sun."""
    t, s = _TURBIDITY, sun_zenith
    powers = np.array([s**3, s**2, s, 1.0])
    chi = (4 / 9 - t / 120) * (np.pi - 2 * s)
    zenith_x = np.array([t * t, t, 1.0]) @ np.array(
        [[0.00166, -0.00375, 0.00209, 0], [-0.02903, 0.06377, -0.03202, 0.00394], [0.11693, -0.21196, 0.06052, 0.25886]]
    )
    zenith_y = np.array([t * t, t, 1.0]) @ np.array(
        [[0.00275, -0.00610, 0.00317, 0], [-0.04214, 0.08970, -0.04153, 0.00516], [0.15346, -0.26756, 0.06670, 0.26688]]
    )
    zenith = (
        (4.0453 * t - 4.9710) * np.tan(chi) - 0.2155 * t + 2.4192,
        float(zenith_x @ powers),
        float(zenith_y @ powers),
    )
    # The five coefficients (A..E) of Perez's formula for Y, x and y are linear in turbidity.
    slopes = (
        (0.1787, -0.3554, -0.0227, 0.1206, -0.0670),
        (-0.0193, -0.0665, -0.0004, -0.0641, -0.0033),
        (-0.0167, -0.0950, -0.0079, -0.0441, -0.0109),
    )
    offsets = (
        (-1.4630, 0.4275, 5.3251, -2.5771, 0.3703),
        (-0.2592, 0.0008, 0.2125, -0.8989, 0.0452),
        (-0.2608, 0.0092, 0.2102, -1.6537, 0.0529),
    )

    def perez(k: int, cosine: Floats | float, gamma: Floats | float) -> Floats:
        a, b, c, d, e = (slope * t + offset for slope, offset in zip(slopes[k], offsets[k], strict=True))
        return np.asarray(
            (1 + a * np.exp(b / cosine)) * (1 + c * np.exp(d * gamma) + e * np.cos(gamma) ** 2), np.float32
        )

    lum, cx, cy = (zenith[k] * perez(k, cosine, to_sun) / perez(k, 1.0, s) for k in range(3))
    xyz = np.stack([lum * cx / cy, lum, lum * (1 - cx - cy) / cy], axis=-1)
    to_rgb = np.array([[3.2406, -1.5372, -0.4986], [-0.9689, 1.8758, 0.0415], [0.0557, -0.2040, 1.0570]])
    return np.asarray(np.maximum(xyz @ to_rgb.T, 0), np.float32)


def _sun_coverage(sun: NDArray[np.float64], height: int) -> Floats:
    """The share of each pixel that the sun's disc covers."""
    width = 2 * height
    row = int(np.arccos(sun[1]) / np.pi * height)
    column = int(np.arctan2(sun[0], -sun[2]) / (2 * np.pi) * width) % width
    # Towards the zenith a disc is as wide as it is high over the sine of its distance from it.
    reach = min(int(4 / max(np.sin(np.arccos(sun[1])), 1e-3)) + 1, height - 1)
    rows, columns = np.arange(max(row - 3, 0), min(row + 4, height)), np.arange(column - reach, column + reach + 1)
    fine = (np.arange(16) + 0.5) / 16
    v = ((rows[:, None] + fine).ravel() * np.pi / height)[:, None]
    u = (columns[:, None] + fine).ravel() * 2 * np.pi / width
    cosine = np.sin(v) * np.sin(u) * sun[0] + np.cos(v) * sun[1] - np.sin(v) * np.cos(u) * sun[2]
    inside = (cosine > np.cos(SUN_RADIUS)).reshape(len(rows), 16, len(columns), 16).mean(axis=(1, 3))
    coverage = np.zeros((height, width), np.float32)
    coverage[np.ix_(rows, columns % width)] = inside
    return coverage


# --- studio ----------------------------------------------------------------------------------------------------------

# Azimuth and elevation (degrees), half width and half height (tangents), roundness, radiance.
_LAMPS = (
    (-35, 40, 0.10, 0.16, False, (95.0, 92.0, 88.0)),
    (48, 25, 0.06, 0.22, False, (38.0, 42.0, 50.0)),
    (150, 55, 0.07, 0.07, True, (260.0, 240.0, 205.0)),
    (-120, 12, 0.02, 0.30, False, (70.0, 34.0, 14.0)),
    (100, 70, 0.025, 0.025, True, (1500.0, 1450.0, 1400.0)),
    (-160, 65, 0.012, 0.012, True, (2600.0, 2000.0, 1300.0)),
    (10, -8, 0.30, 0.012, False, (22.0, 24.0, 30.0)),
)


def studio() -> Floats:
    """A few small bright lamps, square and round, on near black."""
    x, y, z = _directions(3 * HEIGHT, 3 * WIDTH)
    image = np.empty((3 * HEIGHT, 3 * WIDTH, 3), np.float32)
    image[:] = 0.002 + 0.002 * np.clip(y, 0, 1)[..., None]
    for azimuth, elevation, wide, high, is_round, colour in _LAMPS:
        out = toward(np.radians(azimuth), np.radians(elevation))
        right = np.array([np.cos(np.radians(azimuth)), 0.0, np.sin(np.radians(azimuth))])
        up = np.cross(right, out)
        # Only the rows that the lamp can reach are looked at.
        reach = np.arctan(np.hypot(wide, high))
        middle = np.pi / 2 - np.radians(elevation)
        first, last = (int(np.clip(3 * HEIGHT * (middle + k * reach) / np.pi, 0, 3 * HEIGHT)) for k in (-1.05, 1.05))
        rows = slice(first, last + 1)
        a, b, c = (
            (x[rows] * axis[0] + y[rows] * axis[1] + z[rows] * axis[2]).astype(np.float32) for axis in (right, up, out)
        )
        c = np.where(c > 0, c, np.float32(1e-9))
        s, t = a / (c * wide), b / (c * high)
        inside = s * s + t * t < 1 if is_round else np.maximum(abs(s), abs(t)) < 1
        # A lamp is brighter in its middle.
        falloff = (1 - 0.4 * np.clip(s[inside] ** 2 + t[inside] ** 2, 0, 1.5) / 1.5)[:, None]
        image[rows][inside] += np.array(colour, np.float32) * falloff
    return _block_mean(image, 3)


# --- hall ------------------------------------------------------------------------------------------------------------

# Half width and half length of the hall, floor below and ceiling above the eye, in metres.
_HALF_X, _HALF_Z, _FLOOR, _CEILING = 6.0, 15.0, -1.6, 7.5
_BAY = 3.0
"""Distance from window to window, and from beam to beam."""


def hall() -> Floats:
    """A long hall seen from its inside: tall windows, beams, a tiled floor, chandeliers, walls rough at every scale."""
    x, y, z = _directions(2 * HEIGHT, 2 * WIDTH)
    far = np.float32(1e9)

    def distance(component: Floats, low: float, high: float) -> Floats:
        bound = np.where(component > 0, np.float32(high), np.float32(low))
        return np.where(abs(component) > 1e-9, bound / np.where(component == 0, 1, component), far)

    to_side, to_end = distance(x, -_HALF_X, _HALF_X), distance(z, -_HALF_Z, _HALF_Z)
    to_level = distance(y, _FLOOR, _CEILING)
    t = np.minimum(np.minimum(to_side, to_end), to_level)
    px, py, pz = x * t, y * t, z * t

    image = np.zeros((*x.shape, 3), np.float32)
    side, end = to_side == t, (to_end == t) & (to_side != t)
    level = ~side & ~end
    ceiling, floor = level & (y > 0), level & (y < 0)
    image[side] = _window_wall(pz[side], py[side], np.sign(px[side]))
    image[end] = _end_wall(px[end], py[end], np.sign(pz[end]))
    image[ceiling] = _beamed_ceiling(px[ceiling], pz[ceiling])
    image[floor] = _tiled_floor(px[floor], pz[floor])
    return _with_lamps(_block_mean(image, 2))


def _noise(a: Floats, b: Floats, octaves: int, seed: int) -> Floats:
    """Value noise in about [-1, 1]: a table of random numbers, smoothly interpolated, at `octaves` scales."""
    table = np.random.default_rng(seed).uniform(-1, 1, 65536).astype(np.float32)
    total = np.zeros(a.shape, np.float32)
    for octave in range(octaves):
        scale = np.float32(2.0**octave)
        fa, fb = np.floor(a * scale), np.floor(b * scale)
        i, j = fa.astype(np.int32), fb.astype(np.int32) * 241
        s, t = a * scale - fa, b * scale - fb
        s, t = s * s * (3 - 2 * s), t * t * (3 - 2 * t)
        upper = table[(i + j) & 65535] * (1 - s) + table[(i + 1 + j) & 65535] * s
        lower = table[(i + j + 241) & 65535] * (1 - s) + table[(i + 242 + j) & 65535] * s
        total += (upper * (1 - t) + lower * t) / scale
    return total


def _window_wall(along: Floats, height: Floats, which: Floats) -> Floats:
    """Stone with an arched window in every bay; one side looks to the bright sky, the other to a shaded court."""
    stone = 1 + 0.35 * _noise(along, height, 5, 1)
    joints = (np.abs((height * 2) % 1 - 0.5) > 0.46) | (np.abs((along + 0.5 * np.floor(height * 2)) % 1 - 0.5) > 0.475)
    stone *= np.where(joints, 0.55, 1.0)
    # Nearer to the floor and the windows' sills the wall gets more light back.
    wall = (0.10 + 0.05 * np.exp(-0.4 * (height - _FLOOR)))[:, None] * stone[:, None] * np.array([1.0, 0.86, 0.68])

    bay = along % _BAY - _BAY / 2
    top = 4.6
    arch = np.where(height > top, np.hypot(bay, height - top), np.abs(bay))
    opening = (arch < 0.75) & (height > 0.0)
    bars = (np.abs(bay * 3 % 1 - 0.5) > 0.44) | (np.abs(height * 1.5 % 1 - 0.5) > 0.46)
    sky = np.where(which > 0, 1.0, 0.22) * (0.35 + 0.65 * np.clip(height / 5.0, 0, 1))
    trees = np.clip(1.5 * _noise(along * 0.7, height * 0.7, 5, 2) + 1.6 - 0.8 * height, 0, 1)
    bright = 34 * sky[:, None] * np.array([0.82, 0.95, 1.15])
    outside = bright * (1 - trees[:, None]) + trees[:, None] * np.array([1.1, 1.7, 0.5]) * (0.4 + sky[:, None])
    # Some panes are stained glass.
    window, column, row = (np.floor(place).astype(int) for place in (along / _BAY, bay * 3, height * 1.5))
    pane = 64 * window + 8 * column + row
    tint = np.random.default_rng(3).uniform(0.15, 1.0, (257, 3))[pane % 257]
    outside = np.where((pane * 7919 % 11 < 3)[:, None], outside * tint, outside)
    glass = np.where(bars[:, None], 0.04, outside)
    frame = ((arch < 0.95) & (height > -0.2))[:, None]
    return np.where(opening[:, None], glass, np.where(frame, wall * 1.6, wall)).astype(np.float32)


def _end_wall(across: Floats, height: Floats, which: Floats) -> Floats:
    """Plaster with a rose window at one end and a door with a lit passage at the other."""
    plaster = (0.16 * (1 + 0.3 * _noise(across, height, 5, 4)))[:, None] * np.array([1.0, 0.9, 0.75])
    radius, angle = np.hypot(across, height - 4.2), np.arctan2(height - 4.2, across)
    petals = (np.cos(12 * angle) > -0.7) & (np.abs(radius % 0.6 - 0.3) < 0.24)
    hue = np.stack([0.5 + 0.5 * np.cos(3 * angle + k + 4 * radius) for k in (0.0, 2.1, 4.2)], axis=-1)
    rose = np.where(petals[:, None], 9.0 * hue + 0.5, 0.03)
    door = (np.abs(across) < 0.9) & (height < 1.2)
    passage = np.array([3.2, 2.1, 1.0]) * (1 - 0.3 * np.abs(across[:, None]))
    front = np.where((radius < 1.8)[:, None], rose, plaster)
    return np.where((which > 0)[:, None], front, np.where(door[:, None], passage, plaster)).astype(np.float32)


def _beamed_ceiling(across: Floats, along: Floats) -> Floats:
    """Dark wooden beams in two directions over lighter boards."""
    grain = 1 + 0.4 * _noise(across * 4, along * 0.5, 4, 5)
    boards = (0.05 * grain)[:, None] * np.array([1.0, 0.7, 0.45])
    beam = (np.abs(along % _BAY - _BAY / 2) > 1.3) | (np.abs(across % 2.0 - 1.0) > 0.88)
    return np.asarray(np.where(beam[:, None], 0.3 * boards, boards), np.float32)


def _tiled_floor(across: Floats, along: Floats) -> Floats:
    """Black and white tiles; the bright side's windows lie on them as slanting pools of light."""
    checker = (np.floor(across / 0.6) + np.floor(along / 0.6)) % 2
    tile = np.where(checker > 0, 0.42, 0.07) * (1 + 0.25 * _noise(across, along, 5, 6))
    slant = (along + 0.35 * across) % _BAY - _BAY / 2
    pool = (np.abs(slant) < 0.7) & (across > -1.0) & (across < 3.5) & (np.abs(slant * 3 % 1 - 0.5) < 0.44)
    light = np.where(pool, 5.5, 0.40 + 0.05 * across)
    return np.asarray((tile * light)[:, None] * np.array([1.0, 0.93, 0.82]), np.float32)


def _with_lamps(image: Floats) -> Floats:
    """Chandeliers of candles and a row of sconces: many small lights, from 100 to 3000 times the walls' radiance."""
    rng = np.random.default_rng(7)
    lamps = []
    for z in (-9.0, -3.0, 3.0, 9.0):
        for k in range(16):
            ring, angle = (1.1 if k % 2 else 0.7), 2 * np.pi * k / 16
            lamps.append((ring * np.cos(angle), 4.0 + 0.3 * (k % 2), z + ring * np.sin(angle), 0.05))
    lamps += [(side * 5.8, 1.8, z, 0.08) for side in (-1, 1) for z in np.arange(-13.5, 14, _BAY)]
    x, y, z, radius = np.array(lamps).T
    distance = np.sqrt(x * x + y * y + z * z)
    rows = (np.arccos(y / distance) / np.pi * HEIGHT).astype(int)
    columns = (np.arctan2(x, -z) / (2 * np.pi) * WIDTH).astype(int) % WIDTH
    # A lamp is smaller than a pixel: its pixel takes its flux.
    pixel = 2 * np.pi**2 / (HEIGHT * WIDTH) * np.sqrt(1 - (y / distance) ** 2)
    radiance = rng.uniform(250, 900, len(lamps)) * np.pi * (radius / distance) ** 2 / pixel
    np.add.at(image, (rows, columns), (radiance[:, None] * np.array([1.0, 0.72, 0.42])).astype(np.float32))
    return image


BUILTIN: dict[str, Callable[[], Floats]] = {"sky": sky, "studio": studio, "hall": hall}
