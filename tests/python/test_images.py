"""Environments in files: what headers say of a pixel's place and meaning is applied or refused, kind by kind."""

import contextlib
import itertools
import os
import struct
import subprocess
import sys
import textwrap
import warnings
import zlib
from pathlib import Path

import deltalux as dl
import numpy as np
import OpenImageIO as oiio
import pytest
from deltalux import Environment, FileError
from deltalux.images import writing
from deltalux.images.attributes import ATTRIBUTES
from deltalux.images.channels import choose
from deltalux.images.colour import from_chromaticities, to_xyz
from deltalux.io import load_image, save_image, to_display
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

# A lat-long picture in which every pixel differs from its mirror images and turns, and one is a lamp.
H, W = 8, 16
MAP = np.random.default_rng(7).uniform(0.25, 0.5, (H, W, 3)).astype(np.float32)
MAP[1, 3] = [64, 32, 16]

AP0 = (0.7347, 0.2653, 0.0, 1.0, 0.0001, -0.077, 0.32168, 0.33767)
AP1 = (0.713, 0.293, 0.165, 0.830, 0.128, 0.044, 0.32168, 0.33767)
P3 = (0.680, 0.320, 0.265, 0.690, 0.150, 0.060, 0.3127, 0.3290)


def rgbe(image):
    exponent = np.floor(np.log2(image.max(-1))) + 1
    out = np.zeros((*image.shape[:2], 4), np.uint8)
    out[..., :3] = np.floor(image * (256 / np.exp2(exponent))[..., None]).clip(0, 255)
    out[..., 3] = exponent + 128
    return out


def write_hdr(path, image, resolution=None, header=(), form="32-bit_rle_rgbe", body=None):
    height, width = image.shape[:2]
    lines = ["#?RADIANCE", f"FORMAT={form}", *header, "", resolution or f"-Y {height} +X {width}", ""]
    path.write_bytes("\n".join(lines).encode() + (rgbe(image).tobytes() if body is None else bytes(body)))


def save(path, parts, kind="float"):
    """Parts of (pixels, names of channels, attributes, fields of the spec)."""
    specs = []
    for pixels, names, attributes, fields in parts:
        spec = oiio.ImageSpec(pixels.shape[1], pixels.shape[0], pixels.shape[2], kind)
        spec.channelnames = tuple(names)
        for key, value in fields.items():
            setattr(spec, key, value)
        for key, value in attributes.items():
            if isinstance(value, tuple):
                spec.attribute(key, oiio.TypeDesc(f"float[{len(value)}]"), value)
            else:
                spec.attribute(key, value)
        specs.append(spec)
    writer = oiio.ImageOutput.create(str(path))
    assert writer.open(str(path), tuple(specs)) if len(specs) > 1 else writer.open(str(path), specs[0])
    for k, (spec, part) in enumerate(zip(specs, parts, strict=True)):
        assert not k or writer.open(str(path), spec, "AppendSubimage")
        assert writer.write_image(np.ascontiguousarray(part[0], np.float32))
    assert writer.close()


def save_one(path, pixels=MAP, names="RGB", kind="float", attributes=(), **fields):
    save(path, [(pixels, names, dict(attributes), fields)], kind)


# --- place -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("signs", ["-+", "--", "++", "+-"])
def test_radiance_pictures_are_upright_in_all_eight_orders(tmp_path, signs):
    y, x = signs
    stored = MAP[:: 1 if y == "-" else -1, :: 1 if x == "+" else -1]
    write_hdr(tmp_path / "rows.hdr", stored, f"{y}Y {H} {x}X {W}")
    write_hdr(tmp_path / "columns.hdr", stored.swapaxes(0, 1), f"{x}X {W} {y}Y {H}")
    for name in ("rows.hdr", "columns.hdr"):
        np.testing.assert_allclose(load_image(tmp_path / name)[0], MAP, rtol=0.02)


# What EXIF 2.32 says of row 0 and column 0 of what is stored, by hand: (row 0 is, column 0 is).
EXIF = {
    1: lambda a: a,
    2: lambda a: a[:, ::-1],
    3: lambda a: a[::-1, ::-1],
    4: lambda a: a[::-1],
    5: lambda a: a.swapaxes(0, 1),  # row 0 is the left side, column 0 the top
    6: lambda a: a.swapaxes(0, 1)[::-1],  # row 0 is the right side, column 0 the top
    7: lambda a: a.swapaxes(0, 1)[::-1, ::-1],  # row 0 is the right side, column 0 the bottom
    8: lambda a: a.swapaxes(0, 1)[:, ::-1],  # row 0 is the left side, column 0 the bottom
}


