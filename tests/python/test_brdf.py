"""Models of reflectance against 50-digit values and Mitsuba; measured materials against Mitsuba and against themselves.

``python tests/python/test_brdf.py`` prints the table that stands in the docstring of `deltalux.brdf`.
"""

from __future__ import annotations

import itertools
import pickle
import struct
from dataclasses import replace
from pathlib import Path

import deltalux as dl
import numpy as np
import pytest
from deltalux import brdf
from deltalux.brdf import tensor_file
from deltalux.brdf.model import Model
from hypothesis import given
from hypothesis import strategies as st
from tools import needed

RGL = Path(__file__).parents[2] / "../shared/data/brdf/rgl"
METAL = {"n": 0.2, "k": 3.9}
UP = (0.0, 0.0, 1.0)


def at(theta, phi=0.0):
    """Unit directions at angles to the normal and azimuths, in degrees."""
    theta, phi = np.radians(theta), np.radians(phi)
    parts = np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)
    return np.stack(np.broadcast_arrays(*parts), axis=-1)


def hemisphere(count, seed=0):
    """Directions spread evenly."""
    z, turn = np.random.default_rng(seed).random((2, count))
    return at(np.degrees(np.arccos(z)), 360 * turn)


# ---- 50 digits -------------------------------------------------------------------------------------------------------
# The formulas as the papers print them, with all the cancellation that 50 digits can afford.


