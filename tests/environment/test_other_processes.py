"""The environment in other processes, and by its name alone."""

from functools import partial

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AsyncVectorEnv

ID = "mazeplan.apps.environment:mazeplan/CircularMaze-v1"


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
