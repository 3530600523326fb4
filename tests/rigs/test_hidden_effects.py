"""What a simulated rig may have that its model does not know: each kind does to ball, plate and pictures what it says.

The rig's own mechanics, told in its own words: nothing here comes from the models."""

from __future__ import annotations

import math

import numpy as np
import pytest

from mazeplan.errors import SettingsError
from mazeplan.maze.mapfile import load_map
from mazeplan.physics.registry import PACKAGED
from mazeplan.rigs.registry import make_rig, rig_label
from mazeplan.rigs.settings import settings_from
from mazeplan.rigs.simulated import SimulatedRig
from mazeplan.rigs.surprise import KINDS, answer

MAZE = load_map("cme")
BARE = {"rolling_friction_m": 0.0, "wall_grip": 0.0, "floor_friction": 1.0}
NO_RIG = {  # effects that no kind has, and why
    "outer_gates": "every rig has openings",
    "outer_edges": "every rig has openings",
    "inner_gates": "every rig has openings",
    "inner_edges": "every rig has openings",
}
ROLLS = 5.0 / 7.0
FLOOR = 1e-5 / MAZE.ball.radius * 9.81 * ROLLS  # m/s^2: the least rolling friction that MuJoCo has


def rig_with(**settings):
    rig = SimulatedRig(MAZE, {**BARE, **settings})
    rig.reset(ring=1, theta=0.0, rng=np.random.default_rng(0))
    return rig


def speed_change(velocity, seconds=0.2, place=(0.0, 0.0), **settings):
    """Change of the ball's velocity (2,), m/s, rolling on the disc of ring 5 without touching a wall."""
    rig = rig_with(**settings)
    rig.observe()
    radius = MAZE.ball.radius
    vx, vy = velocity
    rig.set_ball(np.array([*place, radius]), np.array([vx, vy, 0.0]), np.array([-vy, vx, 0.0]) / radius)
    before = rig.truth()[3:5]
    for _ in range(round(30 * seconds)):
        rig.observe()
    return rig.truth()[3:5] - before


def settled(u, **settings):
    """Tilt (2,), rad, a second after a command, and the last observation."""
    rig = rig_with(**settings)
    for _ in range(31):
        o = rig.observe()
        rig.command(*u)
    return np.array(rig.truth()[5:]), o


def test_every_effect_is_on_some_rig_or_says_why_not():
    assert {kind.effect for kind in KINDS.values()} | NO_RIG.keys() == set(PACKAGED)
    for name in KINDS:
        told = answer(settings_from({"surprise": name}), MAZE)
        assert told is not None
        assert told.changes, name
        settings_from(dict(told.changes))  # as a user might write them
        assert set(told.values) <= set(PACKAGED[told.effect].parameters), name
        assert set(told.along) <= set(PACKAGED[told.effect].parameters), name


def test_a_kind_is_asked_for_by_name():
    rig = make_rig("surprise@gain", MAZE)
    assert rig.settings.servo_gain_beta == 0.85  # pyright: ignore[reportAttributeAccessIssue]
    assert rig.surprise.effect == "servo_gain"  # pyright: ignore[reportAttributeAccessIssue]
    assert rig_label("surprise@gain") == "surprise@gain"
    with pytest.raises(SettingsError, match=r"surprise: got 'nonsense', expected 'drawn', 'table'"):
        make_rig("surprise@nonsense", MAZE)


def test_drag_slows_in_proportion_to_speed_or_its_square_and_may_grow():
    free = speed_change((0.04, 0.0))[0]
    assert free == pytest.approx(-FLOOR * 0.2, rel=0.1)
    lost = speed_change((0.04, 0.0), drag_per_s=0.7)[0] - free
    assert lost == pytest.approx(0.04 * math.expm1(-0.7 * ROLLS * 0.2), rel=0.03)
    lost = speed_change((0.04, 0.0), drag_per_m=20.0)[0] - free
    assert lost == pytest.approx(0.04 / (1.0 + 20.0 * ROLLS * 0.04 * 0.2) - 0.04, rel=0.05)
    lost = speed_change((0.04, 0.0), drag_growth_per_s2=0.1)[0] - free
    assert lost == pytest.approx(-0.04 * ROLLS * 0.1 * 0.5 * 0.2**2, rel=0.2)


NEAR = {"place": (0.006, 0.0), "seconds": 0.1}


def test_friction_in_one_direction_and_in_a_dirty_sector():
    along, back = (0.0, 0.05), (0.0, -0.05)  # counter-clockwise, clockwise
    free, free_back = speed_change(along, **NEAR)[1], speed_change(back, **NEAR)[1]
    assert speed_change(along, one_way_m_s2=0.15, **NEAR)[1] - free == pytest.approx(-0.15 * ROLLS * 0.1, rel=0.05)
    assert speed_change(back, one_way_m_s2=0.15, **NEAR)[1] == pytest.approx(free_back, abs=1e-5)
    dirt = {"dirt_m_s2": 0.25, "dirt_ring": 5, **NEAR}
    assert speed_change(along, dirt_deg=(-90.0, 90.0), **dirt)[1] - free == pytest.approx(-0.25 * ROLLS * 0.1, rel=0.05)
    assert speed_change(along, dirt_deg=(90.0, 270.0), **dirt)[1] == pytest.approx(free, abs=1e-5)
    assert speed_change(along, dirt_deg=(-90.0, 90.0), **{**dirt, "dirt_ring": 1})[1] == pytest.approx(free, abs=1e-5)