class Exactly:
    """Two directions and their half vector in 50 digits; moved by something, they are no longer of length 1."""

    def __init__(self, mp, wi, wo, by):
        self.mp = mp
        self.wi, self.wo = (
            [x + d for x, d in zip(self.unit(w), move, strict=True)] for w, move in zip((wi, wo), by, strict=True)
        )
        h = self.unit([a + b for a, b in zip(self.wi, self.wo, strict=True)])
        self.nh, self.vh = h[2], self.dot(h, self.wo)
        self.nl, self.nv = self.wi[2], self.wo[2]
        across = h[0] ** 2 + h[1] ** 2
        # cos² and sin² of the azimuth of the half vector.
        self.round = (h[0] ** 2 / across, h[1] ** 2 / across) if across else (mp.mpf(1), mp.mpf(0))
        self.tan2 = 1 / self.nh**2 - 1

    def dot(self, a, b):
        return sum(x * y for x, y in zip(a, b, strict=True))

    def unit(self, v):
        v = [self.mp.mpf(float(x)) if not isinstance(x, self.mp.mpf) else x for x in v]
        length = self.mp.sqrt(self.dot(v, v))
        return [x / length for x in v]

    def fresnel(self, n, k, f0=None):
        mp, c = self.mp, self.vh
        if f0 is not None:
            return f0 + (1 - mp.mpf(f0)) * (1 - c) ** 5
        if n is None:
            return mp.mpf(1)
        m = mp.mpc(n, -(k or 0))
        q = mp.sqrt(m**2 - (1 - c**2))
        s, p = (c - q) / (c + q), (m**2 * c - q) / (m**2 * c + q)
        return (abs(s) ** 2 + abs(p) ** 2) / 2

    def slopes(self, alpha, alpha_v):
        return self.tan2 * (
            self.round[0] / self.mp.mpf(alpha) ** 2 + self.round[1] / self.mp.mpf(alpha_v or alpha) ** 2
        )

    def area(self, alpha, alpha_v):
        return self.mp.pi * self.mp.mpf(alpha) * self.mp.mpf(alpha_v or alpha)

    def tangent(self, w, alpha, alpha_v):
        """alpha tan theta, with the roughness along the direction's azimuth."""
        x, y = w[0] * self.mp.mpf(alpha), w[1] * self.mp.mpf(alpha_v or alpha)
        return self.mp.sqrt(x**2 + y**2) / w[2]

    # The models, by the names of their classes.

    def Lambert(self):
        return 1 / self.mp.pi

    def Lafortune(self, exponent, coefficients):
        most = max(abs(c) for c in coefficients)
        base = sum(self.mp.mpf(c) / most * a * b for c, a, b in zip(coefficients, self.wi, self.wo, strict=True))
        return (exponent + 2) / (2 * self.mp.pi) * (base**exponent if base > 0 else 0)

    def Phong(self, exponent):
        return self.Lafortune(exponent, (-1, -1, 1))

    def BlinnPhong(self, exponent):
        g = self.mp.mpf(exponent)
        return (g + 2) * (g + 4) / (8 * self.mp.pi * (2 ** (-g / 2) + g)) * self.nh**g

    def WardDuer(self, alpha, alpha_v):
        return self.mp.exp(-self.slopes(alpha, alpha_v)) / (4 * self.area(alpha, alpha_v) * self.nl * self.nv)

    def Ward(self, alpha, alpha_v):
        return self.WardDuer(alpha, alpha_v) * self.mp.sqrt(self.nl * self.nv)

    def microfacet(self, D, G, F):
        return F * D * G / (4 * self.nl * self.nv)

    def gauss(self, alpha, alpha_v=None):
        return self.mp.exp(-self.slopes(alpha, alpha_v)) / (self.area(alpha, alpha_v) * self.nh**4)

    def CookTorrance(self, sigma, n, k):
        G = min(self.mp.mpf(1), 2 * self.nh * self.nv / self.vh, 2 * self.nh * self.nl / self.vh)
        return self.microfacet(self.gauss(sigma), G, self.fresnel(n, k))

    def Beckmann(self, alpha, alpha_v, n, k):
        def smith(w):
            a = 1 / (self.tangent(w, alpha, alpha_v) or self.mp.mpf("1e-40"))
            top = self.mp.mpf("3.535") * a + self.mp.mpf("2.181") * a**2
            return top / (1 + self.mp.mpf("2.276") * a + self.mp.mpf("2.577") * a**2) if a < 1.6 else self.mp.mpf(1)

        return self.microfacet(self.gauss(alpha, alpha_v), smith(self.wi) * smith(self.wo), self.fresnel(n, k))

    def GGX(self, alpha, alpha_v, n, k):
        def smith(w):
            return 2 / (1 + self.mp.sqrt(1 + self.tangent(w, alpha, alpha_v) ** 2))

        D = 1 / (self.area(alpha, alpha_v) * self.nh**4 * (1 + self.slopes(alpha, alpha_v)) ** 2)
        return self.microfacet(D, smith(self.wi) * smith(self.wo), self.fresnel(n, k))

    def AshikhminShirley(self, exponent, exponent_v, f0, n, k):
        u, v = self.mp.mpf(exponent), self.mp.mpf(exponent if exponent_v is None else exponent_v)
        lobe = self.nh ** (u * self.round[0] + v * self.round[1])
        constant = self.mp.sqrt((u + 1) * (v + 1)) / (8 * self.mp.pi)
        return constant * lobe * self.fresnel(n, k, f0) / (self.vh * max(self.nl, self.nv))


MODELS = (
    brdf.Lambert(),
    brdf.Phong(3),
    brdf.Phong(1e5),
    brdf.Lafortune(7.5, (-1, -0.8, 0.6)),
    brdf.Lafortune(1e4, (1, 1, 1)),
    brdf.Lafortune(2.5, (1, 0.1, 0)),
    brdf.BlinnPhong(0),
    brdf.BlinnPhong(3),
    brdf.BlinnPhong(1e5),
    brdf.Ward(0.3),
    brdf.Ward(0.005, 0.5),
    brdf.WardDuer(0.002),
    brdf.WardDuer(0.2, 0.4),
    brdf.CookTorrance(0.1, 1.5),
    brdf.CookTorrance(2.0),
    brdf.Beckmann(0.002, **METAL),
    brdf.Beckmann(0.5, 0.2, 1.0001),
    brdf.GGX(0.002),
    brdf.GGX(0.05, 0.7, **METAL),
    brdf.GGX(1.0, n=0.6),
    brdf.AshikhminShirley(1e5, f0=0.04),
    brdf.AshikhminShirley(3, 300, n=1.33),
)


