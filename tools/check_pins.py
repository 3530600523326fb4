"""Checks constraints.txt against the environment: each pin is installed and needed, and all that is needed is pinned.

Usage: python tools/check_pins.py

Exit status 1 and a line for each pin that is wrong. Run it with the Python that wrote the pins: another one may need
other packages. Known vulnerabilities are not looked up: mirrors of the package index do not have that data. Where
it can be had, use: pip-audit -r constraints.txt --no-deps
"""

from __future__ import annotations

import argparse
import re
from collections.abc import Mapping
from importlib.metadata import PackageNotFoundError, version

from dependencies import BASE, ROOT, Dependency, closure, requirements
from packaging.utils import canonicalize_name
from pin import EXTRAS, wanted

FILE = ROOT / "constraints.txt"
PIN = re.compile(r"([A-Za-z0-9][A-Za-z0-9._-]*)==([A-Za-z0-9.!]+)")


def pins(text: str) -> dict[str, str]:
    """{package: version} of a file of constraints. Raises ValueError for a line that is no pin."""
    found = {}
    for number, row in enumerate(text.splitlines(), start=1):
        if not row.strip() or row.startswith("#"):
            continue
        match = PIN.fullmatch(row.strip())
        if match is None:
            raise ValueError(f"{FILE.name}:{number}: got {row!r}, expected package==version")
        found[match[1]] = match[2]
    return found


def needed() -> dict[str, Dependency]:
    """{normal name: dependency} of the base install and of the extras that are pinned."""
    groups = requirements()
    return closure(one for name in (BASE, *EXTRAS.split(",")) for one in groups[name])


def problems(pinned: Mapping[str, str], found: Mapping[str, Dependency]) -> list[str]:
    """A line for each pin that is not installed or not needed, and for each package that is needed and not pinned."""
    lines = []
    for name, expected in pinned.items():
        here = installed(name)
        if here is None:
            lines.append(f"{name}: pinned at {expected}, not installed")
        elif here.partition("+")[0] != expected:
            lines.append(f"{name}: pinned at {expected}, installed {here}")
        if canonicalize_name(name) not in found:
            lines.append(f"{name}: pinned at {expected}, nothing needs it; run make constraints")
    names = {canonicalize_name(name) for name in pinned}
    for name, one in found.items():
        if name not in names and wanted(name):
            lines.append(f"{one.name}: needed, installed {one.version or 'not'}, not pinned; run make constraints")
    return lines


def installed(name: str) -> str | None:
    try:
        return version(name)
    except PackageNotFoundError:
        return None


def main() -> None:
    about = __doc__ or ""
    argparse.ArgumentParser(description=about, formatter_class=argparse.RawDescriptionHelpFormatter).parse_args()
    pinned, found = pins(FILE.read_text(encoding="utf-8")), needed()
    lines = problems(pinned, found)
    print("\n".join(lines) or f"{len(pinned)} pins: all installed, all needed, nothing missing")
    raise SystemExit(1 if lines else 0)


if __name__ == "__main__":
    main()
