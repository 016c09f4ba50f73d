"""What a header says of a pixel's place or meaning: one table, which says of each attribute what is done with it.

Names are those that OpenImageIO hands over; those of Radiance pictures, which are read by this package itself
(`radiance`), stand beside them as their headers spell them. What says nothing of a place or a meaning (dates, cameras,
compression, names) is not in the table, and is passed over.
"""

from __future__ import annotations

from typing import Any

ATTRIBUTES = {
    # Place.
    "Orientation": "applied: rows and columns are put upright (EXIF, TIFF, and the tag in any other file), 1 to 8",
    "resolution line": "applied: all eight orders of a Radiance picture's rows and columns",
    "x, y, full_x, full_y, full_width, full_height": "applied to EXR and TIFF: what is stored is set into the display "
    "window, black around it; what lies beyond it is cut. Elsewhere a place on a printed page: passed over",
    "GPano:FullPanoWidthPixels": "applied with its fellows, as a window: a part of a panorama is set into the whole",
    "GPano:ProjectionType": "refused where it is not equirectangular",
    "GPano:PosePitchDegrees": "applied with GPano:PoseRollDegrees: the light is turned until its horizon is level",
    "GPano:PoseHeadingDegrees": "without effect: the middle of a picture is at +Z, whatever its compass says",
    "textureformat": "applied: latlong or cube (the EXR attribute envmap)",
    "PixelAspectRatio": "without effect: an environment spans the sphere, whatever the shape of its pixels (PIXASPECT)",
    "worldtocamera": "without effect: a light is turned by rotated()",
    # Meaning.
    "channelnames": "applied: R G B of any layer, else grey, else refused (`choose`)",
    "oiio:subimagename": "applied: the name of a part is the name of its layer",
    "view": "applied: as the name of a layer",
    "deep": "refused: samples in depth are no light",
    "chromaticities": "applied: converted to Rec.709 with Bradford's adaptation to its white (Radiance: PRIMARIES)",
    "oiio:ColorSpace": "applied: converted to linear Rec.709 by the library's own configuration; refused where unknown",
    "acesImageContainerFlag": "applied as AP0, which it means",
    "ICCProfile": "applied to 8 bits of red, green and blue; refused elsewhere unless it is sRGB",
    "CICP": "applied through oiio:ColorSpace",
    "oiio:Gamma": "applied through oiio:ColorSpace",
    "oiio:UnassociatedAlpha": "applied: alpha is dropped, and colours are taken as the file stores them",
    "EXPOSURE": "applied: divided by the product of all of them (Radiance)",
    "COLORCORR": "applied: divided by the product of all of them, each colour by itself (Radiance)",
    "FORMAT": "applied: RGBE, or XYZE converted to Rec.709 (Radiance)",
    "whiteLuminance": "without effect: radiance stays in the unit of the file",
}
"""Each attribute, and what is done with it."""

# Formats whose windows say where pixels lie in a picture.
_WINDOWED = ("openexr", "tiff")


def text(spec: Any, name: str) -> str:
    """An attribute as text; "" where there is none."""
    return str(spec.get_string_attribute(name))


def envmap(spec: Any) -> str | None:
    """The layout that an EXR file names."""
    kinds = {"LatLong Environment": "latlong", "CubeFace Environment": "cube"}
    return kinds.get(text(spec, "textureformat"))


def orientation(spec: Any) -> int:
    """1, upright, to 8."""
    value = int(spec.get_int_attribute("Orientation", 1))
    return value if 1 <= value <= 8 else 1


def window(spec: Any, file_format: str) -> tuple[int, int, int, int]:
    """Where the stored pixels stand: the column and row of the first, and the width and height of the whole.

    Raises
    ------
    ValueError
        If the file is a part of a panorama of another kind than lat-long.
    """
    left, top = spec.x - spec.full_x, spec.y - spec.full_y
    place = (left, top, spec.full_width, spec.full_height)
    if file_format not in _WINDOWED or min(place[2:]) <= 0:
        place = (0, 0, spec.width, spec.height)
    projection = text(spec, "GPano:ProjectionType")
    if projection and projection.lower() != "equirectangular":
        raise ValueError(f"expected an equirectangular panorama, got GPano:ProjectionType={projection}")
    names = ("CroppedAreaLeftPixels", "CroppedAreaTopPixels", "FullPanoWidthPixels", "FullPanoHeightPixels")
    panorama = [int(spec.get_int_attribute(f"GPano:{name}", -1)) for name in names]
    if min(panorama[:2]) >= 0 and min(panorama[2:]) > 0:
        return (panorama[0], panorama[1], panorama[2], panorama[3])
    return place


def pose(spec: Any) -> tuple[float, float]:
    """Degrees of a panorama: its centre above the horizon, and what the horizon in it is turned by, anticlockwise."""
    pitch, roll = (float(spec.get_float_attribute(f"GPano:Pose{name}Degrees", 0.0)) for name in ("Pitch", "Roll"))
    return pitch, roll
