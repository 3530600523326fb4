"""The blackboard of one run: names and values, in scopes. A fresh object per run; py_trees' process-global one is
not used.

Each SubTree has a scope of its own; a port that is remapped ({key}) reads and writes the key of the scope outside, a
port that is given a literal is a value of the scope itself.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any


class Blackboard:
    """One scope. `remap`: {name here: name outside}; `values`: what it starts with; `autoremap`: names that are not
    known here are those outside, but for private ones, which begin with _."""

    def __init__(
        self,
        outside: Blackboard | None = None,
        remap: Mapping[str, str] | None = None,
        values: Mapping[str, Any] | None = None,
        *,
        autoremap: bool = False,
    ) -> None:
        self._values: dict[str, Any] = dict(values or {})
        self._outside, self._remap, self._autoremap = outside, dict(remap or {}), autoremap

    def _home(self, name: str) -> tuple[Blackboard, str]:
        if self._outside is not None:
            if name in self._remap:
                return self._outside._home(self._remap[name])
            if self._autoremap and name not in self._values and not name.startswith("_"):
                return self._outside._home(name)
        return self, name

    def get(self, name: str) -> Any:
        """The value of a name. Raises KeyError when it was never set."""
        home, name = self._home(name)
        if name not in home._values:
            raise KeyError(f"the blackboard has no {name!r}; it has {', '.join(sorted(home._values)) or 'nothing'}")
        return home._values[name]

    def set(self, name: str, value: Any) -> None:
        """Set a name, here or where it is remapped to."""
        home, name = self._home(name)
        home._values[name] = value

    def __contains__(self, name: str) -> bool:
        home, name = self._home(name)
        return name in home._values
