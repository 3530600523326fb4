"""Campaigns with faults: what a run with a fault becomes, what is counted, and what must never be."""

from __future__ import annotations

import itertools
from dataclasses import replace

import pytest
from planar_rig import PATIENT, PlanarRig, known

from mazeplan.core.errors import RigError
from mazeplan.maze.mapfile import load_map
from mazeplan.rigs.faults.schedule import Entry, FaultTrial
from mazeplan.run.campaign.executor import open_executor
from mazeplan.run.campaign.one_run import Campaign, do_run
from mazeplan.run.commands.evaluate import good, report, run_all
from mazeplan.run.execution import run_job
from mazeplan.run.specification import Job, Setup

MAZE = load_map("cme")
SHORT = Campaign(runs=1, rig="ideal", start=3, seed=40)


def trial(kind, name=None, **values):
    return FaultTrial(name or kind, (Entry(kind=kind, **values),))


def run_trial(campaign, trial):
    return do_run(replace(campaign, fault=trial), 0)


def early(kind, **values):
    """Soon enough for the short way from ring 3."""
    return trial(kind, at_s=(0.2, 0.4), **values)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "noticed", "within"),
    [
        ("frames_lost", "ball_lost", 0.6),
        ("position_nan", "doubt position", 0.04),
        ("frames_duplicated", "doubt clock", 0.2),
        ("tilt_nan", "doubt tilt", 0.04),
        ("clock_jump", "doubt gap", 0.04),
        ("ball_elsewhere", "doubt ball", 0.2),
        ("brown_out", "doubt plate", 0.4),
        ("opening_closed", "opening_closed", 0.04),
    ],
)
def test_what_is_got_over_and_as_what_it_is_noticed(kind, noticed, within):
    outcome = run_trial(SHORT, early(kind))
    assert outcome.result.success, outcome
    assert outcome.noticed.wrong == ()
    assert [fault["kind"] for fault in outcome.noticed.faults] == [kind]
    assert outcome.noticed.noticed_as == noticed
    assert 0.0 <= outcome.noticed.noticed_s <= within


@pytest.mark.parametrize(
    ("kind", "reason", "within"),
    [
        ("tilt_dead", "rig_failed", 0.04),
        ("clock_stopped", "rig_failed", 0.04),
        ("observe_raises", "rig_failed", 0.04),
        ("observe_hangs", "rig_failed", 2.0),  # by the wall: the watchdog waits for half a second
        ("openings_closed", "no_route", 0.04),
    ],
)
def test_what_ends_a_run_ends_it_with_its_reason_and_a_level_plate(kind, reason, within):
    outcome = run_trial(SHORT, early(kind))
    assert not outcome.result.success
    assert outcome.result.reason == reason
    assert outcome.noticed.wrong == ()
    assert outcome.noticed.noticed_s <= within
    row = report(early(kind), [outcome])
    assert (row["arrived"], row["stopped"], row["as_expected"]) == (0, {reason: 1}, 1)
    assert good([row])
    assert not row["survivable"]


@pytest.mark.slow
def test_the_same_for_any_number_of_workers_and_in_the_order_of_the_trials(tmp_path):
    patient = tmp_path / "patient.yaml"
    patient.write_text("travel: {deadline_ms: 1e6}\n")
    campaign = replace(SHORT, runs=2, settings=str(patient))
    trials, finished = (early("tilt_nan"), early("position_nan")), []

    def same(outcomes):
        return [
            [(o.result.time_s, o.result.rings, o.noticed.faults, o.noticed.noticed_s, o.result.seed) for o in of]
            for of in outcomes
        ]

    campaigns = [replace(campaign, fault=trial) for trial in trials]
    with open_executor(1) as here, open_executor(2) as apart:
        alone = run_all(campaigns, here, progress=finished.append)
        assert finished == [1, 2, 3, 4]
        assert same(run_all(campaigns, apart)) == same(alone)
    assert [[o.noticed.faults[0]["kind"] for o in of] for of in alone] == [["tilt_nan"] * 2, ["position_nan"] * 2]
    assert [o.result.seed for o in alone[0]] == [40, 41]


class Restless(PlanarRig):
    """Says that its plate is not level after `level`."""

    def __init__(self, maze, settings=None):
        super().__init__(maze)
        self.tilt = 0.0

    def level(self):
        super().level()
        self.tilt = 0.02

    def observe(self):
        return replace(super().observe(), beta=self.z[4] + self.tilt)


def planar_campaign(rig):
    return Campaign(map=MAZE, rig=rig, model=known(MAZE), settings=PATIENT, start=4, seed=3)


@pytest.mark.slow
def test_a_plate_that_is_not_level_afterwards_is_wrong():
    campaign = planar_campaign(Restless(MAZE))
    outcome = run_trial(campaign, early("commands_lost"))
    assert outcome.result.success
    assert outcome.noticed.wrong == ("the plate was left at 1.15 deg",)
    row = report(early("commands_lost"), [outcome])
    assert row["wrong"] == ["seed 3: the plate was left at 1.15 deg"]
    assert not good([row])


def test_a_program_that_hangs_is_wrong(monkeypatch):
    rig = PlanarRig(MAZE)
    campaign = planar_campaign(rig)
    wall = iter(itertools.chain([0.0] * 20, itertools.repeat(6.5)))  # from one reading on, the clock is 6.5 s later
    monkeypatch.setattr("mazeplan.rigs.faults.faulty.monotonic", lambda: next(wall))
    outcome = run_trial(replace(campaign, time_limit=1.0), early("commands_lost"))
    assert outcome.noticed.wrong == ("no call of the rig for 6.5 s",)


class Failing(PlanarRig):
    def observe(self):
        sample = super().observe()
        if self.t > 0.5:
            raise RigError("smoke")
        return sample


def test_a_rig_that_fails_is_a_result_of_its_own():
    setup, job = Setup(MAZE, known(MAZE), rig_name="planar", settings=PATIENT), Job(1, 5, 0.3)
    with pytest.raises(RigError, match="smoke") as caught:
        run_job(Failing(MAZE), setup, job)
    result = caught.value.result
    assert (result.success, result.reason) == (False, "rig_failed")
    assert result.failures[-1].words == "smoke"
    assert result.time_s == pytest.approx(0.5, abs=0.02)
