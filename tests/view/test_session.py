"""The session behind the page: runs one after another, and what is pressed while they go on or do not."""

from __future__ import annotations

import subprocess
import sys
import threading
from pathlib import Path

import pytest
from soon import soon

from mazeplan.cli import live
from mazeplan.cli.live import LiveSession, exit_status, navigate_live, numbered
from mazeplan.cli.progress import NavigationProgress
from mazeplan.errors import InputError, RigError
from mazeplan.goals import Aim, Edit, Stop
from mazeplan.maze.mapfile import load_map
from mazeplan.records import NavigationResult
from mazeplan.rigs.faulty import FaultyRig
from mazeplan.rigs.paced import PacedRig
from mazeplan.rigs.registry import make_rig
from mazeplan.view.door import listen
from mazeplan.view.livetab import Offer, fault_html, head_html
from mazeplan.view.moment import Moment
from mazeplan.view.panel import facts_html

MAZE = load_map("cme")


class FakePage:
    """Of `PageLink` what a session uses."""

    def __init__(self):
        self.told, self.taken, self.viewers = [], [], 0
        self.opened, self.ended = threading.Event(), threading.Event()

    def tell(self, phase, note=""):
        self.told.append((phase, note))

    def take(self, topic, t, document):
        self.taken.append((topic, t, document))


def outcome(reason="arrived"):
    return NavigationResult(reason == "arrived", reason, 1.0, 0, "toy", (), (), 0, {}, None)


@pytest.fixture
def session():
    """One whose runs end at once, on a rig as the page has it."""
    session = LiveSession(MAZE, "toy", lambda number, **more: outcome(), begin=False, stay=True)
    session._page = FakePage()
    return session


@pytest.fixture
def running(session):
    """The same while a run goes on; what is said to it waits in its goals."""
    machine = session._around(make_rig("toy", MAZE))
    session._goals.begin(MAZE)
    with session._guard(machine):
        session._take("/tick", 0.0, {"t": 0.0})
        session._page.taken.clear()
        yield session


def test_what_is_pressed_is_said_to_the_run(running):
    orders = [
        {"do": "goal", "ring": 3},
        {"do": "close", "opening": "1-2@45"},
        {"do": "open", "opening": "1-2@45"},
        {"do": "stop"},
    ]
    for order in orders:
        running._order(order)
    assert list(running._goals.take(0.0)) == [Aim(3), Edit("1-2@45", True), Edit("1-2@45", False), Stop()]


def test_without_a_run_it_waits_for_the_next_one(session):
    for order in ({"do": "stop"}, {"do": "goal", "ring": 3}, {"do": "level"}):
        session._order(order)
    assert session._page.told[-1] == ("idle", "no run goes on: the plate is level")
    session._goals.begin(MAZE)
    assert list(session._goals.take(0.0)) == [Aim(3)]


def test_level_levels_first_and_stops_then(running):
    machine = running._machine
    running._order({"do": "level"})
    assert machine._levelled
    assert list(running._goals.take(0.0)) == [Stop()]
    assert running._page.told[-1] == ("running", "levelled")


@pytest.mark.parametrize("methods", [("stop", "level"), ("level",)])
def test_a_machine_of_wood_is_stopped_by_what_it_has(session, methods):
    called = []
    machine = type("Machine", (), {name: lambda self, name=name: called.append(name) for name in methods})()
    assert session._around(machine) is machine  # neither paced nor made to go wrong
    session._machine, session._phase = machine, "running"
    session._order({"do": "level"})
    assert called == [methods[0]]


def test_a_machine_that_cannot_be_levelled_is_told_and_the_run_stopped_all_the_same(session):
    def level():
        raise RigError("the board does not answer")

    session._machine = type("Machine", (), {"level": staticmethod(level)})()
    session._phase = "running"
    session._goals.begin(MAZE)
    session._order({"do": "level"})
    assert session._page.told[-1] == ("running", "the board does not answer")
    assert list(session._goals.take(0.0)) == [Stop()]


