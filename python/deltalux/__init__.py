"""deltalux: precomputed light transport of a still scene, relit by sending only what has changed.

B = M V: M is ray traced once (`precompute`); V, the light, moves; a `Relighter` follows it within a budget a frame.
"""

from . import sequences
from ._core import FileError, __version__, set_threads, threads
from .approximation import Approximation, Update
from .camera import Camera
from .columns import Haar, SphericalHarmonics
from .environment import Environment
from .methods import Full, HarmonicOrder, Incremental, Linear, Nonlinear, PerBand
from .plan import Plan
from .precompute import plan, precompute
from .relight import Frame, Relighter
from .scene import Scene
from .transport import Transport

__all__ = [
    "Approximation",
    "Camera",
    "Environment",
    "FileError",
    "Frame",
    "Full",
    "Haar",
    "HarmonicOrder",
    "Incremental",
    "Linear",
    "Nonlinear",
    "PerBand",
    "Plan",
    "Relighter",
    "Scene",
    "SphericalHarmonics",
    "Transport",
    "Update",
    "__version__",
    "plan",
    "precompute",
    "sequences",
    "set_threads",
    "threads",
]
