"""Plan, learn and navigate a ball through a circular maze on a tilting plate.

`from mazeplan import Maze, Observation, Rig, check_rig, navigate` works; the names load when first used, so that
`import mazeplan` stays cheap.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from mazeplan.maze.geometry import Maze
    from mazeplan.maze.mapfile import load_map
    from mazeplan.navigate import navigate
    from mazeplan.records import NavigationResult, Observation
    from mazeplan.rigs.conformance import check_rig
    from mazeplan.rigs.interface import Rig

__version__ = "0.1.0"

_HOMES = {
    "Maze": "mazeplan.maze.geometry",
    "NavigationResult": "mazeplan.records",
    "Observation": "mazeplan.records",
    "Rig": "mazeplan.rigs.interface",
    "check_rig": "mazeplan.rigs.conformance",
    "load_map": "mazeplan.maze.mapfile",
    "navigate": "mazeplan.navigate",
}

__all__ = ["Maze", "NavigationResult", "Observation", "Rig", "check_rig", "load_map", "navigate"]


def __getattr__(name: str) -> Any:
    if name in _HOMES:
        value = getattr(import_module(_HOMES[name]), name)
        globals()[name] = value
        return value
    raise AttributeError(f"module 'mazeplan' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
