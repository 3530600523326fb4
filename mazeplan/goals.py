"""What a run is told from outside while it goes on: another goal, an opening closed or opened, stop.

Any thread may call. The run looks once a tick, after the observation and before its tree, so that what was said rules
the command of that very tick; and it writes an event for each thing said, from which a replay says it again.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from threading import Lock
from typing import Any, Protocol

from mazeplan.choices import ring_number
from mazeplan.errors import InputError, SettingsError
from mazeplan.maze.geometry import Maze
from mazeplan.maze.mapfile import load_map


@dataclass(frozen=True, slots=True)
class Aim:
    """Go to another ring from now on, with these openings closed as well."""

    ring: int
    closed: tuple[str, ...] = ()

    @property
    def event(self) -> tuple[str, dict[str, Any]]:
        """Kind and detail for the log."""
        return "goal", {"ring": self.ring, "closed": list(self.closed)}


@dataclass(frozen=True, slots=True)
class Edit:
    """Use an opening no more, or again."""

    opening: str
    closed: bool

    @property
    def event(self) -> tuple[str, dict[str, Any]]:
        """Kind and detail for the log."""
        return "closed" if self.closed else "opened", {"opening": self.opening}


@dataclass(frozen=True, slots=True)
class Stop:
    """Level the plate and end."""

    @property
    def event(self) -> tuple[str, dict[str, Any]]:
        """Kind and detail for the log."""
        return "stopped", {}


Message = Aim | Edit | Stop
SAID = ("goal", "closed", "opened", "stopped")  # kinds of their events


class Outside(Protocol):
    """What a run asks at each tick."""

    def take(self, t: float) -> Sequence[Message]:
        """What was said since it was asked last; t: rig time of this tick, s."""
        ...

    def over(self) -> bool:
        """Whether the run may end now: not while another goal waits. After True nothing is said any more."""
        ...


class Goals:
    """A mailbox: made for a map, handed to `navigate(..., goals=goals)`, called from any thread.

    Each method returns whether somebody still reads: False once the run is over. What is said before the run begins is
    read at its first tick; of several goals only the last is. A mailbox may be handed to one run after another. Rings
    and openings are checked in the call: it raises SettingsError, and nothing was said."""

    def __init__(self, map: str | Path | Maze = "cme") -> None:
        self._maze = map if isinstance(map, Maze) else load_map(map)
        self._lock = Lock()
        self._waiting: list[Message] = []
        self._running, self._ended = False, False
        self._read = False  # at the first tick of the run

    def aim(self, ring: int | str, closed: Collection[str] = ()) -> bool:
        """Go to another ring from where the ball is, within one tick, whatever the tree does now. Openings that are
        closed stay so, and those in `closed` are closed as well. A goal that was taken in is never lost: a run that
        arrives meanwhile goes on to it."""
        try:
            number = ring_number(ring, self._maze)
        except InputError as problem:
            raise SettingsError(problem.problem, key="goal") from None
        if isinstance(closed, str):
            raise SettingsError(f"got {closed!r}, expected a list of names", key="closed")
        return self._say(Aim(number, tuple(self._opening(name) for name in closed)))

    def close(self, opening: str) -> bool:
        """Use an opening no more, in this run."""
        return self._say(Edit(self._opening(opening), True))

    def open(self, opening: str) -> bool:
        """Use an opening again, also one that the map or the command calls closed."""
        return self._say(Edit(self._opening(opening), False))

    def stop(self) -> bool:
        """End the run at its next tick, with the plate level and the reason `stopped`."""
        return self._say(Stop())

    def _opening(self, name: str) -> str:
        known = [opening.name for opening in self._maze.openings]
        if name not in known:
            raise SettingsError(f"got {name!r}, expected one of {', '.join(known)}", key="opening")
        return name

    def _say(self, message: Message) -> bool:
        with self._lock:
            if not self._ended:
                self._waiting.append(message)
            return not self._ended

    # -- the run's side ---------------------------------------------------------------------------------------------

    def begin(self, maze: Maze) -> None:
        """A run reads from now on. Raises SettingsError if another one does, or its map has other rings or openings."""
        own, other = ([*(r.number for r in m.rings), *(o.name for o in m.openings)] for m in (self._maze, maze))
        if own != other:
            problem = f"made for the map {self._maze.name}, expected the one of the run, {maze.name}"
            raise SettingsError(problem, key="goals")
        with self._lock:
            if self._running:
                raise SettingsError("another run reads them", key="goals")
            self._running, self._ended, self._read = True, False, False

    def take(self, t: float) -> Sequence[Message]:
        """All that waits; after `stop` nobody reads any more."""
        if not self._waiting:  # the usual tick takes no lock
            self._read = True
            return ()
        with self._lock:
            taken, self._waiting = self._waiting if self._read else _last_goal(self._waiting), []
            self._read = True
            self._ended = self._ended or Stop() in taken
        return taken

    def over(self) -> bool:
        """Whether no other goal waits; then nobody reads any more, in one step, so that none comes in between."""
        with self._lock:
            if any(isinstance(message, Aim) for message in self._waiting):
                return False
            self._end()
            return True

    def end(self) -> None:
        """The run is over, however it ended."""
        with self._lock:
            self._end()

    def _end(self) -> None:
        self._waiting, self._running, self._ended = [], False, True


def _last_goal(said: Sequence[Message]) -> list[Message]:
    """Without goals that another one follows; openings that were closed with one stay closed."""
    last = max((i for i, message in enumerate(said) if isinstance(message, Aim)), default=-1)
    left: list[Message] = []
    for i, message in enumerate(said):
        if isinstance(message, Aim) and i < last:
            left += [Edit(name, True) for name in message.closed]
        else:
            left.append(message)
    return left


class Retold:
    """What was said in a run that was logged, said again at the same ticks. events: of the log. Raises KeyError,
    TypeError or ValueError where one is none, or names a ring or an opening that the maze has not."""

    def __init__(self, events: Iterable[dict[str, Any]], maze: Maze) -> None:
        self._left = [(float(e["t"]), _said(e["kind"], e["detail"])) for e in events if e["kind"] in SAID]
        mailbox = Goals(maze)
        for _, said in self._left:  # checked as then
            try:
                if isinstance(said, Aim):
                    mailbox.aim(said.ring, said.closed)
                elif isinstance(said, Edit):
                    mailbox.close(said.opening)
            except SettingsError as problem:
                raise ValueError(str(problem)) from None

    def take(self, t: float) -> Sequence[Message]:
        """What was said at this tick."""
        taken = []
        while self._left and self._left[0][0] <= t:
            taken.append(self._left.pop(0)[1])
        return taken

    def over(self) -> bool:
        """Whether no goal is to come: one that is was waiting when the run arrived."""
        return not any(isinstance(said, Aim) for _, said in self._left)


def _said(kind: str, detail: dict[str, Any]) -> Message:
    makers: dict[str, Callable[[], Message]] = {
        "goal": lambda: Aim(int(detail["ring"]), tuple(detail["closed"])),
        "closed": lambda: Edit(detail["opening"], True),
        "opened": lambda: Edit(detail["opening"], False),
        "stopped": Stop,
    }
    return makers[kind]()
