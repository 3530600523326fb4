"""One navigation end to end on a planar rig: routes, every leaf, every recovery, and what is left behind."""

from __future__ import annotations

import json
import math

import pytest
from planar_rig import PATIENT, PlanarRig, known

from mazeplan.core.logs.run_log_reader import read_log
from mazeplan.core.records import FailureKind
from mazeplan.maze.mapfile import load_map
from mazeplan.run.execution import navigate, run_job
from mazeplan.run.specification import Job, Setup

MAZE = load_map("cme")
SETUP = Setup(MAZE, known(MAZE), rig_name="planar", settings=PATIENT)


def go(start=1, goal=5, theta=0.3, mishap=None, limit=20.0, maze=MAZE, behavior="navigate", log=None, closed=()):
    rig = PlanarRig(maze, mishap=mishap)
    setup = Setup(maze, known(maze), behavior, "planar", settings=PATIENT)
    return run_job(rig, setup, Job(start, goal, theta, 0, limit, closed), log=log), rig


def kinds(result):
    return [str(failure.kind) for failure in result.failures]


def recoveries(result):
    return [failure.recovery for failure in result.failures]


@pytest.mark.parametrize(("start", "goal"), [(1, 5), (5, 1), (2, 3), (3, 2), (1, 1), (5, 5)])
def test_between_rings(start, goal):
    result, rig = go(start, goal)
    assert result.success
    assert result.reason == "arrived"
    assert rig.ring == goal
    assert next(passage.ring for passage in result.rings) == start
    assert result.rings[-1].ring == goal
    assert len(result.rings) == abs(start - goal) + 1
    assert all(passage.opening for passage in result.rings[:-1])
    assert rig.levelled


def test_stuck_ball_is_shaken_free():
    def glue(rig):
        rig.glued = 0.3 < rig.t < 1.4

    result, _ = go(mishap=glue)
    assert result.success
    assert "stuck" in kinds(result)
    assert "dither" in recoveries(result)


def test_lost_ball_is_waited_for_with_a_level_plate():
    def hide(rig):
        rig.hidden = 0.3 < rig.t < 1.6

    result, rig = go(mishap=hide)
    assert result.success
    assert kinds(result) == ["ball_lost"]
    assert recoveries(result) == ["level_plate"]
    waiting = rig.commands[round(1.1 * 30) : round(1.5 * 30)]
    assert all(command == (0.0, 0.0) for command in waiting)


def test_ball_that_fell_back_is_replanned_from_where_it_is():
    state = {"done": False}

    def knock(rig):
        if rig.ring == 3 and not state["done"]:
            state["done"] = True
            rig.place(1, 2.0)

    result, _ = go(mishap=knock)
    assert result.success
    assert {"fell_back", "wrong_ring"} & set(kinds(result))
    assert result.replans >= 1


def test_opening_that_does_not_take_the_ball_is_tried_again_then_avoided():
    plugged = math.radians(45.0)

    def plug(rig):  # a plug in one opening: the ball cannot come further in than its outer edge
        r, theta = math.hypot(rig.z[0], rig.z[1]), math.atan2(rig.z[1], rig.z[0])
        floor = MAZE.ring(1).inner_radius + MAZE.ball.radius - 1e-3
        if r < floor and abs(theta - plugged) < 0.2 and r > MAZE.ring(2).outer_radius:
            rig.z[0] *= floor / r
            rig.z[1] *= floor / r
            rig.z[2:4] = 0.0

    result, _ = go(theta=plugged, mishap=plug)
    assert result.success
    assert kinds(result).count("missed_opening") + kinds(result).count("stuck") >= 1
    assert "back_off" in recoveries(result) or "avoid_opening" in recoveries(result)
    assert result.rings[0].opening != "1-2@45"


def test_closed_openings_are_not_used_and_no_way_is_said():
    names = tuple(opening.name for opening in MAZE.openings_between(1, 2))
    result, _ = go(theta=math.radians(45.0), closed=names[:1])
    assert result.success
    assert result.rings[0].opening != names[0]
    result, _ = go(closed=names, limit=3.0)
    assert [str(f.kind) for f in result.failures] == ["no_route"]  # said once, and the run is over
    assert not result.success
    assert set(kinds(result)) <= {"no_route", "out_of_time"}
    assert result.reason == "no_route"


def test_out_of_time_is_a_failure_with_its_name():
    result, rig = go(limit=0.5)
    assert (result.success, result.reason) == (False, "out_of_time")
    assert result.failures[-1].kind is FailureKind.OUT_OF_TIME
    assert rig.levelled


def test_a_tree_that_is_skipped_ends_the_run_without_success(tmp_path):
    from mazeplan.core import resources

    text = (resources.share("behaviors") / "navigate.xml").read_text()
    for condition, arrives in (("goal &gt; 4", False), ("goal &lt; 4", True)):
        tree = tmp_path / "tree.xml"
        tree.write_text(
            text.replace(
                '<BehaviorTree ID="Navigate">\n    <Sequence',
                f'<BehaviorTree ID="Navigate">\n    <Sequence _skipIf="{condition}"',
            )
        )
        result, rig = go(4, 5, behavior=str(tree))
        assert (result.success, result.reason) == ((True, "arrived") if arrives else (False, "skipped"))
        assert rig.levelled


def test_the_log_tells_the_run(tmp_path):
    path = tmp_path / "run.mcap"
    result, rig = go(log=path)
    log = read_log(path)
    assert log.complete
    assert log.result == json.loads(json.dumps(result.json()))
    assert len(log.ticks["t"]) == len(rig.commands)
    assert log.plans
    assert {"ring", "opening", "passed"} <= {event.kind for event in log.events}


def test_interrupted_run_levels_the_plate_and_closes_the_log(tmp_path):
    def interrupt(rig):
        if rig.t > 0.5:
            raise KeyboardInterrupt

    path = tmp_path / "cut.mcap"
    rig = PlanarRig(MAZE, mishap=interrupt)
    with pytest.raises(KeyboardInterrupt):
        run_job(rig, SETUP, Job(1, 5, 0.3), log=path)
    assert rig.levelled
    log = read_log(path)
    assert log.result is not None
    assert log.result["reason"] == "interrupted"


def faulty(maze, **settings):
    from mazeplan.rigs.sim.simulated import SimulatedRig

    return SimulatedRig(maze, settings)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("faults", "kind"),
    [
        ([{"kind": "stuck", "at_s": 0.2, "duration_s": 1.2}], "stuck"),
        ([{"kind": "blackout", "at_s": 0.4, "duration_s": 1.2}], "ball_lost"),
        ([{"kind": "blocked", "opening": "1-2@45", "at_s": 0.0, "duration_s": 20.0}], None),
        ([{"kind": "push", "at_s": 0.5, "speed_m_s": 0.4, "direction_deg": 200.0}], None),
    ],
)
def test_faults_of_the_simulated_machine_are_recovered_from(faults, kind):
    rig = faulty(MAZE, faults=faults)
    start = 0.0 if kind == "stuck" else 40.0  # a ball that sticks in front of an opening is a missed opening
    result = navigate(1, 5, map=MAZE, rig=rig, model="ideal", start_angle_deg=start)
    assert result.success, result
    if kind is not None:
        assert kind in kinds(result)
        assert all(recoveries(result))
    if faults[0]["kind"] == "blocked":
        assert result.rings[0].opening != "1-2@45"
        assert kinds(result)
