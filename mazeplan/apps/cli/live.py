"""The live page and its runs. A run is in the main thread; orders of the page arrive in another thread.

An order acts on the present run through `Goals` and `PacedRig.level_now`, which accept calls at any time."""

from __future__ import annotations

import sys
import threading
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from time import monotonic
from typing import TYPE_CHECKING, Any

from mazeplan.apps.cli.navigate import navigate_once
from mazeplan.apps.cli.output import free_name, print_json, say
from mazeplan.core.errors import InputError, MazeplanError
from mazeplan.core.records import NavigationResult
from mazeplan.maze.geometry import Maze
from mazeplan.rigs.faults.faulty import FaultyRig, unsupported_faults
from mazeplan.rigs.faults.kinds import KINDS
from mazeplan.rigs.faults.schedule import at_once
from mazeplan.rigs.interface import Rig, traits
from mazeplan.rigs.paced import PacedRig
from mazeplan.rigs.registry import make_rig, rig_label
from mazeplan.rigs.watchdog import watched
from mazeplan.run.goals import Goals
from mazeplan.run.request import Company, NavigationRequest

if TYPE_CHECKING:
    from mazeplan.apps.view.link import PageLink

FIRST_S = 10.0  # s; maximum time that the first run waits for a viewer
GRACE_S = 3.0  # s without a viewer before the page closes; a reload takes less
LOOK_S = 0.05  # s between looks at orders and viewers
READING = "reading map, model and tree; loading the compiled planner, the first time half a minute"
NOT_OFFERED = "observe_hangs"  # no watchdog ends a hanging simulation


