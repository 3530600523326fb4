"""What a leaf is: ports with types, and a life of start, step, halt.

`start` is called when the leaf is entered, `step` at each tick until it returns SUCCESS or FAILURE, `halt` once if it
is interrupted in between. A leaf that fails says why with `fail`. One that needs a moment when the run ends around it
has a `wind_down` (see `winding`).
"""

from __future__ import annotations

import math
import traceback
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from numbers import Integral, Real
from pathlib import Path
from typing import Any, ClassVar, Protocol, TypeVar

from py_trees.behaviour import Behaviour
from py_trees.common import Status

from mazeplan.behavior.blackboard import Blackboard
from mazeplan.behavior.conditions import Conditions
from mazeplan.behavior.expression import ExpressionError
from mazeplan.behavior.status import FINISHED, INVALID, RUNNING, SKIPPED, Result
from mazeplan.errors import MazeplanError, RigError, TreeError
from mazeplan.records import Failure

Returned = TypeVar("Returned")


class _Required:
    def __repr__(self) -> str:
        return "REQUIRED"


REQUIRED = _Required()


class CommandError(Exception):
    """A command that cannot go out; the leaf that gives it makes it a TreeError at its own line."""


BLAME = "raised by the leaf at "


def blames_a_leaf(problem: BaseException) -> bool:
    """Whether an exception came out of a leaf, which then stands in it by file and line."""
    return isinstance(problem, TreeError) or any(n.startswith(BLAME) for n in getattr(problem, "__notes__", ()))


def fault(problem: BaseException) -> str:
    """What came out of a leaf, in a line: what, and which leaf."""
    told = str(problem) if isinstance(problem, MazeplanError) else f"{type(problem).__name__}: {problem}"
    return " ".join(", ".join((told, *getattr(problem, "__notes__", ()))).split())


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


def _number(kind: type) -> Any:
    def convert(text: str) -> Any:
        if "_" in text:  # Python's own notation, which no other reader of the format knows
            raise ValueError(text)
        return kind(text)

    return convert


CONVERSIONS: dict[type, Any] = {int: _number(int), float: _number(float), str: str, bool: _boolean, list: _words}
INSTANCES: dict[type, Any] = {int: Integral, float: Real, bool: bool, list: list | tuple}  # str: any object at all


OF_THE_MAP = ("openings", "rings")


@dataclass(frozen=True)
class Port:
    """A typed input or output of a node. direction: in, out, or inout; an output takes a {key} only. least, most: the
    smallest and the largest number allowed; no number may be infinite. choices: the values allowed, of a list those of
    its words, of which it needs one at least; "openings" or "rings": those of the run's map. A port of type str without
    choices also carries objects, such as a plan, by {key}."""

    type: type
    default: Any = REQUIRED
    doc: str = ""
    direction: str = "in"
    least: float | None = None
    most: float | None = None
    choices: tuple[Any, ...] | str | None = None

    @property
    def expected(self) -> str:
        """What is allowed on any map, for an error."""
        return self.expects()

    def expects(self, context: Any = None) -> str:
        """What is allowed in a run with this context, for an error."""
        allowed = self.allowed(context)
        if allowed is not None:
            several = "one or more, separated by ;, of " if self.type is list else "one of "
            return several + (", ".join(map(str, allowed)) or f"the map's {self.choices}, of which it has none")
        bounds = ((">=", self.least), ("<=", self.most))
        said = " and ".join(f"{sign} {bound:g}" for sign, bound in bounds if bound is not None)
        return " ".join(filter(None, (self.type.__name__, said))) + (", finite" if self.type is float else "")

    def allowed(self, context: Any = None) -> tuple[Any, ...] | None:
        """The values to choose from; None: any, or nobody knows without a map."""
        if not isinstance(self.choices, str):
            return self.choices
        maze = getattr(context, "maze", None)
        if maze is None:
            return None
        return (
            tuple(o.name for o in maze.openings) if self.choices == "openings" else tuple(r.number for r in maze.rings)
        )

    def parse(self, text: str, context: Any = None) -> Any:
        """A literal from a file. Raises ValueError."""
        return self._bounded(CONVERSIONS[self.type](text), context)

    def accept(self, value: Any, context: Any = None) -> Any:
        """A value from the blackboard; text becomes what the port takes, as a literal would. Raises ValueError."""
        if self.type is str or type(value) is self.type:
            return self._bounded(value, context)
        if isinstance(value, str):
            return self.parse(value, context)
        if not isinstance(value, INSTANCES[self.type]) or (isinstance(value, bool) and self.type is not bool):
            raise ValueError(value)
        return self._bounded(value, context)

    def takes(self, default: Any) -> bool:
        """Whether `get` may return this where nothing is given: it is of the type itself, as no text is read."""
        if self.type is not str and isinstance(default, str):
            return False
        try:
            self.accept(default)
        except ValueError:
            return False
        return True

    def _bounded(self, value: Any, context: Any) -> Any:
        if isinstance(value, float) and not math.isfinite(value):
            raise ValueError(value)
        if (self.least is not None and value < self.least) or (self.most is not None and value > self.most):
            raise ValueError(value)
        if self.choices is not None:
            allowed = self.allowed(context)
            words: Any = value if self.type is list else (value,)
            if allowed is not None and not (words and all(word in allowed for word in words)):
                raise ValueError(value)
        return value


