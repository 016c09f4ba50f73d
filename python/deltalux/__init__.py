"""deltalux: precomputed light transport of a still scene, relit by sending only what has changed.

B = M V: M is ray traced once (`precompute`); V, the light, moves; a `Relighter` follows it within a budget a frame.
"""

# isort: off
from importlib import import_module as _import_module

try:
    _import_module(".starting", __name__)  # Ctrl-C is heard while all others are imported.
except KeyboardInterrupt:
    _import_module(".starting", __name__).interrupted()
    raise

# isort: on
from typing import Any as _Any

from . import brdf as brdf
from ._core import FileError, __version__, set_threads, threads
from .brdf.family import Family
from .camera import Camera
from .columns import Haar, Lamps, SphericalHarmonics
from .datasets.cameras import turntable
from .datasets.lights import Layer, LightRecipe, LightRule
from .datasets.run import Dataset, dataset
from .edit import BrdfEditor, EditedFrame, NeedsPrecompute, StaleTransport, Studio, StudioFrame
from .io import write
from .light import sequences
from .light.environment import Environment
from .light.lamps import AreaLight, PointLight, Spot
from .precomputation import views as _views  # noqa: F401, transports are told of what is made of them there
from .precomputation.curves import precompute_curves
from .precomputation.run import plan, precompute
from .precomputation.studio import precompute_studio
from .relight import gradients
from .relight.backdrop import Backdrop
from .relight.bound import Bound
from .relight.compare import Comparison, compare
from .relight.fit import LightFit, fit_light
from .relight.layers import save_layers
from .relight.relighter import Frame, Relighter
from .scene.scene import Scene
from .surface.material import Material
from .transport.curves import CurveTransport
from .transport.plan import Plan
from .transport.studio import StudioTransport
from .transport.transport import Transport
from .update.approximation import Approximation, Update
from .update.choice import Choice, State
from .update.methods import Full, HarmonicOrder, Incremental, Linear, Method, Nonlinear, PerBand
from .viewer import View, view

__all__ = [
    "Approximation",
    "AreaLight",
    "Backdrop",
    "Bound",
    "BrdfEditor",
    "Camera",
    "Choice",
    "Comparison",
    "CurveTransport",
    "Dataset",
    "EditedFrame",
    "Environment",
    "Family",
    "FileError",
    "Frame",
    "Full",
    "Haar",
    "HarmonicOrder",
    "Incremental",
    "Lamps",
    "Layer",
    "LightFit",
    "LightRecipe",
    "LightRule",
    "Linear",
    "Material",
    "Method",
    "NeedsPrecompute",
    "Nonlinear",
    "PerBand",
    "Plan",
    "PointLight",
    "Relighter",
    "Scene",
    "SphericalHarmonics",
    "Spot",
    "StaleTransport",
    "State",
    "Studio",
    "StudioFrame",
    "StudioTransport",
    "Transport",
    "Update",
    "View",
    "__version__",
    "compare",
    "dataset",
    "fit_light",
    "gradients",
    "plan",
    "precompute",
    "precompute_curves",
    "precompute_studio",
    "save_layers",
    "sequences",
    "set_threads",
    "threads",
    "turntable",
    "view",
    "write",
]


def __getattr__(name: str) -> _Any:
    """`dl.torch`, which needs PyTorch, as it is asked for."""
    if name == "torch":
        return _import_module(".torch", __name__)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
