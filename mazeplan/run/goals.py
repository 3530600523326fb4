"""Requests to a run while it goes on: another goal, close or open an opening, stop.

Any thread may make a request. The run reads the requests once a tick, after the observation and before the tree, so
that they already affect the command of that tick. The run logs an event for each request; a replay repeats the request
from this event.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from pathlib import Path
from threading import Lock
from typing import Protocol

from mazeplan.core.errors import InputError, SettingsError
from mazeplan.core.events import GoalChanged, OpeningClosed, OpeningReopened, Request, StopRequested, TimedEvent
from mazeplan.core.name_hints import one_of
from mazeplan.maze.geometry import Maze
from mazeplan.maze.mapfile import load_map
from mazeplan.run.resolve import ring_number


class Requests(Protocol):
    """What a run reads at each tick."""

    def take(self, t: float) -> Sequence[Request]:
        """The requests since the last call; t: rig time of this tick, s."""
        ...

    def over(self) -> bool:
        """Whether the run may end now; False while another goal waits. After True no request is accepted."""
        ...


class Goals:
    """A mailbox for requests to a run. Make it for a map, pass it to `navigate(..., goals=goals)`, call it from any
    thread.

    Each method returns False once the run is over, else True. Requests may be made before the run begins: the run reads
    them at its first tick, and of several goals it takes only the last. A mailbox may serve one run after another.
    Each method checks its rings and openings: for an unknown one it raises SettingsError and makes no request. Several
    balls go to the centre only; before a run, the number of balls is the map's."""

    def __init__(self, map: str | Path | Maze = "cme") -> None:
        self._maze = map if isinstance(map, Maze) else load_map(map)
        self._balls = self._maze.balls  # of the run, once it has begun
        self._lock = Lock()
        self._waiting: list[Request] = []
        self._running, self._ended = False, False
        self._read = False  # at the first tick of the run

    def aim(self, ring: int | str, closed: Collection[str] = ()) -> bool:
        """Go to another ring from where the ball is. It takes effect within one tick, whatever the tree does now.

        Closed openings stay closed, and those in `closed` are closed as well. An accepted goal is never lost: if the
        run arrives at the old goal meanwhile, it goes on to the new one."""
        try:
            number = ring_number(ring, self._maze)
        except InputError as problem:
            raise SettingsError(problem.problem, key="goal") from None
        if isinstance(closed, str):
            raise SettingsError(f"got {closed!r}, expected a list of names", key="closed")
        return self._add(GoalChanged(number, tuple(self._opening(name) for name in closed)))

    def close(self, opening: str) -> bool:
        """Do not use an opening any more in this run."""
        return self._add(OpeningClosed(self._opening(opening)))

    def open(self, opening: str) -> bool:
        """Use an opening again, also one that the map or the command closes."""
        return self._add(OpeningReopened(self._opening(opening)))

    def stop(self) -> bool:
        """End the run at its next tick, with the plate level and the reason `stopped`."""
        return self._add(StopRequested())

    def _opening(self, name: str) -> str:
        known = [opening.name for opening in self._maze.openings]
        if name not in known:
            raise SettingsError(f"got {name!r}, expected {one_of(known, name)}", key="opening")
        return name

    def _add(self, request: Request) -> bool:
        with self._lock:
            if self._ended:
                return False
            self._check_goal(request, self._balls)
            self._waiting.append(request)
            return True

    def _check_goal(self, request: Request, balls: int) -> None:
        """Raises SettingsError for a goal to which this number of balls cannot go."""
        if isinstance(request, GoalChanged) and balls > 1 and not self._maze.ring(request.ring).is_disc:
            centre = f"expected ring{len(self._maze.rings)}: {balls} balls go to the centre"
            raise SettingsError(f"got ring{request.ring}, {centre}", key="goal")

    # -- the run's side ---------------------------------------------------------------------------------------------

    def begin(self, maze: Maze) -> None:
        """A run begins to read the mailbox.

        Raises SettingsError if another run reads it, if the run's map has other rings or openings, or if a goal waits
        to which the balls of the run cannot go."""
        own, other = ([*(r.number for r in m.rings), *(o.name for o in m.openings)] for m in (self._maze, maze))
        if own != other:
            problem = f"made for the map {self._maze.name}, expected the one of the run, {maze.name}"
            raise SettingsError(problem, key="goals")
        with self._lock:
            if self._running:
                raise SettingsError("another run reads them", key="goals")
            for request in self._waiting:
                self._check_goal(request, maze.balls)
            self._balls = maze.balls
            self._running, self._ended, self._read = True, False, False

    def take(self, t: float) -> Sequence[Request]:
        """All requests that wait. A `stop` among them closes the mailbox."""
        if not self._waiting:  # the usual tick takes no lock
            self._read = True
            return ()
        with self._lock:
            taken, self._waiting = self._waiting if self._read else _last_goal(self._waiting), []
            self._read = True
            self._ended = self._ended or StopRequested() in taken
        return taken

    def over(self) -> bool:
        """Whether no goal waits. If so, the call also closes the mailbox, under one lock: no goal comes in between."""
        with self._lock:
            if any(isinstance(request, GoalChanged) for request in self._waiting):
                return False
            self._end()
            return True

    def end(self) -> None:
        """The run is over, however it ended."""
        with self._lock:
            self._end()

    def _end(self) -> None:
        self._waiting, self._running, self._ended = [], False, True


def _last_goal(requests: Sequence[Request]) -> list[Request]:
    """The requests with only the last goal; the openings that an earlier goal closes stay closed."""
    last = max((i for i, request in enumerate(requests) if isinstance(request, GoalChanged)), default=-1)
    left: list[Request] = []
    for i, request in enumerate(requests):
        if isinstance(request, GoalChanged) and i < last:
            left += [OpeningClosed(name) for name in request.closed]
        else:
            left.append(request)
    return left


class RecordedRequests:
    """Repeats the requests of a recorded run at the same ticks; see `Requests`.

    events: of the log. Raises ValueError if a request names a ring or an opening that the maze does not have."""

    def __init__(self, events: Iterable[TimedEvent], maze: Maze) -> None:
        self._left: list[tuple[float, Request]] = []
        mailbox = Goals(maze)
        for timed in events:
            request = timed.event
            if timed.kind in ("goal", "closed", "opened", "stopped") and not isinstance(request, Request):
                raise ValueError(f"event {timed.kind}: got {timed.detail}")
            if not isinstance(request, Request):
                continue
            try:  # the same checks as in the recorded run
                if isinstance(request, GoalChanged):
                    mailbox.aim(request.ring, request.closed)
                elif isinstance(request, OpeningClosed | OpeningReopened):
                    mailbox.close(request.opening)
            except SettingsError as problem:
                raise ValueError(str(problem)) from None
            self._left.append((timed.t, request))

    def take(self, t: float) -> Sequence[Request]:
        """The requests of this tick."""
        taken = []
        while self._left and self._left[0][0] <= t:
            taken.append(self._left.pop(0)[1])
        return taken

    def over(self) -> bool:
        """Whether no goal is left. A goal that is left was waiting when the recorded run arrived."""
        return not any(isinstance(request, GoalChanged) for _, request in self._left)
