"""What a run is told from outside: other goals, openings closed and opened, stop; seen at the next tick."""

from __future__ import annotations

import math

import numpy as np
import pytest
from talking import FIRST, MAZE, go, said

from mazeplan.core.logs.run_log_reader import read_log
from mazeplan.run.goals import Goals

# -- another goal ------------------------------------------------------------------------------------------------------


def test_another_goal_rules_the_command_of_the_same_tick_and_the_plate_is_not_levelled(tmp_path):
    goals = Goals(MAZE)
    acts = {5: lambda: goals.aim("ring2"), 10: lambda: goals.aim(4)}
    result, rig = go(acts, goals=goals, log=tmp_path / "run.mcap")
    log = read_log(tmp_path / "run.mcap")
    assert result.success
    assert rig.ring == 4
    assert [g.ring for g in result.goals] == [5, 2, 4]
    assert [g.t for g in result.goals] == pytest.approx([0.0, 5 / 30, 10 / 30])
    assert [(kind, detail["ring"]) for _, kind, detail in said(log)] == [("goal", 2), ("goal", 4)]
    for t, _, _ in said(log):
        at = log.ticks["t"] == t
        assert at.sum() == 1  # an event has the time of its tick
        assert log.ticks["leaf"][at][0] == "Track"
        routes = [e.t for e in log.events if e.kind == "route"]
        assert t in routes  # planned by the new tree in that tick
        k = int(np.flatnonzero(at)[0])
        assert math.hypot(*rig.commands[k]) > 0.01
    assert rig.levelled == 2  # at the end of the run, by the run and by its guard
    assert result.json()["goals"] == [{"ring": g.ring, "t": g.t} for g in result.goals]


def test_a_goal_given_while_the_ball_falls_into_a_ring_is_planned_for_from_there(tmp_path):
    """The ball is taken for one in the next ring already; the new tree takes it so, too."""
    go({}, log=tmp_path / "plain.mcap")
    log = read_log(tmp_path / "plain.mcap")
    t = next(e.t for e in log.events if e.kind == "passed")
    k = int(np.flatnonzero(log.ticks["t"] == t)[0]) + 1
    rings = []
    goals = Goals(MAZE)
    go({k: lambda: goals.aim(4)}, lambda rig: rings.append(rig.ring), goals=goals, log=tmp_path / "run.mcap")
    log = read_log(tmp_path / "run.mcap")
    assert rings[k] == 1  # of the ball itself
    assert log.ticks["ring"][k] == 2
    route = next(e for e in log.events if e.kind == "route" and e.t == log.ticks["t"][k])
    assert route.detail["openings"][0].startswith("2-3")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("hinder", "leaf"), [("glued", "Dither"), ("hidden", "LevelPlate")], ids=["in a dither", "while the ball is lost"]
)
def test_another_goal_in_the_middle_of_a_recovery(tmp_path, hinder, leaf):
    def until_2_s(rig):
        setattr(rig, hinder, 0.3 < rig.t < 2.0)

    go({}, until_2_s, log=tmp_path / "plain.mcap")
    plain = read_log(tmp_path / "plain.mcap")
    k = int(np.flatnonzero(plain.ticks["leaf"] == leaf)[0]) + 4
    assert plain.ticks["leaf"][k] == leaf  # it would have gone on
    goals = Goals(MAZE)
    result, rig = go({k: lambda: goals.aim(2)}, until_2_s, goals=goals, log=tmp_path / "run.mcap")
    log = read_log(tmp_path / "run.mcap")
    assert result.success
    assert rig.ring == 2
    if leaf == "Dither":
        assert log.ticks["leaf"][k] == "Track"
    else:  # the new tree does not see the ball either, and says so itself
        failures = [e.t for e in log.events if e.kind == "failure"]
        assert failures == [plain.events[0].t] or failures[-1] == log.ticks["t"][k]
    assert len(result.failures) >= (1 if leaf == "Dither" else 2)  # of the whole run


def test_each_goal_has_the_time_limit_of_its_own():
    def glue(rig):
        rig.glued = True

    goals = Goals(MAZE)
    result, rig = go({30: lambda: goals.aim(4), 60: lambda: goals.aim(3)}, glue, goals=goals, limit=1.5)
    assert (result.success, result.reason) == (False, "out_of_time")
    assert rig.t == pytest.approx(2.0 + 1.5, abs=0.04)
    assert "ring 3" in result.failures[-1].words


def test_goals_before_the_run_begins_are_read_at_its_first_tick():
    goals = Goals(MAZE)
    assert goals.aim(4)
    assert goals.aim(2, closed=FIRST[:1])
    result, rig = go({}, goals=goals, theta=math.radians(45.0))
    assert result.success
    assert rig.ring == 2
    assert [(g.ring, g.t) for g in result.goals] == [(5, 0.0), (2, 0.0)]
    assert result.rings[0].opening not in FIRST[:1]


# -- openings ----------------------------------------------------------------------------------------------------------


def test_openings_stay_closed_for_later_goals_until_they_are_opened():
    goals = Goals(MAZE)
    acts = {
        3: lambda: goals.close("1-2@45"),
        6: lambda: goals.aim(2, closed=[n for n in FIRST if n not in ("1-2@45", "1-2@135")]),
    }
    result, _ = go(acts, goals=goals, theta=math.radians(15.0))
    assert result.success
    assert result.rings[0].opening == "1-2@135"
    acts[9] = lambda: goals.open("1-2@45")
    result, _ = go(acts, goals=goals, theta=math.radians(15.0))
    assert result.success
    assert result.rings[0].opening == "1-2@45"


# -- stop --------------------------------------------------------------------------------------------------------------


def test_stop_ends_the_run_level_with_its_reason(tmp_path):
    goals = Goals(MAZE)
    result, rig = go({25: goals.stop, 26: lambda: pytest.fail("a tick after it")}, goals=goals, log=tmp_path / "a.mcap")
    assert (result.success, result.reason) == (False, "stopped")
    assert result.time_s == pytest.approx(25 / 30)
    assert len(rig.commands) == 26
    assert rig.commands[-1] == (0.0, 0.0)  # at once, in the tick in which it is heard
    assert rig.levelled
    log = read_log(tmp_path / "a.mcap")
    assert said(log) == [(log.events[-1].t, "stopped", {})]
    assert log.result is not None
    assert log.result["reason"] == "stopped"
    assert not goals.aim(3)
