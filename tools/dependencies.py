"""What mazeplan needs, directly and through others, in the environment that runs this: names, versions, licences."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterable
from dataclasses import dataclass
from email.message import Message
from importlib.metadata import Distribution, PackageNotFoundError, distribution
from pathlib import Path
from typing import cast

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).resolve().parent.parent
BASE = "base"  # the install without extras
LONGEST = 60  # characters of a licence's name; what is longer is its text
WITH_EXCEPTION = re.compile(
    r"GPL-[0-9.]+(-or-later|-only)? WITH GCC-exception-[0-9.]+"
)  # a compiler's run-time library
COPYLEFT = re.compile(r"(?<!L)(?<!Lesser )\bA?GPL|Affero|(?<!Lesser )General Public License", re.IGNORECASE)
UNKNOWN = "unknown"


@dataclass(frozen=True)
class Dependency:
    """A package; version: None where it is not installed."""

    name: str
    version: str | None
    licence: str
    direct: bool


def requirements() -> dict[str, list[Requirement]]:
    """{"base" or extra: what pyproject.toml asks for on this machine}."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    groups = {BASE: project["dependencies"], **project["optional-dependencies"]}
    return {name: [r for r in map(Requirement, group) if _applies(r, "")] for name, group in groups.items()}


def closure(wanted: Iterable[Requirement]) -> dict[str, Dependency]:
    """{normal name: dependency} of these and of all that they need, by what is installed."""
    found: dict[str, Dependency] = {}
    seen: set[tuple[str, str]] = set()
    queue = [(requirement, True) for requirement in wanted]
    while queue:
        requirement, direct = queue.pop(0)
        name = canonicalize_name(requirement.name)
        held = _installed(requirement.name)
        if name not in found:
            version = None if held is None else held.version
            label = requirement.name if held is None else held.metadata["Name"]
            found[name] = Dependency(label, version, UNKNOWN if held is None else licence_of(held), direct)
        for extra in ("", *sorted(requirement.extras)):
            if held is None or (name, extra) in seen:
                continue
            seen.add((name, extra))
            needs = (Requirement(text) for text in held.requires or ())
            queue += [(need, False) for need in needs if _applies(need, extra)]
    return found


def licence_of(held: Distribution) -> str:
    """Its licence in a few words, from the metadata: expression, classifiers, or free text."""
    about = cast(Message, held.metadata)
    given = about.get("License-Expression")
    classifiers = [text.rpartition(" :: ")[2] for text in about.get_all("Classifier") or ()
                   if text.startswith("License :: ") and not text.endswith("OSI Approved")]  # fmt: skip
    text = " ".join((about.get("License") or "").split())
    short = text if 0 < len(text) <= LONGEST and text.lower() != UNKNOWN else ""
    return given or short or ", ".join(classifiers) or _file_says(held)


def copyleft(licence: str) -> bool:
    """Whether it is GPL or AGPL: not LGPL, and not the GPL with the exception of GCC's run-time library."""
    return COPYLEFT.search(WITH_EXCEPTION.sub("", licence)) is not None


def _file_says(held: Distribution) -> str:
    """The licence by the first line of its file in the package."""
    for path in held.files or ():
        if ".dist-info/" in str(path) and re.match(r"licen[cs]e|copying", path.name, re.IGNORECASE):
            text = Path(str(path.locate())).read_text(errors="replace")
            rows = [row.strip() for row in text.splitlines() if row.strip()]
            if rows and len(rows[0]) <= LONGEST:
                return rows[0]
    return UNKNOWN


def _applies(requirement: Requirement, extra: str) -> bool:
    marker = requirement.marker
    if marker is None:
        return not extra
    needs_extra = "extra" in str(marker)
    return marker.evaluate({"extra": extra}) and needs_extra == bool(extra)


def _installed(name: str) -> Distribution | None:
    try:
        return distribution(name)
    except PackageNotFoundError:
        return None
