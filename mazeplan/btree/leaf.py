"""The base of all leaves: ports with types, and the calls start, step and halt.

`start` is called when the leaf is entered, `step` at each tick until it returns SUCCESS or FAILURE, `halt` once if the
leaf is interrupted in between. A leaf that fails gives the reason with `fail`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, ClassVar, Protocol, TypeVar

from py_trees.common import Status

from mazeplan.btree.blackboard import Blackboard
from mazeplan.btree.blame import CommandError, blame
from mazeplan.btree.node import TreeNode
from mazeplan.btree.ports import shown
from mazeplan.btree.status import FINISHED, RUNNING, Result

Returned = TypeVar("Returned")


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
        super().__init__(name)
        self.context = context
        self._board, self._values = blackboard, dict(values)
        self._running = False

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

    def act(self) -> Result:
        """One tick: entered unless it runs, then a step."""
        if self.status is not RUNNING:
            self._running = True
            self.blamed(self.start)
        status = self.blamed(self.step)
        self._running = status not in FINISHED
        return self.checked(status, "step")

    def on_halt(self) -> None:
        """Interrupted: `halt`, once."""
        if self._running:
            self._running = False
            self.blamed(self.halt)

    @property
    def interrupted(self) -> bool:
        """Whether it was entered and neither finished nor was halted, as after an exception."""
        return self._running

    def blamed(self, method: Callable[[], Returned]) -> Returned:
        """Call a method of the leaf; what it raises names the leaf. Raises TreeError for a command that cannot go out;
        anything else keeps its type and gets a note."""
        try:
            return method()
        except CommandError as problem:
            raise self.wrong(str(problem)) from None
        except (Exception, SystemExit) as problem:
            ended = blame(problem, self.where)
            if ended is problem:
                raise
            raise ended from None

    def checked(self, status: Any, method: str) -> Status:
        """What a method returned. Raises TreeError where that is no status."""
        if status is not Status.RUNNING and status not in FINISHED:
            what = f"{type(self).__name__}.{method} returned {shown(status)}"
            raise self.wrong(f"{what}, expected RUNNING, SUCCESS or FAILURE")
        return status
