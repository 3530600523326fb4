"""Requests to a run while it goes on: another goal, close or open an opening, stop.

Any thread may make a request. The run reads the requests once a tick, after the observation and before the tree, so
that they already affect the command of that tick. The run logs an event for each request; a replay repeats the request
from this event.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from pathlib import Path
from threading import RLock

from mazeplan.core.errors import InputError, SettingsError
from mazeplan.core.events import GoalChanged, OpeningClosed, OpeningReopened, Request, StopRequested, TimedEvent
from mazeplan.maze.geometry import Maze
from mazeplan.maze.mapfile import load_map
from mazeplan.run.resolve import opening_name, ring_number


class Goals:
    """A mailbox for requests to a run. Make it for a map, pass it to `navigate(..., goals=goals)`, call it from any
    thread.

    Each method returns False once the run is over, else True. Requests may be made before the run begins: the run reads
    them at its first tick. A mailbox may serve one run after another. Each method checks its rings and openings: for an
    unknown one it raises InputError and makes no request. Several balls go to the centre only; before a run, the
    number of balls is the map's."""

    def __init__(self, map: str | Path | Maze = "cme") -> None:
        self._maze = map if isinstance(map, Maze) else load_map(map)
        self._balls = self._maze.balls  # of the run, once it has begun
        self._lock = RLock()  # `over` calls `end`
        self._waiting: list[Request] = []
        self._running = False
        self._ended = False

    def aim(self, ring: int | str, closed: Collection[str] = ()) -> bool:
        """Go to another ring from where the ball is. It takes effect within one tick, whatever the tree does now.

        Closed openings stay closed, and those in `closed` are closed as well. An accepted goal is never lost: if the
        run arrives at the old goal meanwhile, it goes on to the new one."""
        return self._add(GoalChanged(ring_number(ring, self._maze, "goal"), tuple(closed)))

    def close(self, opening: str) -> bool:
        """Do not use an opening any more in this run."""
        return self._add(OpeningClosed(opening))

    def open(self, opening: str) -> bool:
        """Use an opening again, also one that the map or the command closes."""
        return self._add(OpeningReopened(opening))

    def stop(self) -> bool:
        """End the run at its next tick, with the plate level and the reason `stopped`."""
        return self._add(StopRequested())

    def _add(self, request: Request) -> bool:
        with self._lock:
            if not self._ended:
                self.check(request)
                self._waiting.append(request)
            return not self._ended

    def check(self, request: Request) -> None:
        """Raises InputError for a ring or opening that the map does not have, and for a goal to which several balls
        cannot go."""
        names: Collection[str] = ()
        if isinstance(request, GoalChanged):
            names, ring = request.closed, ring_number(request.ring, self._maze, "goal")
            if self._balls > 1 and not self._maze.ring(ring).is_disc:
                centre = f"expected ring{len(self._maze.rings)}: {self._balls} balls go to the centre"
                raise SettingsError(f"got ring{ring}, {centre}", key="goal")
        elif isinstance(request, OpeningClosed | OpeningReopened):
            names = (request.opening,)
        for name in names:
            opening_name(name, self._maze)

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
            self._balls = maze.balls
            for request in self._waiting:
                self.check(request)
            self._running = True
            self._ended = False

    def take(self, t: float) -> Sequence[Request]:
        """All requests that wait, at the rig time t, s. A `stop` among them closes the mailbox."""
        if not self._waiting:  # the usual tick takes no lock
            return ()
        with self._lock:
            taken, self._waiting = self._waiting, []
            self._ended = self._ended or StopRequested() in taken
        return taken

    def over(self) -> bool:
        """Whether no goal waits. If so, the call also closes the mailbox, under one lock: no goal comes in between."""
        with self._lock:
            if any(isinstance(request, GoalChanged) for request in self._waiting):
                return False
            self.end()
            return True

    def end(self) -> None:
        """The run is over, however it ended."""
        with self._lock:
            self._waiting = []
            self._running = False
            self._ended = True


class RecordedRequests:
    """Repeats the requests of a recorded run at the same ticks, as `Goals` gave them.

    events: of the log. Raises ValueError if a request names a ring or an opening that the maze does not have."""

    def __init__(self, events: Iterable[TimedEvent], maze: Maze) -> None:
        self._left: list[tuple[float, Request]] = []
        mailbox = Goals(maze)
        for timed in events:
            request = timed.event
            if timed.kind in ("goal", "closed", "opened", "stopped") and not isinstance(request, Request):
                raise ValueError(f"event {timed.kind}: got {timed.detail}")
            if isinstance(request, Request):
                try:
                    mailbox.check(request)
                except InputError as problem:
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


Requests = Goals | RecordedRequests  # what a run reads at each tick
