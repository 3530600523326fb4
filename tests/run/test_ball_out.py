"""A ball that leaves the maze is a failure of its own: told within 0.2 s, with a level plate, in tree, log, page and
Gymnasium alike. On a real rig a run waits until it is put back; on a simulation it ends."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import gymnasium
import numpy as np
import pytest
from planar_rig import PATIENT, PlanarRig, known
from thrown_ball import LIMIT_S, MAZE, RIGS, RIM, thrown_run, told

import mazeplan.apps.environment as room
from mazeplan.apps.view.panel import facts_html
from mazeplan.apps.view.story import moments
from mazeplan.control.estimation.rim_watch import AGREEING, SAMPLES, RimWatch, rim_of
from mazeplan.core.logs.run_log_reader import read_log, read_messages
from mazeplan.core.records import FailureKind
from mazeplan.physics.rig.sensors import Camera
from mazeplan.run.execution import run_job
from mazeplan.run.replay import replay
from mazeplan.run.specification import PUT_BACK_S, Job, Setup

HERE = Path(__file__).resolve().parent


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


@pytest.mark.parametrize("flown", [(OUTSIDE, OUTSIDE, None), (OUTSIDE, None, OUTSIDE), (None, OUTSIDE, OUTSIDE)])
def test_a_ball_that_flies_out_of_the_picture_is_out_and_stays_so(flown):
    watch = RimWatch(MAZE, 0.5e-3)
    assert seen_at(INSIDE, *flown, watch=watch) == [False] * SAMPLES + [True]
    assert all(seen_at(*[None] * 99, watch=watch))


def test_a_ball_is_in_again_when_it_was_seen_so_as_often_in_a_row():
    watch = RimWatch(MAZE, 0.5e-3)
    assert seen_at(*[OUTSIDE] * SAMPLES, watch=watch)[-1]
    assert all(seen_at(*([INSIDE] * (SAMPLES - 1) + [OUTSIDE]) * 5, watch=watch))
    assert all(seen_at(None, None, INSIDE, watch=watch))
    assert seen_at(INSIDE, watch=watch) == [False]
    assert seen_at(*[OUTSIDE] * SAMPLES, watch=watch) == [False] * (SAMPLES - 1) + [True]
    assert seen_at(*[INSIDE] * SAMPLES, watch=watch) == [True] * (SAMPLES - 1) + [False]


def test_beyond_is_past_the_middle_of_the_rim_by_more_than_the_noise():
    for sigma, margin in ((0.5e-3, 2e-3), (1e-3, 4e-3)):
        at = rim_of(MAZE) + margin
        assert not any(seen_at(*[at - 1e-6] * 9, sigma=sigma))
        assert seen_at(*[at + 1e-6] * SAMPLES, sigma=sigma)[-1]
    most = MAZE.rings[0].outer_radius - MAZE.ball.radius  # where the centre of a ball in ring 1 can be
    assert rim_of(MAZE) - most > 8e-3


def test_it_is_known_since_when_and_where_the_ball_is_out():
    watch = RimWatch(MAZE, 0.5e-3)
    for k, r in enumerate([0.09, 0.11, 0.09, 0.11, 0.12, 0.13, 0.14]):
        out = watch.update(k / 30.0, (0.0, -r))
    assert out.since == pytest.approx(3 / 30.0)
    assert (out.x, out.y) == pytest.approx((0.0, -0.14))
    assert out.message == "the ball has left the maze: it is 41 mm beyond the rim"


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


def test_a_camera_that_is_known_to_be_off_sees_no_ball_outside():
    class Shifted(PlanarRig):
        def observe(self):
            sample = super().observe()
            return replace(sample, x=sample.x + 0.02)

    off = replace(known(MAZE), camera=Camera(offset_x=0.02))
    assert MAZE.track_radius(1) * math.cos(0.3) + 0.02 > rim_of(MAZE) + 2e-3
    assert driven(Shifted(MAZE), model=off).success
    assert driven(Shifted(MAZE)).reason == "ball_out"


@pytest.mark.slow
def test_a_log_from_before_decides_as_it_did(tmp_path):
    """Nobody asked then whether the ball is out: its header does not say how long it may be."""
    log = tmp_path / "run.mcap"
    rig = Table()
    rig.realtime = False
    result = driven(rig, log, out_s=None)
    assert result.reason != "ball_out"
    assert "out_s" not in read_log(log).header["replay"]
    outcome = replay(log, model=known(MAZE))
    assert outcome.identical, outcome.difference


# -- where it is read -------------------------------------------------------------------------------------------------


def test_the_page_says_it_in_plain_words(tmp_path):
    log = tmp_path / "run.mcap"
    driven(Table(), log)
    page = facts_html(moments(read_messages(log)[1])[-1])
    assert "ball_out" in page
    assert "the ball has left the maze: it is 32 mm beyond the rim" in page
    assert "level_plate" in page


def test_an_episode_of_the_environment_ends_and_says_so(monkeypatch):
    monkeypatch.syspath_prepend(HERE)
    for name, out in (("Leaving", True), ("Blinking", False)):
        env = gymnasium.make(room.ID, rig=f"leaving_rig:{name}", start_ring=1)
        _, info = env.reset(seed=0)
        assert info["ball_out"] is False
        ends = []
        for _ in range(20):
            *_, terminated, _, info = env.step(np.zeros(2, dtype=np.float32))
            ends.append((terminated, info["ball_out"]))
            if terminated:
                break
        assert ends[-1] == (out, out)
        assert (len(ends) == 9 + SAMPLES) is out  # outside from the tenth on
        assert not any(ended for ended, _ in ends[:-1])
        env.close()
