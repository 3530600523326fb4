"""`doctor`: what is installed, what is missing or too old, and how to install it."""

from __future__ import annotations

import platform
import sys
import tomllib
from importlib.metadata import PackageNotFoundError, metadata, version

from packaging.requirements import Requirement

from mazeplan.apps.cli import options as opt
from mazeplan.apps.cli.output import print_result
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


def doctor(as_json: opt.AsJson = False) -> None:
    """Show what is installed, what is missing or too old, and how to install it.

    Exit status 1: a package that every command needs is missing."""
    features = {}
    for extra, group in requirements().items():
        found = {need.name: installed(need.name) for need in group}
        old = [n.name for n in group if (v := found[n.name]) and not n.specifier.contains(v, prereleases=True)]
        missing = [name for name, got in found.items() if got is None]
        features[extra] = {
            "what": FEATURES.get(extra, ""), "ready": not missing and not old, "missing": missing, "too_old": old,
            "get": resources.to_install("" if extra == CORE else extra) if missing or old else None, "packages": found,
        }  # fmt: skip
    this, python = installed("mazeplan"), platform.python_version()
    lines = [f"mazeplan {this} on Python {python}, {platform.platform()}"]
    for extra, feature in features.items():
        problems = [f"{name} is missing" for name in feature["missing"]]
        problems += [f"{name} is {feature['packages'][name]}, too old" for name in feature["too_old"]]
        how = f"; to install it: {feature['get']}" if problems else ""
        lines.append(f"{extra:9s} {', '.join(problems) or 'ready'}: {feature['what']}{how}")
    print_result(as_json, {"python": python, "mazeplan": this, "features": features}, *lines)
    sys.exit(0 if features[CORE]["ready"] else 1)


def installed(package: str) -> str | None:
    """Version of an installed package, or None."""
    try:
        return version(package)
    except PackageNotFoundError:
        return None


def requirements() -> dict[str, list[Requirement]]:
    """{"core" or extra: its requirements on this machine}; in a checkout from pyproject.toml, else as installed."""
    if resources.CHECKOUT.is_file():
        project = tomllib.loads(resources.CHECKOUT.read_text(encoding="utf-8"))["project"]
        groups = {CORE: project["dependencies"], **project["optional-dependencies"]}
    else:
        package = metadata("mazeplan")
        every = package.get_all("Requires-Dist") or []
        groups = {extra: [text for text in every if f"extra == '{extra}'" in text.replace('"', "'")]
                  for extra in package.get_all("Provides-Extra") or []}  # fmt: skip
        groups = {CORE: [text for text in every if "extra ==" not in text], **groups}
    return {
        extra: [
            need for need in map(Requirement, group) if need.marker is None or need.marker.evaluate({"extra": extra})
        ]
        for extra, group in groups.items()
    }
