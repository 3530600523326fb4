"""The environment in other processes, and by its name alone."""

import subprocess
import sys
from functools import partial

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AsyncVectorEnv

import mazeplan

ID = "mazeplan/CircularMaze-v1"


def make(**options):
    """A factory in a module: what another process imports."""
    return gymnasium.make(ID, **options)


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
