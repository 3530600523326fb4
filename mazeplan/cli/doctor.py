"""`doctor`: what is installed, and what a missing feature needs."""

from __future__ import annotations

import platform
import sys
from importlib.metadata import PackageNotFoundError, version
from typing import Annotated

import typer

from mazeplan.cli.output import print_json

NEEDED = {
    "core": (
        "numpy",
        "scipy",
        "numba",
        "pandas",
        "scikit-learn",
        "mujoco",
        "networkx",
        "py-trees",
        "pydantic",
        "lxml",
        "mcap",
        "pyyaml",
        "matplotlib",
    ),
    "learn": ("torch", "gpytorch"),
    "view": ("viser",),
    "hardware": ("pyserial", "opencv-python-headless"),
    "testing": ("hypothesis",),
}
FEATURES = {
    "core": "maps, simulated rigs, navigate, evaluate, collect, learn --kind pi, logs",
    "learn": "Gaussian-process models",
    "view": "the live page in the browser",
    "hardware": "camera and serial line of a real rig",
    "testing": "generated ball behaviours for tests of trees",
}


def installed(package: str) -> str | None:
    """Version of an installed package, or None."""
    try:
        return version(package)
    except PackageNotFoundError:
        return None


def report() -> dict[str, dict[str, str | None]]:
    """{extra: {package: version or None}} of all packages the program can use."""
    return {extra: {package: installed(package) for package in packages} for extra, packages in NEEDED.items()}


def doctor(
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON document on stdout.")] = False,
) -> None:
    """What is installed, and what a missing feature needs."""
    found = report()
    if as_json:
        print_json({"python": platform.python_version(), "mazeplan": installed("mazeplan"), "packages": found})
    else:
        print(f"mazeplan {installed('mazeplan')} on Python {platform.python_version()}, {platform.platform()}")
        for extra, packages in found.items():
            missing = [package for package, got in packages.items() if got is None]
            state = "ready" if not missing else f"missing {', '.join(missing)}"
            advice = "" if not missing or extra == "core" else f"; to have it: pip install 'mazeplan[{extra}]'"
            print(f"{extra:9s} {state}: {FEATURES[extra]}{advice}")
            for package, got in packages.items():
                print(f"    {package} {got or '-'}")
    sys.exit(1 if None in found["core"].values() else 0)
