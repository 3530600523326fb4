"""Recorded runs that decide again: alike, or different at the first place where something was changed."""

from __future__ import annotations

import pytest
from planar_rig import PATIENT
from replayed import MAZE, again, of, other_end, planar, rewritten, tick

from mazeplan.core.errors import LogError, RigError
from mazeplan.core.logs.run_log_reader import read_messages
from mazeplan.core.resources import share
from mazeplan.maze.memory import OpeningMemory
from mazeplan.run.navigate import navigate
from mazeplan.run.replay import replay
from mazeplan.run.settings import settings_from_text


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


def test_a_log_from_before_that_tells_less_of_the_result_decides_again(tmp_path):
    result = planar(tmp_path / "run.mcap", mishap=fall)
    assert (result.start.ring, result.start.theta) == (3, 0.3)

    def less(header, messages):
        (told,) = [document for topic, document in messages if topic == "/result"]
        assert told.pop("start") == {"ring": 3, "theta": 0.3}
        for failure in told["failures"]:
            assert failure.pop("x") is not None
            del failure["y"], failure["where"]

    assert again(rewritten(tmp_path / "run.mcap", less)).identical

    def another(header, messages):
        less(header, messages)
        next(d for t, d in messages if t == "/result")["failures"][0]["kind"] = "stuck"

    outcome = again(rewritten(tmp_path / "run.mcap", another))
    assert (outcome.identical, outcome.difference.what) == (False, "result")


def test_a_failure_tells_where_the_ball_was(tmp_path):
    result = planar(tmp_path / "run.mcap", mishap=fall)
    ticks = [d for t, d in read_messages(tmp_path / "run.mcap")[1] if t == "/tick"]
    for failure in result.failures:
        tick_then = min(ticks, key=lambda d: abs(d["t"] - failure.t))
        assert failure.x == pytest.approx(tick_then["x"], abs=0.004)  # m
        assert failure.y == pytest.approx(tick_then["y"], abs=0.004)
    fallen = result.failures[0]
    assert MAZE.ring_at((fallen.x**2 + fallen.y**2) ** 0.5) == 2  # where it was put


@pytest.mark.parametrize(("error", "reason"), [(KeyboardInterrupt, "interrupted"), (RigError, "rig_failed")])
def test_runs_that_were_ended_decide_again_up_to_there(tmp_path, error, reason):
    def end(rig):
        if rig.t > 0.8:
            raise error("enough")

    path = tmp_path / "run.mcap"
    with pytest.raises(error):
        planar(path, mishap=end)
    outcome = again(path)
    assert outcome.identical
    assert outcome.ticks == 25
    assert outcome.reason == reason

    def other(header, messages):
        [d for t, d in messages if t == "/tick"][-1]["u_beta"] += 0.001

    assert not again(rewritten(path, other)).identical


def test_what_is_remembered_of_openings_decides(tmp_path):
    memory = OpeningMemory()
    for _ in range(6):
        memory.record("1-2@45", success=False, now=0.0)
    path = tmp_path / "run.mcap"
    planar(path, start=1, goal=2, theta=0.785, memory=memory)
    assert again(path).identical
    assert again(path).identical  # a replay leaves nothing behind

    def forget(header, messages):
        del header["replay"]["memory"]

    outcome = again(rewritten(path, forget))
    assert outcome.difference.what == "event"
    assert outcome.difference.tick == 0


def test_settings_decide_again(tmp_path):
    path = tmp_path / "run.mcap"
    planar(path, settings=PATIENT.with_values({"travel": {"lean_deg": 2.0}, "estimator": {"lost_after": 0.3}}))
    assert again(path).identical
    for values in ({"travel": {"lean_deg": 4.0}}, {"cost": {"theta": 2.0}}):

        def change(header, messages, values=values):
            kept = header["replay"]
            kept["settings"] = settings_from_text(kept["settings"]).with_values(values).text()

        assert not again(rewritten(path, change)).identical


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
    for side in (difference.recorded, difference.replayed):
        assert set(side) == {"status", "leaf", "u_beta", "u_gamma", "opening"}
    if field in difference.recorded:
        assert difference.recorded[field] == value
        assert difference.replayed[field] != value


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


def test_a_track_with_a_name_of_its_own_tells_where_the_plan_is(tmp_path):
    tree = tmp_path / "named.xml"
    text = (share("behaviors") / "navigate.xml").read_text()
    tree.write_text(text.replace("<Track ", '<Track name="along the ring" '))
    planar(tmp_path / "run.mcap", start=4, behavior=str(tree))
    ticks = [document for topic, document in read_messages(tmp_path / "run.mcap")[1] if topic == "/tick"]
    along = [document for document in ticks if document.get("leaf") == "along the ring"]
    assert len(along) > 5
    assert all(("planned_theta" in document) is (document in along) for document in ticks)
    assert again(tmp_path / "run.mcap").identical

    def less(header, messages):  # as earlier versions wrote it
        for _, document in messages:
            document.pop("planned_theta", None)

    assert again(rewritten(tmp_path / "run.mcap", less)).identical


def test_rounding_is_no_difference(recorded):
    def change(header, messages):
        for topic, document in messages:
            if topic == "/tick":
                document["u_beta"] += 1e-12

    assert replay(rewritten(recorded[0], change)).identical
