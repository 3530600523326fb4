"""A ball that leaves the maze is a failure of its own: told within 0.2 s, with a level plate, in tree, log, page and
Gymnasium alike. On a real rig a run waits until it is put back; on a simulation it ends."""

from __future__ import annotations

import math

import pytest
from planar_rig import PATIENT, PlanarRig, known
from thrown_ball import LIMIT_S, MAZE, RIGS, RIM, thrown_run, told

from mazeplan.control.estimation.sample_check import AGREEING, SAMPLES, RimWatch, rim_of
from mazeplan.core.logs.run_log_reader import read_log
from mazeplan.core.records import FailureKind
from mazeplan.run.execution import run_job
from mazeplan.run.replay import replay
from mazeplan.run.specification import PUT_BACK_S, Job, Setup

# -- on simulated rigs: ten of ten ------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(10))
def test_ten_of_ten_balls_that_jump_over_the_rim_are_told_within_a_fifth_of_a_second(seed, tmp_path):
    rig, result = thrown_run(RIGS[seed % 3], seed, tmp_path / "run.mcap")
    assert (result.success, result.reason) == (False, "ball_out")
    failure = told(result)
    assert 0.0 < failure.t - rig.passed_at <= LIMIT_S
    assert (failure.where, failure.recovery) == ("BallSeen", "level_plate")
    assert math.hypot(failure.x, failure.y) > rim_of(MAZE)
    assert result.time_s == pytest.approx(failure.t, abs=1e-6)  # at once: nobody puts it back
    log = read_log(tmp_path / "run.mcap")
    assert log.result["reason"] == "ball_out"
    assert (log.ticks["u_beta"][-1], log.ticks["u_gamma"][-1]) == (0.0, 0.0)


# -- what the watch believes ------------------------------------------------------------------------------------------


def seen_at(*radii, watch=None, sigma=0.5e-3):
    """Whether the ball counts as out after each sample; None: not seen."""
    watch = watch or RimWatch(MAZE, sigma)
    return [watch.update(k / 30.0, None if r is None else (r, 0.0)) is not None for k, r in enumerate(radii)]


INSIDE, OUTSIDE = MAZE.track_radius(1), RIM + 0.01


def test_fewer_wrong_positions_in_a_row_than_decide_are_no_ball_outside():
    assert not any(seen_at(*([INSIDE] + [OUTSIDE] * (SAMPLES - 1)) * 20))
    assert not any(seen_at(INSIDE, *[OUTSIDE, None, None, None] * 20))  # one, and nothing for a while
    assert seen_at(INSIDE, *[OUTSIDE] * SAMPLES) == [False] * SAMPLES + [True]
    assert (SAMPLES - 1) / 30.0 < 0.5 * LIMIT_S


def test_a_ball_is_in_again_when_it_was_seen_so_as_often_in_a_row():
    watch = RimWatch(MAZE, 0.5e-3)
    assert seen_at(*[OUTSIDE] * SAMPLES, watch=watch)[-1]
    assert all(seen_at(*([INSIDE] * (SAMPLES - 1) + [OUTSIDE]) * 5, watch=watch))
    assert all(seen_at(None, None, INSIDE, watch=watch))
    assert seen_at(INSIDE, watch=watch) == [False]
    assert seen_at(*[OUTSIDE] * SAMPLES, watch=watch) == [False] * (SAMPLES - 1) + [True]
    assert seen_at(*[INSIDE] * SAMPLES, watch=watch) == [True] * (SAMPLES - 1) + [False]


# -- a real rig -------------------------------------------------------------------------------------------------------


class Table(PlanarRig):
    """The light rig as one in real time, whose ball lies beside the maze from `out_at` until somebody puts it back into
    ring 2; hidden: it cannot be seen there after a moment."""

    realtime = True

    def __init__(self, out_at=0.5, back_at=math.inf, hidden=False, unseen_s=None):
        super().__init__(MAZE, mishap=self._lie)
        self.out_at, self.back_at, self.hides, self.unseen_s = out_at, back_at, hidden, unseen_s
        self.at = []

    def _lie(self, _):
        out = self.out_at - 1e-6 <= self.t < self.back_at - 1e-6
        if out:
            self.put(RIM + 0.03, 1.0)
        elif self.at and self.at[-1]:
            self.place(2, 2.0)
        self.hidden = self.hides and out and self.t > self.out_at + 0.5
        self.at.append(out)


