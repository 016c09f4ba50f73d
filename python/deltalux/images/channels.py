"""Which channels of a file are light: chosen by their names, over all of its parts and layers."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

# Names of a colour, as the last part of a channel's.
_COLOURS = {"r": 0, "red": 0, "g": 1, "green": 1, "b": 2, "blue": 2}
_CHROMA = {"y": 0, "ry": 1, "by": 2}
_GREY = ("y", "l", "gray", "grey", "luminance", "intensity")

# Words of layers that measure something else than light: none becomes light unless it is asked for by its name.
_DATA = frozenset(
    "ao occlusion ambientocclusion depth z zdepth deptha normal normals n nn position positions pos p pworld "
    "worldposition uv uvs st motion motionvector motionvectors velocity vector vectors crypto cryptomatte mask masks "
    "matte alpha coverage opacity id ids index indexma indexob object objectid material materialid albedo diffcol "
    "glosscol transcol basecolor roughness metallic shadow shadows mist denoising variance samples samplecount "
    "wireframe curvature bump displacement heat debug tangent bitangent barycentric facing fresnel".split()
)
# Words of the layer that is the whole picture, of those that hold only a part of the light.
_WHOLE = (
    "beauty",
    "combined",
    "rgba",
    "rgb",
    "final",
    "composite",
    "image",
    "color",
    "colour",
    "main",
    "default",
    "hdr",
)


@dataclass(frozen=True)
class Choice:
    """Channels of one part of a file.

    Attributes
    ----------
    part
        Its number.
    layer
        The layer's name; "" where it has none.
    kind
        "rgb", "chroma" (luminance and two differences of colour) or "grey".
    channels
        Their numbers within the part.
    """

    part: int
    layer: str
    kind: str
    channels: tuple[int, ...]


def choose(parts: Sequence[tuple[str, Sequence[str]]], layer: str | None = None) -> Choice:
    """The channels of a file that are its light.

    Red, green and blue without a layer, else those of the one layer that has them, or of the one that is the whole
    picture by its name; else luminance with chroma, else grey.

    Parameters
    ----------
    parts
        Of each part its name and the names of its channels.
    layer
        The name of a layer, or its last part.

    Returns
    -------
    Choice

    Raises
    ------
    ValueError
        If nothing of it is light, or several layers may be, or none has the name asked for: it lists what is there.
    """
    found = [choice for number, (name, names) in enumerate(parts) for choice in _choices(number, name, names, parts)]
    for kind in ("rgb", "chroma", "grey"):
        of_kind = [choice for choice in found if choice.kind == kind]
        of_kind = _named(of_kind, layer) if layer is not None else _light(of_kind)
        if len(of_kind) == 1:
            return of_kind[0]
        if of_kind:
            # The same layer twice, say for two eyes: nobody said which.
            raise ValueError(f"several layers may be the light: {_listed(of_kind)}; choose one by layer=")
    there = ", ".join(f"{name}.{channel}" if name else channel for name, names in parts for channel in names)
    wanted = f"a layer {layer!r} with red, green and blue, or grey" if layer is not None else "channels R, G and B"
    also = f"; its layers: {_listed(found)}" if found else ""
    raise ValueError(f"expected {wanted}, but the file has {there}{also}")


def _choices(number: int, part: str, names: Sequence[str], parts: Sequence[object]) -> list[Choice]:
    """All that may be light within a part, data included."""
    layers: dict[str, dict[str, int]] = {}
    for at, name in enumerate(names):
        prefix, _, base = name.rpartition(".")
        layers.setdefault(prefix, {}).setdefault(base.lower(), at)
    found = []
    for prefix, channels in layers.items():
        # The name of the only part says nothing; nor does one that the channels repeat.
        own = part if len(parts) > 1 and not prefix.lower().startswith(part.lower()) else ""
        layer = ".".join(piece for piece in (own, prefix) if piece)
        colours = {_COLOURS[base]: at for base, at in channels.items() if base in _COLOURS}
        chroma = {_CHROMA[base]: at for base, at in channels.items() if base in _CHROMA}
        # X, Y and Z are a position, a normal, or CIE's: nobody knows which.
        grey = [] if "x" in channels else [at for base, at in channels.items() if base in _GREY]
        if len(colours) == 3:
            found.append(Choice(number, layer, "rgb", tuple(colours[k] for k in range(3))))
        elif len(chroma) == 3:
            found.append(Choice(number, layer, "chroma", tuple(chroma[k] for k in range(3))))
        elif len(grey) == 1:
            found.append(Choice(number, layer, "grey", (grey[0],)))
    return found


def _named(choices: list[Choice], layer: str) -> list[Choice]:
    """Those of a name; else those whose last part it is."""
    wanted = layer.lower()
    exactly = [choice for choice in choices if choice.layer.lower() == wanted]
    return exactly or [choice for choice in choices if choice.layer.lower().endswith(f".{wanted}")]


def _light(choices: list[Choice]) -> list[Choice]:
    """Those without a layer; else those that are no data, and of them the one that is called the whole."""
    bare = [choice for choice in choices if not choice.layer]
    if bare:
        return bare
    light = [choice for choice in choices if not _is_data(choice.layer)]
    whole = [choice for choice in light if _words(choice.layer)[-1:] and _words(choice.layer)[-1] in _WHOLE]
    return whole if len(light) > 1 and len(whole) == 1 else light


def _words(layer: str) -> list[str]:
    """The words of a layer's own name, which stands behind those of what it belongs to."""
    own = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", layer.rsplit(".", 1)[-1])
    return re.findall(r"[a-z]+", own.lower())


def _is_data(layer: str) -> bool:
    words = _words(layer)
    return bool(_DATA.intersection(words)) or "".join(words) in _DATA


def _listed(choices: Sequence[Choice]) -> str:
    return ", ".join(repr(choice.layer) for choice in choices)