@pytest.mark.parametrize("orientation", EXIF)
def test_the_orientation_of_exif_and_tiff_is_undone(tmp_path, orientation):
    stored = EXIF[orientation](MAP)
    for name in ("a.tif", "a.exr"):
        save_one(tmp_path / name, stored, attributes={"Orientation": orientation})
        np.testing.assert_array_equal(load_image(tmp_path / name)[0], MAP)
    shown = np.round(255 * MAP.clip(0, 1)).astype(np.uint8)
    picture = Image.fromarray(np.ascontiguousarray(EXIF[orientation](shown)))
    exif = picture.getexif()
    exif[0x0112] = orientation
    picture.save(tmp_path / "a.png", exif=exif)
    plain = Image.fromarray(shown)
    plain.save(tmp_path / "b.png")
    np.testing.assert_array_equal(load_image(tmp_path / "a.png")[0], load_image(tmp_path / "b.png")[0])


@pytest.mark.parametrize("suffix", ["exr", "tif"])
def test_crops_stand_where_they_belong(tmp_path, suffix):
    path = tmp_path / f"a.{suffix}"
    save_one(path, MAP[1:5, 2:10], x=2, y=1, full_width=W, full_height=H)
    want = np.zeros_like(MAP)
    want[1:5, 2:10] = MAP[1:5, 2:10]
    np.testing.assert_array_equal(load_image(path)[0], want)


def test_overscan_is_cut_and_frames_may_start_anywhere(tmp_path):
    path = tmp_path / "a.exr"
    wide = np.pad(MAP, ((1, 1), (2, 2), (0, 0)), constant_values=9)
    save_one(path, wide, x=-2, y=-1, full_width=W, full_height=H)
    np.testing.assert_array_equal(load_image(path)[0], MAP)
    save_one(path, wide, x=8, y=9, full_x=10, full_y=10, full_width=W, full_height=H)
    np.testing.assert_array_equal(load_image(path)[0], MAP)
    save_one(path, MAP, x=100, full_width=W, full_height=H)
    with pytest.raises(FileError, match="all beyond it"):
        load_image(path)


def xmp(**words):
    """What a camera for panoramas writes of a picture."""
    inside = " ".join(f'GPano:{name}="{value}"' for name, value in words.items())
    rdf, pano = "http://www.w3.org/1999/02/22-rdf-syntax-ns#", "http://ns.google.com/photos/1.0/panorama/"
    return (
        f'<x:xmpmeta xmlns:x="adobe:ns:meta/"><rdf:RDF xmlns:rdf="{rdf}"><rdf:Description xmlns:GPano="{pano}" '
        f"{inside}/></rdf:RDF></x:xmpmeta>"
    ).encode()


def test_a_part_of_a_panorama_is_set_into_the_whole(tmp_path):
    crop = {"FullPanoWidthPixels": 16, "FullPanoHeightPixels": 8, "CroppedAreaLeftPixels": 4}
    crop |= {"CroppedAreaTopPixels": 2, "ProjectionType": "equirectangular"}
    grey = Image.new("RGB", (8, 4), (188, 188, 188))
    grey.save(tmp_path / "a.jpg", xmp=xmp(**crop))
    image, _ = load_image(tmp_path / "a.jpg")
    assert image.shape == (8, 16, 3) and (image[2:6, 4:12] > 0.49).all() and (image > 0).sum() == 8 * 4 * 3
    grey.save(tmp_path / "b.jpg", xmp=xmp(ProjectionType="cylindrical"))
    with pytest.raises(FileError, match="equirectangular"):
        load_image(tmp_path / "b.jpg")


@pytest.mark.parametrize(
    "pitch, roll, lamp, direction",
    [
        # The middle is so far above the horizon, and stays there when the picture turns about it.
        (30, 0, (15, 32), (0, 0.5, np.sqrt(0.75))),
        (-30, 70, (15, 32), (0, -0.5, np.sqrt(0.75))),
        # A quarter turn anticlockwise shows at the top what is right of the middle, which is -X.
        (0, 90, (0, 32), (-1, 0, 0)),
        (0, -90, (0, 32), (1, 0, 0)),
        # Turned so, it is the axis that the middle is raised about.
        (60, 90, (0, 32), (-1, 0, 0)),
    ],
)
def test_a_panorama_s_horizon_is_level(tmp_path, pitch, roll, lamp, direction):
    pixels = np.zeros((32, 64, 3), np.uint8)
    row, column = lamp
    pixels[row : row + 2, column - 1 : column + 1] = 255
    pixels[0] = pixels[0, lamp[1]]
    pose = {"PosePitchDegrees": pitch, "PoseRollDegrees": roll, "PoseHeadingDegrees": 77}
    Image.fromarray(pixels).save(tmp_path / "a.jpg", quality=100, xmp=xmp(ProjectionType="equirectangular", **pose))
    with pytest.warns(UserWarning, match="made for a display"):
        env = Environment.load(tmp_path / "a.jpg")
    assert env.radiance(direction).min() > 0.5
    assert env.radiance(-np.array(direction)).max() < 0.01


# --- meaning ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "factor, header",
    [
        (4, ["EXPOSURE=4.0"]),
        (4, ["EXPOSURE=2.0", "EXPOSURE= 2"]),
        ((2, 1, 0.5), ["COLORCORR=2 1 .5"]),
        ((4, 2, 1), ["COLORCORR=2 1 .5", "EXPOSURE=2"]),
    ],
)
def test_exposures_of_a_radiance_header_are_divided_out(tmp_path, factor, header):
    write_hdr(tmp_path / "a.hdr", MAP * np.float32(factor), header=header)
    image, about = load_image(tmp_path / "a.hdr")
    np.testing.assert_allclose(image, MAP, rtol=0.04)
    assert "divided by" in " ".join(about["notes"])