@dataclass(frozen=True)
class Key:
    """A reference {name} to the blackboard."""

    name: str


def shown(value: Any, most: int = 60) -> str:
    """A value for an error: its repr, cut where it is long."""
    text = repr(value)
    return text if len(text) <= most else f"{text[: most - 3]}..."


@dataclass(frozen=True)
class Place:
    """Where a node stands: file, line, path in the tree."""

    file: Path
    line: int
    path: str


class TreeNode(Behaviour):
    """What leaves and nodes with children share: ports given as literal or {key}, preconditions, a place in a file."""

    ports: ClassVar[dict[str, Port]] = {}
    place: Place | None = None
    conditions: Conditions | None = None
    skipped: bool = False
    _board: Blackboard
    _values: dict[str, Any]

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
            raise self.wrong(f"{port}: got {shown(found)} from {{{value.name}}}, expected {expected}") from None

    def wrong(self, problem: str) -> TreeError:
        """The error that names this node."""
        if self.place is None:
            return TreeError(problem, key=self.name)
        return TreeError(problem, file=self.place.file, line=self.place.line, key=self.place.path)

    @property
    def result(self) -> Result:
        """What its last tick ended with; INVALID before the first one, and after it was halted."""
        return SKIPPED if self.skipped else self.status

    def tick(self) -> Iterator[Behaviour]:
        """py_trees: one tick, unless the preconditions decide. Written out because py_trees' own takes twice the time,
        for its debug log."""
        decided = None if self.conditions is None else self._decided(self.conditions)
        if decided is None:
            result = self.act()
        else:
            result = decided
            self.reset()
        self.skipped = result is SKIPPED
        self.status = result if isinstance(result, Status) else INVALID
        yield self

    def _decided(self, conditions: Conditions) -> Result | None:
        try:
            return conditions.decide(self.status is RUNNING)
        except ExpressionError as problem:
            raise self.wrong(str(problem)) from None

    def act(self) -> Result:
        """One tick of the node itself."""
        # a node without an act is a mistake in the program: nothing sensible could be done at run time
        raise NotImplementedError(f"{type(self).__name__} has no act")

    def update(self) -> Status:
        """py_trees: wants one of every node; a tick goes by `act`."""
        return self.status

    def reset(self) -> None:
        """Idle from now on: what runs is halted, and what was kept because a child was skipped is forgotten; how the
        last tick ended can still be read."""
        if self.status is RUNNING:
            self.stop(INVALID)

    def stop(self, new_status: Status = INVALID) -> None:
        """py_trees: halted from outside."""
        self.skipped = False
        super().stop(new_status)


