"""The environment as Gymnasium meets it."""

import warnings
from functools import partial
from pathlib import Path

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AsyncVectorEnv

import mazeplan.apps.environment as room
from mazeplan.apps.environment.expert import Expert
from mazeplan.core.errors import InputError, SettingsError

HERE = Path(__file__).resolve().parent


def made(**options):
    return gymnasium.make(room.ID, **options)


@pytest.mark.parametrize("reward", ["dense", "sparse"])
def test_gymnasium_has_nothing_to_say_against_it(reward):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(made(reward=reward).unwrapped)


def test_the_expert_plays_behind_wrappers_and_no_other_game():
    env = made(rig="ideal", start_ring=4)
    expert = Expert(env)
    env.reset(seed=3)
    expert.begin()
    ended, info = False, {}
    while not ended:
        _, _, ended, truncated, info = env.step(expert.act())
        assert not truncated
    assert info["success"]
    env.close()
    with pytest.raises(InputError, match=r"the expert plays mazeplan/CircularMaze-v1, got CartPoleEnv"):
        Expert(gymnasium.make("CartPole-v1"))


def test_actions_tilt_the_plate_by_parts_of_its_limit():
    env = made(rig="ideal").unwrapped
    env.reset(seed=1)
    for _ in range(20):
        env.step(np.array([0.5, -1.0], dtype=np.float32))
    sample, limit = env.measured, env.maze.tilt_limit
    assert (sample.beta, sample.gamma) == pytest.approx((0.5 * limit, -limit), rel=0.02)
    assert sample.t == pytest.approx(20 / 30)
    for _ in range(20):
        env.step(np.array([7.0, -7.0]))  # beyond counts as that
    assert (env.measured.beta, env.measured.gamma) == pytest.approx((limit, -limit), rel=0.02)
    with pytest.raises(ValueError, match="expected two numbers from -1 to 1"):
        env.step(np.array([np.nan, 0.0]))


def test_starts_are_drawn_by_seed_or_said():
    env = made(rig="ideal", start_ring="any")
    angles = []
    for _ in range(2):
        places = []
        for seed in (0, 1, 2, 3):
            observed, info = env.reset(seed=seed)
            places.append((info["ring"], *observed[1:3].tolist()))
        angles.append(places)
    assert angles[0] == angles[1]
    assert len(set(angles[0])) == 4
    assert len({place[0] for place in angles[0]}) > 1
    observed, info = env.reset(seed=0, options={"start_ring": 3, "start_angle_deg": 90.0})
    assert info["ring"] == 3
    assert observed[1:3].tolist() == pytest.approx([0.0, 1.0], abs=1e-6)
    for options in ({"start_ring": 5}, {"start_angle_deg": "north"}, {"ring": 1}):
        with pytest.raises(SettingsError):
            env.reset(options=options)


def test_a_users_rig_arrives(monkeypatch):
    monkeypatch.syspath_prepend(HERE)
    env = made(rig="my_gym_rig:Sinking", start_ring=4)
    _, info = env.reset(seed=0)
    assert (info["ring"], info["success"]) == (4, False)
    rewards, terminated = [], False
    while not terminated:
        _, reward, terminated, truncated, info = env.step(np.zeros(2, dtype=np.float32))
        rewards.append(reward)
        assert not truncated
    assert info["success"]
    assert info["is_success"]
    assert info["ring"] == 5
    assert rewards[-1] == 1.0
    assert sum(rewards) == 1.0
    env.close()
    several = gymnasium.make_vec(room.ID, num_envs=2, rig="my_gym_rig:Sinking", start_ring=4)
    several.reset(seed=0)
    *_, told = several.step(np.zeros((2, 2), dtype=np.float32))
    assert told["time_s"].tolist() == pytest.approx([1 / 30, 1 / 30])


def test_what_cannot_be_made_says_so_in_one_line():
    for options, words in (
        ({"rig": "wooden"}, "got rig 'wooden'"), ({"map": "nowhere.yaml"}, "nowhere.yaml"),
        ({"start_ring": 7}, "start_ring"), ({"start_ring": 5}, "start_ring"), ({"goal_ring": "ring7"}, "goal_ring"),
        ({"discount": 0.0}, "discount"), ({"start_angle_deg": np.nan}, "start_angle_deg"),
        ({"flavour": 1}, "flavour: unknown key"),
    ):  # fmt: skip
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # Gymnasium's own about render modes
            with pytest.raises(InputError, match=words) as problem:
                made(**options)
        assert "\n" not in str(problem.value)


@pytest.mark.parametrize("action", [np.zeros(3), "x", None])
def test_an_action_of_another_shape_is_refused(action):
    env = made(rig="ideal").unwrapped
    env.reset(seed=0)
    with pytest.raises(ValueError, match="action: got"):
        env.step(action)


def make(**options):
    """A factory in a module: what another process imports."""
    return gymnasium.make(f"mazeplan.apps.environment:{room.ID}", **options)


@pytest.mark.slow
def test_it_works_in_processes_that_are_begun_afresh():
    many = AsyncVectorEnv([partial(make, rig="toy")] * 2, context="spawn")
    alone = make(rig="toy")
    got, expected = many.reset(seed=7)[0], alone.reset(seed=7)[0]
    np.testing.assert_array_equal(got[0], expected)
    action = np.full((2, 2), 0.3, dtype=np.float32)
    np.testing.assert_array_equal(many.step(action)[0][0], alone.step(action[0])[0])
    many.close()
