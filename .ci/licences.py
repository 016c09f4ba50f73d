"""Every Rust crate that is locked comes from crates.io, with a checksum, under a licence of the list in deny.toml.

    python .ci/licences.py

It needs nothing but cargo and a Cargo.lock whose crates have been downloaded once.
"""

from __future__ import annotations

import json
import re
import subprocess
import sys
import tomllib
from pathlib import Path

HERE = Path(__file__).parent
ROOT = HERE.parent
REGISTRY = "registry+https://github.com/rust-lang/crates.io-index"


def allowed(expression: str, licences: set[str]) -> bool:
    """Whether an SPDX expression can be met: of "A OR B" one must be, of "A AND B" both; old crates write A/B."""
    tokens = re.findall(r"[()]|[\w.+-]+", expression.replace("/", " OR "))

    def either() -> bool:
        found = both()
        while tokens and tokens[0] == "OR":
            tokens.pop(0)
            found |= both()
        return found

    def both() -> bool:
        found = one()
        while tokens and tokens[0] == "AND":
            tokens.pop(0)
            found &= one()
        return found

    def one() -> bool:
        name = tokens.pop(0)
        if name == "(":
            found = either()
            tokens.pop(0)
            return found
        if tokens[:1] == ["WITH"]:
            tokens.pop(0)
            name += f" WITH {tokens.pop(0)}"
        return name in licences

    return either()


def complaints(packages: list[dict], locked: list[dict], licences: set[str]) -> list[str]:
    """A line for each crate that cannot be taken; our own, which has no source, can."""
    checksums = {(crate["name"], crate["version"]) for crate in locked if "checksum" in crate}
    found = []
    for package in packages:
        name = f"{package['name']} {package['version']}"
        if package["source"] is None:
            continue
        if package["source"] != REGISTRY:
            found.append(f"{name} comes from {package['source']}")
        if (package["name"], package["version"]) not in checksums:
            found.append(f"{name} has no checksum in Cargo.lock")
        if not allowed(package["license"] or "unstated", licences):
            found.append(f"{name} is under {package['license'] or 'no stated licence'}, which is not on the list")
    return found


def main() -> int:
    licences = set(tomllib.loads((HERE / "deny.toml").read_text())["licenses"]["allow"])
    command = ["cargo", "metadata", "--format-version", "1", "--locked"]
    packages = json.loads(subprocess.run(command, cwd=ROOT, check=True, stdout=subprocess.PIPE).stdout)["packages"]
    locked = tomllib.loads((ROOT / "Cargo.lock").read_text())["package"]
    found = complaints(packages, locked, licences)
    print("\n".join(found) or f"{len(packages) - 1} crates, all from crates.io and under a licence of the list")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
