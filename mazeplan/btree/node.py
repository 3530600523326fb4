"""The base of all nodes of a tree: ports, pre- and postconditions, a place in a file, and the states of
BehaviorTree.CPP 4. A node is idle, is ticked by `execute`, is RUNNING, and is finished until its parent resets it.

From py_trees the nodes only use the base `Behaviour`, because its composites differ in important points: a retry costs
a tick, and timers read the wall clock. INVALID is py_trees' word for idle. A node that was skipped keeps its status;
`last` has the result of its last tick.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from collections.abc import Sequence as Row
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Protocol
from weakref import ref

from py_trees.behaviour import Behaviour
from py_trees.common import Status

from mazeplan.btree.blackboard import Blackboard
from mazeplan.btree.blame import blame
from mazeplan.btree.conditions import Conditions
from mazeplan.btree.ports import Key, Port, one_line, shown
from mazeplan.btree.script_values import ScriptError
from mazeplan.btree.status import FINISHED, INVALID, RESULTS, RUNNING, SKIPPED, Result
from mazeplan.core.errors import TreeError


@dataclass(frozen=True)
class Place:
    """The place of a node: file, line, and path in the tree."""

    file: Path
    line: int
    path: str


class Probe(Protocol):
    """Watches the ticks of a node and may change their results."""

    def before(self, node: TreeNode) -> Result | None:
        """Called before a node is ticked. Returns a result that replaces the tick, or None."""
        ...

    def after(self, node: TreeNode, result: Result) -> Result | None:
        """Called after a node was ticked. Returns another result, or None."""
        ...


class Waker:
    """Asks the tree to tick its root again in the same tick. A loop asks for it when it has more to do: before the loop
    goes on, reactive nodes above it check their conditions."""

    def __init__(self) -> None:
        self.asked = False

    def take(self) -> bool:
        """Whether another tick was asked for. Clears the request."""
        asked, self.asked = self.asked, False
        return asked


class TreeNode(Behaviour):
    """Base of all nodes. status: RUNNING, SUCCESS, FAILURE, or INVALID while idle; last: how its last tick ended,
    INVALID before the first one and after it was halted."""

    ports: ClassVar[dict[str, Port]] = {}
    category: ClassVar[str] = ""  # Action, Condition, Control or Decorator: the element of the explicit form
    place: Place | None = None
    conditions: Conditions | None = None
    probe: Probe | None = None
    waker: Waker | None = None
    last: Result = INVALID
    _board: Blackboard
    _values: dict[str, Any]
    _parent: ref[Behaviour] | None = None

    def __init__(self, name: str) -> None:
        super().__init__(name)
        self.iterator = iter(())  # py_trees' own one knows the node, which would be in a cycle of references

    @property
    def parent(self) -> Behaviour | None:
        """The node above; None for the root, and where the tree above is gone: a node does not keep it."""
        return None if self._parent is None else self._parent()

    @parent.setter
    def parent(self, above: Behaviour | None) -> None:  # pyright: ignore[reportIncompatibleVariableOverride]
        self._parent = None if above is None else ref(above)

    def get(self, port: str) -> Any:
        """The value of a port: literal, blackboard entry, or default. Raises TreeError, at the line of the node, where
        the entry is missing or not of the port's type, or the node has no such port."""
        if port not in self.ports:
            raise self.wrong(
                f"get: got {shown(port)}, expected one of {', '.join(self.ports) or 'its ports: it has none'}"
            )
        if port not in self._values:
            return self.ports[port].default
        value = self._values[port]
        if not isinstance(value, Key):
            return value
        try:
            found = self._board.get(value.name)
        except KeyError as missing:
            raise self.wrong(f"{port}: {missing.args[0]}") from None
        try:
            return self.ports[port].accept(found, getattr(self, "context", None))
        except (ValueError, OverflowError):
            expected = self.ports[port].expects(getattr(self, "context", None))
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

    @property
    def where(self) -> str:
        """File, line and path in the tree; its name if it stands in no file."""
        place = self.place
        return self.name if place is None else f"{place.file}:{place.line}: {place.path}"

    @property
    def result(self) -> Result:
        """How its last tick ended; see `last`."""
        return self.last

    def execute(self) -> Result:
        """One tick, unless the preconditions decide; then the postconditions, if it has ended."""
        conditions, probe = self.conditions, self.probe
        result = None if conditions is None else self._scripted(conditions.decide, self.status)
        if result is SKIPPED and self.status is RUNNING:
            self.halt_node()
        if result is None and probe is not None and self.status not in FINISHED:
            result = probe.before(self)
        if result is None:
            result = self.act()
        if conditions is not None and result in FINISHED:
            self._scripted(conditions.after, result)
        if probe is not None:
            result = probe.after(self, result) or result
        if isinstance(result, Status):
            self.status = result
        self.last = result
        return result

    def _scripted(self, method: Callable[..., Any], *arguments: Any) -> Any:
        try:
            return method(*arguments)
        except ScriptError as problem:
            raise self.wrong(str(problem)) from None

    def act(self) -> Result:
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

    # -- py_trees ---------------------------------------------------------------------------------------------------

    def tick(self) -> Iterator[Behaviour]:
        """py_trees: one tick."""
        self.execute()
        yield self

    def update(self) -> Status:
        """py_trees: wants one of every node; a tick goes by `execute`."""
        return self.status

    def stop(self, new_status: Status = INVALID) -> None:
        """py_trees: halted from outside."""
        self.reset()
        self.status = new_status


