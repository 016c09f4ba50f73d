"""Which files a scene file may name: those in its folder, in folders below, and in folders beside it.

The rule is of names, not of where links lead: ``../textures/wood.png`` lies in a folder beside the scene's own and is
read; ``../wood.png``, absolute paths and addresses of the net are not. A link that lies where a file may lie is
followed wherever it leads, as caches link what they hold; what it leads to must be a plain file, as a device or a pipe
may never answer.
"""

from __future__ import annotations

import os
import re
from pathlib import Path

__all__ = ["is_nearby", "nearby"]


def is_nearby(folder: Path, name: str) -> bool:
    """Whether a name leads into a folder, below it, or into a folder beside it."""
    if ":" in name or name.startswith("/"):
        return False
    path = os.path.normpath(folder / name)
    inside, beside = (os.path.relpath(path, start) for start in (folder, folder.parent))
    return not inside.startswith("..") or (not beside.startswith("..") and os.sep in beside)


def nearby(folder: Path, name: str) -> Path | None:
    """The file of a name as exporters write it, which may be a path of Windows; None where there is none to read.

    Of a path that was right on another machine alone the last part is looked for beside the scene.
    """
    name = name.strip().strip('"').replace("\\", "/")
    if re.match(r"[A-Za-z]:/|/", name):
        name = name.rsplit("/", 1)[-1]
    if not name or not is_nearby(folder, name):
        return None
    path = Path(os.path.normpath(folder / name))
    return path if path.is_file() else None
