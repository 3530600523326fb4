"""Decorators: nodes with one child, with the semantics of BehaviorTree.CPP 4. docs/trees.md has their table."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from typing import Any, ClassVar

from mazeplan.btree.node import Node
from mazeplan.btree.ports import REQUIRED, Key, Port
from mazeplan.btree.script import parse_script
from mazeplan.btree.script_values import ScriptError
from mazeplan.btree.status import FAILURE, FINISHED, INVALID, RUNNING, SKIPPED, SUCCESS, Status

RESULTS = ("SUCCESS", "FAILURE", "RUNNING", "SKIPPED")


class Decorator(Node):
    """Base of the decorators, also of a user's own: `run` does one tick, `on_halt` forgets what it keeps."""

    category: ClassVar[str] = "Decorator"
    most: ClassVar[int | None] = 1

    def execute(self) -> Status:
        """One tick; a child that has finished is idle after it."""
        result = super().execute()
        if self.parts[0].status in FINISHED:
            self.parts[0].status = INVALID
        return result


class _Loop(Decorator):
    """Ticks its child again while it returns `again`, at most so many times."""

    again: ClassVar[Status] = FAILURE
    limit: ClassVar[str] = "num_attempts"
    reread: ClassVar[bool] = True  # the limit, after each round: the child may have changed it

    def _forget(self) -> None:
        self._count = 0

    def run(self) -> Status:
        """Loop within the tick, reactive nodes above looking at their conditions after each round; without end, one
        round a tick, or it would never return. A skipped child does not reset the count."""
        limit, child = self.get(self.limit), self.parts[0]
        while limit < 0 or self._count < limit:
            idle = child.status is INVALID
            result = self.tick_child(0)
            if result is RUNNING:
                return RUNNING
            child.reset()
            if result is SKIPPED:
                return SKIPPED
            if result is not self.again:
                return self.finish(result)
            self._count += 1
            if self.reread:
                limit = self.get(self.limit)
            if limit < 0 and idle:
                return RUNNING
            if idle and self._count < limit and self.waker is not None:
                self.waker.asked = True
                return RUNNING
        return self.finish(self.again)  # the child may run: the limit has changed


class RetryUntilSuccessful(_Loop):
    """Its child again while it fails."""

    ports: ClassVar[dict[str, Port]] = {"num_attempts": Port(int, REQUIRED, "attempts; -1: without end", least=-1)}


class Repeat(_Loop):
    """Its child again while it succeeds."""

    ports: ClassVar[dict[str, Port]] = {"num_cycles": Port(int, REQUIRED, "repetitions; -1: without end", least=-1)}
    again: ClassVar[Status] = SUCCESS
    limit: ClassVar[str] = "num_cycles"
    reread: ClassVar[bool] = False


class _Timed(Decorator):
    """Keeps the rig time of its start until its child has finished."""

    def _forget(self) -> None:
        self._began: float | None = None

    def started(self) -> float:
        now = self.clock()
        if self._began is None:
            self._began = now
        return 1e3 * (now - self._began) + 1e-6


class Timeout(_Timed):
    """FAILURE when its child takes too long, in rig time."""

    ports: ClassVar[dict[str, Port]] = {"msec": Port(int, REQUIRED, "limit in ms; 0: none", least=0)}

    def run(self) -> Status:
        """The child's result, until the time is over."""
        limit, since = self.get("msec"), self.started()
        if 0 < limit <= since and self.parts[0].status is RUNNING:
            return self.finish(FAILURE)
        result = self.tick_child(0)
        return result if result is RUNNING else self.finish(result)


class Delay(_Timed):
    """Its child after a while, in rig time."""

    ports: ClassVar[dict[str, Port]] = {"delay_msec": Port(int, REQUIRED, "delay in ms", least=0)}

    def run(self) -> Status:
        """RUNNING until the time is over, then the child's result."""
        if self.started() < self.get("delay_msec"):
            return RUNNING
        result = self.tick_child(0)
        return self.finish(result) if result in FINISHED else result


class _Changed(Decorator):
    """Its child, whose results are replaced by others."""

    instead: ClassVar[dict[Status, Status]] = {}

    def run(self) -> Status:
        result = self.tick_child(0)
        return self.instead.get(result, result)


class Inverter(_Changed):
    """SUCCESS and FAILURE exchanged."""

    instead: ClassVar[dict[Status, Status]] = {SUCCESS: FAILURE, FAILURE: SUCCESS}


class ForceSuccess(_Changed):
    """SUCCESS whatever its child returns."""

    instead: ClassVar[dict[Status, Status]] = {FAILURE: SUCCESS}


class ForceFailure(_Changed):
    """FAILURE whatever its child returns."""

    instead: ClassVar[dict[Status, Status]] = {SUCCESS: FAILURE}


class KeepRunningUntilFailure(_Changed):
    """RUNNING until its child fails."""

    instead: ClassVar[dict[Status, Status]] = {SUCCESS: RUNNING, SKIPPED: RUNNING}


class RunOnce(Decorator):
    """Its child once in a run of the tree."""

    ports: ClassVar[dict[str, Port]] = {
        "then_skip": Port(bool, True, "whether it is skipped afterwards; otherwise it returns the same result again")
    }
    _ended: Status | None = None

    def act(self) -> Status:
        """One tick; it does not run where its child is not ticked."""
        if self._ended is not None:
            return SKIPPED if self.get("then_skip") else self._ended
        return super().act()

    def run(self) -> Status:
        """The child's result, which is kept."""
        result = self.tick_child(0)
        self._ended = result if result in FINISHED else None
        return result


