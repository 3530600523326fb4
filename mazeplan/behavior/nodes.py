"""Control and decorator nodes with the semantics of BehaviorTree.CPP 4, as py_trees behaviours.

py_trees' own composites differ where it matters here (retries cost a tick each, timers read the wall clock), so the
nodes are written on its `Behaviour`, with children in `children`. A child that has finished counts as idle: it starts
anew when ticked again.

| node | ticks | result |
|---|---|---|
| Sequence | from the child that is running | FAILURE of a child: fails, starts over next time |
| SequenceWithMemory | the same, but after FAILURE it resumes at the child that failed | |
| ReactiveSequence | always from the first child | RUNNING of a child: later ones are halted |
| Fallback, ReactiveFallback | the same with SUCCESS and FAILURE exchanged | |
| Parallel | all that have not finished | success_count successes, failure_count failures; -1: all, -2: all but 1 |
| RetryUntilSuccessful | its child up to num_attempts times, within the tick; -1: without end, one attempt a tick | |
| Repeat | its child num_cycles times, within the tick; -1: without end, one a tick | |
| Timeout | FAILURE msec after its start, in rig time; the child is halted; 0: no limit | |
| Delay | its child delay_msec after its start | |
| Inverter, ForceSuccess, ForceFailure, KeepRunningUntilFailure | | |
| SubTree | its one child, on a blackboard of its own | |
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any, ClassVar

from py_trees.behaviour import Behaviour
from py_trees.common import Status

from mazeplan.behavior.blackboard import Blackboard
from mazeplan.behavior.leaf import REQUIRED, Port, Ported

RUNNING, SUCCESS, FAILURE, INVALID = Status.RUNNING, Status.SUCCESS, Status.FAILURE, Status.INVALID


class Node(Ported, Behaviour):
    """Base of nodes with children. `most`: children allowed (None: any number from 1)."""

    most: ClassVar[int | None] = None

    def __init__(
        self,
        name: str,
        children: list[Behaviour],
        clock: Callable[[], float],
        blackboard: Blackboard,
        values: Mapping[str, Any],
    ) -> None:
        super().__init__(name)
        self.children = children
        for child in children:
            child.parent = self
        self.clock, self._board, self._values = clock, blackboard, dict(values)

    @classmethod
    def problem(cls, values: Mapping[str, Any], n: int) -> str | None:
        """What is wrong with these literals for n children, if anything; asked when a file is read."""
        return None

    def tick(self) -> Iterator[Behaviour]:
        """py_trees: one tick, children first."""
        if self.status is not RUNNING:
            self.enter()
        self.status = self.update()
        if self.status is not RUNNING:
            self.halt_children()
        yield self

    def enter(self) -> None:
        """Called when the node is entered."""

    def update(self) -> Status:
        """py_trees: the new status."""
        return self.run()

    def run(self) -> Status:
        """One tick of the node."""
        # a node without a run is a mistake in the program, as a leaf without a step is
        raise NotImplementedError(f"{type(self).__name__} has no run")

    def tick_child(self, index: int) -> Status:
        """Tick one child and return its status."""
        child = self.children[index]
        for _ in child.tick():
            pass
        return child.status

    def halt_children(self, start: int = 0) -> None:
        """Halt the children that are running, from `start` on."""
        for child in self.children[start:]:
            if child.status is RUNNING:
                child.stop(INVALID)

    def stop(self, new_status: Status = INVALID) -> None:
        """py_trees: halted from outside."""
        self.halt_children()
        self.status = new_status


class _Ordered(Node):
    """Sequence and Fallback: `go_on` is the result of a child after which the next one is ticked."""

    go_on: ClassVar[Status] = SUCCESS
    remember_stop: ClassVar[bool] = False

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self._current = 0

    def enter(self) -> None:
        """From the first child, but for the node with memory; an exception may have left another place."""
        if not self.remember_stop:
            self._current = 0

    def run(self) -> Status:
        """Tick children in order, from the one that is running."""
        while self._current < len(self.children):
            status = self.tick_child(self._current)
            if status is RUNNING:
                return RUNNING
            if status is not self.go_on:
                if not self.remember_stop:
                    self._current = 0
                return status
            self._current += 1
        self._current = 0
        return self.go_on

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

    def run(self) -> Status:
        """Tick from the first child; halt the later ones when an earlier one stops the row."""
        for i in range(len(self.children)):
            status = self.tick_child(i)
            if status is not self.go_on:
                self.halt_children(i + 1)
                return status
        return self.go_on


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
        self._done: dict[int, Status] = {}

    def run(self) -> Status:
        """Tick the children that have not finished, until enough of them have."""
        n = len(self.children)
        needed, allowed = (_from_end(self.get(port), n) for port in ("success_count", "failure_count"))
        for i in range(n):
            if i not in self._done:
                status = self.tick_child(i)
                if status is not RUNNING:
                    self._done[i] = status
            successes = sum(status is SUCCESS for status in self._done.values())
            failures = len(self._done) - successes
            if successes >= needed:
                return SUCCESS
            if failures >= allowed or n - failures < needed:
                return FAILURE
        return RUNNING


def _from_end(threshold: int, n: int) -> int:
    """A negative threshold counts from the end, as an index does: -1 is n, -2 is n - 1."""
    return threshold if threshold >= 0 else max(n + threshold + 1, 0)


class _Decorator(Node):
    most: ClassVar[int | None] = 1


class _Loop(_Decorator):
    """Ticks its child again while it returns `again`, at most so many times."""

    again: ClassVar[Status] = FAILURE
    limit: ClassVar[str] = "num_attempts"
    reread: ClassVar[bool] = True  # the limit, after each round: the child may have changed it

    def enter(self) -> None:
        """Count from 0."""
        self._count = 0

    def run(self) -> Status:
        """Loop within the tick; without end, at most one round a tick, or it would never return."""
        limit = self.get(self.limit)
        while limit < 0 or self._count < limit:
            status = self.tick_child(0)
            if status is not self.again:
                return status
            self._count += 1
            if limit < 0:
                return RUNNING
            if self.reread:
                limit = self.get(self.limit)
        return self.again


class RetryUntilSuccessful(_Loop):
    """Its child again while it fails."""

    ports: ClassVar[dict[str, Port]] = {"num_attempts": Port(int, REQUIRED, "attempts; -1: without end", least=-1)}


class Repeat(_Loop):
    """Its child again while it succeeds."""

    ports: ClassVar[dict[str, Port]] = {"num_cycles": Port(int, REQUIRED, "repetitions; -1: without end", least=-1)}
    again: ClassVar[Status] = SUCCESS
    limit: ClassVar[str] = "num_cycles"
    reread: ClassVar[bool] = False


class Timeout(_Decorator):
    """FAILURE when its child takes too long, in rig time."""

    ports: ClassVar[dict[str, Port]] = {"msec": Port(int, REQUIRED, "limit in ms; 0: none", least=0)}

    def enter(self) -> None:
        """Start the clock."""
        self._began = self.clock()

    def run(self) -> Status:
        """The child's status, until the time is over."""
        limit = self.get("msec")
        if limit > 0 and 1e3 * (self.clock() - self._began) >= limit - 1e-6:
            self.halt_children()
            return FAILURE
        return self.tick_child(0)


