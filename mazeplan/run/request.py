"""What one navigation is asked to do: the request that the command line and Python fill in, and how it is resolved.

NavigationRequest --resolve--> Navigation (rig, job, setup) --execution--> NavigationResult
"""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from mazeplan.behavior.context import RunContext
from mazeplan.behavior.registry import registry_with
from mazeplan.behavior.trees import StaticContext, load_tree, refuse_mistakes
from mazeplan.btree.check import reads_key
from mazeplan.btree.ports import one_line
from mazeplan.btree.tree import BehaviorTree
from mazeplan.control.policy import Policy, load_policy
from mazeplan.core.constants import TIME_LIMIT
from mazeplan.core.errors import InputError
from mazeplan.core.field_checks import check_numbers
from mazeplan.core.logs.run_log import Sink
from mazeplan.core.progress import Display
from mazeplan.learning.modelfile import RigModel
from mazeplan.maze.geometry import Maze
from mazeplan.maze.mapfile import load_map
from mazeplan.physics.registry import own_effects
from mazeplan.rigs.interface import Rig, traits
from mazeplan.rigs.registry import make_rig, rig_label
from mazeplan.rigs.watchdog import watched
from mazeplan.run.assembly import check_balls, with_balls
from mazeplan.run.goals import Goals
from mazeplan.run.resolve import check_start_angle, model_source, opening_name, resolve_model, ring_number
from mazeplan.run.settings import Settings, load_settings
from mazeplan.run.specification import Job, Setup

NO_DEADLINE = {"travel": {"deadline_ms": 1e6}}


@dataclass(frozen=True)
class Company:
    """What goes along with a run.

    feed: called in the thread of the run with topic, rig time and document of each message of a log
    watch: called with each tree and its context before it begins
    guard: a context around the run, entered with the rig, such as an emergency stop"""

    display: Display | None = None  # shows its progress
    goals: Goals | None = None  # requests from other threads
    own_process: bool = False  # whether the watchdog may end the process when a leaf hangs and nothing else ends it
    feed: Sink | None = None
    around: Callable[[Rig], Rig] | None = None  # wraps the rig, for example to pace it by the wall clock
    watch: Callable[[BehaviorTree, RunContext], None] | None = None
    guard: Callable[[Rig], AbstractContextManager[object]] = nullcontext


@dataclass(frozen=True)
class NavigationRequest:
    """One navigation, in the words of the command line. `navigate` explains the fields."""

    start: int | str = 1
    goal: int | str | None = None
    map: str | Path | Maze = "cme"
    rig: str | Rig | type = "toy"
    model: str | Path | RigModel | None = None
    policy: str | Path | Policy | None = None
    behavior: str = "navigate"
    behavior_modules: tuple[str, ...] = ()
    effects: str | None = None
    settings: str | Path | Settings | None = None
    start_angle_deg: float | None = None
    closed: tuple[str, ...] = ()
    via: tuple[int | str, ...] = ()
    balls: int | None = None
    seed: int = 0
    time_limit: float = TIME_LIMIT
    log: str | Path | None = None
    deadline: bool = True  # whether plans have a limit of time by the wall clock

    def __post_init__(self) -> None:
        check_numbers(self, positive=("time_limit",), most={"seed": math.inf})

    @cached_property
    def maze(self) -> Maze:
        """The map, with the balls of the request. Raises InputError."""
        return with_balls(self.map if isinstance(self.map, Maze) else load_map(self.map), self.balls)

    @cached_property
    def job(self) -> Job:
        """The job, checked. Raises InputError."""
        maze, degrees = self.maze, self.start_angle_deg
        for name in self.closed:
            opening_name(name, maze)
        start = ring_number(self.start, maze)
        goal = len(maze.rings) if self.goal is None else ring_number(self.goal, maze)
        via = tuple(ring_number(ring, maze) for ring in self.via)
        if degrees is not None:
            check_start_angle(degrees, start, maze, "start angle")
        theta = None if degrees is None else math.radians(degrees)
        return Job(start, goal, theta, self.seed, self.time_limit, tuple(self.closed), via)

    @property
    def tree(self) -> str:
        """Name or file of the tree: what was asked for, else the one for a policy, waypoints or two balls."""
        if self.behavior != "navigate":
            return self.behavior
        if self.policy is not None or self.via:
            return "policy" if self.policy is not None else "waypoints"
        return "two_balls" if self.maze.balls > 1 else "navigate"

    def resolve(self, company: Company | None = None, job: Job | None = None) -> Navigation:
        """Make the rig, read everything that the request names, and check the tree. job: in place of the request's own

        Raises InputError, RigError."""
        company, job = company or Company(), job or self.job
        maze, rig_name = self.maze, self.rig if isinstance(self.rig, str) else None
        made = make_rig(self.rig, maze)
        rig = watched(made if company.around is None else company.around(made), own_process=company.own_process)
        check_balls(maze, rig, job, self.policy is not None)
        traits(rig).ready()
        own_effects(self.effects)
        self._check_tree(job)  # before the model, which may compile for minutes
        model = self.model
        settings = self.settings if isinstance(self.settings, Settings) else load_settings(self.settings)
        setup = Setup(
            maze,
            resolve_model(model, rig_name, maze),
            self.tree,
            rig_label(self.rig),
            model_name="" if isinstance(model, RigModel | None) else str(model),
            settings=settings if self.deadline else settings.with_values(NO_DEADLINE),
            behavior_modules=tuple(self.behavior_modules),
            watch=company.watch,
            model_source=None if isinstance(model, RigModel) else model_source(model, rig_name),
            effects=self.effects,
            policy=self.policy if isinstance(self.policy, Policy | None) else load_policy(self.policy),
        )
        return Navigation(rig, job, setup)

    def _check_tree(self, job: Job) -> None:
        tree = load_tree(self.tree, registry_with(self.behavior_modules), StaticContext(self.maze))
        refuse_mistakes(tree)
        if job.via and not reads_key(tree, "waypoints"):
            rings, name = ", ".join(f"ring{ring}" for ring in job.via), one_line(self.behavior, 300)
            expected = "expected `waypoints`, or a tree that does"
            raise InputError(f"got {rings}, but the tree {name} does not read {{waypoints}}; {expected}", key="via")


@dataclass(frozen=True)
class Navigation:
    """A request with everything that it names read: ready to be executed."""

    rig: Rig
    job: Job
    setup: Setup
