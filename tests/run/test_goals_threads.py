"""Requests with wrong names raise in the call; any thread may make requests."""

from __future__ import annotations

import threading

import pytest
from planar_rig import PlanarRig
from talking import MAZE, NAMES, SETUP, go, said

from mazeplan.core.errors import SettingsError
from mazeplan.core.logs.run_log import read_log
from mazeplan.run.execution import run_job
from mazeplan.run.goals import Goals
from mazeplan.run.navigate import navigate
from mazeplan.run.specification import Job


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda g: g.aim(6), "goal: got 6, expected ring1 to ring5"),
        (lambda g: g.aim("²"), "goal: got '²', expected ring1 to ring5"),
        (lambda g: g.aim(3, closed=["1-2@45", "7-8@1"]), "opening: got '7-8@1', expected one of 1-2@45, "),
        (lambda g: g.aim(3, closed="1-2@45"), "closed: got '1-2@45', expected a list of names"),
        (lambda g: g.close("1-2"), "opening: got '1-2', expected one of "),
        (lambda g: g.open(None), "opening: got None, expected one of "),
    ],
)
def test_wrong_names_are_refused_in_the_call_and_change_nothing(call, message):
    goals = Goals(MAZE)
    with pytest.raises(SettingsError, match=message):
        call(goals)
    assert not goals.take(0.0)


def test_goals_of_another_map_or_another_run_are_refused():
    rig = PlanarRig(MAZE)
    with pytest.raises(SettingsError, match="goals: made for the map lopsided, expected the one of the run, cme"):
        navigate(map=MAZE, rig=rig, goals=Goals("lopsided"))
    assert rig.commands == []
    goals, inner = Goals(), []

    def another():
        with pytest.raises(SettingsError, match="goals: another run reads them"):
            run_job(PlanarRig(MAZE), SETUP, Job(1, 2, 0.3), goals=goals)
        inner.append(True)

    result, _ = go({3: another}, goals=goals)
    assert inner
    assert result.success
    assert go({}, goals=goals)[0].success  # afterwards they may be used again


def test_threads_may_all_talk_at_once(tmp_path):
    """Every message arrives, once; the newest goal is the one that is reached."""
    goals, threads = Goals(MAZE), []
    ready, last = threading.Barrier(5), threading.Event()

    def talk(n):
        ready.wait(10.0)
        for k in range(50):
            assert goals.aim(2 + (n + k) % 3)
            assert goals.close(NAMES[-1 - n])
            assert goals.open(NAMES[-1 - n])

    def start():
        threads.extend(threading.Thread(target=talk, args=(n,), daemon=True) for n in range(4))
        for thread in threads:
            thread.start()
        ready.wait(10.0)

    def join():
        for thread in threads:
            thread.join()
        goals.aim(2)
        last.set()

    result, rig = go({2: start, 20: join}, goals=goals, log=tmp_path / "a.mcap")
    assert last.is_set()
    assert result.success
    assert rig.ring == 2
    events = [kind for _, kind, _ in said(read_log(tmp_path / "a.mcap"))]
    assert (events.count("goal"), events.count("closed"), events.count("opened")) == (201, 200, 200)


def test_a_thread_of_the_user_gives_another_goal_through_the_public_names():
    from mazeplan import Goals

    goals, began = Goals("cme"), threading.Event()

    def person():
        began.wait(10.0)
        goals.aim("ring2")
        goals.aim("ring3")
        seen.set()

    seen = threading.Event()
    thread = threading.Thread(target=person, daemon=True)
    thread.start()

    class Waiting(PlanarRig):
        def observe(self):
            if len(self.commands) == 10:
                began.set()
                assert seen.wait(10.0)
            return super().observe()

    rig = Waiting(MAZE)
    result = navigate("ring1", "ring5", map=MAZE, rig=rig, start_angle_deg=20.0, goals=goals)
    thread.join()
    assert result.success
    assert rig.ring == 3
