"""Training by imitation: who drives, whose commands are the lesson, and a policy that comes out the same."""

from __future__ import annotations

import math

import numpy as np
import pytest
from policies import LIMIT, hand_made

from mazeplan.control.policy import INPUTS, load_policy, save_policy
from mazeplan.core.errors import LogError
from mazeplan.core.logs.run_log_reader import read_log
from mazeplan.run.campaign.imitation import MOST_RUNS, SEEDS, Options, Teacher, demonstrate, train
from mazeplan.run.campaign.one_run import Campaign
from mazeplan.run.commands.evaluate import results_of
from mazeplan.run.execution import navigate
from mazeplan.run.replay import replay

CAMPAIGN = Campaign(runs=1, rig="ideal", seed=SEEDS, deadline=False)
TURN, PASSING = INPUTS.index("turn"), INPUTS.index("passing")


def test_where_the_planner_drives_the_lesson_is_what_went_out():
    teacher, sent = Teacher(None), []

    def watch(tree, context):
        teacher.watch(tree, context)
        sent.append(context)

    result = navigate(1, 3, rig="ideal", seed=4, watch=watch, settings=None)
    assert result.success
    x = np.array(teacher.rows)
    assert set(x[:, PASSING]) == {0.0, 1.0}
    assert (np.abs(np.diff(x[x[:, PASSING] == 0.0][:10, TURN])) < 0.3).all()
    assert max(abs(c.u_beta) for c in teacher.commands) <= LIMIT


def test_where_the_policy_drives_the_lesson_is_still_the_planners():
    level = hand_made(near=(0.0, 0.0))  # never tilts
    taught = Teacher(level)
    sent = []

    def watch(tree, context):
        taught.watch(tree, context)
        keep = context.steer
        context.steer = lambda leaf, command: (keep(leaf, command), sent.append((leaf, context.command)))

    navigate(1, 2, rig="ideal", seed=4, watch=watch, time_limit=1.0, start_angle_deg=0.0)
    went = [command for leaf, command in sent if leaf == "Track"]
    assert went
    assert max(abs(command.u_beta) + abs(command.u_gamma) for command in went) < 0.05 * LIMIT  # the table
    assert max(math.hypot(c.u_beta, c.u_gamma) for c in taught.commands) > 0.5 * LIMIT


@pytest.mark.slow
def test_a_lesson_is_the_same_whenever_it_is_given_and_begins_in_every_ring():
    one, same = (demonstrate(CAMPAIGN, 1, None) for _ in range(2))
    assert np.array_equal(one.inputs, same.inputs)
    assert np.array_equal(one.commands, same.commands)
    assert one.arrived
    assert len(one.inputs) == len(one.commands) > 10
    assert not np.array_equal(one.inputs, demonstrate(CAMPAIGN, 2, None).inputs[: len(one.inputs)])


@pytest.mark.slow
def test_a_training_is_the_same_for_any_number_of_workers_and_its_seeds_are_no_evaluations(tmp_path):
    rounds = []
    options = (Options(2, 2, 7, workers, epochs=1, hidden=(8,)) for workers in (1, 2))
    one, other = (train(CAMPAIGN, each, tell=rounds.append) for each in options)
    assert all(np.array_equal(a[0], b[0]) for a, b in zip(one.layers, other.layers, strict=True))
    assert np.array_equal(one.centres, other.centres)
    assert one.facts == other.facts
    assert one.facts["run_seeds"] == [SEEDS + 7 * MOST_RUNS, SEEDS + 7 * MOST_RUNS + 3]
    assert rounds[1].samples == one.facts["samples"] > rounds[0].samples
    save_policy(one, tmp_path / "policy")
    assert load_policy(tmp_path / "policy").facts == one.facts


# -- runs with a policy ---------------------------------------------------------------------------------------------


@pytest.fixture
def folder(tmp_path):
    save_policy(hand_made(), tmp_path / "policy")
    return tmp_path / "policy"


def test_a_run_with_a_policy_replays_alike_and_not_with_another(tmp_path, folder):
    log = tmp_path / "run.mcap"
    assert navigate(1, 3, rig="ideal", policy=folder, log=log).success
    assert "FollowPolicy" in set(read_log(log).ticks["leaf"])
    assert replay(log).identical
    save_policy(hand_made(near=(0.0, 0.7)), folder)
    with pytest.raises(LogError, match=r"the policy .*policy is not that of the run, by its SHA-256"):
        replay(log)


@pytest.mark.slow
def test_workers_get_the_policy_and_do_what_one_process_does(folder):
    campaign = Campaign(runs=2, rig="ideal", policy=str(folder), behavior="policy", goal=3, seed=9, deadline=False)
    alone, apart = (results_of(campaign, workers=workers) for workers in (1, 2))
    assert [r.time_s for r in alone] == [r.time_s for r in apart]
    assert all(r.success and not r.planner_ms["max"] for r in apart)


def test_via_goes_by_the_policy_too(folder):
    result = navigate(1, 3, rig="ideal", policy=folder, via=(2,))
    assert [goal.ring for goal in result.goals] == [2, 3]
    assert result.success
