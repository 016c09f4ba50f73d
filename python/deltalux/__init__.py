"""deltalux: precomputed light transport of a still scene, relit by sending only what has changed.

B = M V: M is ray traced once (`precompute`); V, the light, moves; a `Relighter` follows it within a budget a frame.
"""

from ._core import FileError, __version__, set_threads, threads
from .camera import Camera
from .columns import Haar, SphericalHarmonics
from .light import sequences
from .light.environment import Environment
from .precomputation.run import plan, precompute
from .relight.relighter import Frame, Relighter
from .scene.scene import Scene
from .transport.plan import Plan
from .transport.transport import Transport
from .update.approximation import Approximation, Update
from .update.methods import Full, HarmonicOrder, Incremental, Linear, Nonlinear, PerBand

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