@pytest.mark.parametrize("line", ["EXPOSURE=0", "EXPOSURE=-1", "EXPOSURE=nan", "EXPOSURE=two", "COLORCORR=1 2"])
def test_exposures_that_are_none_are_refused(tmp_path, line):
    write_hdr(tmp_path / "a.hdr", MAP, header=[line])
    with pytest.raises(FileError, match="expected"):
        load_image(tmp_path / "a.hdr")


def test_old_run_lengths_and_xyz(tmp_path):
    body = bytearray()
    flat = np.repeat(MAP[:, ::8], 8, axis=1)  # runs of eight
    for row in rgbe(flat):
        for pixel in row[::8]:
            body += pixel.tobytes() + bytes([1, 1, 1, 7])
    write_hdr(tmp_path / "a.hdr", flat, body=body)
    np.testing.assert_allclose(load_image(tmp_path / "a.hdr")[0], flat, rtol=0.02)
    xyz = MAP @ to_xyz((0.64, 0.33, 0.30, 0.60, 0.15, 0.06, 0.3127, 0.3290)).T
    write_hdr(tmp_path / "b.hdr", xyz.astype(np.float32), form="32-bit_rle_xyze")
    np.testing.assert_allclose(load_image(tmp_path / "b.hdr")[0], MAP, rtol=0.06)
    write_hdr(tmp_path / "c.hdr", MAP, form="32-bit_rle_luv")
    with pytest.raises(FileError, match="expected FORMAT"):
        load_image(tmp_path / "c.hdr")


def test_primaries_are_converted_and_those_that_nobody_set_are_not(tmp_path):
    write_hdr(tmp_path / "a.hdr", MAP, header=["PRIMARIES=0 0 0 0 0 0 0 0"])  # Photoshop
    np.testing.assert_allclose(load_image(tmp_path / "a.hdr")[0], MAP, rtol=0.02)
    wide = MAP @ np.linalg.inv(from_chromaticities(P3)).T
    write_hdr(tmp_path / "b.hdr", wide.astype(np.float32), header=["PRIMARIES=" + " ".join(map(str, P3))])
    np.testing.assert_allclose(load_image(tmp_path / "b.hdr")[0], MAP, rtol=0.06)


def test_matrices_of_chromaticities_are_those_of_others():
    # ACES: TB-2014-004 (AP0 and AP1 to Rec.709 by Bradford), as OpenColorIO has them; Apple's P3.
    ap1 = [[1.70505, -0.62179, -0.08326], [-0.13026, 1.14080, -0.01055], [-0.02400, -0.12897, 1.15297]]
    np.testing.assert_allclose(from_chromaticities(AP1), ap1, atol=2e-4)
    ap0 = [[2.52169, -1.13413, -0.38756], [-0.27648, 1.37272, -0.09624], [-0.01538, -0.15298, 1.16835]]
    np.testing.assert_allclose(from_chromaticities(AP0), ap0, atol=2e-4)
    p3 = [[1.22494, -0.22494, 0], [-0.04206, 1.04206, 0], [-0.01964, -0.07864, 1.09827]]
    np.testing.assert_allclose(from_chromaticities(P3), p3, atol=2e-4)


@pytest.mark.parametrize("chromaticities", [AP0, AP1, P3])
def test_chromaticities_are_converted(tmp_path, chromaticities):
    stored = MAP @ np.linalg.inv(from_chromaticities(chromaticities)).T
    save_one(tmp_path / "a.exr", stored, attributes={"chromaticities": chromaticities})
    image, about = load_image(tmp_path / "a.exr")
    np.testing.assert_allclose(image, MAP, rtol=1e-3, atol=1e-4)
    assert "chromaticities" in about["notes"][0]


@pytest.mark.parametrize("name", ["ACEScg", "lin_p3d65_scene", "lin_rec2020_scene", "ACES2065-1"])
def test_named_spaces_are_converted(tmp_path, name):
    config = oiio.ImageBufAlgo.colorconvert(oiio.ImageBuf(MAP), "lin_rec709_scene", name)
    save_one(tmp_path / "a.exr", config.get_pixels("float"), attributes={"oiio:ColorSpace": name})
    np.testing.assert_allclose(load_image(tmp_path / "a.exr")[0], MAP, rtol=1e-3, atol=1e-3)


@pytest.mark.parametrize("text", [b"\xff\xfein_rec70", b"\xe4cescg\0\0\0\0", b"\x80" * 10])
def test_text_of_a_header_that_is_none_is_refused(tmp_path, text):
    """Of 1,500 EXRs with harmed headers 15 raised a TypeError of the library, and 25 a UnicodeDecodeError before."""
    save_one(tmp_path / "a.exr", attributes={"oiio:ColorSpace": "lin_rec709"})
    whole = (tmp_path / "a.exr").read_bytes()
    assert whole.count(b"lin_rec709") == 1
    (tmp_path / "a.exr").write_bytes(whole.replace(b"lin_rec709", text))
    with pytest.raises(FileError, match="a colour space that is known|corrupt text|can be read"):
        load_image(tmp_path / "a.exr")


