"""The session behind the page, with a page that presses: runs one after another, and orders to them."""

from __future__ import annotations

import subprocess
import sys
import threading
from contextlib import contextmanager
from types import SimpleNamespace

import numpy as np
import pytest
from soon import soon

from mazeplan.apps.cli import live
from mazeplan.apps.cli.live import READING, LiveSession, exit_status, navigate_live
from mazeplan.apps.view.link import Offer, head_html
from mazeplan.core.errors import RigError
from mazeplan.core.events import GoalChanged, OpeningClosed, OpeningReopened, StopRequested
from mazeplan.core.records import NavigationResult
from mazeplan.maze.mapfile import load_map
from mazeplan.rigs.registry import make_rig
from mazeplan.run.request import NavigationRequest

MAZE = load_map("cme")


class FakePage:
    """Of `PageLink` what a session uses; `press` sends an order."""

    def __init__(self, offer, listening, on_order):
        self.told, self.taken, self.viewers = [], [], 1
        self.opened, self.ended = threading.Event(), threading.Event()
        self.opened.set()
        self._on_order = on_order

    def __enter__(self):
        return self

    def __exit__(self, *problem):
        self.ended.set()

    def tell(self, phase, note=""):
        self.told.append((phase, note))

    def take(self, topic, t, document):
        self.taken.append((topic, document))

    def press(self, do, **more):
        self._on_order({"do": do, **more})
        return self.told[-1] if self.told else None


def outcome(reason="arrived"):
    return NavigationResult(reason == "arrived", reason, 1.0, 0, "toy", (), (), 0, {}, None)


@contextmanager
def served(once, monkeypatch, **options):
    """A session that serves in a thread: (session, its page). The page ends with the block."""
    pages = []

    def page(*arguments):
        pages.append(FakePage(*arguments))
        return pages[-1]

    monkeypatch.setattr("mazeplan.apps.view.link.PageLink", page)
    session = LiveSession(MAZE, "toy", once, **{"begin": False, "stay": True, **options})
    serving = threading.Thread(target=session.serve, args=(0,), daemon=True)
    serving.start()
    assert soon(lambda: pages and pages[0].told)
    try:
        yield session, pages[0]
    finally:
        pages[0].ended.set()
        serving.join(30.0)
        assert not serving.is_alive()


class HeldRun:
    """A run on the toy, or on another machine, that waits at its first tick until `end`."""

    def __init__(self, machine=None, tick=True, result="arrived"):
        self.machine, self.tick, self.result = machine, tick, result
        self.ready, self.end, self.orders, self.numbers = threading.Event(), threading.Event(), [], []

    def __call__(self, number, goals, feed, around):
        self.numbers.append(number)
        goals.begin(MAZE)
        self.rig = around(self.machine or make_rig("toy", MAZE))
        if self.tick:
            feed("/header", 0.0, {})
            feed("/tick", 0.0, {"t": 0.0, "opening": "2-3@0"})
        self.ready.set()
        assert self.end.wait(60.0)
        self.orders += goals.take(0.0)
        return outcome(self.result)


@pytest.fixture
def running(monkeypatch):
    """A run that goes on: (page, run); leaving ends it."""
    run = HeldRun()
    with served(run, monkeypatch) as (_, page):
        page.press("start")
        assert run.ready.wait(60.0)
        yield page, run
        run.end.set()


def after(page, run):
    """Orders that the run got, after its end."""
    run.end.set()
    assert soon(lambda: page.told[-1][0] == "idle")
    return run.orders


def test_orders_reach_the_run_and_each_phase_is_told(running):
    page, run = running
    assert page.told[-2:] == [("starting", READING), ("running", "")]
    assert [topic for topic, _ in page.taken] == ["/header", "/tick"]
    page.press("goal", ring=3)
    page.press("close", opening="1-2@45")
    page.press("open", opening="1-2@45")
    page.press("stop")
    assert after(page, run) == [GoalChanged(3), OpeningClosed("1-2@45"), OpeningReopened("1-2@45"), StopRequested()]


def test_level_levels_first_and_then_stops(running):
    page, run = running
    assert page.press("level") == ("running", "levelled")
    assert after(page, run) == [StopRequested()]


