"""The maze as a Gymnasium environment.

`import mazeplan`, then `gymnasium.make("mazeplan/CircularMaze-v1")` (`mazeplan.core.gymnasium_names` registers it).

task.py       the options of an environment
worlds.py     the rigs of an environment
senses.py     memory of measurements, and the observation "state" made from them
judging.py    rewards, and when an episode ends
episodes.py   episodes of N rigs, from these parts; also the observation "pixels"
single.py     the Gymnasium environment with one rig
expert.py     the planner as a policy

Only this package imports Gymnasium. A program that has not imported mazeplan can name the module instead:
`gymnasium.make("mazeplan.apps.environment:mazeplan/CircularMaze-v1")`.
"""

from __future__ import annotations

from mazeplan.core.errors import SettingsError
from mazeplan.core.gymnasium_names import ID as ID
from mazeplan.core.gymnasium_names import register
from mazeplan.core.resources import to_install

try:
    import gymnasium
except ImportError:
    raise SettingsError(f"the environment needs Gymnasium: {to_install('gym')}") from None

register(gymnasium)