def test_harmed_headers_are_refused_or_read(tmp_path):
    save_one(tmp_path / "a.exr", attributes={"oiio:ColorSpace": "lin_rec709", "comment": "light", "owner": "us"})
    whole, random = (tmp_path / "a.exr").read_bytes(), np.random.default_rng(1)
    for _ in range(150):
        harmed = np.frombuffer(whole, np.uint8).copy()
        harmed[random.integers(0, 500, random.integers(1, 5))] = random.integers(0, 256)
        (tmp_path / "b.exr").write_bytes(harmed.tobytes())
        with contextlib.suppress(FileError), warnings.catch_warnings(action="ignore"):
            load_image(tmp_path / "b.exr")


def png(path, *chunks):
    """Eight by four pixels of (188, 100, 50), with chunks before them."""

    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    raw = b"".join(b"\0" + bytes([188, 100, 50] * 8) for _ in range(4))
    head = chunk(b"IHDR", struct.pack(">IIBBBBB", 8, 4, 8, 2, 0, 0, 0))
    middle = b"".join(chunk(*own) for own in chunks)
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + head + middle + chunk(b"IDAT", zlib.compress(raw)) + chunk(b"IEND", b""))


@pytest.mark.parametrize(
    "chunks, red",
    [
        ((), 0.5029),
        (((b"gAMA", struct.pack(">I", 100000)),), 188 / 255),
        (((b"gAMA", struct.pack(">I", 55556)),), 0.578),
    ],
)
def test_pngs_say_their_curve(tmp_path, chunks, red):
    png(tmp_path / "a.png", *chunks)
    assert load_image(tmp_path / "a.png")[0][0, 0, 0] == pytest.approx(red, abs=2e-3)


def test_curves_of_a_screen_are_refused(tmp_path):
    png(tmp_path / "a.png", (b"cICP", bytes([9, 16, 0, 1])))
    with pytest.raises(FileError, match="pq_rec2020"):
        load_image(tmp_path / "a.png")


def test_profiles_are_applied_to_8_bits(tmp_path):
    from PIL import ImageCms

    linear_xyz = ImageCms.ImageCmsProfile(ImageCms.createProfile("XYZ")).tobytes()
    picture = Image.new("RGB", (8, 4), (188, 100, 50))
    picture.save(tmp_path / "a.jpg", icc_profile=ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes())
    assert load_image(tmp_path / "a.jpg")[0][0, 0, 0] == pytest.approx(0.503, abs=0.01)
    picture.save(tmp_path / "b.jpg", icc_profile=linear_xyz)
    with pytest.raises(FileError, match="profile"):
        load_image(tmp_path / "b.jpg")


def test_luminance_and_chroma_become_colours(tmp_path):
    y = MAP @ [0.2126, 0.7152, 0.0722]
    chroma = np.stack([y, (MAP[..., 0] - y) / y, (MAP[..., 2] - y) / y], axis=-1)
    save_one(tmp_path / "a.exr", chroma, ["Y", "RY", "BY"])
    np.testing.assert_allclose(load_image(tmp_path / "a.exr")[0], MAP, rtol=1e-2)


def test_alpha_is_dropped_and_darkens_nothing(tmp_path):
    Image.new("RGBA", (8, 4), (188, 188, 188, 64)).save(tmp_path / "a.png")
    assert load_image(tmp_path / "a.png")[0] == pytest.approx(0.503, abs=1e-3)
    save_one(tmp_path / "a.exr", np.concatenate([MAP, np.zeros((H, W, 1))], -1), "RGBA")
    np.testing.assert_array_equal(load_image(tmp_path / "a.exr")[0], MAP)


def test_the_table_knows_every_attribute_that_it_should(tmp_path):
    # What libraries write about themselves, about time, and about how bytes are packed says nothing of a pixel.
    silent = {"compression", "DateTime", "Software", "name", "planarconfig", "fps", "ImageDescription", "XResolution"}
    silent |= {"YResolution", "ResolutionUnit", "screenWindowCenter", "screenWindowWidth", "colorInteropID", "owner"}
    prefixes = ("openexr:", "tiff:", "jpeg:", "png:", "oiio:", "ICCProfile:", "GPano:", "deltalux:", "Exif:", "xmp")
    known = {name for names in ATTRIBUTES for name in names.split(", ")}
    unknown = set()
    files = sorted((Path(__file__).parents[2] / "../shared/data/env").glob("*.exr"))
    save_image(tmp_path / "own.exr", MAP, {"deltalux:frame": 1})
    save_one(tmp_path / "a.exr", attributes={"chromaticities": AP0, "whiteLuminance": 1.0, "Orientation": 3})
    save_one(tmp_path / "a.tif")
    for file in [*files, *tmp_path.iterdir()]:
        reader = oiio.ImageInput.open(str(file))
        names = {one.name for one in reader.spec().extra_attribs}
        reader.close()
        unknown |= {name for name in names - known - silent if not name.startswith(prefixes)}
    told = {"fileHistory", "capDate", "utcOffset", "worldtoscreen", "averagecolor", "ConstantColor", "Copyright"}
    assert unknown <= told | {"FILE_NAME", "LUMINANCE"}, unknown


