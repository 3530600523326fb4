"""The base of all leaves: ports with types, and the calls start, step and halt.

`start` is called when the leaf is entered, `step` at each tick until it returns SUCCESS or FAILURE, `halt` once if the
leaf is interrupted in between. A leaf that fails gives the reason with `fail`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, ClassVar, Protocol

from mazeplan.btree.blackboard import Blackboard
from mazeplan.btree.blame import CommandError
from mazeplan.btree.node import TreeNode
from mazeplan.btree.ports import shown
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
