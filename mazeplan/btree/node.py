"""The base of all nodes of a tree: ports, pre- and postconditions, a place in a file, and the states of
BehaviorTree.CPP 4. A node is idle (INVALID), is ticked by `execute`, is RUNNING, and is finished until its parent
resets it. A node that was skipped keeps its status; `last` has the result of its last tick.

Preconditions are evaluated in the order of DECISIONS, in an idle node; _while in one that runs, too, which it halts.
All scripts use the blackboard scope of the node; for a SubTree, that of the tree around it. docs/tree-nodes.md has
their table.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Protocol

from mazeplan.btree.blackboard import Blackboard
from mazeplan.btree.blame import blame
from mazeplan.btree.ports import Key, Port, one_line, shown
from mazeplan.btree.script import Script
from mazeplan.btree.script_values import ScriptError
from mazeplan.btree.status import FAILURE, FINISHED, INVALID, RUNNING, SKIPPED, SUCCESS, Status
from mazeplan.core.errors import TreeError

WHILE, POST, ON_HALTED = "_while", "_post", "_onHalted"
DECISIONS: dict[str, tuple[bool, Status]] = {  # in the order of evaluation: (decisive value of the script, result)
    "_failureIf": (True, FAILURE),
    "_successIf": (True, SUCCESS),
    "_skipIf": (True, SKIPPED),
    WHILE: (False, SKIPPED),
}
ENDINGS: dict[str, Status] = {"_onSuccess": SUCCESS, "_onFailure": FAILURE}
CONDITIONS = (*DECISIONS, *ENDINGS, ON_HALTED, POST)


@dataclass(frozen=True)
class Place:
    """The place of a node: file, line, and path in the tree."""

    file: Path
    line: int
    path: str


@dataclass(frozen=True)
class Conditions:
    """The pre- and postconditions of one node: {attribute: script}, and the blackboard of their names."""

    given: Mapping[str, Script]
    board: Blackboard

    def decide(self, status: Status) -> Status | None:
        """The result that the preconditions give in place of a tick; None: the node is ticked.

        status: of the node before. Raises ScriptError that names the attribute."""
        for name, (decisive, result) in DECISIONS.items():
            evaluated = status is not RUNNING or name == WHILE
            if evaluated and name in self.given and self._named(name, Script.holds) is decisive:
                return result
        return None

    def after(self, result: Status) -> None:
        """Run the scripts of a node that has ended. Raises ScriptError, which names the attribute."""
        for name in (*(name for name, ending in ENDINGS.items() if result is ending), POST):
            if name in self.given:
                self._named(name, Script.run)

    def halted(self) -> None:
        """Run the script of a node that was halted while it ran. Raises ScriptError, which names the attribute."""
        if ON_HALTED in self.given:
            self._named(ON_HALTED, Script.run)

    def _named(self, name: str, action: Callable[[Script, Blackboard], Any]) -> Any:
        try:
            return action(self.given[name], self.board)
        except ScriptError as problem:
            raise ScriptError(f"{name}: {problem}") from None


@dataclass
class Waker:
    """Asks the tree to tick its root again in the same tick. A loop asks for it when it has more to do: before the loop
    goes on, reactive nodes above it check their conditions."""

    asked: bool = False


class Probe(Protocol):
    """Watches the ticks of a node, or replaces them."""

    def before(self, node: TreeNode) -> Status | None:
        """Called before a node is ticked. Returns a result that replaces the tick, or None."""
        ...

    def after(self, node: TreeNode, result: Status) -> None:
        """Called after a node was ticked."""
        ...


class TreeNode:
    """Base of all nodes. status: RUNNING, SUCCESS, FAILURE, or INVALID while idle; last: how its last tick ended,
    INVALID before the first one and after it was halted; parts: its children."""

    ports: ClassVar[dict[str, Port]] = {}
    category: ClassVar[str] = ""  # Action, Condition, Control or Decorator: the element of the explicit form
    place: Place | None = None
    conditions: Conditions | None = None
    waker: Waker | None = None
    probe: Probe | None = None
    status: Status = INVALID
    last: Status = INVALID
    parts: tuple[TreeNode, ...] = ()

    def __init__(self, name: str, board: Blackboard, values: Mapping[str, Any]) -> None:
        self.name, self._board, self._values = name, board, dict(values)

    def get(self, port: str) -> Any:
        """The value of a port: literal, blackboard entry, or default. Raises TreeError, at the line of the node, where
        the entry is missing or not of the port's type, or the node has no such port."""
        if port not in self.ports:
            known = ", ".join(self.ports) or "its ports: it has none"
            raise self.wrong(f"get: got {shown(port)}, expected one of {known}")
        if port not in self._values:
            return self.ports[port].default
        value = self._values[port]
        if not isinstance(value, Key):
            return value
        try:
            found = self._board.get(value.name)
        except KeyError as missing:
            raise self.wrong(f"{port}: {missing.args[0]}") from None
        context = getattr(self, "context", None)
        try:
            return self.ports[port].accept(found, context)
        except (ValueError, OverflowError):
            expected = self.ports[port].expects(context)
            raise self.wrong(f"{port}: got {shown(found)} from {value}, expected {expected}") from None

    def set(self, port: str, value: Any) -> None:
        """Write an output, or an input that is a key; nothing happens where the tree gave none."""
        target = self._values.get(port)
        if isinstance(target, Key):
            self._board.set(target.name, value)

    @property
    def values(self) -> Mapping[str, Any]:
        """{port: literal or Key} of the ports given in the tree."""
        return self._values

    @property
    def board(self) -> Blackboard:
        """The scope of the blackboard on which it stands."""
        return self._board

    def wrong(self, problem: str) -> TreeError:
        """The error that names this node."""
        if self.place is None:
            return TreeError(one_line(problem), key=one_line(self.name))
        return TreeError(one_line(problem), file=self.place.file, line=self.place.line, key=one_line(self.place.path))

    def execute(self) -> Status:
        """One tick, unless the preconditions decide; then the postconditions, if it has ended."""
        conditions = self.conditions
        result = None if conditions is None else self._scripted(conditions.decide, self.status)
        if result is SKIPPED and self.status is RUNNING:
            self.halt_node()
        if result is None and self.probe is not None and self.status not in FINISHED:
            result = self.probe.before(self)
        if result is None:
            result = self.act()
        if conditions is not None and result in FINISHED:
            self._scripted(conditions.after, result)
        if self.probe is not None:
            self.probe.after(self, result)
        if result is not SKIPPED:
            self.status = result
        self.last = result
        return result

    def _scripted(self, method: Callable[..., Any], *arguments: Any) -> Any:
        try:
            return method(*arguments)
        except ScriptError as problem:
            raise self.wrong(str(problem)) from None

    def blamed(self, method: Callable[[], Any], kind: str) -> Any:
        """Call a method of the node; what it raises keeps its type and names the node. kind: leaf or node"""
        try:
            return method()
        except (Exception, SystemExit) as problem:
            place = self.place
            where = self.name if place is None else f"{place.file}:{place.line}: {place.path}"
            ended = blame(problem, where, kind)
            if ended is problem:
                raise
            raise ended from None

    def act(self) -> Status:
        """One tick of the node itself."""
        # a node without an act is a mistake in the program: nothing sensible could be done at run time
        raise NotImplementedError(f"{type(self).__name__} has no act")

    def on_halt(self) -> None:
        """Called when the node is halted while it runs, before it is idle."""

    def halt_node(self) -> None:
        """Halt the node and what runs below it; it is idle from now on."""
        self.on_halt()
        self.status = self.last = INVALID
        if self.conditions is not None:
            self._scripted(self.conditions.halted)

    def reset(self) -> None:
        """Idle from now on, halted if it runs; how the last tick of a finished node ended can still be read."""
        if self.status is RUNNING:
            self.halt_node()
        self.status = INVALID