# --- channels --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "parts, layer, found",
    [
        ([("", "RGBA")], None, (0, (0, 1, 2))),
        ([("", ["A", "b", "g", "r", "Z"])], None, (0, (3, 2, 1))),
        ([("", ["AO.R", "AO.G", "AO.B", "rgba.R", "rgba.G", "rgba.B"])], None, (0, (3, 4, 5))),
        ([("", ["Depth.Z", "beauty.R", "beauty.G", "beauty.B"])], None, (0, (1, 2, 3))),
        ([("", ["View Layer.Normal.X", *(f"View Layer.Combined.{c}" for c in "RGBA")])], None, (0, (1, 2, 3))),
        ([("", ["beauty.red", "beauty.green", "beauty.blue", "Z"])], None, (0, (0, 1, 2))),
        ([("", [*(f"Normal.{c}" for c in "RGB"), *(f"Light.{c}" for c in "RGB")])], None, (0, (3, 4, 5))),
        ([("depth", "Z"), ("image", "RGB")], None, (1, (0, 1, 2))),
        ([("ao", "RGB"), ("beauty", "RGB")], None, (1, (0, 1, 2))),
        ([("normals", [f"normals.{c}" for c in "RGB"]), ("main", [f"main.{c}" for c in "RGB"])], None, (1, (0, 1, 2))),
        ([("", ["Y", "A"])], None, (0, (0,))),
        ([("", ["Y", "Z"])], None, (0, (0,))),
        ([("", ["AO.R", "AO.G", "AO.B", "rgba.R", "rgba.G", "rgba.B"])], "ao", (0, (0, 1, 2))),
        ([("", [*(f"L.sun.{c}" for c in "RGB"), *(f"L.sky.{c}" for c in "RGB")])], "sky", (0, (3, 4, 5))),
    ],
)  # fmt: skip
def test_channels_are_chosen_by_name(parts, layer, found):
    choice = choose(parts, layer)
    assert (choice.part, choice.channels) == found


@pytest.mark.parametrize(
    "parts, layer",
    [
        ([("", "Z")], None),
        ([("", ["X", "Y", "Z"])], None),
        ([("", ["normal.R", "normal.G", "normal.B"])], None),
        ([("", ["AO.R", "AO.G", "AO.B", "Depth.Z"])], None),
        ([("", ["S0.400,0nm", "S0.500,0nm"])], None),
        ([("", [*(f"sun.{c}" for c in "RGB"), *(f"sky.{c}" for c in "RGB")])], None),
        ([("", "RGB")], "sun"),
    ],
)
def test_what_is_not_light_is_refused_with_what_there_is(parts, layer):
    with pytest.raises(ValueError, match="layer|but the file has") as refused:
        choose(parts, layer)
    assert parts[0][1][0].split(".")[0] in str(refused.value)


def test_a_layer_is_asked_for_by_name(tmp_path):
    both = np.concatenate([MAP, 2 * MAP], -1)
    save_one(tmp_path / "a.exr", both, ["sun.R", "sun.G", "sun.B", "sky.R", "sky.G", "sky.B"])
    one, two = (Environment.load(tmp_path / "a.exr", layer=name).radiance([1, 2, 3]) for name in ("sun", "sky"))
    np.testing.assert_allclose(2 * one, two)
    with pytest.raises(FileError, match="'sky', 'sun'; choose one by layer="):
        Environment.load(tmp_path / "a.exr")


def test_parts_of_a_file_are_looked_through(tmp_path):
    parts = [(np.full((H, W, 1), 1e3), "Z", {"oiio:subimagename": "depth"}, {})]
    parts += [(MAP, "RGB", {"oiio:subimagename": "beauty"}, {})]
    save(tmp_path / "a.exr", parts)
    np.testing.assert_array_equal(load_image(tmp_path / "a.exr")[0], MAP)


# --- pixels ----------------------------------------------------------------------------------------------------------


def test_infinite_pixels_are_clipped_or_blackened(tmp_path):
    pixels = np.ones((H, W, 3), np.float32)
    pixels[2, 5], pixels[3, 0] = np.inf, np.nan
    save_one(tmp_path / "a.exr", pixels, kind="half")
    with pytest.raises(ValueError, match='repair="clip"'):
        Environment.load(tmp_path / "a.exr")
    for repair, sun in (("clip", 65504), ("zero", 0), ("clamp", 65504)):
        with pytest.warns(UserWarning, match="2 pixels"):
            map_, _ = Environment.load(tmp_path / "a.exr", repair=repair)._layers[0][1].pixels()
        assert (
            map_[2, 5].tolist() == [sun] * 3 and map_[3, 0].tolist() == [0] * 3 and (map_ == 1).sum() == 3 * (H * W - 2)
        )