class Leaf(TreeNode):
    """Base of all leaves. `values`: {port: literal or Key} of the ports given in the tree; `category`: Action, or
    Condition for one that answers at once and changes nothing."""

    category: ClassVar[str] = "Action"
    wind_down_ticks: ClassVar[int] = 15  # most calls of wind_down; half a second at 30 Hz

    def __init__(self, name: str, context: Any, blackboard: Blackboard, values: Mapping[str, Any]) -> None:
        super().__init__(name)
        self.context = context
        self._board, self._values = blackboard, dict(values)
        self._running = False

    def set(self, port: str, value: Any) -> None:
        """Write an output, or an input that is a key; nothing happens where the tree gave none."""
        target = self._values.get(port)
        if isinstance(target, Key):
            self._board.set(target.name, value)

    def start(self) -> None:
        """Called when the leaf is entered."""

    def step(self) -> Status:
        """Called at each tick: RUNNING, SUCCESS or FAILURE, at once."""
        # a leaf without a step is a mistake in the program: nothing sensible could be done at run time
        raise NotImplementedError(f"{type(self).__name__} has no step")

    def halt(self) -> None:
        """Called once when the leaf is interrupted while running. It commands nothing: another leaf does."""

    def wind_down(self) -> Status:
        """Called at each tick after `halt`, if the run was stopped or its time was over while this leaf ran: RUNNING
        for one more tick, of `wind_down_ticks` at most. It may command, but the plate goes level meanwhile: no command
        tilts it more than the last one, nor more than what is left of the ticks. Not called where the tree goes on, or
        a new goal takes over: there the next leaf commands in the same tick."""
        return Status.SUCCESS

    def fail(self, failure: Failure) -> Status:
        """Leave a reason and return FAILURE. Raises TreeError where it is none."""
        if not isinstance(failure, Failure):
            raise self.wrong(f"fail: got {shown(failure)}, expected a Failure; fail_as(kind, detail) makes one")
        self.context.failed(failure)
        return Status.FAILURE

    # -- py_trees ---------------------------------------------------------------------------------------------------

    def act(self) -> Result:
        """One tick: entered if it was idle, then a step."""
        if self.status is not RUNNING:
            self.blamed(self.initialise)
        return self.blamed(self.update)

    def blamed(self, method: Callable[[], Returned]) -> Returned:
        """Call a method of the leaf; what it raises names the leaf. Raises TreeError for a command that cannot go out;
        anything else keeps its type and gets a note."""
        try:
            return method()
        except CommandError as problem:
            raise self.wrong(str(problem)) from None
        except RigError:  # the rig's, or the watchdog's, that interrupts whatever goes on
            raise
        except SystemExit as problem:
            if type(problem) is not SystemExit:  # that of a signal, wherever it comes
                raise
            ended = RuntimeError(f"sys.exit({problem.code!r}) in a leaf, which ends no run")
            self._blame(ended, problem)
            raise ended from None
        except Exception as problem:
            if not blames_a_leaf(problem):
                self._blame(problem, problem)
            raise

    def _blame(self, problem: Exception, raised: BaseException) -> None:
        """Note on a problem where in the tree and in the code something was raised."""
        place = self.place
        where = self.name if place is None else f"{place.file}:{place.line}: {place.path}"
        code = traceback.extract_tb(raised.__traceback__)[-1]  # which the way to another process does not keep
        problem.add_note(f"{BLAME}{where} ({Path(code.filename).name}:{code.lineno})")

    def initialise(self) -> None:
        """py_trees: entered."""
        self._running = True
        self.start()

    def update(self) -> Status:
        """py_trees: ticked. Raises TreeError where `step` returned anything but a status."""
        status = self.step()
        self._running = status not in FINISHED
        return self.checked(status, "step")

    def checked(self, status: Any, method: str) -> Status:
        """What a method returned. Raises TreeError where that is no status."""
        if status is not Status.RUNNING and status not in FINISHED:
            what = f"{type(self).__name__}.{method} returned {shown(status)}"
            raise self.wrong(f"{what}, expected RUNNING, SUCCESS or FAILURE")
        return status

    def terminate(self, new_status: Status) -> None:
        """py_trees: left; may be called more than once for one interruption."""
        if new_status is Status.INVALID and self._running:
            self._running = False
            self.blamed(self.halt)