class Node(TreeNode):
    """Base of nodes with children. least, most: children allowed (None: any number)."""

    least: ClassVar[int] = 1
    most: ClassVar[int | None] = None
    fresh: bool = True  # whether this tick enters the node

    def __init__(
        self,
        name: str,
        children: Row[TreeNode],
        clock: Callable[[], float],
        blackboard: Blackboard,
        values: Mapping[str, Any],
    ) -> None:
        super().__init__(name)
        self.parts = tuple(children)
        self.children = list(children)
        for child in children:
            child.parent = self
        self.clock, self._board, self._values = clock, blackboard, dict(values)

    @classmethod
    def problem(cls, values: Mapping[str, Any], n: int) -> str | None:
        """What is wrong with these literals for n children, if anything; asked when a file is read."""
        return None

    def act(self) -> Result:
        """One tick, children first."""
        self.fresh = self.status is not RUNNING
        self.status = RUNNING
        try:
            result = self.run()
        except (Exception, SystemExit) as problem:
            ended = blame(problem, self.where, "node")
            if ended is problem:
                raise
            raise ended from None
        if result not in RESULTS:
            what = f"{type(self).__name__}.run returned {shown(result)}"
            raise self.wrong(f"{what}, expected RUNNING, SUCCESS, FAILURE or SKIPPED")
        return result

    def run(self) -> Result:
        """One tick of the node: RUNNING, SUCCESS, FAILURE or SKIPPED. `tick_child` ticks a child; children that have
        finished are to be reset before the node finishes (`reset_children`)."""
        # a node without a run is a mistake in the program, as a leaf without a step is
        raise NotImplementedError(f"{type(self).__name__} has no run")

    def tick_child(self, index: int) -> Result:
        """Tick one child and return how that ended. Raises TreeError where there is none of that number."""
        try:
            child = self.parts[index]
        except (IndexError, TypeError):
            n = len(self.parts)
            expected = f"a number from 0 to {n - 1}" if n > 1 else "0"
            children = "one child" if n == 1 else f"{n} children"
            what = f"tick_child of {type(self).__name__}: got {shown(index)}, expected {expected}"
            raise self.wrong(f"{what}: it has {children}") from None
        return child.execute()

    def reset_children(self, start: int = 0) -> None:
        """Make the children idle, from `start` on; those that run are halted."""
        for child in self.parts[start:]:
            child.reset()

    def on_halt(self) -> None:
        """Halted: so are its children. A node that keeps a place or a count forgets it here."""
        self.reset_children()

    def pause(self) -> Result:
        """RUNNING, and the tree goes on in the same tick; only for a node that has a `waker`."""
        if self.waker is not None:
            self.waker.asked = True
        return RUNNING


class Control(Node):
    """Base of the control nodes, also of a user's own: `run` does one tick, `on_halt` forgets what it keeps."""

    category: ClassVar[str] = "Control"