def driven(rig, log=None, goal=5, model=None, **more):
    setup = Setup(MAZE, model or known(MAZE), rig_name="planar", settings=PATIENT, **more)
    return run_job(rig, setup, Job(1, goal, 0.3), log=log)


@pytest.mark.slow
@pytest.mark.parametrize("hidden", [False, True])
def test_a_real_rig_waits_level_until_the_ball_is_put_back_and_goes_on(tmp_path, hidden):
    rig, log = Table(back_at=4.0, hidden=hidden, unseen_s=2.0), tmp_path / "run.mcap"
    result = driven(rig, log)
    assert result.success
    (failure,) = result.failures
    assert (failure.kind, failure.recovery) == (FailureKind.BALL_OUT, "level_plate")
    assert failure.t == pytest.approx(0.5 + (SAMPLES - 1) / 30.0, abs=1e-6)
    began, back = round(30 * failure.t), round(30 * 4.0) + (AGREEING if hidden else SAMPLES) - 1
    assert set(rig.commands[began:back]) == {(0.0, 0.0)}
    assert rig.commands[began - 1] != (0.0, 0.0)
    assert rig.commands[back] != (0.0, 0.0)
    assert [ring.ring for ring in result.rings][-3:] == [3, 4, 5]
    outcome = replay(log, model=known(MAZE))
    assert outcome.identical, outcome.difference


@pytest.mark.parametrize("hidden", [False, True])
def test_a_ball_that_nobody_puts_back_ends_the_run_of_a_real_rig(tmp_path, hidden):
    rig, log = Table(hidden=hidden, unseen_s=2.0), tmp_path / "run.mcap"
    result = driven(rig, log)
    assert (result.success, result.reason) == (False, "ball_out")
    assert result.time_s == pytest.approx(0.5 + PUT_BACK_S, abs=0.04)
    assert [f.kind for f in result.failures] == [FailureKind.BALL_OUT]
    assert rig.levelled
    assert replay(log, model=known(MAZE)).identical


@pytest.mark.parametrize("goal", [1, 5])  # the estimate of a ball outside is in ring 1, for it knows walls
def test_a_tree_that_does_not_ask_is_told_all_the_same_and_has_not_arrived(tmp_path, goal):
    tree = tmp_path / "blind.xml"
    tree.write_text(
        '<root BTCPP_format="4"><BehaviorTree ID="Main"><Delay delay_msec="6000"><AlwaysSuccess/></Delay>'
        "</BehaviorTree></root>"
    )
    result = driven(Table(), tmp_path / "run.mcap", goal=goal, behavior=str(tree))
    assert (result.success, result.reason) == (False, "elsewhere")
    first, last = result.failures
    assert (first.kind, first.where) == (FailureKind.BALL_OUT, "run")
    assert first.t == pytest.approx(0.5 + (SAMPLES - 1) / 30.0, abs=1e-6)
    assert last.words == f"the tree succeeded with the ball out of the maze, the goal is ring {goal}"
    assert replay(tmp_path / "run.mcap", model=known(MAZE)).identical


def test_one_or_two_wrong_positions_change_nothing():
    def jump(rig):
        wrong = 12 <= round(30 * rig.t) < 12 + SAMPLES - 1
        rig.glued = wrong  # the ball stays where it is while it is seen elsewhere
        rig.hold = rig.z[:2].copy() if round(30 * rig.t) == 11 else getattr(rig, "hold", None)
        if wrong:
            rig.z[:2] = 0.0, -(RIM + 0.02)
        elif rig.hold is not None and round(30 * rig.t) == 12 + SAMPLES - 1:
            rig.z[:2] = rig.hold

    result = run_job(PlanarRig(MAZE, mishap=jump), Setup(MAZE, known(MAZE), settings=PATIENT), Job(1, 5, 0.3))
    assert result.success
    assert FailureKind.BALL_OUT not in {f.kind for f in result.failures}


# -- where it is read -------------------------------------------------------------------------------------------------
