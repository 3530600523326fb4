"""One verdict from several rings, against what an old log shows, too."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from mazeplan.diagnosis.merge import Evidence, evidence, merge


def ring(gains, effects=()):
    """A diagnosis as far as it is looked at: gain of each candidate by itself, and effects seen without the ball."""
    ranked = [
        SimpleNamespace(
            candidate=SimpleNamespace(
                name=name,
                parameters={"p": SimpleNamespace(unit="1")},
                depends_on=("beta",),
                placebo=False,
                named=True,
                places=(),
            ),
            gain=gain,
            fit=SimpleNamespace(values={name: {"p": gain}}, stderr={name: {"p": 1.0}}),
        )
        for name, gain in gains.items()
    ]
    return SimpleNamespace(finding=SimpleNamespace(ranked=ranked, worth={}, unknown=None), effects=list(effects))


def test_the_rings_are_added_up_and_the_strongest_is_named_alone():
    done = merge({1: ring({"dry_friction": 40, "viscous_friction": 50}), 2: ring({"dry_friction": 90})}, 1000)
    assert done.verdict == "effect_found"
    assert done.names == ("dry_friction",)
    assert done.news["dry_friction"] == 130
    assert set(done.found) == {1, 2}


def test_what_the_old_log_shows_too_is_no_news():
    now = {2: ring({"gate_loss": 150, "sensor_delay": 60})}
    assert merge(now, 1000).names == ("gate_loss",)
    assert merge(now, 1000, Evidence(2000, {"gate_loss": 140.0})).names == ("sensor_delay",)
    assert merge({2: ring({"gate_loss": 150})}, 1000, Evidence(1000, {"gate_loss": 140.0})).verdict == "nothing_missing"


def test_of_two_that_explain_as_well_the_one_with_fewer_parameters_is_taken():
    done = merge({1: ring({"tilt_gain": 205, "rolling_inertia": 200})}, 1000)
    assert done.names == ("rolling_inertia",)
    assert done.verdict == "effect_found"
    tied = merge({1: ring({"viscous_friction": 205, "rolling_inertia": 200})}, 1000)
    assert tied.verdict == "ambiguous"
    assert tied.alike == ("rolling_inertia",)


def test_what_has_no_name_must_explain_far_more():
    assert merge({1: ring({"tilt rates": 230, "sensor_delay": 200})}, 1000).names == ("sensor_delay",)
    done = merge({1: ring({"tilt rates": 400, "sensor_delay": 200})}, 1000)
    assert done.verdict == "unknown_effect"
    assert done.names == ()
    assert done.unknown == {"depends_on": ["beta"], "description": "a force that depends on beta (tilt rates)"}


def test_what_is_seen_without_the_ball_needs_most_of_the_rings():
    play = {"name": "backlash", "parameters": {}}
    three = {1: ring({}, [play]), 2: ring({}, [play]), 3: ring({})}
    assert merge(three, 1000).names == ("backlash",)
    assert merge({1: ring({}, [play]), 2: ring({}), 3: ring({})}, 1000).verdict == "nothing_missing"


def test_evidence_is_kept_in_a_file():
    found = evidence({1: ring({"gate_loss": 20.04}), 2: ring({"gate_loss": 11.0, "dry_friction": -5.0})}, 300)
    assert found.document() == {"samples": 300, "gains": {"gate_loss": pytest.approx(31.0), "dry_friction": 0.0}}
