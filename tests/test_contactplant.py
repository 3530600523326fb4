"""The tests' own rig with contact: its mechanics by what is known of them, servos, sensor and camera by what they say,
and each effect by what it changes."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from contacteffects import EFFECTS, changed, truth
from contactplant import PER, RATE, RIM, TRACKS, WALLS, G, gap_to, packed_walls
from contactrig import Axis, Rig, drawn_rig, record, rolled, sines

NO_LOSS = {"roll": 0.0, "twist": 0.0}
STILL = np.zeros((300, 2))
ORDINARY = replace(Rig(), sensor_noise=0.0)
QUIET = replace(ORDINARY, camera=replace(ORDINARY.camera, noise=0.0, delay=0.0))


def moving(rig, place, speed, heading):
    """A ball that rolls: x, y, velocity, spin."""
    vx, vy = speed * math.cos(heading), speed * math.sin(heading)
    return (*place, vx, vy, -vy / rig.radius, vx / rig.radius, 0.0)


def energy(rig, states):
    turning = 0.5 * rig.k * rig.radius**2 * np.sum(states[:, 6:9] ** 2, axis=1)
    return 0.5 * np.sum(states[:, 3:6] ** 2, axis=1) + turning + G * states[:, 2]


@cache
def drawn(seed=0):
    return drawn_rig(np.random.default_rng(seed))


@cache
def recorded(rig, seed=1, seconds=60.0):
    return record(rig, seconds, seed)


@cache
def travelled(seed):
    """Places at each step of a drawn rig through a minute that begins in ring 1."""
    rig, rng = drawn(seed), np.random.default_rng(seed)
    return rolled(rig, sines(rng, 1800), (TRACKS[1], 0.0))[0]


@pytest.mark.parametrize("heading", [0.0, 0.7, 2.0, 4.0])
def test_no_contact_gives_energy(heading):
    rig = replace(QUIET, **NO_LOSS, bounce=1.0, land=1.0, wall=0.3)
    _, states = rolled(rig, STILL, moving(rig, (TRACKS[2], 0.0), 0.3, heading))
    assert np.max(np.diff(energy(rig, states))) < 1e-9
    assert energy(rig, states)[-1] < energy(rig, states)[0]


def test_a_smooth_wall_takes_no_angular_momentum():
    rig = replace(QUIET, **NO_LOSS, wall=0.0, floor=0.0)
    _, states = rolled(rig, STILL[:90], moving(rig, (TRACKS[1], 0.0), 0.3, 1.2))
    x, y, vx, vy = states[:, [0, 1, 3, 4]].T
    assert x * vy - y * vx == pytest.approx(x[0] * vy[0], rel=4e-3)
    assert np.min(vx * x + vy * y) < -1e-4  # it did come back from the rim


@pytest.mark.parametrize("k", [0.4, 2.0 / 3.0])
def test_on_the_floor_a_ball_rolls_down_by_1_over_1_plus_k_of_gravity(k):
    rig = replace(QUIET, **NO_LOSS, k=k, lean=(0.03, 0.0))
    places, _ = rolled(rig, STILL[:6], (-0.009, 0.0))
    t = np.arange(len(places)) / (RATE * PER)
    assert places[:, 0] + 0.009 == pytest.approx(0.5 * G * math.sin(0.03) / (1.0 + k) * t * t, abs=5e-6)


@pytest.mark.parametrize("k", [0.4, 2.0 / 3.0])
def test_along_the_rim_on_which_it_rolls_a_ball_falls_by_1_over_1_plus_2_k_of_gravity(k):
    rig = replace(QUIET, **NO_LOSS, k=k, lean=(0.03, 0.0), wall=0.8)
    r, start = RIM - rig.radius, 0.15
    places, states = rolled(rig, STILL[:60], (r * math.cos(start), r * math.sin(start)))
    theta = np.arctan2(places[:, 1], places[:, 0])[: len(places) // 2]
    swing = math.sqrt(G * math.sin(0.03) / (1.0 + 2.0 * k) / r)  # a pendulum, for small angles
    t = np.arange(len(theta)) / (RATE * PER)
    assert theta == pytest.approx(start * np.cos(swing * t), abs=1e-3)
    rolls = states[20, 8] * rig.radius, np.hypot(*states[20, 3:5])
    assert rolls[0] == pytest.approx(rolls[1], rel=0.015)  # on the rim as on the floor


def test_rolling_friction_slows_by_f_g_mu_over_r_and_holds_a_ball_on_a_gentle_slope():
    rig = replace(QUIET, roll=1e-4, twist=0.0)
    _, states = rolled(rig, STILL[:4], moving(rig, (-0.009, 0.0), 0.1, 0.0))
    assert (0.1 - states[-1, 3]) * RATE / 3.0 == pytest.approx(G * 1e-4 / rig.radius / 1.4, rel=1e-3)
    held = replace(rig, lean=(0.9 * 1e-4 / rig.radius, 0.0))
    places, _ = rolled(held, STILL, (0.0, 0.0))
    assert np.hypot(*places[-1]) < 1e-9
    places, _ = rolled(replace(held, lean=(1.2 * 1e-4 / rig.radius, 0.0)), STILL, (0.0, 0.0))
    assert np.hypot(*places[-1]) > 5e-3


def test_a_fast_ball_hits_the_rim_with_restitution_and_its_spin_goes_on_into_the_wall():
    rig = replace(QUIET, **NO_LOSS, wall=0.0, bounce=0.6, floor=5.0)
    start = moving(rig, (TRACKS[1], 0.0), 0.4, 0.0)
    fine = rolled(rig, STILL[:2], start)[0]
    v = np.diff(fine[:, 0]) * RATE * PER
    hit = int(np.argmin(v))  # the step in which it is set back to where it would be
    assert v[hit + 1] == pytest.approx(-0.6 * 0.4, abs=3.0 * 5.0 * G / (RATE * PER))
    # sliding friction of the floor turns spin into speed until it rolls: momentum about the floor is kept
    assert v[hit + 100] == pytest.approx((-0.6 * 0.4 + 0.4 * 0.4) / 1.4, rel=0.05)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 1, 2, 3])
def test_the_ball_never_enters_a_wall_nor_leaves_the_maze(seed):
    places, rig = travelled(seed), drawn(seed)
    assert np.max(np.hypot(*places.T)) < RIM - rig.radius + 3e-4
    gaps = [gap_to(wall, rig.corner, rig.radius, side, x, y)[0]
            for x, y in places[::10] for wall in packed_walls() for side in (-1.0, 1.0)]  # fmt: skip
    assert min(gaps) > -3e-4


def test_the_ball_passes_openings_and_no_other_place_of_a_wall():
    passed = 0
    for seed in range(4):
        x, y = travelled(seed).T
        r, theta = np.hypot(x, y), np.degrees(np.arctan2(y, x))
        for inner, outer, width, angles in WALLS:
            middle = 0.5 * (inner + outer)
            at = np.flatnonzero((r[:-1] - middle) * (r[1:] - middle) < 0.0)
            passed += len(at)
            for angle in theta[at]:
                off = min(abs((angle - a + 180.0) % 360.0 - 180.0) for a in angles)
                assert middle * math.sin(math.radians(off)) < 0.5 * width - drawn(seed).radius + 3e-4
    assert passed > 20


def test_edges_are_round_as_told():
    _, outer, width, _ = WALLS[0]
    for corner in (0.0, 1e-3):
        wall = packed_walls()[0]
        a, b = math.sqrt((outer - corner) ** 2 - (0.5 * width + corner) ** 2), 0.5 * width + corner
        ball = 6.35e-3
        away = (corner + ball) / math.sqrt(2.0)
        x, y = a + away, b - away  # 45 degrees out of the corner, in axes along the opening's middle
        c = math.sqrt(0.5)
        gap, nx, ny = gap_to(wall, corner, ball, 1.0, c * (x - y), c * (x + y))
        assert gap == pytest.approx(0.0, abs=1e-12)
        assert (nx, ny) == pytest.approx((1.0, 0.0), abs=1e-9)  # 45 degrees less than 45


def test_a_servo_answers_a_step_as_an_axis_of_second_order_with_dead_time_and_gain():
    u = np.full((30, 2), 0.05)
    rig = replace(QUIET, beta=Axis(0.9, 20.0, 0.7, 0.02, slew=9.0), gamma=Axis(slew=0.2))
    _, states = rolled(rig, u, (TRACKS[1], 0.0))
    t = np.maximum(np.arange(30) / RATE - 0.02, 0.0)
    turn = 20.0 * math.sqrt(1.0 - 0.49)
    left = np.exp(-14.0 * t) * (np.cos(turn * t) + 14.0 / turn * np.sin(turn * t))
    assert states[:, 9] == pytest.approx(0.045 * (1.0 - left), abs=3e-4)
    assert np.max(np.abs(np.diff(states[:, 10]))) * RATE == pytest.approx(0.2, rel=1e-3)


def test_play_dead_band_and_coupling_of_servos():
    assert Axis(play=0.02).passed_on([0.0, 0.005, 0.03, 0.025, 0.0]) == pytest.approx([0.0, 0.0, 0.02, 0.02, 0.01])
    assert Axis(deadband=0.01).passed_on([0.005, 0.012, 0.015, 0.03]) == pytest.approx([0.0, 0.012, 0.012, 0.03])
    rig = replace(QUIET, beta=Axis(0.5, coupling=0.1))
    assert rig.targets(np.array([[0.02, 0.04]])) == pytest.approx(np.array([[0.5 * 0.024, 0.04]]))


def test_camera_and_sensor_say_what_they_are_told_to():
    true = recorded(QUIET)
    camera = replace(QUIET.camera, offset=(3e-3, -2e-3), angle=0.1, scale=1.02, k=-3.0, delay=2.0 / RATE)
    seen = recorded(replace(QUIET, camera=camera, sensor=(1.1, 0.9)))
    assert seen["beta"] == pytest.approx(1.1 * true["beta"])
    assert seen["gamma"] == pytest.approx(0.9 * true["gamma"])
    z = 1.02 * np.exp(0.1j) * (true["x"] + 1j * true["y"]) + 3e-3 - 2e-3j
    z *= 1.0 - 3.0 * np.abs(z) ** 2
    inside = (np.arange(len(z)) % 600 >= 2)[2:]  # at first the ball is seen where it was placed
    assert (seen["x"] + 1j * seen["y"])[2:][inside] == pytest.approx(z[:-2][inside], abs=1e-12)


def test_noise_is_as_large_as_told_and_pictures_are_lost_as_often():
    true, seen = recorded(QUIET), recorded(replace(QUIET, sensor_noise=2e-3, camera=replace(QUIET.camera, noise=1e-3)))
    for name, size in (("x", 1e-3), ("y", 1e-3), ("beta", 2e-3), ("gamma", 2e-3)):
        assert np.std(seen[name] - true[name]) == pytest.approx(size, rel=0.06)
    lost = np.isnan(recorded(replace(QUIET, camera=replace(QUIET.camera, lost=0.2)), seconds=120.0)["x"])
    assert np.mean(lost) == pytest.approx(0.2, abs=0.03)
    assert np.mean(lost[1:][lost[:-1]]) == pytest.approx(0.3, abs=0.06)


def test_a_record_is_like_one_of_collect():
    table = recorded(drawn(), seconds=100.0)
    assert set(table) == {"t", "x", "y", "beta", "gamma", "u_beta", "u_gamma", "segment"}
    assert {len(column) for column in table.values()} == {3000}
    begins = np.arange(0, 3000, 600)
    assert np.hypot(table["x"], table["y"])[begins] == pytest.approx([TRACKS[n] for n in (1, 2, 3, 4, 1)], abs=6e-3)
    assert np.flatnonzero(np.diff(table["segment"])).tolist() == (begins[1:] - 1).tolist()
    u = np.column_stack([table["u_beta"], table["u_gamma"]])
    assert np.max(np.abs(u)) == pytest.approx(math.radians(5.0))
    spectrum = np.abs(np.fft.rfft(u - u.mean(axis=0), axis=0)) ** 2
    assert np.sum(spectrum[np.fft.rfftfreq(3000, 1.0 / RATE) > 1.7]) < 0.01 * np.sum(spectrum)


def test_records_and_rigs_come_back_by_their_seed():
    again = record(drawn(), 60.0, 1)
    assert all(np.array_equal(again[name], column) for name, column in recorded(drawn()).items())
    assert not np.array_equal(record(drawn(), 60.0, 2)["x"], again["x"])
    assert drawn_rig(np.random.default_rng(0)) == drawn()
    assert drawn_rig(np.random.default_rng(1)) != drawn()


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(EFFECTS))
def test_each_effect_changes_the_record_the_more_the_larger_it_is(name):
    rig = replace(drawn(), camera=replace(drawn().camera, noise=0.0), sensor_noise=0.0)
    if name == "camera_noise":
        rig = replace(rig, camera=replace(rig.camera, noise=1e-4))
    rings, seconds = ((2,), 4.0) if name == "local_friction" else ((1,), 20.0 if name == "surface_bump" else 4.0)
    was, shares = record(rig, seconds, 1, rings), []
    for size in range(3):
        now = record(changed(rig, name, size), seconds, 1, rings)
        parts = [np.nan_to_num(now[key] - was[key], nan=1e-2) for key in ("x", "y", "beta", "gamma")]
        shares.append(float(np.mean(np.abs(parts))))
    assert shares[0] > 1e-6
    assert shares[2] > 1.2 * shares[0]


@pytest.mark.parametrize("name", sorted(EFFECTS))
def test_a_truth_has_the_names_of_the_registry(name):
    from mazeplan.physics.registry import PACKAGED

    rig = changed(drawn(), name)
    for told in EFFECTS[name].names:
        assert set(truth(rig, name, told, 0.08, Rig())) <= set(PACKAGED[told].parameters)
    assert set(EFFECTS[name].near) <= set(PACKAGED)
    assert bool(truth(rig, name, name, 0.08, Rig())) == bool(EFFECTS[name].names)


def test_time_goes_on_from_one_placing_of_the_ball_to_the_next():
    rig = replace(QUIET, rock=(0.71, 0.01, 0.0, 0.0))
    table = record(rig, 21.0, 1)
    u, x, y = (np.column_stack([table["u_beta"], table["u_gamma"]])[600:], table["x"][600:], table["y"][600:])
    again = rolled(rig, u, (x[0], y[0]), 20.0)[1]
    assert again[:, :2] == pytest.approx(np.column_stack([x, y]), abs=1e-9)
    assert np.max(np.abs(rolled(rig, u, (x[0], y[0]), 0.0)[1][:, 0] - x)) > 1e-4
