"""What a simulated rig's servos, tilt sensor and camera may have that nobody told the planner: each kind shows in the
rig as its truth says."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hidden_rigs import MAZE, asked, started

from mazeplan.rigs.sim.simulated import SimulatedRig

# -- servos ----------------------------------------------------------------------------------------------------------


def settled(rig, *u, samples=24):
    """Tilt of the plate after a command was held, rad, and what the sensor says."""
    started(rig)
    for _ in range(samples):
        rig.command(*u)
        seen = rig.observe()
    return rig.truth()[5:], np.array([seen.beta, seen.gamma])


@pytest.mark.parametrize("seed", [0, 1, 2, 3])
def test_true_values_of_servo_gain_and_coupling(seed):
    rig, gain = asked("gain", seed)
    assert settled(rig, 0.05, -0.04)[0] == pytest.approx([gain["beta"] * 0.05, gain["gamma"] * -0.04], abs=3e-4)
    assert sorted(gain.values()) == [0.85, 1.0]
    rig, share = asked("coupling", seed)
    beta, gamma = 0.05 + share["beta_from_gamma"] * -0.04, -0.04 + share["gamma_from_beta"] * 0.05
    assert settled(rig, 0.05, -0.04)[0] == pytest.approx([beta, gamma], abs=3e-4)
    assert sorted(share.values()) == [0.0, 0.12]


def test_one_servo_is_slower_and_swings_as_told():
    rig, truth = asked("slow_servo", servo_slew_deg_s=2000.0)
    started(rig)
    tilts = []
    for _ in range(30):
        rig.command(0.02, 0.02)
        rig.observe()
        tilts.append(rig.truth()[5:])
    beta, gamma = np.array(tilts).T / 0.02
    zeta = truth["gamma_damping"]
    assert np.max(beta) < 1.02
    assert np.max(gamma) - 1.0 == pytest.approx(math.exp(-math.pi * zeta / math.sqrt(1.0 - zeta**2)), abs=0.02)
    peak = math.pi / (truth["gamma_natural_frequency"] * math.sqrt(1.0 - zeta**2))
    assert (np.argmax(gamma) + 1) / 30.0 == pytest.approx(peak, abs=0.03)
    assert (truth["beta_natural_frequency"], truth["beta_damping"]) == (26.0, 0.9)


def test_true_values_of_command_delay_and_deadband():
    rig, truth = asked("late_command")
    started(rig)
    angles = []
    for _ in range(12):
        rig.command(0.05, 0.0)
        rig.observe()
        angles.append(rig.truth()[5])
    rig = started(SimulatedRig(MAZE, {}))
    for i in range(12):
        rig.command(0.05, 0.0)
        rig.observe()
        if i == 6:
            prompt = rig.truth()[5]
    samples = truth["delay"] * 30.0
    assert prompt == pytest.approx(np.interp(6 + samples, range(12), angles), abs=1.5e-3)
    rig, band = asked("deadband")
    below, above = 0.9 * band["beta"], 1.1 * band["gamma"]
    assert settled(rig, below, above)[0] == pytest.approx([0.0, above], abs=3e-4)


def test_play_is_told_of_the_servo_that_has_it():
    for seed in range(4):
        rig, play = asked("backlash", seed)
        beta, gamma = (0.04 - 0.5 * play[axis] for axis in ("beta", "gamma"))
        assert settled(rig, 0.04, 0.04)[0] == pytest.approx([beta, gamma], abs=5e-4)


# -- sensors ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", [0, 1, 2, 3])
def test_the_tilt_sensor_says_its_share_of_what_is(seed):
    rig, scale = asked("tilt_scale", seed)
    true, seen = settled(rig, 0.05, -0.04)
    assert true == pytest.approx([0.05, -0.04], abs=3e-4)
    assert seen == pytest.approx([scale["beta"] * true[0], scale["gamma"] * true[1]], rel=1e-9)


def pictured(rig, theta):
    """Where the ball is seen, and where it is, as complex numbers, m."""
    started(rig, theta)
    seen, true = rig.observe(), rig.truth()
    return complex(seen.x, seen.y), complex(true[0], true[1])


@pytest.mark.parametrize("theta", [0.0, 0.7, 2.0, -1.5])
def test_the_camera_is_turned_shifted_and_scaled_as_told(theta):
    rig, truth = asked("turned_camera", 1)
    seen, true = pictured(rig, theta)
    assert seen == pytest.approx(true * complex(math.cos(truth["angle"]), math.sin(truth["angle"])), abs=1e-9)
    rig, truth = asked("shifted_camera", 1)
    seen, true = pictured(rig, theta)
    assert seen - true == pytest.approx(complex(truth["x"], truth["y"]), abs=1e-9)
    assert abs(seen - true) == pytest.approx(2.5e-3)
    rig, truth = asked("scaled_camera")
    seen, true = pictured(rig, theta)
    assert truth == {"factor": 1.025}
    assert seen == pytest.approx(1.025 * true, abs=1e-9)


def test_the_lens_bends_the_scaled_and_shifted_picture():
    rig, truth = asked("lens", camera_scale=1.02, camera_offset_mm=(3.0, -1.0), lens_mm=(5.0, 2.0))
    seen, true = pictured(rig, 0.6)
    centre = complex(truth["x"], truth["y"])
    before = 1.02 * true + complex(3e-3, -1e-3) - centre
    assert seen == pytest.approx(centre + before * (1.0 + truth["k"] * abs(before) ** 2), abs=1e-9)
    assert abs(seen - centre) / abs(before) == pytest.approx(1.0 + 5.0 * abs(before) ** 2)
    noisy, quiet = (
        pictured(SimulatedRig(MAZE, {"camera_noise_mm": 0.5, "lens_per_m2": k}), 0.6)[0] for k in (5.0, 0.0)
    )
    assert noisy - quiet == pytest.approx(5.0 * abs(true) ** 2 * true, abs=1e-9)


def test_the_true_delay_includes_the_usual_frames():
    _, truth = asked("camera", camera_delay_frames=2)
    assert truth["delay"] == pytest.approx(2.0 / 30.0 + 0.08)
