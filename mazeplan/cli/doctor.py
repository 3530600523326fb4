"""`doctor`: what is installed, what is missing or too old for what, and how to get it.

Which package belongs to what is asked of the package itself: of pyproject.toml in a checkout, else of what was
installed. Only the words for people are here."""

from __future__ import annotations

import platform
import shutil
import sys
import tomllib
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from importlib.metadata import PackageNotFoundError, metadata, version
from typing import Annotated, Any

import typer
from packaging.requirements import Requirement

from mazeplan import resources
from mazeplan.cli.added import added, plugin_lines
from mazeplan.cli.output import print_json

CORE = "core"
FEATURES = {
    CORE: "maps, simulated rigs, navigate, evaluate, collect, learn --kind pi, diagnose, improve, logs",
    "learn": "Gaussian-process models: learn --kind sp and np, compare",
    "view": "the live page in the browser",
    "hardware": "camera and serial line of a real rig",
    "testing": "generated ball behaviours for tests of trees",
    "docs": "the documentation as a site: make docs",
    "gym": "the maze as a Gymnasium environment: record, reinforcement learning",
    "campaign": "evaluate on other machines and resumed: --dask, --store",
    "tune": "searching costs and gains: tools/tune.py",
    "bench": "other solvers and searches beside these: make bench",
    "dev": "make test",
}
BROWSERS = ("chromium", "chromium-browser", "google-chrome")


@dataclass(frozen=True)
class Package:
    """A package that is asked for: what version, and which is installed (None: none)."""

    name: str
    needed: str
    installed: str | None

    @classmethod
    def of(cls, requirement: Requirement) -> Package:
        """The state of a requirement here."""
        return cls(requirement.name, str(requirement.specifier), installed(requirement.name))

    @property
    def fits(self) -> bool:
        """Whether the installed version is one of those asked for."""
        found = Requirement(f"{self.name}{self.needed}").specifier
        return self.installed is not None and found.contains(self.installed, prereleases=True)

    @property
    def problem(self) -> str:
        """What is wrong with it, in words; empty if nothing is."""
        if self.installed is None:
            return f"{self.name} is missing"
        return "" if self.fits else f"{self.name} is {self.installed}, needed {self.needed}"


def installed(package: str) -> str | None:
    """Version of an installed package, or None."""
    try:
        return version(package)
    except PackageNotFoundError:
        return None


def requirements() -> dict[str, list[Requirement]]:
    """{"core" or extra: what it asks for here}."""
    if resources.CHECKOUT.is_file():
        project = tomllib.loads(resources.CHECKOUT.read_text(encoding="utf-8"))["project"]
        groups = {CORE: project["dependencies"], **project["optional-dependencies"]}
        return {extra: _here(map(Requirement, group), "") for extra, group in groups.items()}
    told = metadata("mazeplan")
    every = [Requirement(text) for text in told.get_all("Requires-Dist") or []]
    core = _here(every, "")
    extras = {extra: _here(every, extra) for extra in told.get_all("Provides-Extra") or []}
    return {CORE: core, **{extra: [r for r in group if r not in core] for extra, group in extras.items()}}


def _here(group: Iterable[Requirement], extra: str) -> list[Requirement]:
    return [r for r in group if r.marker is None or r.marker.evaluate({"extra": extra})]


def report() -> dict[str, list[Package]]:
    """{"core" or extra: its packages}."""
    return {extra: [Package.of(r) for r in group] for extra, group in requirements().items()}


def advice(extra: str) -> str:
    """The command that installs what an extra needs."""
    return resources.to_install("" if extra == CORE else extra)


def browser() -> str | None:
    """Where a browser is in which the page can be tested without a screen."""
    return next((found for found in map(shutil.which, BROWSERS) if found), None)


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


def _feature(extra: str, packages: list[Package]) -> dict[str, Any]:
    ready = not any(package.problem for package in packages)
    return {
        "what": FEATURES.get(extra, ""),
        "ready": ready,
        "missing": [package.name for package in packages if package.installed is None],
        "too_old": [package.name for package in packages if package.installed is not None and not package.fits],
        "get": None if ready else advice(extra),
    }


def document(found: dict[str, list[Package]]) -> dict[str, Any]:
    """What `doctor --json` prints."""
    return {
        "python": platform.python_version(),
        "mazeplan": installed("mazeplan"),
        "features": {extra: _feature(extra, packages) for extra, packages in found.items()},
        "packages": {extra: {p.name: p.installed for p in packages} for extra, packages in found.items()},
        "needed": {extra: {p.name: p.needed for p in packages} for extra, packages in found.items()},
        "emulator": emulator(),
        "browser": browser(),
        "ports": ports(),
        "plugins": [asdict(found) for found in added()],
    }


def doctor(
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON document on stdout.")] = False,
) -> None:
    """What is installed, what is missing or too old for what, and how to get it.

    Exit status 1 where what everything needs is not there."""
    found = report()
    if as_json:
        print_json(document(found))
    else:
        print("\n".join(lines(found)))
    sys.exit(1 if any(package.problem for package in found[CORE]) else 0)


def lines(found: dict[str, list[Package]]) -> list[str]:
    """The same for people: a line a feature, then what it is made of."""
    told = [f"mazeplan {installed('mazeplan')} on Python {platform.python_version()}, {platform.platform()}"]
    for extra, packages in found.items():
        problems = ", ".join(package.problem for package in packages if package.problem)
        how = f"; to have it: {advice(extra)}" if problems else ""
        told.append(f"{extra:9s} {problems or 'ready'}: {FEATURES.get(extra, '')}{how}")
        told += [f"    {package.name} {package.installed or '-'}" for package in packages]
    parts, serial, page = emulator(), ports(), browser()
    missing = [part for part, got in parts.items() if got is None]
    state = f"missing {', '.join(missing)}" if missing else "ready"
    told.append(f"emulator  {state}: the board's firmware on a simulated chip{emulator_advice(parts)}")
    told += [f"    {part} {got or '-'}" for part, got in parts.items()]
    state = "ready" if page else "missing chromium"
    how = "" if page else "; to have them: sudo apt-get install chromium"
    told.append(f"browser   {state}: tests of the live page{how}")
    told += plugin_lines(added())
    if serial is not None:
        told.append(f"ports     {', '.join(serial) or 'none found'}: where a board may be plugged in")
    return told
