"""Rigs, effects and leaves that installed packages add, by entry points:

    [project.entry-points."mazeplan.rigs"]
    cart = "cart_rig:Cart"

The names are read from the metadata of packages. That takes some milliseconds and runs no code of a package. The code
of a package is imported only when someone asks for one of its names. Names of the program itself come first.
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
    """One entry point.

    group:   one of GROUPS
    name:    name by which users ask for the object
    value:   where the object is, `module:object`
    package: name of the package that adds the object
    version: version of this package
    entry:   the entry point as Python's importlib gives it
    """

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
        """The beginning of an error message about this entry point."""
        return f"package {self.source}, entry point {self.group}: {self.name} = {self.value}"

    def problem(self, what: str) -> InputError:
        """An error that names the package and the entry point."""
        return InputError(f"{self.label}: {what}")

    def load(self) -> Any:
        """Import the object and return it. Raises InputError with the place where the package's code failed."""
        try:
            return self.entry.load()
        except (Exception, SystemExit) as problem:  # whatever anybody's code does at import
            raise self.problem(f"cannot be imported: {reason(problem)}") from None

    def file(self) -> Path | None:
        """Import the object and return the file of its module; None without a file."""
        import sys

        self.load()
        file = getattr(sys.modules.get(self.entry.module), "__file__", None)
        return None if file is None else Path(file)


@cache
def plugins(group: str) -> tuple[Plugin, ...]:
    """All entry points of a group, sorted by name and package; nothing is imported."""
    found = []
    for entry in entry_points(group=group):
        package, version = ("?", "?") if entry.dist is None else (entry.dist.name, entry.dist.version)
        found.append(Plugin(group, entry.name, entry.value, package, version, entry))
    return tuple(sorted(found, key=lambda plugin: (plugin.name, plugin.package)))


def plugin(group: str, name: str) -> Plugin | None:
    """The entry point `name` of a group, None without one. Raises InputError if two packages have this name."""
    found = [plugin for plugin in plugins(group) if plugin.name == name]
    if len(found) > 1:
        raise found[0].problem(f"package {found[1].source} has the same name; uninstall one of them")
    return found[0] if found else None