class Node(TreeNode):
    """Base of nodes with children. least, most: children allowed (None: any number)."""

    least: ClassVar[int] = 1
    most: ClassVar[int | None] = None
    fresh: bool = True  # whether this tick enters the node

    def __init__(
        self,
        name: str,
        children: Sequence[TreeNode],
        clock: Callable[[], float],
        blackboard: Blackboard,
        values: Mapping[str, Any],
    ) -> None:
        super().__init__(name, blackboard, values)
        self.parts, self.clock = tuple(children), clock
        self._forget()

    def _forget(self) -> None:
        """Forget what the node keeps from tick to tick: its place among the children, counts, times."""

    @classmethod
    def problem(cls, values: Mapping[str, Any], n: int) -> str | None:
        """What is wrong with these literals for n children, if anything; asked when a file is read."""
        return None

    def act(self) -> Status:
        """One tick, children first."""
        self.fresh = self.status is not RUNNING
        self.status = RUNNING
        result = self.blamed(self.run, "node")
        if not isinstance(result, Status) or result is INVALID:
            what = f"{type(self).__name__}.run returned {shown(result)}"
            raise self.wrong(f"{what}, expected RUNNING, SUCCESS, FAILURE or SKIPPED")
        return result

    def run(self) -> Status:
        """One tick of the node: RUNNING, SUCCESS, FAILURE or SKIPPED. `tick_child` ticks a child; children that have
        finished are to be reset before the node finishes (`reset_children`)."""
        # a node without a run is a mistake in the program, as a leaf without a step is
        raise NotImplementedError(f"{type(self).__name__} has no run")

    def tick_child(self, index: int) -> Status:
        """Tick one child and return how that ended. Raises TreeError where there is none of that number."""
        try:
            child = self.parts[index]
        except (IndexError, TypeError):
            what = f"tick_child of {type(self).__name__}: got {shown(index)}"
            raise self.wrong(f"{what}, expected a number from 0 to {len(self.parts) - 1}") from None
        return child.execute()

    def reset_children(self) -> None:
        """Make the children idle; those that run are halted."""
        for child in self.parts:
            child.reset()

    def finish(self, result: Status) -> Status:
        """The node has finished: its children are idle, and it forgets what it keeps. Returns the result."""
        self.reset_children()
        self._forget()
        return result

    def on_halt(self) -> None:
        """Halted: so are its children."""
        self._forget()
        self.reset_children()


class Control(Node):
    """Base of the control nodes, also of a user's own: `run` does one tick, `on_halt` forgets what it keeps."""

    category: ClassVar[str] = "Control"