def test_pushes_around_the_maze_in_the_room_and_on_a_wavy_floor():
    at_rest = (0.0, 0.0)
    assert speed_change(at_rest, torque_m_s2=0.1, **NEAR)[1] == pytest.approx((0.1 * ROLLS - FLOOR) * 0.1, rel=0.03)
    got, pull = speed_change(at_rest, draught_m_s2=(0.12, -0.06), seconds=0.1), np.array([0.12, -0.06])
    assert got == pytest.approx((ROLLS - FLOOR / np.hypot(*pull)) * 0.1 * pull, rel=0.03)
    crest = speed_change(at_rest, ripple_m_s2=0.15, ripple_waves=5, **NEAR)[1]
    assert crest == pytest.approx((0.15 * ROLLS - FLOOR) * 0.1, rel=0.03)
    where = math.pi / 5
    turned = {**NEAR, "place": (0.006 * math.cos(where), 0.006 * math.sin(where))}
    vx, vy = speed_change(at_rest, ripple_m_s2=0.15, ripple_waves=5, **turned)
    assert -vx * math.sin(where) + vy * math.cos(where) == pytest.approx(-crest, rel=0.15)


def test_a_rocking_table_pulls_as_a_table_that_leans_does():
    swung = speed_change((0.0, 0.0), rocking_x_deg=0.5, rocking_y_deg=1.0, rocking_hz=1.0, seconds=0.1)
    mean = (1.0 - math.cos(0.2 * math.pi)) / (0.2 * math.pi)  # of the sine over the time
    lean = math.radians(0.5) * mean * 0.1 * 9.81 * ROLLS
    assert swung == pytest.approx(
        (1.0 - FLOOR * 0.1 / math.hypot(lean, 2.0 * lean)) * np.array([2.0, -1.0]) * lean, rel=0.1
    )
    leaning = speed_change((0.0, 0.0), table_x_deg=0.5, table_y_deg=1.0, seconds=0.1)
    assert swung[0] / swung[1] == pytest.approx(leaning[0] / leaning[1], rel=0.05)


def test_a_kerb_takes_a_share_of_the_speed_once():
    speeds = {}
    for kerb in ({}, {"kerb_loss": 0.5, "kerb_ring": 5, "kerb_deg": 0.0}):
        rig = rig_with(**kerb)
        rig.observe()
        radius = MAZE.ball.radius
        rig.set_ball(np.array([6e-3, -3e-3, radius]), np.array([0.0, 0.03, 0.0]), np.array([-0.03, 0.0, 0.0]) / radius)
        speeds[len(kerb)] = [(rig.observe(), rig.truth()[4])[1] for _ in range(6)]
    assert speeds[3][:2] == speeds[0][:2], "not before it is there"
    assert speeds[3][-1] == pytest.approx(0.5 * speeds[0][-1], rel=0.1)


def test_an_unbalanced_ball_rolls_to_its_heavy_side():
    still, heavy = (speed_change((0.0, 0.0), imbalance_mm=off, seconds=0.1) for off in (0.0, 0.2))
    assert np.hypot(*still) < 1e-4
    assert heavy[0] > 5e-3
    assert abs(heavy[1]) < 1e-4


def test_servos_gain_coupling_and_speed_of_their_own():
    tilt, _ = settled((0.04, -0.02), servo_gain_beta=0.85)
    assert tilt == pytest.approx([0.034, -0.02], abs=2e-4)
    tilt, _ = settled((0.04, -0.02), coupling_beta_from_gamma=0.1, coupling_gamma_from_beta=-0.2)
    assert tilt == pytest.approx([0.038, -0.028], abs=2e-4)
    rig = rig_with(servo_frequency_gamma_rad_s=12.0)
    for _ in range(5):
        rig.observe()
        rig.command(0.02, 0.02)
    beta, gamma = rig.truth()[5:]
    assert gamma < 0.8 * beta


def test_what_a_sensor_says_is_scaled_and_what_is_stays():
    tilt, seen = settled((0.04, -0.02), tilt_scale_beta=1.1, tilt_scale_gamma=0.9)
    assert tilt == pytest.approx([0.04, -0.02], abs=5e-4)
    assert (seen.beta, seen.gamma) == pytest.approx((1.1 * tilt[0], 0.9 * tilt[1]))


def test_a_picture_is_scaled_bent_turned_and_moved():
    r = MAZE.track_radius(1)
    for settings, expected in (
        ({"camera_scale": 1.03}, (1.03 * r, 0.0)),
        ({"lens_per_m2": 5.0}, (r * (1.0 + 5.0 * r * r), 0.0)),
        ({"camera_rotation_deg": 3.0}, (r * math.cos(math.radians(3.0)), r * math.sin(math.radians(3.0)))),
        ({"camera_offset_mm": (3.0, -2.0)}, (r + 3e-3, -2e-3)),
    ):
        seen = rig_with(**settings).observe()
        assert (seen.x, seen.y) == pytest.approx(expected, abs=1e-9), settings
