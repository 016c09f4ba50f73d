"""What several test files share: transports of small scenes, and a quality that brute force can repeat."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from deltalux import _core
from deltalux.columns.haar import Haar
from deltalux.precomputation.quality import QUALITIES
from deltalux.scene.scene import Scene
from hypothesis import settings

# The same examples in every run: a failure is a change of the code, and can be repeated.
settings.register_profile("suite", derandomize=True, deadline=None)
# Others in every run, for `benches/card/properties.py`: `--hypothesis-profile=card`.
settings.register_profile("card", derandomize=False, deadline=None, database=None)
settings.load_profile("suite")

# Whatever runs outside our own pool fails here, and does not wait for ever in some child of a fork.
_core.without_a_global_pool()

CENTRES = "centres"


@pytest.fixture(scope="session", autouse=True)
def centres_quality():
    """One ray a texel and a pixel, nothing dropped, 16 bits: what is left is what the rays say, to 2^-15."""
    QUALITIES[CENTRES] = replace(QUALITIES["lossless"], edges=False, edge_side=0)
    yield
    del QUALITIES[CENTRES]


@pytest.fixture(autouse=True)
def threads_stay():
    """A test that changes the number of threads changes it back."""
    before = _core.threads()
    yield
    _core.set_threads(before)


@pytest.fixture(scope="session")
def make(tmp_path_factory, centres_quality):
    """make(scene, size, quality): a transport in a directory of its own."""
    import deltalux as dl

    def run(scene: Scene, size: int | Haar = 8, quality: str = CENTRES, **options) -> dl.Transport:
        path = tmp_path_factory.mktemp("made") / "a.transport"
        columns = Haar(size) if isinstance(size, int) else size
        return dl.precompute(scene, path, columns=columns, quality=quality, progress=False, **options)

    return run


@pytest.fixture(scope="session")
def cornell(make):
    """The Cornell box at 24 x 24 pixels and haar:8."""
    scene = Scene.builtin("cornell")
    return make(scene.with_camera(scene.camera.resized(24, 24)), 8, "lossless")


@pytest.fixture(scope="session")
def cornell_texels(make):
    """The Cornell box at 64 x 64 pixels and haar:8 with texels: rows enough for some that are kept untruncated."""
    scene = Scene.builtin("cornell")
    return make(scene.with_camera(scene.camera.resized(64, 64)), Haar(8, texels=True), "preview")


@pytest.fixture
def rng():
    return np.random.default_rng(7)
