"""What a simulated rig may have that nobody told the planner: each kind shows in the rig as its truth says, and every
effect that mazeplan names is in a kind. Nothing of mazeplan's physics is asked but the effects' names and bounds."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hidden_effects import KINDS
from hidden_rigs import BALL, BARE, MAZE, OUTER, R, asked, change_of, gained, gained_by, plain, rolled, started, thrown

from mazeplan.physics.registry import PACKAGED
from mazeplan.rigs.files import validated
from mazeplan.rigs.sim.settings import SimulatedSettings
from mazeplan.rigs.sim.simulated import SimulatedRig

NO_KIND = {
    **dict.fromkeys(
        ("outer_gates", "inner_gates", "outer_edges", "inner_edges"),
        "edges of openings are walls, which every rig with contacts has: there is none without them to compare with",
    ),
    "rate_limit": "torque limits the servos of the packaged rigs; `test_stage_effects` has a limited rate",
}


# -- the table of kinds ----------------------------------------------------------------------------------------------


def test_every_effect_has_a_kind_or_a_reason():
    told = {kind.effect for kind in KINDS.values()}
    assert told.isdisjoint(NO_KIND)
    assert told | NO_KIND.keys() == set(PACKAGED)


@pytest.mark.parametrize("name", KINDS)
def test_true_parameters_are_within_the_bounds_of_the_effect(name):
    for seed in range(5):
        found = change_of(name, seed)
        assert found.by_ring
        assert found.by_ring.keys() >= found.known_before.keys()
        for values in found.by_ring.values():
            PACKAGED[found.effect](**values)  # raises for unknown names and beyond the bounds
        assert found.by_ring != found.known_before, "something is otherwise"
        validated(SimulatedSettings, found.changes)  # within the bounds of the settings


# -- what slows and pushes the ball ----------------------------------------------------------------------------------


@pytest.mark.parametrize("upright", [0.0, 1.0])
def test_drag_takes_its_share_of_the_speed(upright):
    left = []
    for settings in ({}, change_of("viscous").changes):
        rig = started(SimulatedRig(MAZE, {"rolling_friction_m": 0.0, "wall_grip": upright, **settings}))
        thrown(rig, 0.15, at=OUTER, upright=upright)
        _, v = rolled(rig, 12)
        left.append(v[-1])
    assert math.log(left[0] / left[1]) / 0.4 == pytest.approx(0.3, rel=0.1)
    assert change_of("viscous").parameters == {"coefficient": 0.3}


def test_drag_of_air_grows_with_the_square_of_the_speed():
    for speed in (0.1, 0.2):
        slower, at, truth = gained_by("air", speed)
        assert -slower / R == pytest.approx(truth["coefficient"] * (at / R) ** 2, rel=0.08)


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_a_steady_push_is_as_large_everywhere_and_both_ways(seed):
    for theta, speed in ((0.1, 0.1), (2.5, 0.1), (0.1, -0.1)):
        faster, _, truth = gained_by("push", speed, seed, theta=theta)
        assert faster / R == pytest.approx(truth["acceleration"], rel=0.05)


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_nap_slows_the_ball_one_way_round_alone(seed):
    """Rolling friction of the floor alone: 1e-5 m of it is MuJoCo's least."""
    forwards, backwards = (gained_by("nap", speed, seed) for speed in (0.1, -0.1))
    mean = 0.5 * (backwards[0] - forwards[0]) / R
    more = 0.5 * (-backwards[0] - forwards[0]) / R
    assert abs(more) == pytest.approx(mean, rel=0.1)
    assert more == pytest.approx(forwards[2]["asymmetry"], rel=0.15)
    assert mean == pytest.approx(forwards[2]["coefficient"], rel=0.15)


