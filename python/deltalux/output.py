"""Folders of results: only files of our own are ever overwritten, and tables are plain CSV."""

from __future__ import annotations

import csv
import os
import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, TextIO

from .mistakes import kind_of

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]

__all__ = ["check_folder", "check_writable", "claim", "keep_out", "nearest", "slug", "write_csv"]

# The names that a run of ours has written, one a line; whatever is not in it belongs to someone else.
_LIST = ".deltalux-files"


def check_folder(folder: str | os.PathLike[str], names: Iterable[str] = ()) -> Path:
    """Whether files of these names may be written into a folder, which need not exist yet; writes nothing.

    Raises
    ------
    FileExistsError
        If a file of such a name is there that we did not write.
    OSError
        If the folder is a file, or may not be written.
    """
    path = Path(folder)
    if kind_of(path).startswith("a transport"):
        raise FileExistsError(f"{path} is {kind_of(path)}; give another folder")
    check_writable(path, "a folder to write into")
    ours = _written(path)
    foreign = sorted(name for name in names if name not in ours and (path / name).exists())
    if foreign:
        raise FileExistsError(f"{path} holds {foreign[0]}, which deltalux did not write; give another folder")
    return path


def check_writable(path: Path, what: str) -> None:
    """Refuses a folder, which need not exist yet, that is a file or may not be written; `what` is wanted of it.

    Raises
    ------
    OSError
        As above.
    """
    there = nearest(path)
    if not there.is_dir():
        raise NotADirectoryError(f"expected {what}, but {there} is a file")
    if not os.access(there, os.W_OK | os.X_OK):
        raise PermissionError(
            f"expected a folder that can be written, but there is no permission to write into {there}"
        )


def nearest(path: Path) -> Path:
    """The path itself if it exists, else the folder above it that does."""
    return next(parent for parent in (path.absolute(), *path.absolute().parents) if parent.exists())


# Of the folders that this process writes into: the lock of each, which goes with the process.
_LOCKS: dict[Path, TextIO] = {}


def claim(folder: str | os.PathLike[str], names: Sequence[str]) -> Path:
    """Makes the folder, removes what an earlier run of ours left in it, and notes what this one will write.

    Raises
    ------
    FileExistsError
        If another run is writing into the folder.
    """
    path = check_folder(folder, names)
    path.mkdir(parents=True, exist_ok=True)
    keep_out(path)
    stale = _written(path) - set(names)
    _note(path, names)
    for name in stale:
        (path / name).unlink(missing_ok=True)
    return path


def _note(path: Path, names: Iterable[str]) -> None:
    """Writes the list in its place, as it is the lock too, and cuts it only then: whoever is killed in between leaves a
    name too many, and never a folder whose files are nobody's."""
    text = "".join(f"{name}\n" for name in names).encode()
    with open(path / _LIST, "r+b" if (path / _LIST).exists() else "wb") as file:
        file.write(text)
        file.flush()
        file.truncate(len(text))


def keep_out(path: Path) -> None:
    """Keeps other processes out of a folder until this one ends; where the system has no such locks, nothing does."""
    if fcntl is None or path.absolute() in _LOCKS:
        return
    file = open(path / _LIST, "a", encoding="utf-8")  # noqa: SIM115, it stays open
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        file.close()
        raise FileExistsError(f"another run is writing into {path}; give another folder, or wait") from None
    except OSError:
        file.close()  # Some network file systems lock nothing.
    else:
        _LOCKS[path.absolute()] = file


def slug(name: str, k: int) -> str:
    """A name for files: what is plain of a name, its ending left out, made unique by its number."""
    stem = re.sub(r"\.(hdr|exr|png|jpg)\b", "", name.lower())
    plain = "".join(letter if letter.isascii() and letter.isalnum() else "-" for letter in stem)
    return f"{k + 1}-{plain.strip('-') or 'light'}"


def _written(path: Path) -> set[str]:
    """Names of the files that we wrote there. A name is never a path: nothing outside the folder is ours."""
    try:
        names = (path / _LIST).read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError):
        return set()
    return {name for name in names if name and name == Path(name).name}


class Table:
    """A table in a file that grows row by row: what is there stays, whatever happens next.

    Parameters
    ----------
    path
        Of the file; the first row brings the headings.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.path.write_text("", encoding="utf-8")

    def add(self, row: Mapping[str, Any]) -> None:
        """Writes a row behind the others.

        Parameters
        ----------
        row
            With the same keys as all others.
        """
        first = self.path.stat().st_size == 0
        with open(self.path, "a", newline="", encoding="utf-8") as file:
            table = csv.DictWriter(file, list(row), lineterminator="\n")
            if first:
                table.writeheader()
            table.writerow(row)


def write_csv(path: Path, rows: Sequence[Mapping[str, Any]]) -> None:
    """A table with a line of headings: the keys of the first row."""
    with open(path, "w", newline="", encoding="utf-8") as file:
        table = csv.DictWriter(file, list(rows[0]), lineterminator="\n")
        table.writeheader()
        table.writerows(rows)