def test_negative_pixels_are_lifted_and_what_changed_is_said():
    pixels = np.ones((H, W, 3))
    pixels[1, 2] = -np.array([1, 2, 3])
    with pytest.warns(UserWarning, match="1 pixels are negative .* 1.6 % of all"):
        env = Environment.from_latlong(pixels, repair="positive")
    assert env._layers[0][1].pixels()[0].min() == 0


def test_whole_numbers_are_no_radiance_unless_they_are_srgb():
    eight = np.full((4, 8, 3), 188, np.uint8)
    for make, pixels in ((Environment.from_latlong, eight), (Environment.from_cubemap, np.full((6, 2, 2, 3), 188))):
        with pytest.raises(ValueError, match=r'encoding="srgb".*astype\(float\)'):
            make(pixels)
    as_16_bit = Environment.from_latlong(eight.astype(np.uint16) * 257, encoding="srgb")
    for env in (Environment.from_latlong(eight, encoding="srgb"), as_16_bit):
        assert env.radiance([0, 1, 0.1])[0] == pytest.approx(0.503, abs=1e-3)


def test_pictures_of_a_display_are_light_with_a_warning(tmp_path):
    Image.new("RGB", (8, 4), (188, 188, 188)).save(tmp_path / "a.jpg")
    with pytest.warns(UserWarning, match="made for a display"):
        env = Environment.load(tmp_path / "a.jpg")
    assert env.radiance([0, 0, 1])[0] == pytest.approx(0.503, abs=0.01)


@pytest.mark.parametrize("layout", ["vertical-cross", "horizontal-cross"])
@pytest.mark.parametrize("start", [0, 4, 8])
def test_padded_crosses_are_no_probes(tmp_path, layout, start):
    # Faces of one colour each; the padding is grey.
    tall = layout == "vertical-cross"
    image = np.full((32, 32, 3), 0.5, np.float32)
    places = [(1, 2), (1, 0), (0, 1), (2, 1), (3, 1) if tall else (1, 3), (1, 1)]
    for face, (row, column) in enumerate(places):
        top, left = (8 * row, start + 8 * column) if tall else (start + 8 * row, 8 * column)
        image[top : top + 8, left : left + 8] = face + 1
    save_image(tmp_path / "a.exr", image)
    cubemap = Environment.load(tmp_path / "a.exr").cubemap(2)
    np.testing.assert_allclose(cubemap[:, 0, 0, 0], [1, 2, 3, 4, 5, 6], rtol=1e-5)


# --- whose rows ------------------------------------------------------------------------------------------------------


def directions(count=500):
    d = np.random.default_rng(3).normal(size=(count, 3))
    return d / np.linalg.norm(d, axis=1, keepdims=True)


def test_arrays_lie_as_mitsubas():
    mitsuba = pytest.importorskip("mitsuba")
    mitsuba.set_variant("scalar_rgb")
    image = np.random.default_rng(4).random((16, 32, 3)).astype(np.float32)
    theirs = mitsuba.load_dict({"type": "envmap", "bitmap": mitsuba.Bitmap(image)})
    d = directions()

    def looked(direction):
        interaction = mitsuba.SurfaceInteraction3f()
        interaction.wi = mitsuba.Vector3f(*(-direction))
        return np.array(theirs.eval(interaction))

    exact = np.array([looked(one) for one in d])
    np.testing.assert_allclose(Environment.from_latlong(image).radiance(d), exact, atol=2e-3)


def bilinear(image, row, column):
    """Between rows, clamped, and columns, repeating."""
    top, left = np.floor(row).astype(int), np.floor(column).astype(int)
    v, u = (row - top)[:, None], (column - left)[:, None]
    rows = [np.clip(top + k, 0, len(image) - 1) for k in (0, 1)]
    columns = [(left + k) % image.shape[1] for k in (0, 1)]
    lines = [image[r, columns[0]] * (1 - u) + image[r, columns[1]] * u for r in rows]
    return lines[0] * (1 - v) + lines[1] * v


def test_rows_lie_as_openexrs_and_columns_to_half_a_texel():
    # ImfEnvmap.cpp, LatLongMap::pixelPosition: latitude asin(y) and longitude atan2(x, z), from edge to edge.
    height, width = 16, 32
    d = directions()
    row = (0.5 - np.arcsin(d[:, 1]) / np.pi) * (height - 1)
    column = (np.arctan2(-d[:, 0], d[:, 2]) / (2 * np.pi) + 0.5) * (width - 1)
    by_rows = np.broadcast_to(np.random.default_rng(5).random((height, 1, 3)), (height, width, 3))
    ours = Environment.from_latlong(by_rows, rows="edge").radiance(d)
    np.testing.assert_allclose(ours, bilinear(by_rows, row, column), atol=1e-5)
    own = (np.arctan2(d[:, 0], -d[:, 2]) / (2 * np.pi)) % 1 * width - 0.5
    assert np.abs((own - column + width / 2) % width - width / 2).max() <= 0.5 + 1e-9


