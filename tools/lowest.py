"""Prints a file of constraints with the lowest version of each direct dependency that pyproject.toml allows.

Usage: python tools/lowest.py > build/lowest.txt  (make lowest installs these and runs tests with them)
"""

from __future__ import annotations

import sys
import tomllib
from collections.abc import Iterable
from pathlib import Path

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name
from packaging.version import Version

ROOT = Path(__file__).resolve().parent.parent
LOW = (">=", "==", "~=")


def lowest(requirements: Iterable[str]) -> dict[str, Version]:
    """{normal name: lowest version} that all these requirements allow. Raises ValueError for one without a bound."""
    found: dict[str, Version] = {}
    for text in requirements:
        requirement = Requirement(text)
        bounds = [Version(one.version) for one in requirement.specifier if one.operator in LOW]
        if not bounds:
            raise ValueError(f"pyproject.toml: got {text}, expected a lowest version, such as {requirement.name}>=1.0")
        name = canonicalize_name(requirement.name)
        found[name] = max([*bounds, *([found[name]] if name in found else [])])
    return found


def direct(document: str) -> list[str]:
    """All requirements of a pyproject.toml, those of the extras too."""
    project = tomllib.loads(document)["project"]
    return [*project["dependencies"], *(one for group in project["optional-dependencies"].values() for one in group)]


def main() -> None:
    try:
        found = lowest(direct((ROOT / "pyproject.toml").read_text(encoding="utf-8")))
    except ValueError as problem:
        sys.exit(str(problem))
    for name, version in sorted(found.items()):
        print(f"{name}=={version}")


if __name__ == "__main__":
    main()
