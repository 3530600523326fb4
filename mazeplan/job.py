"""What is to be done, with what, and what a log says of both."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from importlib.metadata import version
from typing import Any

from mazeplan.behavior.context import RunContext
from mazeplan.behavior.tree import BehaviorTree
from mazeplan.maze.geometry import Maze
from mazeplan.maze.mapfile import dump_map
from mazeplan.maze.memory import OpeningMemory
from mazeplan.models.modelfile import RigModel
from mazeplan.settings import Settings, load_settings

TIME_LIMIT = 20.0  # s of rig time; the limit under which the published figures were taken


@dataclass(frozen=True)
class Job:
    """One navigation to do: from a ring and angle (rad; None: drawn by seed) to a ring, within time_limit s."""

    start: int
    goal: int
    theta: float | None = None
    seed: int = 0
    time_limit: float = TIME_LIMIT
    closed: tuple[str, ...] = ()


@dataclass(frozen=True)
class Setup:
    """With what a job is done: maze, model of ball and stage, tree (name or file), settings, names of modules with
    leaves of one's own, what is remembered of openings, which the run adds to, and who watches: called with each tree
    before it begins."""

    maze: Maze
    model: RigModel
    behavior: str = "navigate"
    rig_name: str = ""
    model_name: str = ""
    settings: Settings = field(default_factory=load_settings)
    behavior_modules: tuple[str, ...] = ()
    memory: OpeningMemory | None = None
    watch: Callable[[BehaviorTree, RunContext], None] | None = None


def log_header(setup: Setup, job: Job) -> dict[str, Any]:
    """What a reader of the log needs to know about the run."""
    return {
        "program": "mazeplan",
        "version": version("mazeplan"),
        "rig": setup.rig_name,
        "map": dump_map(setup.maze),
        "map_name": setup.maze.name,
        "model": setup.model_name or setup.model.kind,
        "behavior": setup.behavior,
        "behavior_modules": list(setup.behavior_modules),
        "start_ring": job.start,
        "goal_ring": job.goal,
        "seed": job.seed,
        "time_limit_s": job.time_limit,
    }