def hard_pairs():
    """Pairs near the mirror direction, in the tail, at grazing angles, equal, and opposite."""
    rng = np.random.default_rng(3)
    eyes = np.concatenate([hemisphere(25, 1), at([0, 45, 75, 89.99, 89.9999], [0, 90, 30, 200, 45])])
    mirrored = eyes * (-1, -1, 1)
    for spread in (0, 1e-8, 1e-4, 3e-3, 0.1, 2.0):
        wi = mirrored + spread * rng.normal(size=eyes.shape)
        yield from zip(wi * np.sign(wi[:, 2:]), eyes, strict=True)
    yield from zip(eyes, eyes, strict=True)
    # One from nearly behind the other, both nearly on the horizon.
    yield from zip(at(90 - 10.0 ** -np.arange(1, 9), 180), at(90 - 10.0 ** -np.arange(2, 10), 0), strict=True)


@pytest.mark.parametrize("model", MODELS, ids=str)
def test_values_to_fifty_digits(model):
    """As near as directions that are themselves rounded allow: 16 units of it, and what moving them by one does."""
    mp = needed("mpmath").mp.clone()
    mp.dps = 50
    rng = np.random.default_rng(5)
    parameters = vars(model)
    compared = 0
    for wi, wo in hard_pairs():

        def exactly(by=0.0, wi=wi, wo=wo):
            moves = by * rng.uniform(-1, 1, (2, 3))
            return getattr(Exactly(mp, wi, wo, moves), type(model).__name__)(**parameters)

        right, found = exactly(), float(model.evaluate(wi, wo))
        assert np.isfinite(found) and found >= 0
        if right < 1e-290:
            assert found < 1e-280
            continue
        moved = max(abs(exactly(2.0**-52) - right) for _ in range(4))
        assert abs(found - right) <= 16 * 2.0**-52 * right + 4 * moved, (wi, wo, found, float(right))
        compared += 1
    assert compared > 40


# ---- What each does with light ---------------------------------------------------------------------------------------

ROUGH = (0.002, 0.05, 0.1, 0.3, 1.0, 2.0, 10.0)
POWERS = (0.0, 3.0, 30.0, 300.0, 1e4, 1.25e5)
ANGLES = (0, 15, 30, 45, 60, 75, 80, 85, 87, 89)
FAMILIES = {
    "Lambert": [brdf.Lambert()],
    "Phong": [brdf.Phong(n) for n in POWERS],
    "BlinnPhong": [brdf.BlinnPhong(n) for n in (*POWERS, 5e5)],
    "Lafortune": [
        brdf.Lafortune(n, c) for n, c in itertools.product(POWERS, ((-1, -1, 0.6), (1, 1, 1), (-0.3, -0.8, -0.5)))
    ],
    "Ward": [brdf.Ward(a, b) for a, b in itertools.product(ROUGH, (None, 0.02, 0.5))],
    "WardDuer": [brdf.WardDuer(a, b) for a, b in itertools.product(ROUGH, (None, 0.02, 0.5))],
    "CookTorrance": [brdf.CookTorrance(a) for a in ROUGH],
    "Beckmann": [brdf.Beckmann(a, b) for a, b in itertools.product(ROUGH, (None, 0.02, 0.5))],
    "GGX": [brdf.GGX(a, b) for a, b in itertools.product(ROUGH, (None, 0.02, 0.5))],
    "AshikhminShirley": [brdf.AshikhminShirley(a, b) for a, b in itertools.product((*POWERS, 5e5), (None, 10, 1e3))],
}


def claims() -> str:
    """The table of `deltalux.brdf`: of each family the largest directional albedo and asymmetry."""
    ruler = f"{'=' * 16}  {'=' * 14}  {'=' * 14}  {'=' * 9}"
    lines = [ruler, f"{'model':<16}  {'largest albedo':<14}  {'up to 75 deg':<14}  asymmetry", ruler]
    wi, wo = hemisphere(20_000, 1), hemisphere(20_000, 2)
    # Half of them about the lobe.
    wi[::2] = wo[::2] * (-1, -1, 1) + 0.02 * np.random.default_rng(3).normal(size=wo[::2].shape)
    for name, models in FAMILIES.items():
        albedo = np.array([model.albedo(at(ANGLES, 20)) for model in models])
        there = np.array([model.evaluate(wi, wo) for model in models])
        back = np.array([model.evaluate(wo, wi) for model in models])
        apart = np.abs(there - back)[there > 1e-200] / (there + back)[there > 1e-200]
        asymmetry = "rounding" if apart.max() < 1e-8 else f"{2 * apart.max():.1e}"
        steep = albedo[:, np.array(ANGLES) <= 75].max()
        lines.append(f"{name:<16}  {albedo.max():<14.3f}  {steep:<14.3f}  {asymmetry}")
    return "\n".join([*lines, ruler])