class LiveSession:
    """A page and its runs.

    once: does one run; gets its number and further arguments of `mazeplan.navigate`
    begin: whether to start the first run at once
    stay: whether the page stays open without a viewer when a run is over"""

    def __init__(self, maze: Maze, rig: str, once: Callable[..., NavigationResult], *, begin: bool, stay: bool) -> None:
        self._maze, self._rig, self._once, self._begin, self._stay = maze, rig, once, begin, stay
        machine = make_rig(rig, maze)
        self._kinds: dict[str, str] = {}  # what each fault does that the page offers
        if traits(machine).inject is not None:
            never = {NOT_OFFERED, *unsupported_faults(machine)}
            self._kinds = {kind.name: kind.what for kind in KINDS.values() if kind.name not in never}
        self._goals = Goals(maze)
        self._started = threading.Event()
        self._machine: Any = None
        self._faulty: FaultyRig | None = None
        self._opening: str | None = None
        self._count, self._injected, self._phase = 0, 0, "idle"
        self._page: PageLink | None = None
        self.result: NavigationResult | None = None
        self.problem: MazeplanError | None = None

    def serve(self, port: int) -> None:
        """Serve the page until Ctrl-C, or until the last viewer has left. Raises InputError without a page."""
        from mazeplan.apps.view.server import check_installed, listen, url_of

        check_installed()
        from mazeplan.apps.view.link import Offer, PageLink

        listening = listen(port)
        url = url_of(listening)
        offer = Offer(self._maze, rig_label(self._rig), self._kinds)
        with PageLink(offer, listening, self._order) as self._page:
            listening.close()
            try:
                say(f"page: {url}")
                if self._begin:
                    self._tell("starting", "the run begins with the first viewer")
                    self._page.opened.wait(FIRST_S)
                    self._run()
                while self._asked(self._page):
                    self._run()
            except KeyboardInterrupt:  # Ctrl-C without a run closes the page
                if not self._resting:
                    raise

    # -- runs -------------------------------------------------------------------------------------------------------

    def _asked(self, page: PageLink) -> bool:
        """Wait for an order to start a run; returns False when the page closes."""
        problem = self.problem
        self._tell("idle" if problem is None else "failed", "Start begins a run" if problem is None else str(problem))
        left_at = monotonic()
        while not self._started.wait(LOOK_S):
            if page.ended.is_set():
                return False
            if page.viewers or self._stay:
                left_at = monotonic()
            elif monotonic() - left_at > GRACE_S:
                return False
        return True

    def _run(self) -> None:
        self._started.clear()
        self._tell("starting", READING)
        number = self._count
        self._count += 1
        try:
            self.result, self.problem = None, None
            self.result = self._once(number, goals=self._goals, feed=self._take, around=self._around)
        except MazeplanError as problem:
            self.problem = problem
            self.result = getattr(problem, "result", None)
            if isinstance(problem, InputError) and number == 0 and self._begin:
                raise
            say(f"mazeplan: {problem}")
        finally:
            self._machine = self._faulty = None
            self._goals = Goals(self._maze)

    def _tell(self, phase: str, note: str = "") -> None:
        self._phase = phase
        if self._page is not None:
            self._page.tell(phase, note)

    def _take(self, topic: str, t: float, document: dict[str, Any]) -> None:
        if topic == "/tick":
            self._opening = document.get("opening")
            if self._phase == "starting":
                self._tell("running")
        if self._page is not None:
            self._page.take(topic, t, document)

    def _around(self, rig: Rig) -> Rig:
        """Pace a simulation by wall-clock time, and make it ready for faults. The page levels what this returns."""
        own = traits(rig)
        if not own.realtime:
            if own.inject is not None:
                rig = self._faulty = FaultyRig(rig, self._maze, (), self._goals.close)
                rig.aimed_at = lambda: self._opening
            rig = PacedRig(rig)
        self._machine = machine = watched(rig, own_process=True)
        return machine

    # -- orders -----------------------------------------------------------------------------------------------------

    def _order(self, order: dict[str, Any]) -> None:
        """Carry out an order of the page, and show the answer on the page."""
        try:
            answer = self._do(str(order.get("do")), order)
        except MazeplanError as problem:
            answer = str(problem)
        if answer:
            self._tell(self._phase, answer)

    @property
    def _resting(self) -> bool:
        """Whether no run is in progress or starting."""
        return self._phase not in ("starting", "running")

    def _do(self, what: str, order: dict[str, Any]) -> str:
        machine = self._machine
        if what == "level":
            return self._level_now(machine)
        if what == "start" and self._resting:
            self._tell("starting", READING)  # at once, because the main thread notices the order a little later
            self._started.set()
        elif what == "stop" and not self._resting:
            self._goals.stop()
        elif what == "goal":
            self._goals.aim(int(order["ring"]))
            return "" if self._phase == "running" else f"the next run goes to ring {order['ring']}"
        elif what in ("close", "open"):
            getattr(self._goals, what)(str(order["opening"]))
            return f"the next run begins with: {what} {order['opening']}" if self._resting else ""
        elif what == "fault":
            return self._inject(str(order["kind"]))
        return ""

    def _level_now(self, machine: Any) -> str:
        """Level the plate, then end the run."""
        if machine is None and self._resting:
            return "no run in progress: the plate is level"
        if machine is None:
            self._goals.stop()
            return "the run that gets ready ends before it begins"
        try:
            for name in ("level_now", "stop", "level"):
                if callable(level := getattr(machine, name, None)):
                    level()
                    break
        finally:
            self._goals.stop()
        return "levelled"

    def _inject(self, kind: str) -> str:
        machine, faulty = self._machine, self._faulty
        if kind not in self._kinds:
            return "a fault needs a simulated rig that can have it"
        if machine is None or faulty is None or self._phase != "running":
            return "a fault needs a run that goes on"
        self._injected += 1
        number = self._injected
        machine.between_samples(lambda: faulty.add(at_once(kind, faulty.now, number)))
        say(f"{faulty.now:7.2f} s  injected: {kind}")
        return f"injected: {kind}"


def navigate_live(request: NavigationRequest, port: int, *, begin: bool = True, as_json: bool = False) -> int:
    """Serve a page and its runs. Returns the exit status.

    begin: whether to start the first run at once

    Each run gets the next seed and a separate log. At a terminal, or with `begin` False, the page stays until Ctrl-C.
    Otherwise it stays until the run is over and the last viewer has left."""

    def once(number: int, **more: Any) -> NavigationResult:
        log = request.log if request.log is None or number == 0 else free_name(Path(request.log), number + 1)
        return navigate_once(replace(request, seed=request.seed + number, log=log), Company(**more))

    stay = not begin or at_terminal()
    session = LiveSession(request.maze, str(request.rig), once, begin=begin, stay=stay)
    try:
        session.serve(port)
    finally:
        if as_json and session.result is not None:
            print_json(session.result.json())
    return exit_status(session)


def exit_status(session: LiveSession) -> int:
    """The exit status of the last run; 0 without a run."""
    failed = int(session.result is not None and not session.result.success)
    return failed if session.problem is None else session.problem.exit_status


def at_terminal() -> bool:
    """Whether a person at a terminal can press Ctrl-C."""
    return sys.stdin is not None and sys.stdin.isatty() and sys.stderr.isatty()
