"""Directories that hold several transports and arrays beside them: of curves, and of studios."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np
from numpy.typing import NDArray

from .._core import FileError
from ..mistakes import misplaced

__all__ = ["Folder", "array", "stored_arrays"]

_ARRAYS = "arrays.npz"
_LARGEST = 1 << 30


@dataclass(frozen=True)
class Folder:
    """One kind of directory.

    Attributes
    ----------
    what
        It is called when something else is found.
    manifest
        The file that stands for a whole directory: it is written last.
    version
        Of what is in it.
    """

    what: str
    manifest: str
    version: int

    def write(self, path: Path, about: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]) -> None:
        """The arrays, then the manifest."""
        np.savez(path / _ARRAYS, **arrays)  # type: ignore[arg-type]
        beside = path / f".{self.manifest}"
        beside.write_text(json.dumps({"version": self.version, **about}, indent=1), encoding="utf-8")
        beside.replace(path / self.manifest)

    @contextmanager
    def opened(self, path: Path) -> Iterator[tuple[dict[str, Any], dict[str, NDArray[Any]]]]:
        """The manifest and the arrays; what goes wrong with them inside is the directory's fault."""
        if not (path / self.manifest).exists():
            raise FileError(misplaced(path, self.what) or f"{path}: expected {self.what}, got none")
        try:
            about = json.loads((path / self.manifest).read_text(encoding="utf-8"))
            if about["version"] != self.version:
                raise ValueError(f"expected version {self.version}, found {about['version']!r}")
            yield about, stored_arrays(path / _ARRAYS)
        except (ValueError, TypeError, LookupError, RecursionError, EOFError, BadZipFile) as error:
            raise FileError(f"{path}: {error}") from None


def stored_arrays(path: Path) -> dict[str, NDArray[Any]]:
    """All arrays of a file."""
    with open(path, "rb") as file, np.load(file, allow_pickle=False) as arrays:
        return {name: arrays[name] for name in arrays.files}


def array(stored: Mapping[str, NDArray[Any]], name: str, kind: type, shape: tuple[int, ...]) -> NDArray[Any]:
    """One of the arrays; refuses another kind or shape than it should have, and what is not finite."""
    found = stored[name]
    if found.dtype != kind or found.shape != shape or found.size > _LARGEST or not np.isfinite(found).all():
        raise ValueError(f"expected {name} of shape {shape}, finite, found {found.dtype} {found.shape}")
    return found
