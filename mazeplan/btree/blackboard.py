"""The blackboard of one run: entries by name, in scopes.

Each SubTree has its own scope. A port that is remapped ({key}) reads and writes an entry of the scope outside; a port
with a literal is an entry of the scope itself. A name that begins with @ belongs to the outermost scope.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any


class _Empty:
    def __repr__(self) -> str:
        return "EMPTY"


EMPTY = _Empty()  # the value of an entry that was declared but never set


class Entry:
    """One value of the blackboard.

    changes: how often the value was set
    number: int or float, the type of the first port that names the entry; None: another type

    An entry that is given a float from outside the tree has `number` float, unless a port decided before."""

    __slots__ = ("_named", "changes", "number", "value")

    def __init__(self, value: Any = EMPTY) -> None:
        self.value = value
        self.number: type | None = None
        self._named = False
        self.changes = 0 if value is EMPTY else 1

    def named_by(self, kind: type) -> None:
        """Note that a port of this type names the entry. The first port decides about `number`."""
        if not self._named:
            self._named, self.number = True, kind if kind in (int, float) else self.number

    def put(self, value: Any) -> None:
        """Set the value. An entry for floats keeps a whole number as a float, so that scripts may give it fractions."""
        self.value = float(value) if self.number is float and type(value) is int else value
        self.changes += 1


class Blackboard:
    """One scope.

    outside: the scope around this one; None: this is the outermost scope
    remap: {name here: name outside}
    values: {name: value} at the start
    autoremap: whether names that are unknown here belong to the scope outside, except private names, which begin with _
    enums: {name: number} that scripts know besides the entries; the same in all scopes
    """

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
        self.outside, self._remap, self._autoremap = outside, dict(remap or {}), autoremap
        self.enums: Mapping[str, int] = outside.enums if outside is not None else dict(enums or {})

    def scope_chain(self, name: str) -> Iterator[tuple[Blackboard, str]]:
        """(scope, name there) of each scope from this one to the scope to which the name belongs."""
        board = self
        while True:
            yield board, name
            if name.startswith("@"):
                board, name = self._outermost(), name[1:]
            elif board.outside is None or name in board._entries:
                return
            elif name in board._remap:
                board, name = board.outside, board._remap[name]
            elif board._autoremap and not name.startswith("_"):
                board = board.outside
            else:
                return

    def _resolve(self, name: str) -> tuple[Blackboard, str]:
        *_, home = self.scope_chain(name)
        return home

    def _outermost(self) -> Blackboard:
        return self if self.outside is None else self.outside._outermost()

    def find(self, name: str) -> Entry | None:
        """The entry of a name; None if it was neither declared nor set."""
        home, name = self._resolve(name)
        return home._entries.get(name)

    def declare(self, name: str) -> Entry:
        """The entry of a name. If there is none yet, it is made without a value."""
        home, name = self._resolve(name)
        return home._entries.setdefault(name, Entry())

    def get(self, name: str) -> Any:
        """The value of a name. Raises KeyError if it was never set."""
        entry = self.find(name)
        if entry is None or entry.value is EMPTY:
            known = sorted(self._resolve(name)[0].values())
            raise KeyError(f"the blackboard has no {name!r}; it has {', '.join(known) or 'nothing'}")
        return entry.value

    def set(self, name: str, value: Any) -> None:
        """Set the entry of a name, in the scope to which the name belongs."""
        self.declare(name).put(value)

    def set_external(self, name: str, value: Any) -> None:
        """Set the entry of a name from outside the tree. An entry that gets a float keeps later whole numbers as
        floats."""
        entry = self.declare(name)
        entry.number = entry.number or (float if type(value) is float else None)
        entry.put(value)

    def unset(self, name: str) -> None:
        """Remove an entry of this scope. Entries of scopes outside stay."""
        self._entries.pop(name, None)

    def values(self) -> dict[str, Any]:
        """{name: value} of the entries of this scope that were set."""
        return {name: entry.value for name, entry in self._entries.items() if entry.value is not EMPTY}

    def __iter__(self) -> Iterator[str]:
        return iter(self.values())

    def __contains__(self, name: str) -> bool:
        entry = self.find(name)
        return entry is not None and entry.value is not EMPTY