class Precondition(Decorator):
    """Its child if a script is true; while the child runs, the script is not asked again."""

    ports: ClassVar[dict[str, Port]] = {
        "if": Port(str, REQUIRED, "script that is true where the child may be ticked"),
        "else": Port(str, "FAILURE", "the result where it is not", choices=RESULTS),
    }

    def _forget(self) -> None:
        self._inside = False

    def act(self) -> Status:
        """One tick; it runs only while its child does."""
        return self.run()

    def run(self) -> Status:
        """The child's result, or that of `else`."""
        try:
            self._inside = self._inside or parse_script(self.get("if")).holds(self._board)
        except ScriptError as problem:
            raise self.wrong(f"if: {problem}") from None
        if not self._inside:
            return Status(self.get("else"))
        result = self.tick_child(0)
        return self.finish(result) if result in FINISHED else result


class _Queue(Decorator):
    """Its child once for each value of a queue, one a tick. item: a value as a port; words: its kind"""

    item: ClassVar[Port] = Port(str)
    words: ClassVar[str] = "words"

    def _forget(self) -> None:
        self._queue: deque[Any] | None = None
        self._busy = False

    @classmethod
    def problem(cls, values: Mapping[str, Any], n: int) -> str | None:
        try:
            cls._values_of(values.get("queue", ""))
        except ValueError as problem:
            return f"queue: {problem}"
        return None

    @classmethod
    def _values_of(cls, queue: Any) -> deque[Any]:
        """The values of a list or of text in a queue of their own. Raises ValueError."""
        found = deque[Any]()
        if not isinstance(queue, list | tuple):
            queue = str(queue).split(";") if isinstance(queue, str) and queue else ()
        for one in queue:
            word = one.strip() if isinstance(one, str) and cls.item.type is not str else one
            try:
                found.append(cls.item.parse(word) if isinstance(word, str) else word)
            except ValueError:
                raise ValueError(f"got {one!r}, expected {cls.words}, separated by ;") from None
        return found

    def act(self) -> Status:
        if self.status is not RUNNING:  # it runs once it has a value
            self._forget()
        return self.run()

    def run(self) -> Status:
        if not self._busy:
            queue = self._source()
            if not queue:
                return Status(self.get("if_empty"))
            self.set("value", queue.popleft())
        self.status = RUNNING
        result = self.tick_child(0)
        self._busy = result is RUNNING
        return FAILURE if result is FAILURE else RUNNING

    def _source(self) -> deque[Any]:
        """The queue: a deque on the blackboard is emptied in place; text and lists are copied when it is entered."""
        value = self._values["queue"]
        if isinstance(value, Key):
            value = self._board.get(value.name) if value.name in self._board else ()
            if isinstance(value, deque):
                return value
        if self._queue is None:
            try:
                self._queue = self._values_of(value if isinstance(value, list | tuple) else str(value))
            except ValueError as problem:
                raise self.wrong(f"queue: {problem}") from None
        return self._queue


def _loop(name: str, kind: type, words: str) -> type[_Queue]:
    ports = {
        "queue": Port(str, REQUIRED, f"{words}, separated by ;, or a {{key}} with a list of them"),
        "value": Port(kind, None, "the value of this round", "out"),
        "if_empty": Port(str, "SUCCESS", "the result when no value is left", choices=RESULTS),
    }

    doc = f"Its child once for each value of a queue of {words}, one a tick."
    return type(name, (_Queue,), {"ports": ports, "item": Port(kind), "words": words, "__doc__": doc})


class _Updated(Decorator):
    """Its child only where an entry of the blackboard was set since the last time."""

    otherwise: ClassVar[Status] = SKIPPED
    ports: ClassVar[dict[str, Port]] = {"entry": Port(str, REQUIRED, "the {key}, or its name")}
    _seen = 0

    def _forget(self) -> None:
        self._busy = False

    def act(self) -> Status:
        return self.run()  # it runs only while its child does

    def run(self) -> Status:
        if not self._busy:
            key = self._values["entry"]
            entry = self._board.find(key.name if isinstance(key, Key) else str(key))
            before, self._seen = self._seen, self._seen if entry is None else entry.changes
            if entry is None or before == entry.changes:
                return self.otherwise
        result = self.tick_child(0)
        self._busy = result is RUNNING
        return result


class SkipUnlessUpdated(_Updated):
    """Its child where an entry was set since the last time, else SKIPPED."""


class WaitValueUpdate(_Updated):
    """Its child where an entry was set since the last time, else RUNNING."""

    otherwise: ClassVar[Status] = RUNNING


class SubTree(Decorator):
    """Another tree of the file, on a blackboard scope of its own. by_model: ports whose value is a default of its
    model."""

    by_model: frozenset[str] = frozenset()

    def run(self) -> Status:
        """The result of the tree."""
        return self.tick_child(0)


RESULTS_CHANGED = (Inverter, ForceSuccess, ForceFailure, KeepRunningUntilFailure)
QUEUES = (
    _loop("LoopInt", int, "whole numbers"),
    _loop("LoopDouble", float, "numbers"),
    _loop("LoopString", str, "words"),
    _loop("LoopBool", bool, "true or false"),
)
ALL = (RetryUntilSuccessful, Repeat, Timeout, Delay, *RESULTS_CHANGED, RunOnce, Precondition, *QUEUES)
DECORATORS: dict[str, type[Node]] = {kind.__name__: kind for kind in (*ALL, SkipUnlessUpdated, WaitValueUpdate)}
