"""Control nodes, which have several children, with the semantics of BehaviorTree.CPP 4. docs/trees.md has their table.

A child that has finished is idle again when its parent has finished. If its preconditions skip a child, its result is
SKIPPED: neither success nor failure. A node is SKIPPED itself if all its children were skipped.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

from mazeplan.btree.choices import SWITCHES, IfThenElse, ManualSelector, WhileDoElse
from mazeplan.btree.node import Control, Node
from mazeplan.btree.ports import Port
from mazeplan.btree.status import FAILURE, FINISHED, INVALID, RUNNING, SKIPPED, SUCCESS, Status


class _Ordered(Control):
    """Children in order. go_on: the result of a child after which the next one is ticked, as it is after SKIPPED;
    remembers: whether it resumes at the child that stopped it; pauses: whether reactive nodes above look at their
    conditions between two children."""

    go_on: ClassVar[Status] = SUCCESS
    remembers: ClassVar[bool] = False
    pauses: ClassVar[bool] = False

    def _forget(self) -> None:
        self._current = self._skips = 0

    def run(self) -> Status:
        if self.fresh:
            self._skips = 0
        n = len(self.parts)
        while self._current < n:
            idle = self.parts[self._current].status is INVALID
            result = self.tick_child(self._current)
            if result is RUNNING:
                return RUNNING
            if result is SKIPPED:
                self._skips += 1
            elif result is not self.go_on:
                if not self.remembers:
                    return self.finish(result)
                for child in self.parts[self._current :]:
                    child.reset()
                return result
            self._current += 1
            if self.pauses and idle and result is not SKIPPED and self._current < n and self.waker is not None:
                self.waker.asked = True
                return RUNNING
        return self.finish(SKIPPED if self._skips == n else self.go_on)


class Sequence(_Ordered):
    """All children in order until one fails."""


class AsyncSequence(_Ordered):
    """A Sequence that pauses after each child: reactive nodes above it look at their conditions."""

    pauses: ClassVar[bool] = True


class SequenceWithMemory(_Ordered):
    """All children in order; after a failure or a halt it resumes at the child that it was at."""

    remembers: ClassVar[bool] = True
    pauses: ClassVar[bool] = True

    def on_halt(self) -> None:
        """Halted: so are its children; the place stays."""
        self.reset_children()


class Fallback(_Ordered):
    """Children in order until one succeeds."""

    go_on: ClassVar[Status] = FAILURE


class AsyncFallback(_Ordered):
    """A Fallback that pauses after each child: reactive nodes above it look at their conditions."""

    go_on: ClassVar[Status] = FAILURE
    pauses: ClassVar[bool] = True


class _Reactive(Control):
    """Children from the first at every tick; a child that runs halts all others."""

    go_on: ClassVar[Status] = SUCCESS

    def run(self) -> Status:
        skips = 0
        for i, child in enumerate(self.parts):
            result = self.tick_child(i)
            if result is RUNNING:
                for other in self.parts:
                    if other is not child:
                        other.reset()
                return RUNNING
            if result is SKIPPED:
                skips += 1
                child.reset()
            elif result is not self.go_on:
                return self.finish(result)
        return self.finish(SKIPPED if skips == len(self.parts) else self.go_on)


class ReactiveSequence(_Reactive):
    """All children from the first at every tick, until one fails or runs."""


class ReactiveFallback(_Reactive):
    """Children from the first at every tick, until one succeeds or runs."""

    go_on: ClassVar[Status] = FAILURE


class _SideBySide(Control):
    """Children that are ticked side by side; those that have finished wait for the others."""

    def _forget(self) -> None:
        self._done: dict[int, Status] = {}

    @classmethod
    def problem(cls, values: Mapping[str, Any], n: int) -> str | None:
        high = [(port, value) for port, value in values.items() if isinstance(value, int) and value > n]
        return "; ".join(f"{port}: got {v}, expected at most its number of children, {n}" for port, v in high) or None

    def threshold(self, port: str) -> int:
        """A number of children; a negative one counts from the end, as an index does: -1 is n, -2 is n - 1."""
        threshold, n = self.get(port), len(self.parts)
        if threshold > n:
            raise self.wrong(f"{port}: got {threshold}, expected at most its number of children, {n}")
        return threshold if threshold >= 0 else max(n + threshold + 1, 0)

    def tick_open(self, index: int) -> Status | None:
        if index in self._done:
            return None
        result = self.tick_child(index)
        if result in FINISHED:
            self._done[index] = result
        return result

    def count(self, result: Status) -> int:
        return sum(done is result for done in self._done.values())


class Parallel(_SideBySide):
    """All children side by side until enough of them have succeeded or failed."""

    ports: ClassVar[dict[str, Port]] = {
        "success_count": Port(int, -1, "successes that make it succeed; -1: all, -2: all but one, ..."),
        "failure_count": Port(int, 1, "failures that make it fail; -1: all, -2: all but one, ..."),
    }

    def run(self) -> Status:
        """Tick the children that have not finished, until enough of them have. With a negative success_count a child
        that is skipped counts as a success."""
        n, skips = len(self.parts), 0
        needed, allowed = self.threshold("success_count"), self.threshold("failure_count")
        relative = self.get("success_count") < 0
        for i in range(n):
            skips += self.tick_open(i) is SKIPPED
            successes, failures = self.count(SUCCESS), self.count(FAILURE)
            if successes + (skips if relative else 0) >= needed:
                return self.finish(SUCCESS)
            if failures >= allowed or n - failures < needed:
                return self.finish(FAILURE)
        return SKIPPED if skips == n else RUNNING


class ParallelAll(_SideBySide):
    """All children side by side until all have finished."""

    ports: ClassVar[dict[str, Port]] = {
        "max_failures": Port(int, 1, "failures that make it fail; -1: all, -2: all but one, ...")
    }

    def run(self) -> Status:
        """Tick the children that have not finished; the result when all of them have, or are skipped."""
        n, allowed = len(self.parts), self.threshold("max_failures")
        skips = sum(self.tick_open(i) is SKIPPED for i in range(n))
        if skips == n:
            return SKIPPED
        if skips + len(self._done) < n:
            return RUNNING
        return self.finish(FAILURE if self.count(FAILURE) >= allowed else SUCCESS)


class TryCatch(Control):
    """All children but the last in order, as a Sequence; the last one cleans up when one of them fails."""

    least: ClassVar[int] = 2
    ports: ClassVar[dict[str, Port]] = {
        "catch_on_halt": Port(bool, False, "whether the last child is ticked, once, when the node is halted, too")
    }

    def _forget(self) -> None:
        self._current, self._skips, self._catching = 0, 0, False

    def run(self) -> Status:
        """SUCCESS when all have succeeded; FAILURE when the last child has ended after a failure."""
        if self.fresh:
            self._skips, self._catching = 0, False
        last = len(self.parts) - 1
        while not self._catching and self._current < last:
            result = self.tick_child(self._current)
            if result is RUNNING:
                return RUNNING
            if result is FAILURE:
                self.reset_children()
                self._current, self._catching = 0, True
                break
            self._skips += result is SKIPPED
            self._current += 1
        if self._catching:
            if self.tick_child(last) is RUNNING:
                return RUNNING
            result = FAILURE
        else:
            result = SKIPPED if self._skips == last else SUCCESS
        return self.finish(result)

    def on_halt(self) -> None:
        """With catch_on_halt the last child gets one tick, unless it is running already."""
        if self.get("catch_on_halt") and not self._catching:
            self._catching = True  # once, whatever its tick raises
            for child in self.parts[:-1]:
                child.reset()
            self.tick_child(len(self.parts) - 1)
        super().on_halt()


ORDERED = (Sequence, AsyncSequence, SequenceWithMemory, ReactiveSequence, Fallback, AsyncFallback, ReactiveFallback)
OTHERS = (Parallel, ParallelAll, IfThenElse, WhileDoElse, *SWITCHES, TryCatch, ManualSelector)
CONTROLS: dict[str, type[Node]] = {kind.__name__: kind for kind in (*ORDERED, *OTHERS)}
