"""`doctor`: what is installed, what is missing or too old, and how to install it.

In a checkout the required packages come from pyproject.toml, otherwise from the installed metadata.
"""

from __future__ import annotations

import platform
import sys
import tomllib
from collections.abc import Iterable
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, metadata, version
from typing import Any

from packaging.requirements import Requirement

from mazeplan.apps.cli import options as opt
from mazeplan.apps.cli.output import print_json
from mazeplan.core import resources

CORE = "core"
FEATURES = {
    CORE: "maps, simulated rigs, navigate, evaluate, collect, learn, compare, diagnose, improve, logs",
    "learn": "networks: policy train",
    "view": "the live page in the browser",
    "hardware": "camera and serial line of a real rig",
    "testing": "tests of trees: pytest",
    "docs": "the documentation as a site: make docs",
    "gym": "the maze as a Gymnasium environment: reinforcement learning",
    "campaign": "evaluate on other machines: --dask; tables of runs in Parquet: --store",
    "tune": "search of costs and gains: tools/tune.py",
    "dev": "make test",
}


@dataclass(frozen=True)
class Package:
    """A required package: the needed and the installed version (None: not installed)."""

    name: str
    needed: str
    installed: str | None

    @property
    def problem(self) -> str:
        """Why the package cannot be used; empty if it can."""
        if self.installed is None:
            return f"{self.name} is missing"
        needed = Requirement(f"{self.name}{self.needed}").specifier
        fits = needed.contains(self.installed, prereleases=True)
        return "" if fits else f"{self.name} is {self.installed}, needed {self.needed}"


def doctor(as_json: opt.AsJson = False) -> None:
    """Show what is installed, what is missing or too old, and how to install it.

    Exit status 1: a package that every command needs is missing."""
    packages = {
        extra: [Package(r.name, str(r.specifier), installed(r.name)) for r in group]
        for extra, group in requirements().items()
    }
    if as_json:
        print_json(document(packages))
    else:
        print("\n".join(installation_lines(packages)))
    sys.exit(1 if any(package.problem for package in packages[CORE]) else 0)


def installed(package: str) -> str | None:
    """Version of an installed package, or None."""
    try:
        return version(package)
    except PackageNotFoundError:
        return None


def requirements() -> dict[str, list[Requirement]]:
    """{"core" or extra: its requirements on this machine}."""
    if resources.CHECKOUT.is_file():
        project = tomllib.loads(resources.CHECKOUT.read_text(encoding="utf-8"))["project"]
        groups = {CORE: project["dependencies"], **project["optional-dependencies"]}
        return {extra: _applicable(map(Requirement, group), "") for extra, group in groups.items()}
    package = metadata("mazeplan")
    every = [Requirement(text) for text in package.get_all("Requires-Dist") or []]
    core = _applicable(every, "")
    extras = {extra: _applicable(every, extra) for extra in package.get_all("Provides-Extra") or []}
    return {CORE: core, **{extra: [r for r in group if r not in core] for extra, group in extras.items()}}


def _applicable(group: Iterable[Requirement], extra: str) -> list[Requirement]:
    return [r for r in group if r.marker is None or r.marker.evaluate({"extra": extra})]


def advice(extra: str) -> str:
    """The command that installs the packages of an extra."""
    return resources.to_install("" if extra == CORE else extra)


def document(found: dict[str, list[Package]]) -> dict[str, Any]:
    """The document of `doctor --json`. found: packages by extra"""
    features = {
        extra: {
            "what": FEATURES.get(extra, ""),
            "ready": not any(p.problem for p in packages),
            "missing": [p.name for p in packages if p.installed is None],
            "too_old": [p.name for p in packages if p.installed is not None and p.problem],
            "get": advice(extra) if any(p.problem for p in packages) else None,
        }
        for extra, packages in found.items()
    }
    return {
        "python": platform.python_version(),
        "mazeplan": installed("mazeplan"),
        "features": features,
        "packages": {extra: {p.name: p.installed for p in packages} for extra, packages in found.items()},
        "needed": {extra: {p.name: p.needed for p in packages} for extra, packages in found.items()},
    }


def installation_lines(found: dict[str, list[Package]]) -> list[str]:
    """One line per feature, then its packages. found: packages by extra"""
    lines = [f"mazeplan {installed('mazeplan')} on Python {platform.python_version()}, {platform.platform()}"]
    for extra, packages in found.items():
        problems = ", ".join(package.problem for package in packages if package.problem)
        how = f"; to install it: {advice(extra)}" if problems else ""
        lines.append(f"{extra:9s} {problems or 'ready'}: {FEATURES.get(extra, '')}{how}")
        lines += [f"    {package.name} {package.installed or '-'}" for package in packages]
    return lines
