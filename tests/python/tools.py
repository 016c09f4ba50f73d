"""What tests need beside the package: where it is missing, a skip at the desk and a failure in CI.

The environment variable ``CI`` tells them apart; `.ci/run` sets it, as the services do.
"""

from __future__ import annotations

import importlib
import os
from types import ModuleType
from typing import NoReturn

import pytest


def needed(module: str) -> ModuleType:
    """The module, imported."""
    try:
        return importlib.import_module(module)
    except ImportError as error:
        missing(f"{module} cannot be imported ({error}): pip install '.[test,dev]'")


def missing(reason: str) -> NoReturn:
    """Ends a test, or the collection of its file, for want of a tool."""
    if os.environ.get("CI"):
        pytest.fail(f"in CI all tools must be there, but {reason}")
    pytest.skip(reason, allow_module_level=True)
