"""The environment with two balls."""

import math
import pickle

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import mazeplan.apps.environment as room
from mazeplan.apps.environment.pair import TwoBallsEnv
from mazeplan.apps.environment.senses import NAMES
from mazeplan.core.errors import RigError, SettingsError
from mazeplan.core.records import Observation
from mazeplan.maze.mapfile import dump_map, load_map

RADIUS, COS, SIN, RING, U_BETA = (NAMES.index(name) for name in ("radius", "cos_theta", "sin_theta", "ring", "u_beta"))


class Placed:
    """A rig that tells of balls at given places, one set of places a sample."""

    rate_hz, balls = 30.0, 2
    places: tuple = ()

    def __init__(self, maze, settings):
        self.taken, self.commands = 0, []

    def reset(self, *, ring, theta, rng):
        self.taken = 0

    def command(self, beta, gamma):
        self.commands.append((beta, gamma))

    def observe(self):
        places = self.places[min(self.taken, len(self.places) - 1)]
        first, *others = (Observation(self.taken / 30.0, *place, 0.0, 0.0) for place in places)
        self.taken += 1
        return Observation(first.t, first.x, first.y, 0.0, 0.0, others=tuple(others))

    def level(self):
        self.commands.append((0.0, 0.0))

    def close(self):
        pass


@pytest.fixture
def placed(monkeypatch):
    """Makes the environment with balls at given places, and resets it."""
    made = []

    def make(*places, **options):
        monkeypatch.setattr(Placed, "places", places)
        made.append(TwoBallsEnv(rig="test_two_balls_environment:Placed", **options))
        return made[-1], made[-1].reset(seed=1)

    yield make
    for env in made:
        env.close()


@pytest.mark.parametrize("reward", ["sparse", "dense"])
def test_gymnasium_has_nothing_to_say_against_it(reward):
    check_env(gymnasium.make(room.TWO_BALLS, rig="ideal", reward=reward).unwrapped)


def test_each_ball_has_a_row_and_they_begin_on_opposite_sides():
    env = gymnasium.make(room.TWO_BALLS, rig="ideal")
    observed, info = env.reset(seed=3, options={"start_ring": 2, "start_angle_deg": 20.0})
    maze = load_map("cme")
    expected = maze.track_radius(2) / maze.rings[0].outer_radius
    np.testing.assert_allclose(observed[:, RADIUS], expected, atol=1e-3)
    angles = np.degrees(np.arctan2(observed[:, SIN], observed[:, COS])) % 360.0
    np.testing.assert_allclose(angles, [20.0, 200.0], atol=0.1)
    assert info["rings"] == (2, 2)
    again, _ = env.reset(seed=3, options={"start_ring": 2, "start_angle_deg": 20.0})
    np.testing.assert_array_equal(observed, again)
    for _ in range(20):
        observed, *_ = env.step(np.array([0.5, -1.0], dtype=np.float32))
    np.testing.assert_array_equal(observed[:, U_BETA], 0.5)
    assert np.ptp(np.arctan2(observed[:, SIN], observed[:, COS])) != pytest.approx(math.pi, abs=0.05)  # both rolled
    env.close()


def test_both_have_to_be_there_and_for_a_while(placed):
    there, outside = (0.005, 0.0), (0.0, 0.04)
    env, _ = placed((outside, outside), *[(there, outside)] * 10, (there, there))
    rewards, ends, infos = [], [], []
    for _ in range(18):
        _, reward, ended, _, info = env.step(np.zeros(2))
        rewards.append(reward)
        ends.append(ended)
        infos.append(info)
    assert ends.index(True) == 10 + 6  # 0.2 s after the second has come
    assert rewards[:17] == [0.0] * 16 + [1.0]
    assert (infos[9]["rings"][0], infos[9]["success"]) == (5, False)
    assert infos[16]["is_success"] is True


def test_the_dense_reward_counts_both_and_sums_to_what_was_won(placed):
    far, near, there = (0.095, 0.0), (0.0, 0.04), (0.005, 0.0)
    way = ((far, far), (far, far), (near, far), (near, near), *[(there, there)] * 9)
    env, _ = placed(*way, reward="dense", discount=1.0)
    rewards = []
    ended = False
    while not ended:
        _, reward, ended, _, _ = env.step(np.zeros(2))
        rewards.append(reward)
    assert rewards[0] == pytest.approx(0.0, abs=1e-9)
    assert rewards[1] > 0.05  # one ball is nearer
    assert rewards[2] > 0.05  # the other one
    env.reset(seed=1)
    assert 0.0 < env._phi < 0.5
    assert sum(rewards) == pytest.approx(1.0 - env._phi)


def test_one_ball_that_is_out_ends_the_episode(placed):
    inside, outside = (0.09, 0.0), (0.0, 0.2)
    env, _ = placed((inside, inside), *[(inside, outside)] * 40)
    for _ in range(12):
        _, reward, ended, _, info = env.step(np.zeros(2))
        if ended:
            break
    assert (ended, reward, info["ball_out"], info["success"]) == (True, 0.0, True, False)


def test_commands_are_shares_of_the_tilt_limit(placed):
    env, _ = placed(((0.09, 0.0), (-0.09, 0.0)))
    env.step(np.array([0.5, -9.0]))
    rig = env._world._rigs[0]
    assert getattr(rig, "rig", rig).commands[-1] == pytest.approx((0.5 * env.maze.tilt_limit, -env.maze.tilt_limit))
    with pytest.raises(ValueError, match="expected two numbers"):
        env.step(np.zeros(3))


def test_a_copy_begins_anew():
    env = TwoBallsEnv(rig="ideal")
    first, _ = env.reset(seed=5)
    copy = pickle.loads(pickle.dumps(env))
    with pytest.raises(RigError, match="reset"):
        copy.step(np.zeros(2))
    again, _ = copy.reset(seed=5)
    np.testing.assert_array_equal(first, again)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"goal_ring": 3}, "unknown option"),
        ({"observation": "pixels"}, "unknown option"),
        ({"render_mode": "human"}, "expected ansi"),
        ({"rig": "test_two_balls_environment:OneBall"}, "expected 2"),
    ],
)
def test_options_that_cannot_be_used_are_refused(options, words):
    with pytest.raises(SettingsError, match=words):
        TwoBallsEnv(**options)


class OneBall(Placed):
    balls = 1


def test_the_environment_with_one_ball_refuses_a_map_with_two(tmp_path):
    text = tmp_path / "two.yaml"
    text.write_text("balls: 2\n" + dump_map(load_map("cme")))
    with pytest.raises(SettingsError, match=r"2 balls, expected 1: take mazeplan/TwoBalls-v1"):
        gymnasium.make(room.ID, map=str(text))


def test_a_rig_that_tells_of_one_ball_only_fails(placed):
    with pytest.raises(RigError, match="got 1 balls, expected 2"):
        placed(((0.09, 0.0),))


def test_a_line_tells_where_both_balls_are(placed):
    env, _ = placed(((0.09, 0.0), (-0.09, 0.0)), render_mode="ansi")
    assert env.render() == "t   0.00 s  ball 1:  90.0 mm at   0.0 deg  ball 2:  90.0 mm at 180.0 deg\n"
