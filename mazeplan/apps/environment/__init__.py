"""The maze as a Gymnasium environment.

`import mazeplan.apps.environment`, then `gymnasium.make("mazeplan/CircularMaze-v1")`.

task.py       what may be chosen
worlds.py     the rigs behind it: a fleet of simulated ones, or any rigs
senses.py     what is known of balls from what was measured: the observation "state"
judging.py    rewards, arrival, out
episodes.py   all of that together, for N rigs, with the observation "pixels"
single.py     Gymnasium's face of it for one rig; vector.py: for many
expert.py     the planner as a policy; record.py: its episodes as a data set

Gymnasium is imported in this room alone. It has no entry points for packages any more (since its version 1.0), so that
one import is needed; `gymnasium.make("mazeplan.apps.environment:mazeplan/CircularMaze-v1")` does it in the name.
"""

from __future__ import annotations

from mazeplan.apps.environment.task import STEPS
from mazeplan.core.errors import SettingsError
from mazeplan.core.resources import to_install

try:
    import gymnasium
except ImportError:
    raise SettingsError(f"the environment needs Gymnasium: {to_install('gym')}") from None

ID = "mazeplan/CircularMaze-v1"

if ID not in gymnasium.registry:
    gymnasium.register(
        ID,
        entry_point="mazeplan.apps.environment.single:CircularMazeEnv",
        vector_entry_point="mazeplan.apps.environment.vector:CircularMazeVectorEnv",
        max_episode_steps=STEPS,
    )