def test_a_fault_begins_between_two_samples_and_knows_the_next_opening(running, capsys):
    page, run = running
    machine = run.rig
    assert machine.inside.aimed_at() == "2-3@0"
    machine.reset(ring=1, theta=0.0, rng=np.random.default_rng(0))
    assert machine.observe().x is not None
    assert page.press("fault", kind="frames_lost") == ("running", "injected: frames_lost")
    assert capsys.readouterr().err.endswith(" s  injected: frames_lost\n")
    assert machine.observe().x is not None or machine.inside.begun
    assert machine.observe().x is None
    assert [fault.kind.name for fault in machine.inside.begun] == ["frames_lost"]
    machine.close()


def refuses():
    raise RigError("the board does not answer")


@pytest.mark.parametrize(
    ("methods", "told"), [(("stop", "level"), "levelled"), (("level",), "levelled"), ((), "the board does not answer")]
)
def test_a_real_machine_is_levelled_by_its_own_method(monkeypatch, methods, told):
    called = []
    calls = {name: lambda name=name: called.append(name) for name in methods} or {"level": refuses}
    machine = SimpleNamespace(rate_hz=30.0, **calls)
    run = HeldRun(machine)
    with served(run, monkeypatch) as (_, page):
        page.press("start")
        assert run.ready.wait(60.0)
        assert run.rig.inside is machine  # neither paced nor made to go wrong
        assert page.press("level") == ("running", told)
        assert after(page, run) == [StopRequested()]
    assert called == list(methods[:1])


def test_orders_before_a_run_wait_for_it(monkeypatch):
    run = HeldRun()
    with served(run, monkeypatch) as (_, page):
        assert page.press("level") == ("idle", "no run in progress: the plate is level")
        assert page.press("fault", kind="frames_lost") == ("idle", "a fault needs a run that goes on")
        for ring in (1, 4, 2):
            assert page.press("goal", ring=ring) == ("idle", f"the next run goes to ring {ring}")
        page.press("start")
        page.press("start")  # twice in a hurry
        assert run.ready.wait(60.0)
        assert after(page, run)[-1] == GoalChanged(2)
        page.press("start")
        assert soon(lambda: run.numbers == [0, 1])
    assert run.orders[-1] == GoalChanged(2)


def test_a_run_that_fails_leaves_the_page_and_its_status(monkeypatch):
    results = iter([RigError("no picture"), outcome("stopped"), outcome()])

    def once(number, **more):
        result = next(results)
        if isinstance(result, Exception):
            raise result
        return result

    with served(once, monkeypatch) as (session, page):
        for phase, status in ((("failed", "no picture"), 3), (("idle", "Start begins a run"), 1),
                              (("idle", "Start begins a run"), 0)):  # fmt: skip
            page.told.clear()
            page.press("start")
            assert soon(lambda phase=phase: page.told[-1] == phase)
            assert exit_status(session) == status
    shown = head_html(Offer(MAZE, "toy"), "failed", "no picture")
    assert 'data-phase="failed"' in shown
    assert "no picture" in shown


@pytest.mark.realtime
def test_a_run_with_a_page_and_nobody_there_ends_by_itself(monkeypatch, tmp_path, capsys):
    """As in a script: the run begins though nobody looks, goes by the wall clock, and ends with its page."""
    pytest.importorskip("viser")
    monkeypatch.setattr(live, "FIRST_S", 0.1)
    monkeypatch.setattr(live, "GRACE_S", 0.1)
    monkeypatch.setattr(live, "at_terminal", lambda: False)
    request = NavigationRequest(1, 2, MAZE, "ideal", seed=1, log=tmp_path / "a.mcap")
    assert navigate_live(request, 0, as_json=True) == 0
    said = capsys.readouterr()
    assert '"success": true' in said.out
    assert "page: http://127.0.0.1:" in said.err
    assert (tmp_path / "a.mcap").exists()
    assert soon(lambda: not any(t.name == "mazeplan page _receive" for t in threading.enumerate()))


@pytest.mark.parametrize(
    ("wanted", "unwanted"),
    [
        ("mazeplan.apps.cli.app, mazeplan.run.execution", ("mazeplan.apps.view", "mazeplan.apps.cli.live", "viser")),
        ("mazeplan.apps.view.link, mazeplan.apps.view.replay", ("viser",)),
    ],
)
def test_optional_parts_are_imported_by_their_users_alone(wanted, unwanted):
    code = f"import sys, {wanted}\nassert not [name for name in sys.modules if name.startswith({unwanted!r})]"
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120, check=False)
    assert ran.returncode == 0, ran.stderr