def test_the_documented_claims_are_measured():
    assert claims() in (brdf.__doc__ or "")


def test_wide_albedos():
    """METHODS of Ward, Ward-Dür and Ashikhmin-Shirley at normal incidence, by numbers of an independent program."""
    known = {
        brdf.Ward(0.1): 0.97,
        brdf.Ward(0.3): 0.79,
        brdf.Ward(1.0): 0.26,
        brdf.WardDuer(0.1): 0.98,
        brdf.WardDuer(0.3): 0.86,
        brdf.WardDuer(1.0): 0.35,
        brdf.AshikhminShirley(3): 0.42,
        brdf.AshikhminShirley(30): 0.88,
        brdf.AshikhminShirley(300): 0.99,
        brdf.BlinnPhong(300): 1.00,
        brdf.CookTorrance(0.1): 1.00,
    }
    for model, albedo in known.items():
        assert abs(model.albedo(UP) - albedo) < 6e-3, model


# ---- The Python face -------------------------------------------------------------------------------------------------


def test_floats_and_arrays():
    model = dl.brdf.GGX(alpha=0.2)
    wi, wo = hemisphere(12, 1).reshape(3, 4, 3), hemisphere(4, 2)
    values = model.evaluate(wi, wo)
    assert values.shape == (3, 4) == model.pdf(wi, wo).shape
    assert isinstance(model.evaluate(UP, UP), float) and isinstance(model.albedo(UP), float)
    assert values[1, 2] == model.evaluate(7 * wi[1, 2], wo[2]) or abs(values[1, 2] / model.evaluate(
        7 * wi[1, 2], wo[2]) - 1) < 1e-12  # fmt: skip
    sampled, pdf = model.sample(wo, np.full((5, 1, 2), 0.3))
    assert sampled.shape == (5, 4, 3) and pdf.shape == (5, 4)
    np.testing.assert_allclose(model.pdf(sampled, wo), pdf, rtol=1e-9)
    below = wo * (1, 1, -1)
    assert not model.evaluate(below, wo).any() and not model.evaluate(wo, below).any()
    assert not model.sample(below, (0.5, 0.5))[1].any() and not model.albedo(below).any()


def test_models_are_values():
    model = brdf.Lafortune(10, [-1, -1, 0.5])
    assert model == replace(model) == pickle.loads(pickle.dumps(model)) and hash(model) == hash(replace(model))
    assert model.coefficients == (-1.0, -1.0, 0.5) and brdf.Ward(1) == brdf.Ward(1.0) != brdf.Ward(1, 1)
    assert brdf.Phong(20).evaluate(UP, UP) == brdf.Lafortune(20).evaluate(UP, UP)


@pytest.mark.parametrize(
    "make, message",
    [
        (lambda: brdf.GGX(0.001), "alpha of 0.002 or more, got 0.001: mirrors"),
        (lambda: brdf.GGX(0.1, np.nan), "alpha_v from 0.002 to 10, got NaN"),
        (lambda: brdf.Ward("rough"), "alpha to be a number, got 'rough'"),
        (lambda: brdf.CookTorrance(11), "sigma from 0.002 to 10, got 11"),
        (lambda: brdf.CookTorrance(0.1, k=1), "n beside k, got k alone"),
        (lambda: brdf.Beckmann(0.1, n=-1), "n from 0.01 to 100, got -1"),
        (lambda: brdf.Phong(1e6), "exponent of 125000 or less, got 1000000: mirrors"),
        (lambda: brdf.AshikhminShirley(1, -1), "exponent_v from 0 to 500000, got -1"),
        (lambda: brdf.AshikhminShirley(1, f0=0.5, n=1.5), "n or f0, got both"),
        (lambda: brdf.Lafortune(1, (0, 0, 0)), "three finite coefficients, not all 0"),
        (lambda: brdf.Lafortune(1, (1, 1)), "coefficients to be three numbers, got"),
        (lambda: brdf.Lambert().evaluate((0, 0, 0), UP), "finite directions other than"),
        (lambda: brdf.Lambert().evaluate(np.ones((2, 3)), np.ones((3, 3))), "wi and wo that broadcast"),
        (lambda: brdf.Lambert().sample(UP, (0.5, 1.0)), r"u of shape \(..., 2\) in \[0, 1\)"),
        (lambda: brdf.Lambert().sample(np.ones((2, 3)), np.full((3, 2), 0.5)), "wo and u that broadcast"),
    ],
)
def test_refusals(make, message):
    with pytest.raises(ValueError, match=message):
        make()


