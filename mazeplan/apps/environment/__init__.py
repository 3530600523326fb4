"""The maze as a Gymnasium environment.

`import mazeplan.apps.environment`, then `gymnasium.make("mazeplan/CircularMaze-v1")`.

task.py       the options of an environment; observations, rewards, and when an episode ends
single.py     the environment: a rig, and these parts
expert.py     the planner as a policy

Only this package imports Gymnasium. A program that has not imported it can name the module, too:
`gymnasium.make("mazeplan.apps.environment:mazeplan/CircularMaze-v1")`.
"""

from __future__ import annotations

from mazeplan.core.errors import SettingsError
from mazeplan.core.resources import to_install

try:
    import gymnasium
except ImportError:
    raise SettingsError(f"the environment needs Gymnasium: {to_install('gym')}") from None

ID = "mazeplan/CircularMaze-v1"
STEPS = 600  # samples after which an episode is cut off: 20 s at 30 Hz, as for `navigate`

if ID not in gymnasium.registry:
    gymnasium.register(ID, entry_point="mazeplan.apps.environment.single:CircularMazeEnv", max_episode_steps=STEPS)
