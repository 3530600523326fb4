"""Plan, learn and navigate a ball through a circular maze on a tilting plate.

`from mazeplan import Maze, Observation, Rig, check_rig, navigate` works, as do MazeLeaf, Port and Status for leaves of
one's own; the names load when first used, so that
`import mazeplan` stays cheap.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from mazeplan.behavior.leaf import Port
    from mazeplan.behavior.mazeleaf import MazeLeaf
    from mazeplan.behavior.status import Status
    from mazeplan.goals import Goals
    from mazeplan.maze.geometry import Maze
    from mazeplan.maze.mapfile import load_map
    from mazeplan.navigation import navigate
    from mazeplan.records import NavigationResult, Observation
    from mazeplan.rigs.conformance import check_rig
    from mazeplan.rigs.interface import Rig

__version__ = "0.1.0"

_HOMES = {
    "Goals": "mazeplan.goals",
    "Maze": "mazeplan.maze.geometry",
    "MazeLeaf": "mazeplan.behavior.mazeleaf",
    "NavigationResult": "mazeplan.records",
    "Observation": "mazeplan.records",
    "Port": "mazeplan.behavior.leaf",
    "Rig": "mazeplan.rigs.interface",
    "Status": "mazeplan.behavior.status",
    "check_rig": "mazeplan.rigs.conformance",
    "load_map": "mazeplan.maze.mapfile",
    "navigate": "mazeplan.navigation",
}

__all__ = [
    "Goals", "Maze", "MazeLeaf", "NavigationResult", "Observation", "Port", "Rig", "Status", "check_rig", "load_map",
    "navigate",
]  # fmt: skip


def __getattr__(name: str) -> Any:
    if name in _HOMES:
        value = getattr(import_module(_HOMES[name]), name)
        globals()[name] = value
        return value
    raise AttributeError(f"module 'mazeplan' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