# ---- Against Mitsuba -------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def mi():
    mitsuba = needed("mitsuba")
    mitsuba.set_variant("scalar_rgb")
    return mitsuba


def of_mitsuba(mi, plugin, wi, wo):
    """f cos and the density, as Mitsuba has them: its `wi` is the eye."""
    bsdf, context = mi.load_dict(plugin), mi.BSDFContext()
    values, densities = [], []
    for light, eye in zip(wi, wo, strict=True):
        interaction = mi.SurfaceInteraction3f()
        interaction.wi, interaction.sh_frame = mi.Vector3f(*eye), mi.Frame3f(mi.Normal3f(*UP))
        values.append(np.array(bsdf.eval(context, interaction, mi.Vector3f(*light))))
        densities.append(bsdf.pdf(context, interaction, mi.Vector3f(*light)))
    return np.array(values), np.array(densities)


@pytest.mark.parametrize("alpha", [(0.1, 0.1), (0.2, 0.5), (0.6, 0.05)], ids=str)
@pytest.mark.parametrize("index", [{}, METAL, {"n": 1.5, "k": 0.0}], ids=str)
@pytest.mark.parametrize("name", ["ggx", "beckmann"])
def test_rough_conductors_of_mitsuba(mi, name, alpha, index):
    wi, wo = hemisphere(200, 1), hemisphere(200, 2)
    plugin = {"type": "roughconductor", "distribution": name, "alpha_u": alpha[0], "alpha_v": alpha[1]}
    # Ours samples GGX by the facets that are seen, and Beckmann by all.
    plugin["sample_visible"] = name == "ggx"
    plugin |= {"material": "none"}
    if index:
        del plugin["material"]
        plugin |= {"eta": mi_colour(index["n"]), "k": mi_colour(index["k"])}
    model = {"ggx": brdf.GGX, "beckmann": brdf.Beckmann}[name](*alpha, **index)
    values, densities = of_mitsuba(mi, plugin, wi, wo)
    np.testing.assert_allclose(model.evaluate(wi, wo) * wi[:, 2], values[:, 0], rtol=1e-4, atol=1e-7)
    np.testing.assert_allclose(model.pdf(wi, wo), densities, rtol=1e-4, atol=1e-7)


def mi_colour(value):
    return {"type": "rgb", "value": [value] * 3}


# ---- Measured materials ----------------------------------------------------------------------------------------------


def tensor_bytes(fields):
    """A tensor file of these arrays."""
    kinds = {"uint8": 1, "float32": 10}
    head = sum(2 + len(name) + 11 + 8 * array.ndim for name, array in fields.items())
    out, data = bytearray(tensor_file.MAGIC + struct.pack("<2BI", 1, 0, len(fields))), bytearray()
    begins = len(out) + head
    for name, array in fields.items():
        out += struct.pack("<H", len(name)) + name.encode()
        out += struct.pack(f"<HBQ{array.ndim}Q", array.ndim, kinds[array.dtype.name], begins + len(data), *array.shape)
        data += array.tobytes()
    return bytes(out + data)