class Delay(_Decorator):
    """Its child after a while, in rig time."""

    ports: ClassVar[dict[str, Port]] = {"delay_msec": Port(int, REQUIRED, "delay in ms", least=0)}

    def enter(self) -> None:
        """Start the clock."""
        self._began = self.clock()

    def run(self) -> Status:
        """RUNNING until the time is over, then the child's status."""
        if 1e3 * (self.clock() - self._began) < self.get("delay_msec") - 1e-6:
            return RUNNING
        return self.tick_child(0)


class Inverter(_Decorator):
    """SUCCESS and FAILURE exchanged."""

    def run(self) -> Status:
        """The opposite."""
        return {SUCCESS: FAILURE, FAILURE: SUCCESS, RUNNING: RUNNING}[self.tick_child(0)]


class ForceSuccess(_Decorator):
    """SUCCESS whatever its child returns."""

    def run(self) -> Status:
        """RUNNING or SUCCESS."""
        return RUNNING if self.tick_child(0) is RUNNING else SUCCESS


class ForceFailure(_Decorator):
    """FAILURE whatever its child returns."""

    def run(self) -> Status:
        """RUNNING or FAILURE."""
        return RUNNING if self.tick_child(0) is RUNNING else FAILURE


class KeepRunningUntilFailure(_Decorator):
    """RUNNING until its child fails."""

    def run(self) -> Status:
        """RUNNING or FAILURE."""
        return FAILURE if self.tick_child(0) is FAILURE else RUNNING


class SubTree(_Decorator):
    """Another tree of the file, on a blackboard scope of its own."""

    def run(self) -> Status:
        """The status of the tree."""
        return self.tick_child(0)


CONTROLS: dict[str, type[Node]] = {
    kind.__name__: kind
    for kind in (Sequence, SequenceWithMemory, Fallback, ReactiveSequence, ReactiveFallback, Parallel)
}
DECORATORS: dict[str, type[Node]] = {
    kind.__name__: kind
    for kind in (
        RetryUntilSuccessful,
        Repeat,
        Timeout,
        Delay,
        Inverter,
        ForceSuccess,
        ForceFailure,
        KeepRunningUntilFailure,
    )
}
