"""Directories that hold several transports and arrays beside them: of curves, and of studios."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from zipfile import ZIP_STORED, BadZipFile

import numpy as np
from numpy.typing import NDArray

from .._core import FileError
from ..mistakes import misplaced
from ..plain import MOST_TEXT, read_plain

__all__ = ["Folder", "array", "stored_arrays"]

_ARRAYS = "arrays.npz"
_LARGEST = 1 << 30
# What a manifest or an array that is not what it should be makes whoever reads it raise.
_DAMAGE = (
    ValueError, TypeError, LookupError, AttributeError, ArithmeticError, RecursionError, EOFError, MemoryError,
    NotImplementedError, BadZipFile,
)  # fmt: skip


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
            about = json.loads(read_plain(path / self.manifest, MOST_TEXT))
            if about["version"] != self.version:
                raise ValueError(f"expected version {self.version}, found {about['version']!r}")
            yield about, stored_arrays(path / _ARRAYS)
        except FileError:
            raise
        except _DAMAGE as error:
            reason = str(error) if isinstance(error, ValueError) else f"{type(error).__name__}: {error}"
            raise FileError(f"{path}: {reason}") from None


def stored_arrays(path: Path) -> dict[str, NDArray[Any]]:
    """All arrays of a file, which lie in it as they are: a few bytes that unfold into many are refused."""
    if not path.is_file():
        raise ValueError(f"expected {path.name}, a plain file")
    with open(path, "rb") as file, np.load(file, allow_pickle=False) as arrays:
        if any(own.compress_type != ZIP_STORED for own in arrays.zip.infolist()):
            raise ValueError(f"expected arrays as they are in {path.name}, found compressed ones")
        return {name: arrays[name] for name in arrays.files}


def array(stored: Mapping[str, NDArray[Any]], name: str, kind: type, shape: tuple[int, ...]) -> NDArray[Any]:
    """One of the arrays; refuses another kind or shape than it should have, and what is not finite."""
    found = stored[name]
    if found.dtype != kind or found.shape != shape or found.size > _LARGEST or not np.isfinite(found).all():
        raise ValueError(f"expected {name} of shape {shape}, finite, found {found.dtype} {found.shape}")
    return found
