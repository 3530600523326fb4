"""Plan, learn and navigate a ball through a circular maze on a tilting plate.

The functions navigate, evaluate, collect, learn, compare, diagnose and improve do what the commands of these names do.
Maze, Observation, Rig and check_rig are for rigs of one's own; MazeLeaf, Port and Status for leaves. The names load
when first used, so that `import mazeplan` stays cheap.
"""

from __future__ import annotations

import os
from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from mazeplan.behavior.mazeleaf import MazeLeaf
    from mazeplan.btree.controls import Control
    from mazeplan.btree.decorators import Decorator
    from mazeplan.btree.ports import Port
    from mazeplan.btree.status import SKIPPED, Status
    from mazeplan.core.records import NavigationResult, Observation
    from mazeplan.maze.geometry import Maze
    from mazeplan.maze.mapfile import load_map
    from mazeplan.rigs.conformance import check_rig
    from mazeplan.rigs.interface import Rig
    from mazeplan.run.collect import collect
    from mazeplan.run.commands.compare import compare
    from mazeplan.run.commands.diagnose import diagnose
    from mazeplan.run.commands.evaluate import evaluate
    from mazeplan.run.commands.improve import improve
    from mazeplan.run.commands.learn import learn
    from mazeplan.run.execution import navigate
    from mazeplan.run.goals import Goals

__version__ = "0.1.0"
os.environ.setdefault("NUMBA_OPT", "2")  # 3 takes a third longer to compile, and what it makes is not faster

_COMMANDS = ("compare", "diagnose", "evaluate", "improve", "learn")
_HOMES = {
    "Goals": "mazeplan.run.goals",
    "Maze": "mazeplan.maze.geometry",
    "Control": "mazeplan.btree.controls",
    "Decorator": "mazeplan.btree.decorators",
    "MazeLeaf": "mazeplan.behavior.mazeleaf",
    "NavigationResult": "mazeplan.core.records",
    "Observation": "mazeplan.core.records",
    "Port": "mazeplan.btree.ports",
    "Rig": "mazeplan.rigs.interface",
    "SKIPPED": "mazeplan.btree.status",
    "Status": "mazeplan.btree.status",
    "check_rig": "mazeplan.rigs.conformance",
    "collect": "mazeplan.run.collect",
    **{name: f"mazeplan.run.commands.{name}" for name in _COMMANDS},
    "load_map": "mazeplan.maze.mapfile",
    "navigate": "mazeplan.run.execution",
}

__all__ = [
    "SKIPPED", "Control", "Decorator", "Goals", "Maze", "MazeLeaf", "NavigationResult", "Observation", "Port", "Rig",
    "Status", "check_rig", "collect", "compare", "diagnose", "evaluate", "improve", "learn", "load_map", "navigate",
]  # fmt: skip


def __getattr__(name: str) -> Any:
    if name in _HOMES:
        value = getattr(import_module(_HOMES[name]), name)
        globals()[name] = value
        return value
    raise AttributeError(f"module 'mazeplan' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
