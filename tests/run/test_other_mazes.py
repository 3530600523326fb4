"""The main job in mazes with dead ends, and with more rings, on a simulated rig; and what is said of bad starts."""

from __future__ import annotations

import math

import pytest

from mazeplan.core.errors import InputError
from mazeplan.maze.mapfile import load_map
from mazeplan.run.campaign.one_run import Campaign, run_one
from mazeplan.run.execution import navigate
from mazeplan.run.replay import replay


@pytest.fixture(scope="module")
def detour(tmp_path_factory):
    log = tmp_path_factory.mktemp("detour") / "detour.mcap"
    return navigate(map="detour", rig="toy", seed=9200, start_angle_deg=120.0, log=log), log


def test_it_arrives_by_a_ring_that_it_leaves_outwards_and_enters_again(detour):
    result, _ = detour
    assert (result.success, result.reason) == (True, "arrived")
    passed = [(p.ring, p.opening) for p in result.rings]
    assert passed[-1] == (4, None)
    assert [ring for ring, _ in passed][:3] == [1, 2, 3]
    assert (3, "2-3@215") in passed  # out again


def test_such_a_run_decides_the_same_in_a_replay(detour):
    _, log = detour
    found = replay(log)
    assert found.identical, found.difference
    assert found.plans > 50


def test_a_ball_in_a_dead_end_goes_back_out_and_around():
    result = navigate(start=2, map="detour", rig="ideal", seed=9200, start_angle_deg=320.0)
    assert result.success
    assert [p.opening for p in result.rings][:2] == ["1-2@325", "1-2@60"]


def test_a_start_in_a_wall_is_refused_and_a_drawn_one_moved():
    with pytest.raises(InputError, match="start angle: got 99, where a radial wall leaves the ball no room in ring 1"):
        navigate(map="detour", rig="ideal", start_angle_deg=99.0)
    maze = load_map("detour")
    job = Campaign(map="detour", seed=9200).job_of(2)
    assert job.goal == 4
    assert job.theta is not None
    placed = maze.clear_angle(1, job.theta)
    assert math.degrees(job.theta) == pytest.approx(101.25)
    assert math.degrees(placed) == pytest.approx(106.9, abs=0.2)
    started = run_one(Campaign(rig="ideal", map="detour", time_limit=0.1), 2).start  # what is told of it, too
    assert started is not None
    assert started.theta == placed
