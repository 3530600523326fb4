"""`doctor`: what is installed, and what a missing feature needs."""

from __future__ import annotations

import platform
import shutil
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


def emulator() -> dict[str, str | None]:
    """{part: where it is, or None} of what runs the board's firmware without a board."""
    from mazeplan.rigs.hardware.chip import HEADER, paths

    host, firmware = paths()
    return {
        "avr-gcc": shutil.which("avr-gcc"),
        "simavr": str(HEADER) if HEADER.exists() else None,
        "firmware": str(firmware) if firmware.exists() else None,
        "emulator": str(host) if host.exists() else None,
    }


def emulator_advice(parts: dict[str, str | None]) -> str:
    """What to do so that the emulated board runs; empty when it does."""
    from mazeplan.rigs.hardware.chip import DEBIAN

    if parts["emulator"] and parts["firmware"]:
        return ""
    steps = ["make emulator (in a checkout)"]
    if not (parts["avr-gcc"] and parts["simavr"]):
        steps.insert(0, f"sudo apt-get install {' '.join(DEBIAN)}")
    return f"; to have it: {', then '.join(steps)}"


def ports() -> list[str] | None:
    """Serial ports behind USB; None without pyserial."""
    if installed("pyserial") is None:
        return None
    from mazeplan.rigs.link.port import ports_found

    return ports_found()


def report() -> dict[str, dict[str, str | None]]:
    """{extra: {package: version or None}} of all packages the program can use."""
    return {extra: {package: installed(package) for package in packages} for extra, packages in NEEDED.items()}


def doctor(
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON document on stdout.")] = False,
) -> None:
    """What is installed, and what a missing feature needs."""
    found, parts, serial = report(), emulator(), ports()
    if as_json:
        versions = {"python": platform.python_version(), "mazeplan": installed("mazeplan")}
        print_json({**versions, "packages": found, "emulator": parts, "ports": serial})
    else:
        print(f"mazeplan {installed('mazeplan')} on Python {platform.python_version()}, {platform.platform()}")
        for extra, packages in found.items():
            missing = [package for package, got in packages.items() if got is None]
            state = "ready" if not missing else f"missing {', '.join(missing)}"
            advice = "" if not missing or extra == "core" else f"; to have it: pip install 'mazeplan[{extra}]'"
            print(f"{extra:9s} {state}: {FEATURES[extra]}{advice}")
            for package, got in packages.items():
                print(f"    {package} {got or '-'}")
        missing = [part for part, got in parts.items() if got is None]
        state = f"missing {', '.join(missing)}" if missing else "ready"
        print(f"emulator  {state}: the board's firmware on a simulated chip{emulator_advice(parts)}")
        for part, got in parts.items():
            print(f"    {part} {got or '-'}")
        if serial is not None:
            print(f"ports     {', '.join(serial) or 'none found'}: where a board may be plugged in")
    sys.exit(1 if None in found["core"].values() else 0)
