"""Colours as files mean them, made linear Rec.709."""

from __future__ import annotations

import io
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import attributes
from .oiio import library, reason

Image = NDArray[np.float32]

REC709 = (0.64, 0.33, 0.30, 0.60, 0.15, 0.06, 0.3127, 0.3290)
"""Chromaticities x, y of red, green, blue and white."""

# From CIE XYZ to the cones' responses in which whites are adapted (Lam 1985; CIE 159:2004 gives the digits).
_BRADFORD = np.array([[0.8951, 0.2664, -0.1614], [-0.7502, 1.7135, 0.0367], [0.0389, -0.0685, 1.0296]])


def to_xyz(chromaticities: ArrayLike) -> NDArray[np.float64]:
    """The matrix from linear colours to CIE XYZ, where white has Y = 1 (SMPTE RP 177).

    Raises
    ------
    ValueError
        If the eight numbers are no chromaticities of colours.
    """
    xy = np.asarray(chromaticities, np.float64).reshape(-1, 2)
    if xy.shape != (4, 2) or not np.isfinite(xy).all() or (np.abs(xy[:, 1]) < 1e-6).any():
        raise ValueError(f"expected eight chromaticities, x and y of red, green, blue and white, got {xy.ravel()}")
    full = np.stack([xy[:, 0], xy[:, 1], 1 - xy.sum(axis=1)]) / xy[:, 1]
    primaries = full[:, :3]
    if abs(np.linalg.det(primaries)) < 1e-9:
        raise ValueError(f"expected chromaticities of three colours, got {xy.ravel()}")
    return np.asarray(primaries * np.linalg.solve(primaries, full[:, 3]))


def from_chromaticities(chromaticities: ArrayLike) -> NDArray[np.float64]:
    """The matrix from colours of these chromaticities to Rec.709, white to white."""
    source, target = to_xyz(chromaticities), to_xyz(REC709)
    white, wanted = _BRADFORD @ source.sum(axis=1), _BRADFORD @ target.sum(axis=1)
    adapted = np.linalg.inv(_BRADFORD) @ np.diag(wanted / white) @ _BRADFORD
    return np.asarray(np.linalg.inv(target) @ adapted @ source)


XYZ_TO_REC709 = np.linalg.inv(to_xyz(REC709))


def apply(matrix: NDArray[Any], pixels: Image) -> Image:
    """Colours times a matrix; pixels that are not finite stay so, without a word."""
    with np.errstate(invalid="ignore", over="ignore"):
        return np.asarray(pixels @ matrix.T.astype(np.float32), np.float32)


def from_chroma(pixels: Image, chromaticities: ArrayLike) -> Image:
    """Luminance Y with RY = (R - Y) / Y and BY = (B - Y) / Y as red, green and blue (OpenEXR, ImfRgbaYca)."""
    y, ry, by = np.moveaxis(pixels.astype(np.float64), -1, 0)
    weights = to_xyz(chromaticities)[1]
    red, blue = (ry + 1) * y, (by + 1) * y
    green = (y - red * weights[0] - blue * weights[2]) / weights[1]
    return np.stack([red, green, blue], axis=-1).astype(np.float32)


def from_srgb(values: NDArray[Any]) -> Image:
    """Undoes the curve of sRGB (IEC 61966-2-1)."""
    linear = np.where(values <= 0.04045, values / 12.92, ((values + 0.055) / 1.055) ** 2.4)
    return linear.astype(np.float32)


def linear(pixels: Image, spec: Any, number: str) -> tuple[Image, str]:
    """Colours as a file stores them made linear Rec.709, and a word of what they were.

    Chromaticities decide, then a named colour space, then a profile; without all of them whole numbers are sRGB and
    floats linear Rec.709.

    Raises
    ------
    ValueError
        If it is not known what the colours are.
    """
    whole = number.startswith("uint")
    chromaticities = spec.getattribute("chromaticities")
    if chromaticities is not None and len(chromaticities) == 8 and not whole:
        if np.allclose(chromaticities, REC709, atol=2e-3):
            return pixels, "linear Rec.709"
        numbers = ", ".join(f"{value:.4g}" for value in chromaticities)
        return apply(from_chromaticities(chromaticities), pixels), f"linear with chromaticities {numbers}"
    profile = spec.getattribute("ICCProfile")
    if profile is not None:
        description = attributes.text(spec, "ICCProfile:profile_description")
        if "srgb" not in description.lower().replace(" ", ""):
            return _profiled(pixels, profile, description, number), f"of the profile {description!r}"
    space = attributes.text(spec, "oiio:ColorSpace")
    if space in ("lin_rec709_scene", "lin_rec709"):
        return pixels, "linear Rec.709"
    if space in ("", "srgb_rec709_scene", "srgb_rec709_display", "sRGB"):
        srgb = whole or bool(space)
        return (from_srgb(pixels), "sRGB") if srgb else (pixels, "linear Rec.709")
    return _converted(pixels, space), space


def _converted(pixels: Image, space: str) -> Image:
    """By the configuration of colours that comes with the library."""
    oiio = library()
    # Of displays, those whose curve is relative: PQ and HLG say luminances of a screen.
    if space in ("data", "raw", "Raw") or space.startswith(("pq_", "hlg_")):
        raise ValueError(f"expected colours of a scene, got the colour space {space!r}")
    # Bytes that are no text come as lone surrogates, which the library does not take back.
    if not space.isprintable():
        raise ValueError(f"expected a colour space that is known, got {space!r}")
    buffer = oiio.ImageBuf(np.ascontiguousarray(pixels))
    result = oiio.ImageBufAlgo.colorconvert(buffer, space, "lin_rec709_scene")
    if result.has_error:
        raise ValueError(f"expected a colour space that is known, got {space!r} ({reason(result.geterror())})")
    return np.asarray(result.get_pixels("float"), np.float32)


def _profiled(pixels: Image, profile: Any, description: str, number: str) -> Image:
    """8 bits through a profile to sRGB, and from there to linear."""
    from PIL import Image as Pillow
    from PIL import ImageCms

    if number != "uint8":
        raise ValueError(f"expected sRGB, or a profile of 8-bit colours, got {description!r} in {number}")
    try:
        source = ImageCms.ImageCmsProfile(io.BytesIO(bytes(np.asarray(profile, np.uint8))))
        picture = Pillow.fromarray(np.round(pixels * 255).astype(np.uint8), "RGB")
        converted = ImageCms.profileToProfile(picture, source, ImageCms.createProfile("sRGB"))
    except (ImageCms.PyCMSError, OSError, ValueError) as error:
        raise ValueError(f"expected a profile of red, green and blue, got {description!r} ({error})") from None
    return from_srgb(np.asarray(converted, np.float32) / 255)
