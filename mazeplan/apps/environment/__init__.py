"""The maze as a Gymnasium environment.

`import mazeplan`, then `gymnasium.make("mazeplan/CircularMaze-v1")`, or `mazeplan/TwoBalls-v1`
(`mazeplan.core.gymnasium_names` registers both).

task.py       what may be chosen
worlds.py     the rigs behind it: a fleet of simulated ones, or any rigs
senses.py     what is known of balls from what was measured: the observation "state"
judging.py    rewards, arrival, out
episodes.py   all of that together, for N rigs, with the observation "pixels"
single.py     Gymnasium's face of it for one rig; vector.py: for many
pair.py       two balls on one plate, from the same parts
expert.py     the planner as a policy; record.py: its episodes as a data set

Gymnasium is imported in this room alone. A process that has not imported mazeplan can name the module, too:
`gymnasium.make("mazeplan.apps.environment:mazeplan/CircularMaze-v1")`.
"""

from __future__ import annotations

from mazeplan.core.errors import SettingsError
from mazeplan.core.gymnasium_names import ID as ID
from mazeplan.core.gymnasium_names import TWO_BALLS as TWO_BALLS
from mazeplan.core.gymnasium_names import register
from mazeplan.core.resources import to_install

try:
    import gymnasium
except ImportError:
    raise SettingsError(f"the environment needs Gymnasium: {to_install('gym')}") from None

register(gymnasium)