def material(rng, phi=1, span=2 * np.pi, theta=4):
    """Tables of no material, in the shapes of a measured one."""
    table = lambda *shape: rng.uniform(0.1, 1.0, shape).astype(np.float32)  # noqa: E731
    return {
        "phi_i": np.linspace(-np.pi, span - np.pi, phi, dtype=np.float32) if phi > 1 else np.zeros(1, np.float32),
        "theta_i": np.linspace(0, np.pi / 2, theta, dtype=np.float32),
        "ndf": table(6, 7),
        # What an isotropic material shows does not depend on the azimuth.
        "sigma": table(5, 8) if phi > 1 else np.repeat(table(1, 8), 5, axis=0),
        "vndf": table(phi, theta, 9, 10),
        "luminance": table(phi, theta, 5, 5),
        "rgb": table(phi, theta, 3, 5, 5),
        "jacobian": np.ones(1, np.uint8),
        "description": np.frombuffer(b"none\0", np.uint8),
    }


def without_negatives(path, to):
    """A file as our reader takes it: Mitsuba interpolates what is negative, too."""
    fields = tensor_file.read(path.read_bytes())
    kept = {name: np.maximum(array, 0) for name, array in fields.items() if array.dtype.name in ("float32", "uint8")}
    to.write_bytes(tensor_bytes(kept))
    return to


def agrees_with_mitsuba(mi, path, seed):
    wi, wo = hemisphere(300, seed), hemisphere(300, seed + 1)
    values, densities = of_mitsuba(mi, {"type": "measured", "filename": str(path)}, wi, wo)
    ours = brdf.Measured.load(path)
    np.testing.assert_allclose(ours.evaluate(wi, wo) * wi[:, 2:], values, rtol=2e-4, atol=1e-6)
    np.testing.assert_allclose(ours.pdf(wi, wo), densities, rtol=2e-4, atol=1e-6)


@pytest.mark.parametrize("name", ["paper_white", "vch_golden_yellow", "cc_ibiza_sunset"])
def test_measured_materials_are_those_of_mitsuba(mi, tmp_path, name):
    path = RGL / f"{name}_rgb.bsdf"
    if not path.exists():
        pytest.skip("optional data")
    agrees_with_mitsuba(mi, without_negatives(path, tmp_path / "a.bsdf"), 5)


@pytest.mark.parametrize("phi, span", [(1, 0), (9, 2 * np.pi), (5, np.pi), (3, np.pi / 2)])
def test_anisotropic_tables_are_those_of_mitsuba(mi, tmp_path, phi, span):
    path = tmp_path / "a.bsdf"
    path.write_bytes(tensor_bytes(material(np.random.default_rng(1), phi, span)))
    agrees_with_mitsuba(mi, path, 7)
    assert brdf.Measured.load(path).description == "none"


@pytest.fixture(scope="module")
def merl(tmp_path_factory):
    """A Blinn-Phong lobe over a diffuse part in MERL's grid, at the centres of its cells, and the file."""
    model, colour = brdf.BlinnPhong(40), np.array([0.2, 0.3, 0.4])
    # The half vector's angle alone decides; the others are free.
    centres = ((np.arange(90) + 0.5) / 90) ** 2 * 90
    lobe = model.evaluate(at(centres), at(centres)) * (centres < 90)
    table = np.broadcast_to((lobe[:, None] + colour)[:, None, None, :], (90, 90, 180, 3))
    scale = np.array([1, 1.15, 1.66]) / 1500
    path = tmp_path_factory.mktemp("merl") / "blinn-phong.binary"
    stored = np.moveaxis(table / scale, -1, 0).astype("<f8")
    path.write_bytes(np.array([90, 90, 180], "<i4").tobytes() + stored.tobytes())
    return model, colour, path


def test_merl_round_trip(merl):
    model, colour, path = merl
    measured = brdf.Measured.load(path)
    wi, wo = hemisphere(5000, 1), hemisphere(5000, 2)
    half = (wi + wo) / np.linalg.norm(wi + wo, axis=1, keepdims=True)
    # A lookup is off by no more than half a cell of theta_h.
    cell = np.sqrt(np.degrees(np.arccos(half[:, 2])) * 90)
    ends = [((np.floor(cell) + k) / 90) ** 2 * 90 for k in (0, 1)]
    low, high = sorted((model.evaluate(at(end), at(end))[:, None] + colour for end in ends), key=np.sum)
    found = measured.evaluate(wi, wo)
    assert np.all(found >= low - 1e-6) and np.all(found <= high + 1e-6)
    np.testing.assert_array_equal(found, measured.evaluate(wo, wi))
    assert measured.clamped == 0 and measured.description == ""
    expected = model.albedo(at(40)) + np.pi * colour
    np.testing.assert_allclose(measured.albedo(at(40)), expected, atol=5e-3)


