"""Two balls on one plate, both to the centre."""

from __future__ import annotations

import json
from dataclasses import replace

import pytest
from commands import call as run_command
from planar_rig import PATIENT

import mazeplan
from mazeplan.core.records import FailureKind
from mazeplan.maze.mapfile import check_text, dump_map, load_map
from mazeplan.rigs.registry import make_rig
from mazeplan.rigs.sim.settings import Fault
from mazeplan.run.replay import replay

CME = load_map("cme")
TWO = replace(CME, balls=2)


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A run on the toy: its result and its log."""
    log = tmp_path_factory.mktemp("two") / "run.mcap"
    return mazeplan.navigate(rig="toy", balls=2, seed=2, log=log), log


def test_both_balls_come_to_the_centre(run):
    result, _ = run
    assert result.success, result.reason
    assert [p.ring for p in result.rings][-1] == 5
    (other,) = result.others
    assert other.ball == 2
    assert [p.ring for p in other.rings][::4] == [1, 5]
    assert result.json()["others"][0]["rings"][0]["opening"].startswith("1-2@")


@pytest.mark.slow
def test_a_run_with_two_balls_is_replayed(run):
    outcome = replay(run[1])
    assert outcome.identical, outcome.difference
    assert outcome.ticks > 100


class Robbed:
    """A rig from whose centre a ball is taken while the other one is led."""

    def __init__(self, rig, ball):
        self._rig, self._ball, self.taken_at = rig, ball, None

    def __getattr__(self, name):
        return getattr(self._rig, name)

    def observe(self):
        sample, rig = self._rig.observe(), self._rig
        inside = [CME.ring_at(float((scene[:2] ** 2).sum()) ** 0.5) == 5 for scene in rig.machine.scenes()]
        if self.taken_at is None and inside == [self._ball == 1, self._ball == 2]:
            self.taken_at = sample.t + 0.5
            rig.inject(Fault(kind="teleport", at_s=self.taken_at, ball=self._ball, ring=3, direction_deg=90.0))
        return sample


@pytest.mark.slow
@pytest.mark.parametrize(("ball", "angle"), [(1, 120.0), (2, 270.0)])  # so that this one is led first
def test_a_ball_that_leaves_the_centre_is_noticed_and_brought_back(ball, angle):
    rig = Robbed(make_rig("ideal", TWO), ball)
    way = {"model": "ideal", "seed": 8, "start_angle_deg": angle, "time_limit": 30.0, "settings": PATIENT}
    result = mazeplan.navigate(rig=rig, map=TWO, **way)
    left = [failure for failure in result.failures if failure.kind is FailureKind.LEFT_THE_CENTRE]
    assert rig.taken_at is not None
    assert result.success, result.reason
    assert left
    assert 0.0 <= left[0].t - rig.taken_at < 0.3
    assert left[0].words == f"ball {ball} left ring 5 for ring 3"
    assert left[0].recovery == "replan"
    noticed = sum(failure.words.startswith(f"ball {ball} ") for failure in left)
    assert [p.ring for p in (result.rings, result.others[0].rings)[ball - 1]].count(5) == 1 + noticed


def test_a_map_says_how_many_balls_there_are():
    text = dump_map(TWO)
    assert "balls: 2" in text
    assert check_text(text).maze == TWO
    assert "balls" not in dump_map(CME)
    (error,) = check_text(text.replace("balls: 2", "balls: 3")).errors
    assert error.key == "balls"
    assert "got 3" in str(error)


@pytest.mark.parametrize(
    ("more", "said"),
    [
        (("--to", "ring3"), "balls: got 2, expected 1 on the way to ring 3"),
        (("--via", "ring3"), "balls: got 2, expected 1 with waypoints"),
        (("--rig", "hardware"), "balls: got 2, expected 1: the rig has no more"),
    ],
)
def test_what_cannot_be_done_with_two_balls_is_refused(call, more, said):
    status, out, err = call("navigate", "--balls", "2", *more)
    assert (status, out) == (2, "")
    assert said in err
    assert len(err.strip().splitlines()) == 1


@pytest.fixture
def call(monkeypatch, capsys):
    """Run a command; exit status, stdout and stderr."""
    return lambda *words: run_command(monkeypatch, capsys, *words)


@pytest.mark.slow
def test_a_campaign_brings_two_balls(call):
    status, out, _ = call("evaluate", "--balls", "2", "--rig", "ideal", "--runs", "2", "--json")
    document = json.loads(out)
    assert (status, document["success"]) == (0, 2)
    assert "balls: 2" in document["setup"]["map"]
    assert document["setup"]["behavior"] == "two_balls"
    assert all(result["others"][0]["rings"][-1]["ring"] == 5 for result in document["results"])
