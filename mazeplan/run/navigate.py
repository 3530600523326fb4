"""`mazeplan.navigate(...)` for Python."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from mazeplan.behavior.context import RunContext
from mazeplan.btree.tree import BehaviorTree
from mazeplan.control.policy import Policy
from mazeplan.core.logs.run_log import Sink
from mazeplan.core.progress import Display
from mazeplan.core.records import NavigationResult
from mazeplan.learning.modelfile import RigModel
from mazeplan.maze.geometry import Maze
from mazeplan.rigs.interface import Rig
from mazeplan.run.execution import execute
from mazeplan.run.goals import Goals
from mazeplan.run.request import Company, NavigationRequest
from mazeplan.run.settings import Settings
from mazeplan.run.specification import TIME_LIMIT


def navigate(
    start: int | str = 1,
    goal: int | str | None = None,
    *,
    map: str | Path | Maze = "cme",  # the contract's option names
    rig: str | Path | Rig | type = "toy",
    model: str | Path | RigModel | None = None,
    policy: str | Path | Policy | None = None,
    behavior: str = "navigate",
    behavior_modules: Sequence[str] = (),
    effects: str | None = None,
    settings: str | Path | Settings | None = None,
    start_angle_deg: float | None = None,
    closed: Sequence[str] = (),
    via: Sequence[int | str] = (),
    balls: int | None = None,
    seed: int = 0,
    time_limit: float = TIME_LIMIT,
    log: str | Path | None = None,
    display: Display | None = None,
    goals: Goals | None = None,
    own_process: bool = False,
    feed: Sink | None = None,
    around: Callable[[Rig], Rig] | None = None,
    watch: Callable[[BehaviorTree, RunContext], None] | None = None,
) -> NavigationResult:
    """Bring the ball from one ring to another and return what happened.

    start, goal: ring numbers, or "ring1"; goal None: the centre
    rig: a packaged name, a YAML file, "module:Class", a rig, or its class
    model: packaged name, folder or RigModel; None: the rig's own, else one of the rig's name, else nominal physics
    policy: a learned policy, or its folder; the default tree is then `policy`
    behavior: packaged tree or XML file
    behavior_modules: modules with leaves beside the packaged ones
    effects: "module:function" with effects of your own that the model has
    settings: YAML file of costs, gains and windows, or Settings; None: the packaged ones
    start_angle_deg: where the ball is placed in the start ring; None: drawn by the seed
    closed: names of openings that the run does not use
    via: rings to visit before the goal, in this order; the default tree is then `waypoints`
    balls: number of balls, 1 or 2; None: as the map says; with 2 the default tree is `two_balls`
    seed: of start angle and simulated noise
    time_limit: rig time for each goal, from when it was given, s
    display: shows the progress of the run
    goals: gives further goals during the run
    own_process: whether the watchdog may end the process when a leaf hangs and nothing else ends it
    feed: called with topic, rig time and document of each message of a log
    around: wraps the rig, for example to pace it by the wall clock
    watch: called with each tree and its context before it begins

    The tree is checked before anything moves, as `behavior check` does.

    Raises InputError for an argument that cannot be used, RigError when the rig fails.
    """
    request = NavigationRequest(
        start, goal, map, str(rig) if isinstance(rig, Path) else rig, model, policy, behavior, tuple(behavior_modules),
        effects, settings, start_angle_deg, tuple(closed), tuple(via), balls, seed, time_limit, log,
    )  # fmt: skip
    company = Company(display, goals, own_process, feed, around, watch)
    return execute(request, company)