def merl_reference(table, wi, wo):
    """The cell that MERL's program reads: rotate by -phi_h about z, then by -theta_h about y."""
    half = (wi + wo) / np.linalg.norm(wi + wo)
    theta, phi = np.arccos(half[2]), np.arctan2(half[1], half[0])
    x, y, z = wi[0] * np.cos(phi) + wi[1] * np.sin(phi), wi[1] * np.cos(phi) - wi[0] * np.sin(phi), wi[2]
    x, z = x * np.cos(theta) - z * np.sin(theta), x * np.sin(theta) + z * np.cos(theta)
    turn = np.arctan2(y, x) % np.pi
    cell = int(np.sqrt(theta / (np.pi / 2)) * 90), int(np.arccos(z) / (np.pi / 2) * 90), int(turn / np.pi * 180)
    return table[cell]


def test_merl_cells_are_those_of_its_program(tmp_path):
    table = np.random.default_rng(1).random((90, 90, 180))
    scaled = np.stack([table * 1500, table * 1500 / 1.15, -table])
    path = tmp_path / "a.binary"
    path.write_bytes(np.array([90, 90, 180], "<i4").tobytes() + scaled.astype("<f8").tobytes())
    measured = brdf.Measured.load(path)
    wi, wo = hemisphere(400, 1), hemisphere(400, 2)
    expected = np.array([merl_reference(table, *pair) for pair in zip(wi, wo, strict=True)])
    found = measured.evaluate(wi, wo)
    np.testing.assert_allclose(found[:, 0], expected, rtol=1e-6)
    np.testing.assert_allclose(found[:, 1], expected, rtol=1e-6)
    assert not found[:, 2].any() and measured.clamped == table.size


def measured_files(merl, tmp_path):
    path = tmp_path / "a.bsdf"
    path.write_bytes(tensor_bytes(material(np.random.default_rng(2), 5, np.pi)))
    return [merl[2], path, *([RGL / "vch_golden_yellow_rgb.bsdf"] if RGL.exists() else [])]


def test_measured_samples_carry_the_albedo(merl, tmp_path):
    for path in measured_files(merl, tmp_path):
        measured, wo = brdf.Measured.load(path), at(50, 200)
        wi, pdf = measured.sample(wo, np.random.default_rng(1).random((200_000, 2)))
        kept = pdf > 0
        np.testing.assert_allclose(measured.pdf(wi[kept], wo), pdf[kept], rtol=1e-6)
        everywhere = hemisphere(400_000, 3)
        assert abs(2 * np.pi * measured.pdf(everywhere, wo).mean() - kept.mean()) < 0.02
        even = 2 * np.pi * (measured.evaluate(everywhere, wo) * everywhere[:, 2:]).mean(axis=0)
        np.testing.assert_allclose(measured.albedo(wo), even, rtol=0.03, atol=1e-3)


@given(st.data())
def test_measured_tables_make_no_nan(data):
    """Zeros in any table, and directions on and below the horizon."""
    rng = np.random.default_rng(data.draw(st.integers(0, 1000)))
    fields = material(rng, *data.draw(st.sampled_from([(1, 0), (5, np.pi)])))
    for name in ("ndf", "vndf", "luminance", "rgb"):
        fields[name][rng.random(fields[name].shape) < 0.6] = 0
        fields[name].reshape(-1, fields[name].shape[-1] * fields[name].shape[-2])[:, 0] = 1
    core, _, _ = brdf.measured._rgl(fields)
    measured = brdf.Measured(core, "", 0)
    wi, wo = hemisphere(50, 1), hemisphere(50, 2)
    wi[:10] *= (1, 1, 0)
    wi[10:20], wo[20:30] = wo[10:20], at(90 - 10.0 ** -np.arange(10), 30)
    sampled, pdf = measured.sample(wo, rng.random((50, 2)))
    for found in (
        measured.evaluate(wi, wo),
        measured.pdf(wi, wo),
        pdf,
        measured.evaluate(sampled[pdf > 0], wo[pdf > 0]),
    ):
        assert np.isfinite(found).all() and (found >= 0).all()


