"""The simulated rig: physics, camera, servo."""

from __future__ import annotations

import math

import numpy as np
import pytest
from simulation import MAZE, drive, rig

from mazeplan.maze.geometry import Maze, Opening, Ring
from mazeplan.rigs.sim.simulated import SimulatedRig

RADIUS = MAZE.ball.radius


def thrown_at_the_wall(damping_ratio, speed=0.2):
    """Highest radial speed on the way out, lowest on the way back, and the highest the ball ever was (m/s, m)."""
    machine = rig(ring=5, contact_damping_ratio=damping_ratio, rolling_friction_m=0.0, wall_grip=0.0)
    machine.observe()
    velocity = speed * np.array([math.cos(0.3), math.sin(0.3), 0.0])
    machine.machine.set_ball(
        np.array([0.0, 0.0, RADIUS]), velocity, np.array([-velocity[1], velocity[0], 0.0]) / RADIUS
    )
    radial, top = [], 0.0
    for _ in range(12):
        machine.observe()
        x, y, z, vx, vy = machine.truth()[:5]
        radial.append((x * vx + y * vy) / max(math.hypot(x, y), 1e-3))
        top = max(top, z)
    return max(radial), min(radial), top


# -- physics ---------------------------------------------------------------------------------------------------------


def test_no_creep_on_a_slope_below_stiction():
    machine = rig(ring=5, rolling_friction_m=5e-5)  # stiction angle 0.45 deg
    drive(machine, 0.5)
    _, true = drive(machine, 10.0, math.radians(0.3), 0.0)
    settled = true[30:]
    assert np.ptp(settled[:, 0]) < 1e-4  # m in 9 s; without the noslip solver it is 10 mm and more
    assert np.hypot(*settled[-1, :2]) < 2e-3
    _, true = drive(machine, 1.0, math.radians(0.9), 0.0)
    assert np.hypot(*true[-1, :2]) > 5e-3  # above stiction it rolls


OPEN = Maze(
    "open", MAZE.ball, (Ring(1, 0.205, 0.2204), Ring(2, 0.0, 0.2)), (Opening("1-2@0", 1, 2, 0.0, 0.0153),),
    math.radians(5.0), 0.02,
)  # fmt: skip


@pytest.mark.parametrize(("axis", "direction"), [("u_beta", (1.0, 0.0)), ("u_gamma", (0.0, -1.0))])
def test_rolls_with_five_sevenths_of_gravity_away_from_walls(axis, direction):
    """Acceleration gained per tilt gained: rolling friction (MuJoCo knows none below 1e-5 m) is the same at both
    tilts."""
    gained = []
    for tilt in (math.radians(2.0), math.radians(5.0)):
        machine = SimulatedRig(OPEN, {"rolling_friction_m": 0.0})
        machine.reset(ring=2, theta=0.0, rng=np.random.default_rng(0))
        _, true = drive(machine, 0.8, **{axis: tilt})
        speed = true[10:, 3] * direction[0] + true[10:, 4] * direction[1]
        gained.append((np.polyfit(np.arange(len(speed)) / 30.0, speed, 1)[0], 9.81 * math.sin(tilt)))
    (slow, little), (fast, much) = gained
    assert (fast - slow) / (much - little) == pytest.approx(5.0 / 7.0, rel=0.01)


@pytest.mark.slow
@pytest.mark.no_cover  # it is long enough as it is
def test_no_escape_in_three_minutes_of_random_tilt():
    machine = rig(theta=1.0, wall_segments=192)
    rng, limit = np.random.default_rng(5), MAZE.tilt_limit
    lowest, highest, farthest, rings = math.inf, -math.inf, 0.0, set()
    for k in range(5_400):
        machine.observe()
        if k % 10 == 0:
            u = rng.uniform(-limit, limit, 2)
            machine.command(float(u[0]), float(u[1]))
        x, y, z = machine.truth()[:3]
        lowest, highest, farthest = min(lowest, z), max(highest, z), max(farthest, math.hypot(x, y))
        rings.add(MAZE.ring_at(math.hypot(x, y)))
    assert RADIUS - lowest < 0.2e-3
    assert highest - RADIUS < 2e-3  # it never climbs a wall
    assert farthest < MAZE.ring(1).outer_radius
    assert len(rings) >= 3


def test_a_wall_gives_back_the_set_share_of_speed():
    """A damping ratio of .22 is a restitution of about a half, of which rolling on against the floor takes part."""
    back = {ratio: -thrown_at_the_wall(ratio)[1] / 0.2 for ratio in (1.0, 0.5, 0.22, 0.1)}
    assert back[1.0] < 0.05
    assert back[1.0] < back[0.5] < back[0.22] < back[0.1] < 0.8
    assert 0.25 < back[0.22] < 0.55
    for ratio in (0.02, 0.22):
        out, _, top = thrown_at_the_wall(ratio, 0.3)
        assert out < 0.31
        assert top < RADIUS + 2e-3  # it stays on the floor


def test_wall_grip_makes_rolling_along_a_wall_slower():
    """The ball turns against the wall as well as on the floor: less of gravity goes into its motion."""
    travelled = []
    for grip in (0.0, 0.3):
        machine = rig(theta=math.radians(0.0), wall_grip=grip, rolling_friction_m=0.0)
        _, true = drive(machine, 0.5, -0.06, -0.06)  # leans inwards and along +theta
        travelled.append(math.atan2(true[-1, 1], true[-1, 0]))
    assert travelled[1] < 0.92 * travelled[0]