def test_rows_lie_as_blenders_turned_by_a_quarter():
    # Cycles, direction_to_equirectangular: u = 1/2 - atan2(y, x) / 2 pi, v = atan2(z, hypot(x, y)) / pi + 1/2 (from
    # the bottom), +Z up; texels have their centres at (i + 1/2) / n. With +Y up (x, y, z) there is (x, z, -y) here.
    height, width = 16, 32
    image = np.random.default_rng(6).random((height, width, 3))
    d = directions()
    x, y, z = d[:, 0], -d[:, 2], d[:, 1]
    u, v = 0.5 - np.arctan2(y, x) / (2 * np.pi), np.arctan2(z, np.hypot(x, y)) / np.pi + 0.5
    row, column = (1 - v) * height - 0.5, u * width - 0.5
    inside = (row >= 0) & (row <= height - 1)  # Beyond the outermost rows Cycles clamps, and ours looks over the pole.
    ours = Environment.from_latlong(image, rows="centre").rotated(90).radiance(d)
    np.testing.assert_allclose(ours[inside], bilinear(image, row, column)[inside], atol=1e-5)


@pytest.mark.parametrize("height, width, size", [(2, 4, 4), (9, 16, 8), (64, 128, 4), (128, 256, 4)])
def test_maps_between_poles_keep_their_light(height, width, size):
    # The exact integral of the bilinear image, by fine quadrature in the cosine.
    image = np.random.default_rng(8).random((height, 1, 3)) ** 4
    env = Environment.from_latlong(np.repeat(image, width, axis=1), rows="edge")
    y = (np.arange(20000) + 0.5) / 10000 - 1
    mean = bilinear(image, np.arccos(y) / np.pi * (height - 1), np.zeros_like(y)).mean(axis=0)
    edge = np.linspace(-1, 1, size + 1)
    corner = np.arctan2(np.outer(edge, edge), np.sqrt(edge[:, None] ** 2 + edge[None] ** 2 + 1))
    areas = corner[1:, 1:] - corner[:-1, 1:] - corner[1:, :-1] + corner[:-1, :-1]
    for turned in (env, env.rotated(25, (1, 2, 3))):
        found = np.einsum("fijc,ij->c", turned.cubemap(size).astype(float), areas) / (4 * np.pi)
        np.testing.assert_allclose(found, mean, rtol=0.02 if turned is not env or height < 9 else 4e-3)


def test_files_lie_as_areas_and_rows_can_be_asked_for(tmp_path):
    save_image(tmp_path / "a.exr", MAP)
    d = directions(50)
    for rows in ("centre", "edge"):
        loaded, given = Environment.load(tmp_path / "a.exr", rows=rows), Environment.from_latlong(MAP, rows=rows)
        np.testing.assert_array_equal(loaded.radiance(d), given.radiance(d))
    np.testing.assert_array_equal(
        Environment.load(tmp_path / "a.exr").radiance(d), Environment.from_latlong(MAP, rows="centre").radiance(d)
    )


def test_hostile_headers_are_refused(tmp_path):
    path = tmp_path / "a.hdr"
    for resolution in ("-Y 99999 +X 99999", "-Y 0 +X 8", "-Y 8 -Y 8", "8 8", "-Y 8 +X", "-Y 99999999999999999999 +X 8"):
        write_hdr(path, MAP, resolution)
        with pytest.raises(FileError, match="expected|take more"):
            load_image(path)
    for data in (b"#?", b"#?RADIANCE\n", b"#?RADIANCE\n\n", b"#?RADIANCE\n\n-Y 8 +X 8\n", b"#?" + b"x" * 100000):
        path.write_bytes(data)
        with pytest.raises(FileError, match="expected"):
            load_image(path)


def test_all_layouts_of_a_name_are_tried(tmp_path):
    # Any case of the colours, alone or in one layer, with or without alpha, in any order.
    for names, prefix in itertools.product(("RGB", "rgb", "BGR", "bgra"), ("", "main.", "scene.view.")):
        order = {"r": 0, "g": 1, "b": 2, "a": 0}
        pixels = MAP[..., [order[name.lower()] for name in names]]
        save_one(tmp_path / "a.exr", pixels, [prefix + name for name in names])
        np.testing.assert_array_equal(load_image(tmp_path / "a.exr")[0], MAP)


def agx(linear):
    """AgX as its authors write it, in numpy."""
    inset = [
        [0.842479062253094, 0.0784335999999992, 0.0792237451477643],
        [0.0423282422610123, 0.878468636469772, 0.0791661274605434],
        [0.0423756549057051, 0.0784336, 0.879142973793104],
    ]
    outset = [
        [1.19687900512017, -0.0980208811401368, -0.0990297440797205],
        [-0.0528968517574562, 1.15190312990417, -0.0989611768448433],
        [-0.0529716355144438, -0.0980434501171241, 1.15107367264116],
    ]
    low, high = -12.47393, 4.026069
    colours = np.maximum(linear, 0) @ np.transpose(inset)
    at = (np.log2(np.maximum(colours, 2.0**low)).clip(low, high) - low) / (high - low)
    shown = np.polyval([15.5, -40.14, 31.96, -6.868, 0.4298, 0.1191, -0.00232], at) @ np.transpose(outset)
    return np.round(255 * shown.clip(0, 1))


