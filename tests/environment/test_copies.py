"""The environment in copies, in other processes, and by its name alone."""

import copy
import pickle
import subprocess
import sys
from functools import partial

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AsyncVectorEnv

import mazeplan
from mazeplan.core.errors import RigError

ID = "mazeplan/CircularMaze-v1"
cloudpickle = pytest.importorskip("cloudpickle")


def through_cloudpickle(env):
    return pickle.loads(cloudpickle.dumps(env))


def make(**options):
    """A factory in a module: what another process imports."""
    return gymnasium.make(ID, **options)


def going_on(env, steps=40):
    rng, seen = np.random.default_rng(2), []
    for _ in range(steps):
        observed, reward, ended, cut, info = env.step(rng.uniform(-1.0, 1.0, 2).astype(np.float32))
        seen.append((observed.tolist(), reward, ended, cut, info))
        if ended or cut:
            break
    return [*seen, env.reset()[0].tolist()]


@pytest.mark.slow
@pytest.mark.parametrize("copied", [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env)), through_cloudpickle])
@pytest.mark.parametrize("observation", ["state", "pixels"])
def test_a_copy_goes_on_as_the_original_would(copied, observation):
    env = gymnasium.make(ID, reward="dense", observation=observation, size=16)
    env.reset(seed=3)
    for _ in range(15):
        env.step(np.array([0.7, -0.4], dtype=np.float32))
    other = copied(env)
    expected = going_on(env)
    env.close()  # a copy has a rig of its own
    assert going_on(other) == expected
    other.close()


def test_a_copy_of_a_closed_or_unused_one_is_closed_or_unused():
    env = gymnasium.make(ID)
    other = copy.deepcopy(env)
    assert other.reset(seed=5)[0].tolist() == env.reset(seed=5)[0].tolist()
    env.close()
    with pytest.raises(RuntimeError, match="closed"):
        copy.deepcopy(env).reset()


def test_many_at_once_are_copied_too():
    many = gymnasium.make_vec(ID, num_envs=3, threads=1)
    many.reset(seed=1)
    action = np.full((3, 2), 0.5, dtype=np.float32)
    for _ in range(5):
        many.step(action)
    other = copy.deepcopy(many)
    for _ in range(5):
        np.testing.assert_array_equal(many.step(action)[0], other.step(action)[0])


def test_a_copy_with_another_rig_is_fresh_and_begins_with_reset():
    env = gymnasium.make(ID, rig="surprise@magnet")
    env.reset(seed=3)
    env.step(np.zeros(2, dtype=np.float32))
    other = pickle.loads(pickle.dumps(env))
    with pytest.raises(RigError, match="reset"):
        other.step(np.zeros(2, dtype=np.float32))
    assert other.reset()[0].tolist() == env.reset()[0].tolist()  # the random numbers go on


@pytest.mark.slow
@pytest.mark.parametrize("context", ["spawn", "forkserver"])
def test_it_works_in_processes_that_are_begun_afresh(context):
    many = AsyncVectorEnv([partial(make, rig="toy")] * 2, context=context)
    alone = gymnasium.make(ID, rig="toy")
    got, expected = many.reset(seed=7)[0], alone.reset(seed=7)[0]
    np.testing.assert_array_equal(got[0], expected)
    action = np.full((2, 2), 0.3, dtype=np.float32)
    np.testing.assert_array_equal(many.step(action)[0][0], alone.step(action[0])[0])
    many.close()


@pytest.mark.slow
@pytest.mark.parametrize("imports", ["import mazeplan, gymnasium", "import gymnasium, mazeplan"])
def test_the_name_is_known_after_importing_mazeplan_alone(imports):
    code = f"{imports}, sys; assert 'mazeplan.apps' not in sys.modules; print(gymnasium.make('{ID}').reset(seed=1)[0])"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout


def test_importing_mazeplan_imports_no_gymnasium():
    code = "import mazeplan, sys; assert not {'gymnasium', 'numpy'} & sys.modules.keys()"
    subprocess.run([sys.executable, "-c", code], check=True)
    assert mazeplan.__version__
