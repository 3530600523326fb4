"""The blackboard of one run: entries by name, in scopes. Each run has one of its own; py_trees' process-global one is
not used.

Each SubTree has a scope of its own. A port that is remapped ({key}) reads and writes the entry of the scope outside; a
port with a literal is an entry of the scope itself. A name that begins with @ stands in the outermost scope.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any


class _Empty:
    def __repr__(self) -> str:
        return "EMPTY"


EMPTY = _Empty()  # the value of an entry that is declared, but was never set


class Entry:
    """One value, and how often it was set. number: int or float, where the first port that names it is for such
    numbers, or it was given from outside the tree."""

    __slots__ = ("_named", "changes", "number", "value")

    def __init__(self, value: Any = EMPTY) -> None:
        self.value = value
        self.number: type | None = None
        self._named = False
        self.changes = 0 if value is EMPTY else 1

    def named_by(self, kind: type) -> None:
        """Take note of a port of this type; the first one decides."""
        if not self._named:
            self._named, self.number = True, kind if kind in (int, float) else self.number

    def put(self, value: Any) -> None:
        """Set the value. In an entry for floats a whole number is a float, which scripts may halve."""
        self.value = float(value) if self.number is float and type(value) is int else value
        self.changes += 1


class Blackboard:
    """One scope. `remap`: {name here: name outside}; `values`: what it starts with; `autoremap`: names that are not
    known here are those outside, except private ones, which begin with _; enums: {name: number} that scripts know
    besides the entries, the same in all scopes."""

    def __init__(
        self,
        outside: Blackboard | None = None,
        remap: Mapping[str, str] | None = None,
        values: Mapping[str, Any] | None = None,
        *,
        autoremap: bool = False,
        enums: Mapping[str, int] | None = None,
    ) -> None:
        self._entries = {name: Entry(value) for name, value in (values or {}).items()}
        self._outside, self._remap, self._autoremap = outside, dict(remap or {}), autoremap
        self.enums: Mapping[str, int] = outside.enums if outside is not None else dict(enums or {})

    def _home(self, name: str) -> tuple[Blackboard, str]:
        """The scope in which a name stands, and the name that it has there."""
        if name.startswith("@"):
            return self._outermost(), name[1:]
        if name not in self._entries and self._outside is not None:
            if name in self._remap:
                return self._outside._home(self._remap[name])
            if self._autoremap and not name.startswith("_"):
                return self._outside._home(name)
        return self, name

    def way(self, name: str) -> Iterator[tuple[Blackboard, str]]:
        """(scope, name there) of each scope from this one to that in which a name stands."""
        yield self, name
        outside = self._outside
        if name.startswith("@"):
            yield self._outermost(), name[1:]
        elif outside is not None and name not in self._entries:
            if name in self._remap:
                yield from outside.way(self._remap[name])
            elif self._autoremap and not name.startswith("_"):
                yield from outside.way(name)

    @property
    def outside(self) -> Blackboard | None:
        """The scope around this one; None for the outermost."""
        return self._outside

    def _outermost(self) -> Blackboard:
        return self if self._outside is None else self._outside._outermost()

    def find(self, name: str) -> Entry | None:
        """The entry of a name; None where it was neither declared nor set."""
        home, name = self._home(name)
        return home._entries.get(name)

    def declare(self, name: str) -> Entry:
        """The entry of a name, made without a value if there is none yet."""
        home, name = self._home(name)
        return home._entries.setdefault(name, Entry())

    def get(self, name: str) -> Any:
        """The value of a name. Raises KeyError when it was never set."""
        entry = self.find(name)
        if entry is None or entry.value is EMPTY:
            known = sorted(self._home(name)[0].values())
            raise KeyError(f"the blackboard has no {name!r}; it has {', '.join(known) or 'nothing'}")
        return entry.value

    def set(self, name: str, value: Any) -> None:
        """Set a name, here or in the scope where it stands."""
        self.declare(name).put(value)

    def give(self, name: str, value: Any) -> None:
        """Set a name from outside the tree: a float stays one, whatever a leaf sets it to."""
        entry = self.declare(name)
        entry.number = entry.number or (float if type(value) is float else None)
        entry.put(value)

    def unset(self, name: str) -> None:
        """Remove a name of this scope; names that stand outside stay."""
        self._entries.pop(name, None)

    def values(self) -> dict[str, Any]:
        """{name: value} of the entries of this scope that were set."""
        return {name: entry.value for name, entry in self._entries.items() if entry.value is not EMPTY}

    def __iter__(self) -> Iterator[str]:
        return iter(self.values())

    def __contains__(self, name: str) -> bool:
        entry = self.find(name)
        return entry is not None and entry.value is not EMPTY