def damaged():
    """Files that are none, with what is said of them."""
    rng = np.random.default_rng(1)
    whole = tensor_bytes(material(rng))
    yield "neither", b"BRDF" * 10
    yield "neither", b""
    yield "truncated in its header, at byte 12", whole[:13]
    yield "expected version 1.0 of tensor files, got 2.0", whole[:12] + b"\2" + whole[13:]
    yield "truncated", whole[:60]
    yield "field 'description' of shape", whole[:-1]
    yield "expected field 'phi_i' of a known type, got type 99", whole.replace(b"phi_i\1\0\n", b"phi_i\1\0c")
    huge = struct.pack("<Q", 2**63)
    yield "ends behind the file", whole[:36] + huge + whole[44:]
    yield "expected field '' of a known type, got type 0", whole[:14] + b"\xff" * 4 + whole[18:]
    empty = struct.pack("<H3sHBQ2Q", 3, b"ndf", 2, 10, 0, 2**63, 0)
    yield "field 'ndf' of shape", tensor_file.MAGIC + struct.pack("<2BI", 1, 0, 1) + empty
    for name, change, said in (
        ("rgb", None, "expected a field 'rgb'"),
        ("rgb", lambda a: a[:, :, :2], "expected rgb of shape"),
        ("rgb", lambda a: a * np.float32(np.nan), "expected finite numbers of rgb"),
        ("vndf", lambda a: a * 0, "something in every table of vndf"),
        ("vndf", lambda a: a[0], "expected vndf of float32 with 4 axes"),
        ("ndf", lambda a: a[:1], "expected ndf of 2 x 2 points or more, got 7 x 1"),
        ("sigma", lambda a: a * 0, "expected sigma above 0"),
        ("theta_i", lambda a: a[::-1], "expected theta_i in radians that ascend"),
        ("theta_i", lambda a: a.astype("u1"), "expected theta_i of float32"),
    ):
        fields = material(rng)
        fields[name] = np.ascontiguousarray(change(fields[name])) if change else fields.pop(name)
        if change is None:
            del fields[name]
        yield said, tensor_bytes(fields)
    fields = material(rng, 4, 1.0)
    yield "phi_i over a whole, a half or a quarter turn", tensor_bytes(fields)
    lengths = np.array([90, 90, 180], "<i4").tobytes()
    yield "expected 34992012 bytes of a MERL table, got 20", lengths + bytes(8)
    yield "expected a table that reflects something", lengths + bytes(34992000)
    yield "NaN or infinity", lengths + np.full(4374000, np.nan, "<f8").tobytes()


@pytest.mark.parametrize("number", range(len(list(damaged()))))
def test_damaged_files(tmp_path, number):
    said, content = list(damaged())[number]
    path = tmp_path / "a.file"
    path.write_bytes(content)
    with pytest.raises(dl.FileError, match=said) as raised:
        brdf.Measured.load(path)
    assert str(path) in str(raised.value)


@given(st.binary(max_size=300), st.integers(0, 400))
def test_hostile_bytes(tail, cut):
    """Whatever follows the magic, a ValueError is all that comes of it."""
    whole = tensor_bytes({name: array for name, array in material(np.random.default_rng(1)).items() if array.size < 50})
    for content in (tensor_file.MAGIC + tail, whole[:cut] + tail, whole[:cut] + tail + whole[cut + len(tail) :]):
        try:
            tensor_file.read(content if content.startswith(tensor_file.MAGIC) else tensor_file.MAGIC + content)
        except ValueError:
            pass


def test_every_model_is_tested():
    names = {name for name in brdf.__all__ if isinstance(getattr(brdf, name), type)} - {"Measured", "Model"}
    assert names == {type(model).__name__ for model in MODELS} == FAMILIES.keys()
    assert all(issubclass(getattr(brdf, name), Model) for name in names)


if __name__ == "__main__":
    print(claims())