@given(st.lists(st.tuples(*[st.floats(-1, 1e4, width=32)] * 3), min_size=1, max_size=40), st.floats(-4, 4))
def test_agx_is_what_numpy_makes_of_it(colours, stops):
    linear = np.array([colours], np.float32)
    expected = agx(linear.astype(np.float64) * float(np.float32(2.0**stops)))
    # The core rounds the product of exposure and radiance to a float: a shade at most.
    assert np.abs(to_display(linear, stops, "agx").astype(float) - expected).max() <= 1


def test_agx_shows_sixteen_stops():
    # Grey stays grey: both matrices keep it, to rounding. So it is the sigmoid's value at its place among the stops.
    grey = to_display(np.full((1, 1, 3), 0.18), tone="agx")
    at = (np.log2(0.18) + 12.47393) / 16.5
    assert grey.tolist() == [
        [[round(255 * np.polyval([15.5, -40.14, 31.96, -6.868, 0.4298, 0.1191, -0.00232], at))] * 3]
    ]
    ramp = to_display(np.repeat(2.0 ** np.arange(-12, 5), 3).reshape(1, -1, 3), tone="agx")[0, :, 0].astype(int)
    assert (np.diff(ramp) >= 0).all() and ramp[0] < 3 and ramp[-1] > 250 and (np.diff(ramp)[3:13] > 0).all()
    red = to_display(np.array([[[50.0, 0, 0]]]), tone="agx")[0, 0]
    assert red[1] > 100  # What is far too bright turns white, not flat red.
    assert to_display(np.array([[[np.nan, np.inf, -1]]]), tone="agx").shape == (1, 1, 3)
    with pytest.raises(ValueError, match="did you mean 'agx'"):
        to_display(np.ones((1, 1, 3)), tone="AgX")


@pytest.mark.skipif(sys.platform != "linux", reason="needs limits of files")
def test_a_picture_whose_last_bytes_do_not_reach_the_disk_is_an_error(tmp_path):
    script = """
        import os, resource, signal, sys
        import deltalux as dl, numpy as np
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        picture = np.random.default_rng(0).random((64, 64, 3)).astype(np.float32)
        for ending in ("exr", "png", "hdr"):
            path = f"{sys.argv[1]}/a.{ending}"
            dl.write(path, picture)
            before = open(path, "rb").read()
            for length in (len(before) // 2, len(before) - 1):
                resource.setrlimit(resource.RLIMIT_FSIZE, (length, resource.RLIM_INFINITY))
                try:
                    dl.write(path, picture)
                    print(ending, length, "was taken for whole")
                except OSError as error:
                    assert "cannot be written" in str(error), error
                assert open(path, "rb").read() == before
            resource.setrlimit(resource.RLIMIT_FSIZE, (resource.RLIM_INFINITY, resource.RLIM_INFINITY))
        assert len(os.listdir(sys.argv[1])) == 3
    """
    environment = {**os.environ, "PYTHONPATH": str(Path(dl.__file__).parents[1])}
    words = [sys.executable, "-c", textwrap.dedent(script), str(tmp_path)]
    done = subprocess.run(words, capture_output=True, text=True, env=environment)
    assert (done.returncode, done.stdout) == (0, ""), done.stdout + done.stderr


@pytest.mark.parametrize("parts", [1, 2])
def test_a_table_of_lines_that_did_not_reach_the_disk_is_an_error(tmp_path, parts):
    """An EXR without it is read by searching: one whose last write had failed was taken for whole."""
    picture = np.random.default_rng(0).random((70, 30, 3)).astype(np.float32)
    path = tmp_path / "a.exr"
    writing.write_parts(path, [(f"p{k}", ["R", "G", "B"], picture, "half") for k in range(parts)], target=path)
    data = bytearray(path.read_bytes())
    assert writing._is_whole(path, parts)
    # The table is what holds the place of the first chunk; 70 lines are five chunks of 16.
    places = [at for at in range(8, len(data) - 40 * parts) if _table(data, at, 5 * parts)]
    assert len(places) == 1
    for harm in (0, 3):
        torn = data.copy()
        torn[places[0] + 8 * harm : places[0] + 8 * 5 * parts] = bytes(8 * (5 * parts - harm))
        path.write_bytes(torn)
        assert not writing._is_whole(path, parts)
    path.write_bytes(data)
    assert writing._is_whole(path, parts)


def _table(data, at, count):
    """Whether so many places of chunks, in a row, begin here: the first chunk follows them."""
    places = np.frombuffer(bytes(data[at : at + 8 * count]), "<u8")
    return places[0] == at + 8 * count and (np.diff(places.astype(np.int64)) > 0).all() and places[-1] < len(data)