def test_true_velocity_is_in_the_frame_of_the_plate():
    machine = rig(theta=0.3, servo_slew_deg_s=2000.0)
    places, speeds = [], []
    for k in range(60):
        machine.observe()
        truth = machine.truth()
        places.append(truth[:2])
        speeds.append(truth[3:5])
        tilt = 0.08 if (k // 6) % 2 else -0.08
        machine.command(tilt, -tilt)
    moved = np.diff(places, axis=0) * machine.rate_hz
    mean = 0.5 * (np.array(speeds[1:]) + np.array(speeds[:-1]))
    assert np.median(np.abs(moved - mean)) < 1e-3
    data = machine.machine.gimbal.data
    data.qvel[:2] = 2.0, 0.0  # rad/s of the plate alone
    data.qvel[2:5] = np.cross([0.0, 2.0, 0.0], data.qpos[2:5])  # the ball goes with it
    assert np.allclose(machine.truth()[3:5], 0.0, atol=1e-6)


# -- camera ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("frames", [0, 2, 5])
def test_the_picture_is_late_but_the_tilt_is_not(frames):
    seen, true = drive(rig(camera_delay_frames=frames), 1.0, 0.06, -0.05)
    for k in range(frames, len(seen)):
        assert (seen[k].x, seen[k].y) == pytest.approx(tuple(true[k - frames, :2]), abs=1e-12)
        assert (seen[k].beta, seen[k].gamma) == pytest.approx(tuple(true[k, 5:]), abs=1e-12)
    assert (seen[0].x, seen[0].y) == pytest.approx(tuple(true[0, :2]))


def test_the_ball_is_lost_now_and_then_for_some_frames():
    seen, _ = drive(rig(ball_lost_probability=0.02, ball_lost_frames=4), 60.0)
    lost = np.array([o.x is None for o in seen])
    starts = np.flatnonzero(np.diff(lost.astype(int)) == 1)
    lengths = [int(np.argmin(lost[i + 1 :])) for i in starts[:-1]]
    assert 20 < len(starts) < 55  # 36 expected, less those that run into one another
    assert min(lengths) == 4


def test_calibration_errors_and_outliers():
    seen, true = drive(rig(theta=0.5, camera_offset_mm=(1.0, -2.0), camera_rotation_deg=2.0), 0.2)
    turn = math.radians(2.0)
    x, y = true[-1, :2]
    expected = (math.cos(turn) * x - math.sin(turn) * y + 1e-3, math.sin(turn) * x + math.cos(turn) * y - 2e-3)
    assert (seen[-1].x, seen[-1].y) == pytest.approx(expected)
    seen, true = drive(rig(outlier_probability=0.1), 20.0)
    far = [math.hypot(o.x - t[0], o.y - t[1]) > 5e-3 for o, t in zip(seen, true, strict=True)]
    assert 0.05 < np.mean(far) < 0.15


# -- servo -----------------------------------------------------------------------------------------------------------


def test_tilt_settles_in_time_within_the_slew_limit():
    _, true = drive(rig(servo_slew_deg_s=120.0), 0.5, math.radians(5.0), 0.0)
    beta = np.degrees(true[:, 5])
    assert beta[-1] == pytest.approx(5.0, abs=0.1)
    assert 0.1 < np.argmax(beta > 4.75) / 30.0 < 0.25
    assert np.max(np.diff(beta)) < 120.0 / 30.0 * 1.05
    _, slow = drive(rig(servo_slew_deg_s=10.0), 0.5, math.radians(5.0), 0.0)
    assert np.degrees(slow[-1, 5]) < 5.0 * 0.99


def test_command_delay_backlash_and_deadband():
    _, true = drive(rig(command_delay_ms=100.0), 0.5, 0.05, 0.0)
    assert np.all(np.abs(true[:4, 5]) < 1e-3)
    assert true[-1, 5] > 0.04
    _, true = drive(rig(backlash_deg=1.0), 0.6, 0.05, 0.0)
    assert true[-1, 5] == pytest.approx(0.05 - math.radians(0.5), abs=1e-3)
    _, true = drive(rig(deadband_deg=1.0), 0.5, math.radians(0.8), 0.0)
    assert np.all(np.abs(true[:, 5]) < 1e-3)


def test_level_drops_commands_that_are_still_on_their_way():
    machine = rig(command_delay_ms=200.0)
    machine.observe()
    machine.command(0.08, 0.08)
    machine.level()
    for _ in range(30):
        machine.observe()
    assert np.all(np.abs(machine.truth()[5:]) < 2e-3)


def test_a_leaning_table_pulls_the_ball():
    for settings, axis, sign in (({"table_x_deg": 2.0}, 1, -1.0), ({"table_y_deg": 2.0}, 0, 1.0)):
        seen, true = drive(rig(ring=5, **settings), 0.4)
        assert sign * true[-1, axis] > 2e-3
        assert abs(true[-1, 1 - axis]) < 1e-3
        assert abs(seen[-1].beta) < 1e-3
        assert abs(seen[-1].gamma) < 1e-3
