"""A page and the runs that are begun from it, one after another, in the main thread; orders come in a thread of the
page's line, and do what the run can take at any time (`goals`, `PacedRig.level_now`)."""

from __future__ import annotations

import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from time import monotonic
from typing import TYPE_CHECKING, Any, cast

from mazeplan.cli.emergency import stop_key
from mazeplan.cli.navigate import navigate_once
from mazeplan.cli.output import print_json, say
from mazeplan.errors import InputError, MazeplanError
from mazeplan.goals import Goals
from mazeplan.maze.geometry import Maze
from mazeplan.records import NavigationResult
from mazeplan.rigs.faultkinds import KINDS
from mazeplan.rigs.faultschedule import at_once
from mazeplan.rigs.faulty import FaultyRig, Injectable, Orders, impossible
from mazeplan.rigs.interface import Rig
from mazeplan.rigs.paced import PacedRig
from mazeplan.rigs.registry import make_rig, rig_label

if TYPE_CHECKING:
    from mazeplan.view.link import PageLink

FIRST_S = 10.0  # s that the first run waits for somebody who looks
GRACE_S = 3.0  # s without anybody, in which a page that is loaded again comes back
LOOK_S = 0.05
READING = "reading map, model and tree, making the rig"
LOADING = (
    "rig and model are there; loading the compiled planner: seconds, the first time on this machine up to two minutes"
)
NOT_OFFERED = ("observe_hangs",)  # nothing watches a simulation, nobody could end it


class LiveSession:
    """once: does one run, given its number from 0 on and what of `mazeplan.navigate` this session adds.

    stay: whether the page stays when a run is over and nobody looks; begin: whether a run begins by itself."""

    def __init__(
        self, maze: Maze, rig: str, once: Callable[..., NavigationResult], *, begin: bool, stay: bool,
        sense: str | None = None,
    ) -> None:  # fmt: skip
        self._maze, self._rig, self._once, self._begin, self._stay = maze, rig, once, begin, stay
        machine = make_rig(rig, maze, sense)
        self._injectable, self._impossible = isinstance(machine, Injectable), impossible(machine)
        self._goals = Goals(maze)
        self._started = threading.Event()
        self._machine: Any = None
        self._faulty: FaultyRig | None = None
        self._opening: str | None = None
        self._count, self._injected, self._waiting = 0, 0, ""
        self._aimed: int | None = None  # the goal that was pressed before the run's first tick
        self._phase, self._step = "idle", READING
        self._page: PageLink | None = None
        self.result: NavigationResult | None = None
        self.problem: MazeplanError | None = None

    def serve(self, host: str, port: int) -> None:
        """Until Ctrl-C, or until nobody looks any more. Raises InputError where there can be no page."""
        from mazeplan.view.server import check_installed

        check_installed()
        from mazeplan.view.door import Door, listen
        from mazeplan.view.link import PageLink
        from mazeplan.view.livetab import Offer

        listening = listen(host, port)
        door = Door.at(host, listening.getsockname()[1])
        kinds = {kind.name: kind.what for kind in KINDS.values() if kind.name not in {*NOT_OFFERED, *self._impossible}}
        offer = Offer(self._maze, rig_label(self._rig), kinds if self._injectable else {})
        with PageLink(offer, door, listening, self._order) as self._page:
            listening.close()
            try:
                say(f"page: {door.url}")
                self._serve(self._page)
            except KeyboardInterrupt:  # how one leaves a page where no run goes on
                if not self._resting:
                    raise

    def _serve(self, page: PageLink) -> None:
        if self._begin:
            self._tell("starting", "the run begins as soon as somebody looks")
            page.opened.wait(FIRST_S)
            self._run(page)
        while self._asked(page):
            self._run(page)

    # -- runs -------------------------------------------------------------------------------------------------------

    def _asked(self, page: PageLink) -> bool:
        """Wait until another run is wanted; whether one is."""
        self._tell("failed" if self.problem is not None else "idle", self._waiting or "Start begins a run")
        left_at = monotonic()
        while not self._started.wait(LOOK_S):
            if page.ended.is_set():
                return False
            if page.viewers or self._stay:
                left_at = monotonic()
            elif monotonic() - left_at > GRACE_S:
                return False
        return True

    def _run(self, page: PageLink) -> None:
        self._started.clear()
        self._tell("starting", READING)
        self._waiting, number = "", self._count
        self._count += 1
        try:
            self.result, self.problem = None, None
            self.result = self._once(number, goals=self._goals, feed=self._take, around=self._around, guard=self._guard)
        except MazeplanError as problem:
            self.problem = problem
            self.result = getattr(problem, "result", None)
            self._waiting = str(problem)
            if isinstance(problem, InputError) and number == 0 and self._begin:
                raise
            say(f"mazeplan: {problem}")
        finally:
            self._machine = self._faulty = self._aimed = None
            self._goals = Goals(self._maze)

    def _tell(self, phase: str, note: str = "") -> None:
        self._phase = phase
        if phase == "starting" and note in (READING, LOADING):
            self._step = note
            note = note if self._aimed is None else f"it goes to ring {self._aimed}; {note}"
        if self._page is not None:
            self._page.tell(phase, note)

    def _take(self, topic: str, t: float, document: dict[str, Any]) -> None:
        if topic == "/tick":
            self._opening = document.get("opening")
            if self._phase == "starting":  # until now it was getting ready
                self._tell("running")
        if self._page is not None:
            self._page.take(topic, t, document)

    def _around(self, rig: Rig) -> Rig:
        """A simulation goes by the clock on the wall, and can be made to go wrong; a machine is left as it is."""
        if getattr(rig, "realtime", True):
            return rig
        inside = rig
        if isinstance(rig, Injectable):
            orders = Orders(aimed_at=lambda: self._opening, close=self._goals.close)
            self._faulty = FaultyRig(rig, self._maze, (), orders)
            for name in ("latency", "unseen_s"):
                if hasattr(rig, name):
                    setattr(self._faulty, name, getattr(rig, name))
            inside = cast(Rig, self._faulty)  # a rig but for how it is made
        return cast(Rig, PacedRig(inside))

    @contextmanager
    def _guard(self, machine: Rig) -> Iterator[None]:
        self._machine = machine
        self._tell("starting", LOADING)
        with stop_key(machine, self._goals.stop):
            yield

    # -- orders -----------------------------------------------------------------------------------------------------

    def _order(self, order: dict[str, Any]) -> None:
        """What somebody pressed on the page."""
        try:
            told = self._do(str(order.get("do")), order)
        except MazeplanError as problem:
            told = str(problem)
        if self._resting:
            self._waiting = told
        if told:
            self._tell(self._phase, told)

    @property
    def _resting(self) -> bool:
        """Whether no run goes on or gets ready."""
        return self._phase not in ("starting", "running")

    def _do(self, what: str, order: dict[str, Any]) -> str:
        machine = self._machine
        if what == "level":
            return self._level_now(machine)
        if what == "start" and self._resting:
            self._tell("starting", READING)  # at once: the run's thread looks a little later
            self._started.set()
        elif what == "stop" and not self._resting:
            self._goals.stop()
        elif what == "goal":
            self._goals.aim(int(order["ring"]))
            if self._phase == "running":
                return ""
            self._aimed = int(order["ring"])
            if self._resting:
                return f"the next run goes to ring {self._aimed}"
            self._tell("starting", self._step)
        elif what in ("close", "open"):
            (self._goals.close if what == "close" else self._goals.open)(str(order["opening"]))
            is_ = "closed" if what == "close" else "open"
            return f"in the next run {order['opening']} is {is_}" if self._resting else ""
        elif what == "fault":
            return self._inject(str(order["kind"]))
        return ""

    def _level_now(self, machine: Any) -> str:
        """The plate first, then the run."""
        if machine is None and self._resting:
            return "no run goes on: the plate is level"
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
        if machine is None or faulty is None or kind not in KINDS or kind in NOT_OFFERED:
            return "a fault needs a run on a simulated rig"
        self._injected += 1
        seed = self._injected
        say(f"{faulty.now:7.2f} s  injected: {kind}")
        machine.between_samples(lambda: faulty.add(at_once(kind, faulty.now, seed)))
        return f"injected: {kind}"