def test_a_fault_begins_between_two_samples(running, capsys):
    import numpy as np

    machine = running._machine
    assert isinstance(machine, PacedRig)
    assert isinstance(machine.inside, FaultyRig)
    machine.reset(ring=1, theta=0.0, rng=np.random.default_rng(0))
    assert machine.observe().x is not None
    running._order({"do": "fault", "kind": "frames_lost"})
    assert capsys.readouterr().err.endswith(" s  injected: frames_lost\n")
    assert machine.observe().x is not None or machine.inside.begun
    assert machine.observe().x is None
    assert [fault.kind.name for fault in machine.inside.begun] == ["frames_lost"]
    machine.close()


def test_wrong_orders_are_told_and_do_nothing(running):
    for order in ({"do": "goal", "ring": 9}, {"do": "close", "opening": "x"}, {"do": "fault", "kind": "observe_hangs"}):
        running._order(order)
        assert running._page.told[-1][1]
    running._order({"do": "nonsense"})
    assert not running._goals.take(0.0)


def test_the_opening_that_is_next_is_known_to_faults(session):
    machine = session._around(make_rig("toy", MAZE))
    session._take("/tick", 0.1, {"t": 0.1, "opening": "2-3@0"})
    assert machine.inside.orders.aimed_at() == "2-3@0"
    assert session._page.taken == [("/tick", 0.1, {"t": 0.1, "opening": "2-3@0"})]


def test_a_script_ends_when_nobody_looks(session, monkeypatch):
    monkeypatch.setattr(live, "GRACE_S", 0.1)
    session._stay = False
    assert not session._asked(session._page)
    session._page.viewers, asked = 1, []
    waiting = threading.Thread(target=lambda: asked.append(session._asked(session._page)))
    waiting.start()
    waiting.join(0.5)
    assert waiting.is_alive()  # somebody looks
    session._order({"do": "start"})
    waiting.join(10.0)
    assert asked == [True]
    session._page.ended.set()
    session._started.clear()
    assert not session._asked(session._page)


def test_each_run_has_a_seed_and_a_log_of_its_own():
    path = Path("runs/a.mcap")
    assert [numbered(path, k) for k in range(3)] == [path, Path("runs/a-2.mcap"), Path("runs/a-3.mcap")]
    assert numbered(None, 3) is None


def test_a_run_that_fails_leaves_the_page_and_its_status(session):
    def broken(number, **more):
        raise RigError("no picture")

    session._once = broken
    session._run(session._page)
    assert exit_status(session) == 3
    session._once = lambda number, **more: outcome("stopped")
    session._run(session._page)
    assert exit_status(session) == 1
    session._once = lambda number, **more: outcome()
    session._run(session._page)
    assert exit_status(session) == 0
    assert session._count == 3


def test_bad_input_ends_it_at_its_first_run(session):
    def wrong(number, **more):
        raise InputError("no such tree")

    session._once, session._begin = wrong, True
    with pytest.raises(InputError):
        session._run(session._page)


@pytest.mark.realtime
def test_a_run_with_a_page_and_nobody_there_ends_by_itself(monkeypatch, tmp_path, capsys):
    """As a script has it: the run begins though nobody looks, goes by the wall's clock, and the page goes with it."""
    pytest.importorskip("viser")
    monkeypatch.setattr(live, "FIRST_S", 0.1)
    monkeypatch.setattr(live, "GRACE_S", 0.1)
    monkeypatch.setattr(live, "at_terminal", lambda: False)
    job = {"start": 1, "goal": 2, "map": MAZE, "rig": "ideal", "seed": 1, "log": tmp_path / "a.mcap", "sense": None}
    assert navigate_live(job, "127.0.0.1", 0, as_json=True) == 0
    said = capsys.readouterr()
    assert '"success": true' in said.out
    assert "page: http://127.0.0.1:" in said.err
    assert (tmp_path / "a.mcap").exists()
    assert soon(lambda: not any(t.name == "mazeplan page _receive" for t in threading.enumerate()))


