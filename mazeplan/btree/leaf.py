"""The base of all leaves: ports with types, and the calls start, step and halt.

`start` is called when the leaf is entered, `step` at each tick until it returns SUCCESS or FAILURE, `halt` once if the
leaf is interrupted in between. A leaf that fails gives the reason with `fail`. Below
stand the leaves of BehaviorTree.CPP 4, which do not depend on the maze.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, ClassVar, Protocol

from mazeplan.btree.blackboard import EMPTY, Blackboard
from mazeplan.btree.blame import CommandError
from mazeplan.btree.node import TreeNode
from mazeplan.btree.ports import REQUIRED, Key, Port, shown
from mazeplan.btree.script import Script, parse_script
from mazeplan.btree.script_values import WHOLE, ScriptError, number_of
from mazeplan.btree.status import FINISHED, RUNNING, Status


class Context(Protocol):
    """What the context of every leaf offers. The context of maze leaves offers more (`context.RunContext`)."""

    def clock(self) -> float:
        """Time of this tick, s."""
        ...

    def failed(self, failure: Any) -> None:
        """Note a failure."""
        ...


class Leaf(TreeNode):
    """Base of all leaves. `values`: {port: literal or Key} of the ports given in the tree; `category`: Action, or
    Condition for one that answers at once and changes nothing."""

    category: ClassVar[str] = "Action"

    def __init__(self, name: str, context: Any, blackboard: Blackboard, values: Mapping[str, Any]) -> None:
        super().__init__(name, blackboard, values)
        self.context = context
        self.interrupted = False  # whether it was entered and has not ended, as after an exception

    def start(self) -> None:
        """Called when the leaf is entered."""

    def step(self) -> Status:
        """Called at each tick: RUNNING, SUCCESS or FAILURE, at once."""
        # a leaf without a step is a mistake in the program: nothing sensible could be done at run time
        raise NotImplementedError(f"{type(self).__name__} has no step")

    def halt(self) -> None:
        """Called once when the leaf is interrupted while running. It commands nothing: another leaf does."""

    def fail(self, failure: Any) -> Status:
        """Give the context a reason and return FAILURE."""
        self.context.failed(failure)
        return Status.FAILURE

    def act(self) -> Status:
        """One tick: entered unless it runs, then a step."""
        if self.status is not RUNNING:
            self.interrupted = True
            self.call(self.start)
        status = self.call(self.step)
        self.interrupted = status not in FINISHED
        if status is not RUNNING and status not in FINISHED:
            expected = "expected RUNNING, SUCCESS or FAILURE"
            raise self.wrong(f"{type(self).__name__}.step returned {shown(status)}, {expected}")
        return status

    def on_halt(self) -> None:
        """Interrupted: `halt`, once."""
        if self.interrupted:
            self.interrupted = False
            self.call(self.halt)

    def call(self, method: Callable[[], Any]) -> Any:
        """Call a method of the leaf (`blamed`). Raises TreeError for a command that cannot go out."""
        try:
            return self.blamed(method, "leaf")
        except CommandError as problem:
            raise self.wrong(str(problem)) from None


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
