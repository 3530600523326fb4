"""Nodes with children, with the semantics of BehaviorTree.CPP 4, as py_trees behaviours: their base and the controls;
the decorators are in `decorators`.

py_trees' own composites differ where it matters here (retries cost a tick each, timers read the wall clock), so the
nodes are written on its `Behaviour`, with children in `children`. A child that has finished counts as idle: it starts
anew when ticked again.

| node | ticks | result |
|---|---|---|
| Sequence | from the child that is running | FAILURE of a child: fails, starts over next time |
| SequenceWithMemory | the same, but after FAILURE or a halt it resumes at the child it was at | |
| ReactiveSequence | always from the first child | RUNNING of a child: later ones are halted |
| Fallback, ReactiveFallback | the same with SUCCESS and FAILURE exchanged | |
| Parallel | all that have not finished | success_count successes, failure_count failures; -1: all, -2: all but 1 |
| RetryUntilSuccessful | its child up to num_attempts times, within the tick; -1: without end, one attempt a tick | |
| Repeat | its child num_cycles times, within the tick; -1: without end, one a tick | |
| Timeout | FAILURE msec after its start, in rig time; the child is halted; 0: no limit | |
| Delay | its child delay_msec after its start | |
| Inverter, ForceSuccess, ForceFailure, KeepRunningUntilFailure | | |
| SubTree | its one child, on a blackboard of its own | |

A child whose preconditions skip it (`conditions`) is SKIPPED: neither success nor failure, and idle, so that they are
looked at again when it is ticked again.

| node | child SKIPPED |
|---|---|
| Sequence, Fallback with their other forms | the next one is ticked; all skipped since it was entered: SKIPPED |
| Parallel | asked again at the next tick; counts as success for a negative success_count; all at once: SKIPPED |
| RetryUntilSuccessful, Repeat | SKIPPED at once; the count neither grows nor is reset, if it is ticked again |
| Timeout, Delay, Inverter, ForceSuccess, ForceFailure, SubTree | SKIPPED; a delay that is over stays over |
| KeepRunningUntilFailure | RUNNING |
| none: the root | the tree ends with SKIPPED, which is not success; ticked again, it is asked again |

One thing differs from what BehaviorTree.CPP 4 does, for it is at odds with its own rule that a node is skipped if all
its children are: its Parallel succeeds then if success_count is negative.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from collections.abc import Sequence as Row
from typing import Any, ClassVar

from py_trees.common import Status

from mazeplan.behavior.blackboard import Blackboard
from mazeplan.behavior.leaf import Port, TreeNode
from mazeplan.behavior.status import FAILURE, FINISHED, INVALID, RUNNING, SKIPPED, SUCCESS, Result


class Node(TreeNode):
    """Base of nodes with children. `most`: children allowed (None: any number from 1); `stays`: whether it goes on from
    where it was after it was skipped because its child was."""

    most: ClassVar[int | None] = None
    stays: ClassVar[bool] = False

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
        self._entered = False

    @classmethod
    def problem(cls, values: Mapping[str, Any], n: int) -> str | None:
        """What is wrong with these literals for n children, if anything; asked when a file is read."""
        return None

    def act(self) -> Result:
        """One tick, children first; when it has finished, no child runs."""
        if not self._entered:
            self.enter()
        result = self.run()
        self._entered = result is RUNNING or (result is SKIPPED and self.stays)
        if result in FINISHED:
            self.reset_children()
        return result

    def enter(self) -> None:
        """Called when the node is entered."""

    def run(self) -> Result:
        """One tick of the node."""
        # a node without a run is a mistake in the program, as a leaf without a step is
        raise NotImplementedError(f"{type(self).__name__} has no run")

    def tick_child(self, index: int) -> Result:
        """Tick one child and return what it ended with."""
        child = self.parts[index]
        for _ in child.tick():
            pass
        return child.result

    def reset_children(self, start: int = 0) -> None:
        """Make the children idle, from `start` on; those that run are halted."""
        for child in self.parts[start:]:
            if child.status is RUNNING or child.skipped:
                child.reset()

    def reset(self) -> None:
        """Idle from now on, and so are its children."""
        if self.status is RUNNING:
            self.stop(INVALID)
        elif self._entered or self.skipped:
            self._entered = False
            self.reset_children()

    def stop(self, new_status: Status = INVALID) -> None:
        """py_trees: halted from outside."""
        self.reset_children()
        self._entered = self.skipped = False
        self.status = new_status


class _Ordered(Node):
    """Sequence and Fallback: `go_on` is the result of a child after which the next one is ticked, as it is after one
    that was skipped."""

    go_on: ClassVar[Status] = SUCCESS
    remember_stop: ClassVar[bool] = False

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self._current = self._skips = 0

    def enter(self) -> None:
        """From the first child, but for the node with memory; an exception may have left another place."""
        self._skips = 0
        if not self.remember_stop:
            self._current = 0

    def run(self) -> Result:
        """Tick children in order, from the one that is running."""
        n = len(self.parts)
        while self._current < n:
            result = self.tick_child(self._current)
            if result is RUNNING:
                return RUNNING
            if result is SKIPPED:
                self._skips += 1
            elif result is not self.go_on:
                if not self.remember_stop:
                    self._current = 0
                return result
            self._current += 1
        self._current = 0
        if self._skips < n:
            return self.go_on
        self.reset_children()
        return SKIPPED

    def stop(self, new_status: Status = INVALID) -> None:
        """Halting forgets the place, but for the node with memory."""
        if not self.remember_stop:
            self._current = 0
        super().stop(new_status)


class Sequence(_Ordered):
    """All children in order until one fails."""


class SequenceWithMemory(_Ordered):
    """All children in order; after a failure it resumes at the child that failed."""

    remember_stop: ClassVar[bool] = True


class Fallback(_Ordered):
    """Children in order until one succeeds."""

    go_on: ClassVar[Status] = FAILURE


class _Reactive(Node):
    go_on: ClassVar[Status] = SUCCESS

    def run(self) -> Result:
        """Tick from the first child; halt the later ones when an earlier one stops the row."""
        skips = 0
        for i, child in enumerate(self.parts):
            result = self.tick_child(i)
            if result is SKIPPED:
                skips += 1
                child.reset()
            elif result is not self.go_on:
                self.reset_children(i + 1)
                return result
        return SKIPPED if skips == len(self.parts) else self.go_on


class ReactiveSequence(_Reactive):
    """All children from the first at every tick, until one fails or runs."""


class ReactiveFallback(_Reactive):
    """Children from the first at every tick, until one succeeds or runs."""

    go_on: ClassVar[Status] = FAILURE


class Parallel(Node):
    """All children side by side."""

    ports: ClassVar[dict[str, Port]] = {
        "success_count": Port(int, -1, "successes that make it succeed; -1: all, -2: all but one, ..."),
        "failure_count": Port(int, 1, "failures that make it fail; -1: all, -2: all but one, ..."),
    }

    @classmethod
    def problem(cls, values: Mapping[str, Any], n: int) -> str | None:
        """A threshold that so few children cannot reach."""
        for port, value in values.items():
            if isinstance(value, int) and value > n:
                return f"{port}: got {value}, expected at most its number of children, {n}"
        return None

    def enter(self) -> None:
        """No child has finished."""
        self._done: dict[int, Result] = {}

    def run(self) -> Result:
        """Tick the children that have not finished, until enough of them have."""
        n, skips = len(self.parts), 0
        needed, allowed = self._threshold("success_count"), self._threshold("failure_count")
        relative = self.get("success_count") < 0
        for i in range(n):
            if i not in self._done:
                result = self.tick_child(i)
                if result is SKIPPED:
                    skips += 1
                elif result is not RUNNING:
                    self._done[i] = result
            successes = sum(result is SUCCESS for result in self._done.values())
            failures = len(self._done) - successes
            if successes >= needed or (relative and skips < n and successes + skips >= needed):
                return SUCCESS
            if failures >= allowed or n - failures < needed:
                return FAILURE
        return SKIPPED if skips == n else RUNNING

    def _threshold(self, port: str) -> int:
        """A number of children; a negative one counts from the end, as an index does: -1 is n, -2 is n - 1."""
        threshold, n = self.get(port), len(self.parts)
        if threshold > n:
            raise self.wrong(f"{port}: got {threshold}, expected at most its number of children, {n}")
        return threshold if threshold >= 0 else max(n + threshold + 1, 0)


CONTROLS: dict[str, type[Node]] = {
    kind.__name__: kind
    for kind in (Sequence, SequenceWithMemory, Fallback, ReactiveSequence, ReactiveFallback, Parallel)
}
