"""The leaves of BehaviorTree.CPP 4, which do not depend on the maze. docs/trees.md has their table."""

from __future__ import annotations

from collections.abc import Callable
from typing import ClassVar

from mazeplan.btree.blackboard import EMPTY, Blackboard
from mazeplan.btree.leaf import Leaf
from mazeplan.btree.ports import REQUIRED, Key, Port
from mazeplan.btree.script import Script, parse_script
from mazeplan.btree.script_values import WHOLE, ScriptError, number_of
from mazeplan.btree.status import Status


class AlwaysSuccess(Leaf):
    """SUCCESS, at once."""

    def step(self) -> Status:
        """SUCCESS."""
        return Status.SUCCESS


class AlwaysFailure(Leaf):
    """FAILURE, at once."""

    def step(self) -> Status:
        """FAILURE."""
        return Status.FAILURE


class Sleep(Leaf):
    """RUNNING for a while, in rig time."""

    ports: ClassVar[dict[str, Port]] = {"msec": Port(int, REQUIRED, "how long, ms", least=0)}

    def start(self) -> None:
        """Start the clock."""
        self._began = self.context.clock()

    def step(self) -> Status:
        """SUCCESS when the time is over."""
        over = 1e3 * (self.context.clock() - self._began) + 1e-6 >= self.get("msec")
        return Status.SUCCESS if over else Status.RUNNING


class _Scripted(Leaf):
    """A leaf with a script."""

    ports: ClassVar[dict[str, Port]] = {"code": Port(str, REQUIRED, "the script")}

    def evaluate(self, method: Callable[[Script, Blackboard], bool | None]) -> bool | None:
        """Run the script as it is now by a method of `Script`."""
        try:
            return method(parse_script(self.get("code")), self._board)
        except ScriptError as problem:
            raise self.wrong(f"code: {problem}") from None


class RunScript(_Scripted):
    """Run a script, such as `tries := 0`."""

    def step(self) -> Status:
        """SUCCESS."""
        self.evaluate(Script.run)
        return Status.SUCCESS


RunScript.__name__ = RunScript.__qualname__ = "Script"  # its name in a tree, which `script.Script` has in the program


class ScriptCondition(_Scripted):
    """Whether a script is true."""

    category: ClassVar[str] = "Condition"

    def step(self) -> Status:
        """SUCCESS or FAILURE."""
        return Status.SUCCESS if self.evaluate(Script.holds) else Status.FAILURE


class SetBlackboard(Leaf):
    """Set an entry of the blackboard to a text, or to what another entry has."""

    ports: ClassVar[dict[str, Port]] = {
        "value": Port(str, REQUIRED, "the text, or a {key}"),
        "output_key": Port(str, REQUIRED, "name of the entry to set", direction="inout"),
    }

    def step(self) -> Status:
        """SUCCESS; FAILURE where the other entry has no value yet."""
        name, value = str(self.get("output_key")), self._values["value"]
        if isinstance(value, Key):
            source = self._board.find(value.name)
            if source is None:
                raise self.wrong(f"value: the blackboard has no {value.name!r}")
            value = source.value
            if value is EMPTY:
                return Status.FAILURE
        entry = self._board.declare(name)
        if isinstance(value, str) and isinstance(entry.value, bool | int | float):
            number = number_of(value, {})
            if number is None:
                raise self.wrong(f"value: got {value!r} for {name}, which is a number")
            value = (
                int(number) if isinstance(entry.value, int) and abs(number) < WHOLE and number.is_integer() else number
            )
        entry.put(value)
        return Status.SUCCESS


class UnsetBlackboard(Leaf):
    """Remove an entry of the blackboard."""

    ports: ClassVar[dict[str, Port]] = {"key": Port(str, REQUIRED, "name of the entry to remove")}

    def step(self) -> Status:
        """SUCCESS, also where there was none."""
        self._board.unset(str(self.get("key")))
        return Status.SUCCESS


class WasEntryUpdated(Leaf):
    """Whether an entry of the blackboard was set since the last time."""

    ports: ClassVar[dict[str, Port]] = {"entry": Port(str, REQUIRED, "the {key}, or its name")}
    _seen = 0

    def step(self) -> Status:
        """SUCCESS or FAILURE."""
        key = self._values["entry"]
        entry = self._board.find(key.name if isinstance(key, Key) else str(key))
        before, self._seen = self._seen, self._seen if entry is None else entry.changes
        return Status.SUCCESS if entry is not None and before != entry.changes else Status.FAILURE


SCRIPTED = (RunScript, ScriptCondition)
ALL = (AlwaysSuccess, AlwaysFailure, Sleep, *SCRIPTED, SetBlackboard, UnsetBlackboard, WasEntryUpdated)
BUILTIN_LEAVES: dict[str, type[Leaf]] = {leaf.__name__: leaf for leaf in ALL}
