"""What installed packages add: rigs, effects and leaves, by entry points of their names.

    [project.entry-points."mazeplan.rigs"]
    cart = "cart_rig:Cart"

Which there are is read from the metadata of packages, which takes some milliseconds and runs nothing of theirs; a
package's code is imported only where what it adds is asked for by name. What the program itself has comes first.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import Any

from mazeplan.core.errors import InputError
from mazeplan.core.user_modules import reason

RIGS, EFFECTS, LEAVES = "mazeplan.rigs", "mazeplan.effects", "mazeplan.leaves"
GROUPS = (RIGS, EFFECTS, LEAVES)


@dataclass(frozen=True)
class Plugin:
    """One entry point: its group, the name by which it is used, what it is, and whose it is."""

    group: str
    name: str
    value: str
    package: str
    version: str
    entry: EntryPoint

    @property
    def source(self) -> str:
        """Package and version."""
        return f"{self.package} {self.version}"

    @property
    def label(self) -> str:
        """What an error begins with."""
        return f"package {self.source}, entry point {self.group}: {self.name} = {self.value}"

    def problem(self, what: str) -> InputError:
        """An error that says whose entry point it is."""
        return InputError(f"{self.label}: {what}")

    def load(self) -> Any:
        """What it names. Raises InputError with the place where its code broke."""
        try:
            return self.entry.load()
        except (Exception, SystemExit) as problem:  # whatever anybody's code does at import
            raise self.problem(f"cannot be imported: {reason(problem)}") from None

    def file(self) -> Path | None:
        """The file of its code; None where it has none. Imports it."""
        import sys

        self.load()
        file = getattr(sys.modules.get(self.entry.module), "__file__", None)
        return None if file is None else Path(file)


@cache
def plugins(group: str) -> tuple[Plugin, ...]:
    """All of a group, by name and package; nothing of them is imported."""
    found = []
    for entry in entry_points(group=group):
        package, version = ("?", "?") if entry.dist is None else (entry.dist.name, entry.dist.version)
        found.append(Plugin(group, entry.name, entry.value, package, version, entry))
    return tuple(sorted(found, key=lambda plugin: (plugin.name, plugin.package)))


def unknown_groups() -> dict[str, str]:
    """Groups that packages offer something in and that this program does not know, such as mazeplan.rig, with the
    package."""
    groups = sorted(group for group in entry_points().groups if group.split(".")[0] == "mazeplan")
    ours = [entry for group in groups if group not in GROUPS for entry in entry_points(group=group)]
    return {entry.group: "?" if entry.dist is None else entry.dist.name for entry in ours}


def plugin(group: str, name: str) -> Plugin | None:
    """The one of that name, None if there is none. Raises InputError where two packages have it."""
    found = [plugin for plugin in plugins(group) if plugin.name == name]
    if len(found) > 1:
        raise found[0].problem(f"package {found[1].source} has the same name; uninstall one of them")
    return found[0] if found else None
