"""deltalux: precomputed light transport of a still scene, relit by sending only what has changed.

B = M V: M is ray traced once (`precompute`); V, the light, moves; a `Relighter` follows it within a budget a frame.
"""

# isort: off
from . import starting as _starting  # noqa: F401, Ctrl-C is heard while all others are imported

# isort: on
from . import brdf as brdf
from ._core import FileError, __version__, set_threads, threads
from .brdf.family import Family
from .camera import Camera
from .columns import Haar, SphericalHarmonics
from .edit import BrdfEditor, EditedFrame, NeedsPrecompute, StaleTransport, Studio, StudioFrame
from .io import write
from .light import sequences
from .light.environment import Environment
from .light.lamps import AreaLight, PointLight, Spot
from .precomputation import views as _views  # noqa: F401, transports are told of what is made of them there
from .precomputation.curves import precompute_curves
from .precomputation.run import plan, precompute
from .precomputation.studio import precompute_studio
from .relight.backdrop import Backdrop
from .relight.bound import Bound
from .relight.compare import Comparison, compare
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
    "EditedFrame",
    "Environment",
    "Family",
    "FileError",
    "Frame",
    "Full",
    "Haar",
    "HarmonicOrder",
    "Incremental",
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
    "plan",
    "precompute",
    "precompute_curves",
    "precompute_studio",
    "sequences",
    "set_threads",
    "threads",
    "view",
    "write",
]
