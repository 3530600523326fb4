"""Samples that cannot be true: passed over, told, and after half a second the rig's failure."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from test_estimator import MAZE, Played, model, wave

from mazeplan.control.estimation.estimator import Estimator
from mazeplan.control.estimation.sample_check import SampleCheck
from mazeplan.control.estimation.tilt_filter import TiltCheck
from mazeplan.core.errors import RigError
from mazeplan.core.records import Doubt, Observation

DT = 1.0 / 30.0


def sample(k, **more):
    return replace(Observation(k * DT, 0.08, 0.01, 0.0, 0.0), **more)


def test_what_is_in_order_goes_through_untouched():
    scrutiny = SampleCheck(30.0)
    for k in range(30):
        unseen = sample(k, x=None, y=None) if k % 7 == 0 else sample(k)
        assert scrutiny.admit(unseen) is unseen
        assert scrutiny.judge(set(), k * DT) == []
    assert scrutiny.doubts == []


@pytest.mark.parametrize("t", [5 * DT, 2 * DT, -1.0, math.nan, math.inf])
def test_a_time_that_does_not_go_on_is_passed_over(t):
    scrutiny = SampleCheck(30.0)
    for k in range(6):
        assert scrutiny.admit(sample(k)) is not None
        scrutiny.judge(set(), k * DT)
    assert scrutiny.admit(sample(6, t=t)) is None
    assert scrutiny.admit(sample(7)) == sample(7)
    assert scrutiny.doubts == [Doubt("clock", 5 * DT)]


def test_a_stopped_clock_fails_the_rig():
    scrutiny = SampleCheck(30.0)
    scrutiny.admit(sample(0))
    for _ in range(14):
        assert scrutiny.admit(sample(0)) is None
    with pytest.raises(RigError, match="its clock does not go on"):
        scrutiny.admit(sample(0))


def test_every_second_sample_twice_is_not():
    scrutiny = SampleCheck(30.0)
    for k in range(200):
        assert scrutiny.admit(sample(k)) is not None
        scrutiny.judge(set(), k * DT)
        assert scrutiny.admit(sample(k)) is None


def test_a_position_of_nan_is_an_unseen_ball():
    scrutiny = SampleCheck(30.0)
    for x, y in ((math.nan, 0.0), (0.0, math.inf)):
        assert scrutiny.admit(sample(scrutiny._last is not None, x=x, y=y)).seen is False
    assert scrutiny.judge(set(), DT) == [Doubt("position", DT)]


def test_a_leap_of_the_clock_is_told_and_taken():
    scrutiny = SampleCheck(30.0)
    for k in (0, 1, 5):  # three samples lost are nothing
        scrutiny.admit(sample(k))
        assert scrutiny.judge(set(), k * DT) == []
    scrutiny.admit(sample(10))
    assert scrutiny.judge(set(), 10 * DT) == [Doubt("gap", 10 * DT)]
    for k in range(20, 400, 10):  # a slow rig is not a broken one
        assert scrutiny.admit(sample(k)) is not None
        scrutiny.judge(set(), k * DT)


def test_a_lasting_doubt_of_the_tilt_fails_the_rig():
    scrutiny = SampleCheck(30.0)
    for k in range(14):
        scrutiny.admit(sample(k))
        assert scrutiny.judge({"tilt", "ball"}, k * DT) == ([Doubt("ball", 0.0), Doubt("tilt", 0.0)] if k == 0 else [])
        assert scrutiny.admit(sample(k)) is None  # the same sample once more does not hide it
    scrutiny.admit(sample(14))
    with pytest.raises(RigError, match="its tilt sensor measures no number"):
        scrutiny.judge({"tilt"}, 14 * DT)


def test_a_ball_or_plate_may_be_doubted_for_long():
    scrutiny = SampleCheck(30.0)
    for k in range(100):
        scrutiny.admit(sample(k))
        scrutiny.judge({"ball", "plate", "position", "gap"}, k * DT)
    assert len(scrutiny.doubts) == 4


# -- tilt ------------------------------------------------------------------------------------------------------------


def test_a_spike_is_not_believed_and_a_move_is():
    check = TiltCheck()
    assert check.admit(0.0, 0.0)
    assert not check.admit(math.radians(8.0), 0.0)
    assert not check.admit(math.nan, 0.0)
    assert check.admit(math.radians(0.5), 0.0)
    for k in range(20):  # faster than predicted, slower than a leap
        assert check.admit(math.radians(2.0 * k), 0.0)
    assert check.admit(math.radians(-5.0), math.radians(-4.0))  # as predicted, however far from the last one


def test_a_tilt_repeated_four_times_is_accepted():
    check, off = TiltCheck(), math.radians(10.0)
    assert check.admit(0.0, 0.0)
    assert [check.admit(off, 0.0) for _ in range(5)] == [False, False, False, True, True]
    check = TiltCheck()
    check.admit(0.0, 0.0)
    assert not any(check.admit((-1) ** k * off, 0.0) for k in range(20))  # but not what contradicts itself


def estimated(change, ticks=60):
    """Tilt errors (rad) of the estimator, and its doubts, with samples changed: change(k, observation)."""
    played, estimator, errors, doubts = Played(model(), noise=5e-4), Estimator(MAZE, model()), [], []
    for k in range(ticks):
        state = estimator.update(change(k, played.observation()))
        errors.append(max(abs(state.beta - played.z[4]), abs(state.gamma - played.z[6])))
        doubts.append(set(estimator.doubts))
        command = wave(played.t)
        estimator.sent(command, played.t)
        played.step(command)
    return np.array(errors), doubts


def test_a_missing_tilt_is_predicted_from_the_commands():
    errors, doubts = estimated(lambda k, o: replace(o, beta=math.nan) if 20 <= k < 30 else o)
    assert [bool(d) for d in doubts] == [20 <= k < 30 for k in range(60)]
    assert doubts[20] == {"tilt"}
    assert errors.max() < 2e-3


def test_spikes_of_the_tilt_sensor_do_not_reach_the_estimate():
    errors, doubts = estimated(lambda k, o: replace(o, gamma=o.gamma + 0.3 * (-1) ** k) if k % 4 == 3 else o)
    assert all(("tilt" in d) == (k % 4 == 3) for k, d in enumerate(doubts))
    assert errors.max() < 2e-3


def test_a_plate_that_does_not_follow_is_told():
    _, doubts = estimated(lambda k, o: replace(o, beta=o.beta + math.radians(2.0)) if k >= 30 else o)
    assert not any(doubts[:34])
    assert "plate" in doubts[45]
    _, doubts = estimated(lambda k, o: o)
    assert not any(doubts)


def test_a_ball_that_is_left_out_is_told():
    _, doubts = estimated(lambda k, o: replace(o, x=-o.x, y=-o.y) if k == 40 else o)
    assert [k for k, d in enumerate(doubts) if "ball" in d] == [40]


# -- units and rate --------------------------------------------------------------------------------------------------


def test_positions_in_millimetres_fail_the_rig():
    scrutiny = SampleCheck(30.0)
    assert scrutiny.admit(sample(0, x=80.0, y=10.0)).seen is False
    assert scrutiny.judge(set(), 0.0) == [Doubt("far", 0.0)]
    assert scrutiny.admit(sample(1)).seen
    scrutiny.judge(set(), DT)
    for k in range(2, 16):
        scrutiny.admit(sample(k, x=80.0, y=10.0))
        scrutiny.judge(set(), k * DT)
    scrutiny.admit(sample(16, x=80.0, y=10.0))
    with pytest.raises(RigError, match="more than 2 m from the middle: it is out, or x and y are not in m"):
        scrutiny.judge(set(), 16 * DT)


@pytest.mark.parametrize(("times", "told"), [(0.5, True), (0.85, False), (1.0, False), (1.15, False), (2.0, True)])
def test_a_wrong_sampling_rate_is_reported_once(times, told):
    scrutiny, rng = SampleCheck(30.0), np.random.default_rng(0)
    for k in range(200):
        t = times * k * DT + rng.uniform(0.0, 0.2 * DT) + (3.0 * DT if k > 50 else 0.0)  # jitter, and a leap
        scrutiny.admit(sample(k, t=t))
        scrutiny.judge(set(), t)
    assert [doubt.what for doubt in scrutiny.doubts].count("rate") == told


def test_a_picture_that_repeats_while_the_plate_turns_is_told():
    scrutiny = SampleCheck(30.0)
    for k in range(60):
        scrutiny.admit(sample(k, beta=0.05 * math.sin(0.2 * k)))
        scrutiny.judge(set(), k * DT)
    assert [doubt.what for doubt in scrutiny.doubts] == ["frozen"]


def test_a_ball_that_rests_on_a_still_plate_is_no_frozen_picture():
    scrutiny = SampleCheck(30.0)
    for k in range(90):
        scrutiny.admit(sample(k, beta=0.02 * math.sin(0.2 * k)))
        scrutiny.judge(set(), k * DT)
    assert scrutiny.doubts == []