def navigate_live(job: dict[str, Any], host: str, port: int, *, begin: bool = True, as_json: bool = False) -> int:
    """Do the runs of a page, each a job in the words of `mazeplan.navigate` with a seed of its own and, from the second
    on, a log of its own; the exit status. The page stays until Ctrl-C where a person sits at a terminal or no run
    begins by itself; otherwise until the run is over and nobody looks."""

    def once(number: int, **more: Any) -> NavigationResult:
        return navigate_once({**job, "seed": job["seed"] + number, "log": numbered(job["log"], number)}, **more)

    stay = not begin or at_terminal()
    session = LiveSession(job["map"], job["rig"], once, begin=begin, stay=stay, sense=job["sense"])
    try:
        session.serve(host, port)
    finally:
        if as_json and session.result is not None:
            print_json(session.result.to_json())
    return exit_status(session)


def exit_status(session: LiveSession) -> int:
    """Of the last run; 0 where there was none."""
    if session.problem is not None:
        return session.problem.exit_status
    return 0 if session.result is None or session.result.success else 1


def numbered(path: Path | None, number: int) -> Path | None:
    """The file of run `number`: run.mcap, run-2.mcap, run-3.mcap."""
    return path if path is None or number == 0 else path.with_stem(f"{path.stem}-{number + 1}")


def at_terminal() -> bool:
    """Whether a person sits there, who can press Ctrl-C."""
    return sys.stdin is not None and sys.stdin.isatty() and sys.stderr.isatty()
