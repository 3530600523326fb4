"""What a leaf is: ports with types, and a life of start, step, halt.

`start` is called when the leaf is entered, `step` at each tick until it returns SUCCESS or FAILURE, `halt` once if
it is
interrupted in between. A leaf that fails says why with `fail`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Protocol

from py_trees.behaviour import Behaviour
from py_trees.common import Status

from mazeplan.behavior.blackboard import Blackboard
from mazeplan.records import Failure


class _Required:
    def __repr__(self) -> str:
        return "REQUIRED"


REQUIRED = _Required()


class Context(Protocol):
    """What every leaf's context offers; maze leaves have more (`context.RunContext`)."""

    def clock(self) -> float:
        """Rig time, s."""
        ...

    def failed(self, failure: Failure) -> None:
        """Take note of a failure."""
        ...


def _boolean(text: str) -> bool:
    if text.lower() in ("true", "1"):
        return True
    if text.lower() in ("false", "0"):
        return False
    raise ValueError(text)


def _words(text: str) -> list[str]:
    return [word.strip() for word in text.split(";") if word.strip()]


CONVERSIONS: dict[type, Any] = {int: int, float: float, str: str, bool: _boolean, list: _words}


@dataclass(frozen=True)
class Port:
    """A typed input or output of a leaf. direction: in, out, or inout; an output takes a {key} only."""

    type: type
    default: Any = REQUIRED
    doc: str = ""
    direction: str = "in"

    def parse(self, text: str) -> Any:
        """A literal from a file. Raises ValueError."""
        value = CONVERSIONS[self.type](text)
        if isinstance(value, float) and value != value:  # NaN is equal to nothing
            raise ValueError(text)
        return value


@dataclass(frozen=True)
class Key:
    """A reference {name} to the blackboard."""

    name: str


class Leaf(Behaviour):
    """Base of all leaves. `values`: {port: literal or Key} of the ports given in the tree."""

    ports: ClassVar[dict[str, Port]] = {}

    def __init__(self, name: str, context: Any, blackboard: Blackboard, values: Mapping[str, Any]) -> None:
        super().__init__(name)
        self.context = context
        self._board, self._values = blackboard, dict(values)
        self._running = False

    def get(self, port: str) -> Any:
        """The value of an input: literal, blackboard entry, or default."""
        if port not in self._values:
            return self.ports[port].default
        value = self._values[port]
        return self._board.get(value.name) if isinstance(value, Key) else value

    def set(self, port: str, value: Any) -> None:
        """Write an output, or an input that is a key; nothing happens where the tree gave none."""
        target = self._values.get(port)
        if isinstance(target, Key):
            self._board.set(target.name, value)

    def start(self) -> None:
        """Called when the leaf is entered."""

    def step(self) -> Status:
        """Called at each tick: RUNNING, SUCCESS or FAILURE, at once."""
        raise NotImplementedError(f"{type(self).__name__} has no step")

    def halt(self) -> None:
        """Called once when the leaf is interrupted while running."""

    def fail(self, failure: Failure) -> Status:
        """Leave a reason and return FAILURE."""
        self.context.failed(failure)
        return Status.FAILURE

    # -- py_trees ---------------------------------------------------------------------------------------------------

    def initialise(self) -> None:
        """py_trees: entered."""
        self._running = True
        self.start()

    def update(self) -> Status:
        """py_trees: ticked."""
        status = self.step()
        self._running = status is Status.RUNNING
        return status

    def terminate(self, new_status: Status) -> None:
        """py_trees: left; may be called more than once for one interruption."""
        if new_status is Status.INVALID and self._running:
            self._running = False
            self.halt()
