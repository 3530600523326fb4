"""Recorded runs that decide again: alike, or different at the first place where something was changed."""

from __future__ import annotations

import pytest
from replayed import MAZE, again, of, other_end, planar, rewritten, tick

from mazeplan.core.errors import LogError
from mazeplan.core.logs.run_log_reader import read_messages
from mazeplan.run.execution import navigate
from mazeplan.run.replay import replay


def test_a_run_on_the_toy_decides_again(recorded):
    path, result = recorded
    told = []
    outcome = replay(path, advance=lambda done, total: told.append((done, total)))
    assert outcome.identical
    assert told == [(k + 1, outcome.ticks) for k in range(outcome.ticks)]
    _, messages, _ = read_messages(path)
    topics = [topic for topic, _ in messages]
    counts = outcome.ticks, outcome.plans, outcome.events
    assert counts == tuple(topics.count(topic) for topic in ("/tick", "/plan", "/event"))
    assert outcome.ticks > 30
    assert outcome.cut_off > 3
    assert outcome.reason == result.reason


def test_where_the_deadline_ended_a_search_decides(recorded):
    """Without it, or with another place, the plans become others."""
    path, _ = recorded

    def forget(header, messages):
        for _, document in messages:
            document.pop("cut_off", None)

    outcome = replay(rewritten(path, forget))
    assert not outcome.identical
    assert outcome.difference.what == "plan"
    assert {"reason", "iterations"} <= set(outcome.difference.fields)

    def garble(header, messages):
        next(d for t, d in messages if t == "/tick")["cut_off"] = "soon"

    with pytest.raises(LogError, match="damaged"):
        replay(rewritten(path, garble))


def hide(rig):
    rig.hidden = 0.3 < rig.t < 1.1


def fall(rig):
    if rig.ring == 4 and not getattr(rig, "fell", False):
        rig.fell = True
        rig.place(2, 2.0)


@pytest.mark.parametrize(
    ("mishap", "limit", "reason", "kind"),
    [
        (hide, 20.0, "arrived", "ball_lost"),
        (fall, 20.0, "arrived", None),
        (None, 0.7, "out_of_time", "out_of_time"),
    ],
)
def test_runs_that_went_wrong_on_the_way_decide_again(tmp_path, mishap, limit, reason, kind):
    result = planar(tmp_path / "run.mcap", mishap=mishap, limit=limit)
    assert result.reason == reason
    assert result.failures
    assert kind in (None, *(str(f.kind) for f in result.failures))
    outcome = again(tmp_path / "run.mcap")
    assert outcome.identical, outcome.difference
    assert outcome.reason == reason


def test_closed_openings_seed_and_start_decide_again(tmp_path):
    path = tmp_path / "run.mcap"
    closed = [opening.name for opening in MAZE.openings_between(3, 4)][:1]
    navigate(3, 4, rig="ideal", closed=closed, seed=7, log=path)
    assert replay(path).identical

    def change(header, messages):
        header["seed"] = 8

    outcome = replay(rewritten(path, change))
    assert outcome.difference.what == "event"
    assert outcome.difference.fields == ("detail",)
    navigate(4, 5, rig="ideal", start_angle_deg=-100.0, seed=7, log=path)
    assert replay(path).identical


@pytest.mark.parametrize(
    ("field", "value"),
    [("status", "FAILURE"), ("leaf", "Nobody"), ("u_beta", 0.01), ("u_gamma", -0.01), ("opening", "4-5@1"), ("ring", 1),
     ("goal_theta", 0.1), ("planned_theta", 0.1)],
)  # fmt: skip
def test_every_decision_of_a_tick_is_compared(tmp_path, recorded, field, value):
    path, _ = recorded

    def change(header, messages):
        tick(messages, 20)[field] = value

    outcome = replay(rewritten(path, change))
    difference = outcome.difference
    assert (difference.tick, difference.what, difference.fields) == (20, "tick", (field,))
    assert difference.t == pytest.approx(20 / 30.0, abs=1e-6)
    assert outcome.ticks == 20
    recorded, replayed = difference.messages
    assert recorded[field] == value
    assert replayed.get(field) != value


def drop_event(header, messages):
    del messages[of(messages, "/event", 2)]


def other_event(header, messages):
    messages[of(messages, "/event", 2)][1]["kind"] = "surprise"


def other_plan(header, messages):
    messages[of(messages, "/plan", 2)][1]["iterations"] += 1


def bent_plan(header, messages):
    messages[of(messages, "/plan", 2)][1]["theta"][7] += 1e-4


def other_sight(header, messages):
    tick(messages, 15)["x"] += 2e-3


def other_goal(header, messages):
    header["goal_ring"] = 4


def one_tick_less(header, messages):
    del messages[of(messages, "/tick", -1)]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("change", "what", "fields"),
    [
        (drop_event, None, None),
        (other_event, "event", ("kind",)),
        (other_plan, "plan", ("iterations",)),
        (bent_plan, "plan", ("theta",)),
        (other_end, "result", ("reason",)),
        (other_sight, None, None),
        (other_goal, None, None),
        (one_tick_less, None, None),
    ],
)
def test_everything_else_that_is_decided_is_compared(recorded, change, what, fields):
    difference = replay(rewritten(recorded[0], change)).difference
    assert difference is not None
    if what is not None:
        assert (difference.what, difference.fields) == (what, fields)
    if change is other_sight:
        assert difference.tick == 15


def test_rounding_is_no_difference(recorded):
    def change(header, messages):
        for topic, document in messages:
            if topic == "/tick":
                document["u_beta"] += 1e-12

    assert replay(rewritten(recorded[0], change)).identical