def test_a_taken_port_is_told_before_anything_begins():
    with listen("127.0.0.1", 0) as taken:
        session = LiveSession(MAZE, "toy", lambda number, **more: outcome(), begin=True, stay=False)
        with pytest.raises(InputError, match="cannot be listened at"):
            session.serve("127.0.0.1", taken.getsockname()[1])
    assert session.result is None


def test_who_does_not_ask_for_a_page_gets_nothing_of_it():
    code = (
        "import sys, mazeplan.cli.app, mazeplan.navigation\n"
        "assert not [name for name in sys.modules if name.startswith(('mazeplan.view', 'mazeplan.cli.live', 'viser'))]"
    )
    subprocess.run([sys.executable, "-c", code], check=True, timeout=120)


def test_from_start_to_the_first_tick_it_is_told_what_one_waits_for(session):
    def once(number, **more):
        with more["guard"](more["around"](make_rig("toy", MAZE))):
            more["feed"]("/header", 0.0, {})
            more["feed"]("/tick", 0.0, {"t": 0.0})
            more["feed"]("/tick", 0.1, {"t": 0.1})
        return outcome()

    session._once = once
    session._order({"do": "start"})
    assert session._page.told == [("starting", live.READING)]
    session._order({"do": "start"})  # twice in a hurry
    session._run(session._page)
    assert session._page.told[1:] == [("starting", live.READING), ("starting", live.LOADING), ("running", "")]
    assert not session._started.is_set()


def test_what_is_pressed_while_it_gets_ready_is_for_that_run(session):
    session._order({"do": "start"})
    session._order({"do": "goal", "ring": 3})
    assert session._page.told[-1] == ("starting", f"it goes to ring 3; {live.READING}")  # not: the next run
    session._order({"do": "level"})
    assert session._page.told[-1] == ("starting", "the run that gets ready ends before it begins")
    session._goals.begin(MAZE)
    assert list(session._goals.take(0.0)) == [Aim(3), Stop()]


def test_of_goals_pressed_before_a_run_the_last_counts_and_is_told_until_it_begins(session):
    for ring in (1, 4, 2):
        session._order({"do": "goal", "ring": ring})
    session._order({"do": "start"})
    assert session._page.told[-1] == ("starting", f"it goes to ring 2; {live.READING}")
    session._goals.begin(MAZE)
    assert list(session._goals.take(0.0)) == [Aim(2)]
    session._run(session._page)
    session._phase = "idle"
    session._order({"do": "start"})
    assert session._page.told[-1] == ("starting", live.READING)  # that was for one run


def test_what_stderr_does_not_take_ends_nothing(running, monkeypatch):
    class Gone:
        def write(self, text):
            raise BrokenPipeError

        flush = write

    monkeypatch.setattr(live.sys, "stderr", Gone())
    running._order({"do": "fault", "kind": "frames_lost"})
    assert running._page.told[-1] == ("running", "injected: frames_lost")
    NavigationProgress(Gone(), live=False).event(0.0, "stuck")


def test_a_fault_is_told_below_its_name():
    assert "no picture shows it" in fault_html(
        Offer(MAZE, "toy", {"frames_lost": "no picture shows it"}), "frames_lost"
    )


def test_no_goal_is_shown_that_another_may_replace():
    assert "→ 5" not in facts_html(Moment(run=1, goal=5))
    assert "→ 5" in facts_html(Moment(run=1, tick=1, ring=1, goal=5))


def test_why_a_run_could_not_begin_stays_where_start_is(session, monkeypatch):
    def broken(number, **more):
        raise RigError("the board does not answer")

    session._once = broken
    session._run(session._page)
    session._page.ended.set()
    assert not session._asked(session._page)
    assert session._page.told[-1] == ("failed", "the board does not answer")
    shown = head_html(Offer(MAZE, "toy"), *session._page.told[-1])
    assert 'data-phase="failed"' in shown
    assert "the board does not answer" in shown
    session._order({"do": "start"})  # once more
    assert session._started.is_set()
