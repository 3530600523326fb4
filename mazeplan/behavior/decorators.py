"""Decorators: nodes with one child. What they do stands in the tables of `nodes`."""

from __future__ import annotations

from typing import ClassVar

from py_trees.common import Status

from mazeplan.behavior.leaf import REQUIRED, Port
from mazeplan.behavior.nodes import Node
from mazeplan.behavior.status import FAILURE, FINISHED, RUNNING, SKIPPED, SUCCESS, Result


class _Decorator(Node):
    most: ClassVar[int | None] = 1


class _Loop(_Decorator):
    """Ticks its child again while it returns `again`, at most so many times."""

    again: ClassVar[Status] = FAILURE
    limit: ClassVar[str] = "num_attempts"
    reread: ClassVar[bool] = True  # the limit, after each round: the child may have changed it
    stays: ClassVar[bool] = True  # a skipped child does not reset the count

    def enter(self) -> None:
        """Count from 0."""
        self._count = 0

    def run(self) -> Result:
        """Loop within the tick; without end, at most one round a tick, or it would never return."""
        limit = self.get(self.limit)
        while limit < 0 or self._count < limit:
            result = self.tick_child(0)
            if result is SKIPPED:
                self.reset_children()
            if result is not self.again:
                return result
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

    def run(self) -> Result:
        """The child's status, until the time is over."""
        limit = self.get("msec")
        if limit > 0 and 1e3 * (self.clock() - self._began) >= limit - 1e-6:
            return FAILURE
        return self.tick_child(0)


class Delay(_Decorator):
    """Its child after a while, in rig time."""

    stays: ClassVar[bool] = True  # once the time is over, it is
    ports: ClassVar[dict[str, Port]] = {"delay_msec": Port(int, REQUIRED, "delay in ms", least=0)}

    def enter(self) -> None:
        """Start the clock."""
        self._began = self.clock()

    def run(self) -> Result:
        """RUNNING until the time is over, then the child's status."""
        if 1e3 * (self.clock() - self._began) < self.get("delay_msec") - 1e-6:
            return RUNNING
        return self.tick_child(0)


class Inverter(_Decorator):
    """SUCCESS and FAILURE exchanged."""

    def run(self) -> Result:
        """The opposite; RUNNING and SKIPPED as they are."""
        result = self.tick_child(0)
        return FAILURE if result is SUCCESS else SUCCESS if result is FAILURE else result


class ForceSuccess(_Decorator):
    """SUCCESS whatever its child returns."""

    def run(self) -> Result:
        """SUCCESS when its child has finished."""
        result = self.tick_child(0)
        return SUCCESS if result in FINISHED else result


class ForceFailure(_Decorator):
    """FAILURE whatever its child returns."""

    def run(self) -> Result:
        """FAILURE when its child has finished."""
        result = self.tick_child(0)
        return FAILURE if result in FINISHED else result


class KeepRunningUntilFailure(_Decorator):
    """RUNNING until its child fails."""

    def run(self) -> Result:
        """RUNNING or FAILURE."""
        return FAILURE if self.tick_child(0) is FAILURE else RUNNING


class SubTree(_Decorator):
    """Another tree of the file, on a blackboard scope of its own."""

    def run(self) -> Result:
        """The status of the tree."""
        return self.tick_child(0)


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