def test_a_sticky_part_slows_and_holds_the_ball():
    for seed in range(10):
        rig, truth = asked("sticky", seed, **BARE)
        if truth["ring"] == 1:
            break
    middle = 0.5 * (truth["start"] + truth["end"])
    slower, _, _ = gained_by("sticky", 0.1, seed, theta=middle - 0.15)
    assert -slower / R == pytest.approx(truth["coefficient"], rel=0.1)
    beside, _, _ = gained_by("sticky", 0.1, seed, theta=truth["end"] + 0.1)
    assert beside == pytest.approx(0.0, abs=1e-9)
    inside, _, _ = gained_by("sticky", 0.1, seed, theta=middle - 0.15, samples=40)
    assert inside < 0.0
    thrown(started(rig, middle), 0.0, middle)
    u = 0.5 * 0.15 * 7.0 / 5.0 / 9.81  # half of what it holds
    angle, v = rolled(rig, 20, (-u * math.sin(middle), -u * math.cos(middle)))
    assert R * abs(angle[-1] - angle[0]) < 5e-6
    thrown(started(rig, middle), 0.0, middle)
    assert np.array_equal(rolled(rig, 20, (-u * math.sin(middle), -u * math.cos(middle))), (angle, v)), "begun anew"


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_a_kerb_takes_its_share_once_where_it_is(way):
    for seed in range(10):
        rig, truth = asked("kerb", seed, **BARE)
        if rig.settings.kerb_ring == 1:
            break
    there = truth["angle"] - way * 0.1
    speeds = []
    for machine in (rig, plain(rig, "kerb")):
        thrown(started(machine, there), way * 0.12, there)
        angle, v = rolled(machine, 6)
        speeds.append(v)
    past = way * (angle - angle[0]) > 0.1 + 0.02
    before = way * (angle - angle[0]) < 0.1 - 0.05
    assert np.any(past)
    assert speeds[0][before] == pytest.approx(speeds[1][before])
    assert speeds[0][past] / speeds[1][past] == pytest.approx(1.0 - truth["loss"], abs=0.02)


def test_wall_friction_grows_with_the_force_on_the_wall():
    """The faster it goes round, the more: with the square of the speed."""
    for speed in (0.2, 0.3):
        found = []
        for settings in ({}, change_of("wall").changes):
            rig = started(SimulatedRig(MAZE, {"rolling_friction_m": 0.0, "wall_grip": 1.0, **settings}))
            thrown(rig, speed, at=OUTER, upright=1.0)
            _, v = rolled(rig, 20)
            found.append((v[-1] - v[3]) * 30.0 / 17.0)
        truth = change_of("wall").parameters["coefficient"]
        assert found[0] - found[1] == pytest.approx(truth * float(np.mean(v[3:] ** 2)) / OUTER, rel=0.15)


def test_a_draught_pushes_as_a_slope_does():
    rig, truth = asked("draught", 3, **BARE)
    size = math.hypot(truth["x"], truth["y"])
    where = math.atan2(truth["y"], truth["x"]) - math.pi / 2  # counter-clockwise is with the wind
    there, _ = gained(rig, 0.05, theta=where)
    back, _ = gained(rig, 0.05, theta=where + math.pi)
    assert 0.5 * (there - back) == pytest.approx(5.0 / 7.0 * size, rel=0.05)
    turned = started(SimulatedRig(MAZE, {"draught_m_s2": (0.0, 0.0), "table_y_deg": math.degrees(size / 9.81), **BARE}))
    same, _ = gained(turned, 0.05, theta=-math.pi / 2)
    assert 0.5 * (there - back) == pytest.approx(same - gained(SimulatedRig(MAZE, BARE), 0.05)[0], rel=0.05)


@pytest.mark.parametrize("phase", [30.0, 90.0, -60.0])
def test_an_unbalanced_ball_falls_towards_its_heavy_side(phase):
    """At rest at once; rolling, forth and back in every turn of its own."""
    size, start, bare = 0.15, math.radians(phase), SimulatedRig(MAZE, BARE)
    rig = SimulatedRig(MAZE, {"imbalance_m_s2": size, "imbalance_phase_deg": phase, **BARE})
    for theta in (0.1, 2.0):
        more = gained(rig, 0.0, 1, theta)[0] - gained(bare, 0.0, 1, theta)[0]
        assert more == pytest.approx(size * math.sin(start), abs=0.012)  # MuJoCo's least rolling friction is 1e-5 m
    speed, t, found = 0.2, np.arange(16) / 30.0, []
    for other in (rig, bare):
        thrown(started(other), speed)
        found.append(rolled(other, 15)[1])
    expected = size * BALL / speed * (math.cos(start) - np.cos(start + speed / BALL * t))
    assert found[0] - found[1] == pytest.approx(expected, abs=0.15 * np.ptp(expected))


def test_a_wavy_floor_pushes_off_its_crests():
    rig, truth = asked("ripple", 2, **BARE)
    n = rig.settings.ripple_waves
    for part in (0.1, 0.25, 0.6):
        theta = part * math.tau / n
        faster, _, _ = gained_by("ripple", 0.02, 2, theta=theta, samples=1)
        expected = truth[f"cos{n}"] * math.cos(n * theta) + truth[f"sin{n}"] * math.sin(n * theta)
        assert faster / R == pytest.approx(expected, abs=0.2)
    crest = math.radians(rig.settings.ripple_deg)
    assert gained(rig, 0.0, 3, theta=crest + 0.1)[0] > 0.0
    assert gained(rig, 0.0, 3, theta=crest - 0.1)[0] < 0.0


# -- the seven that are drawn: their true values ---------------------------------------------------------------------


def test_true_values_of_a_leaning_table_and_a_hollow_ball():
    rig, truth = asked("table", 4, **BARE)
    assert change_of("table", 4).known_before[1] == {"beta": 0.0, "gamma": 0.0}
    for theta in (0.3, 1.8):
        faster = gained(rig, 0.05, theta=theta)[0] - gained(SimulatedRig(MAZE, BARE), 0.05, theta=theta)[0]
        pull = 9.81 * 5.0 / 7.0 * (-truth["beta"] * math.sin(theta + 0.05) - truth["gamma"] * math.cos(theta + 0.05))
        assert faster == pytest.approx(pull, abs=0.01)
    hollow, factor = asked("hollow", **BARE)
    down = {"theta": math.pi / 2, "u": (-0.05, 0.0), "samples": 9}
    ratio = gained(hollow, 0.0, **down)[0] / gained(plain(hollow, "hollow"), 0.0, **down)[0]
    assert ratio == pytest.approx(factor["factor"] * 7.0 / 5.0, rel=0.05)


def test_true_values_of_friction_magnet_and_saddle():
    rough, told = asked("friction", wall_grip=0.0, rolling_friction_m=1e-4)
    least = gained(SimulatedRig(MAZE, BARE))[0]  # 1e-5 m of MuJoCo's
    assert (least - gained(rough)[0]) / R == pytest.approx(told["coefficient"], rel=0.08)
    for seed in range(20):
        _, bump = asked("magnet", seed, **BARE)
        if 1 in change_of("magnet", seed).by_ring:
            break
    for side in (-1.0, 1.0):
        theta = bump["centre"] + side * bump["width"]
        pulled, _, _ = gained_by("magnet", 0.03, seed, theta=theta, samples=1)
        assert pulled / R == pytest.approx(side * bump["height"], rel=0.07)
    _, wave = asked("warp", 3)
    for theta in (0.2, 1.0):
        faster, _, _ = gained_by("warp", 0.03, 3, theta=theta, samples=3)
        there = theta + 0.5 * 0.1 * 0.03 / R
        pushed = wave["cos2"] * math.cos(2.0 * there) + wave["sin2"] * math.sin(2.0 * there)
        assert faster / R == pytest.approx(pushed, abs=0.06)
