"""`mazeplan.navigate(...)` for Python: finds map, rig and model by name and does one run."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext, suppress
from pathlib import Path

from mazeplan.behavior.context import RunContext
from mazeplan.behavior.own_nodes import registry_with
from mazeplan.behavior.trees import StaticContext, load_tree, reads_key, refuse_mistakes
from mazeplan.btree.ports import one_line
from mazeplan.btree.tree import BehaviorTree
from mazeplan.control.policy import Policy
from mazeplan.control.policy_file import load_policy
from mazeplan.core.display import Display
from mazeplan.core.errors import InputError, RigError
from mazeplan.core.logs.run_log import Sink
from mazeplan.core.name_hints import one_of
from mazeplan.core.records import NavigationResult
from mazeplan.learning.modelfile import RigModel
from mazeplan.maze.geometry import Maze
from mazeplan.maze.mapfile import load_map
from mazeplan.maze.memory import load_memory, save_memory
from mazeplan.physics.registry import own_effects
from mazeplan.rigs.interface import Rig, check_ready
from mazeplan.rigs.registry import make_rig, rig_label
from mazeplan.rigs.watchdog import watched
from mazeplan.run.balls import check_balls, tree_of, with_balls
from mazeplan.run.execution import run_job
from mazeplan.run.goals import Goals
from mazeplan.run.resolve import check_start_angle, model_source, resolve_model, ring_number
from mazeplan.run.settings import Settings, load_settings
from mazeplan.run.specification import TIME_LIMIT, Job, Setup


def navigate(
    start: int | str = 1,
    goal: int | str | None = None,
    *,
    map: str | Path | Maze = "cme",  # the contract's option names
    rig: str | Rig = "toy",
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
    memory: str | Path | None = None,
    display: Display | None = None,
    goals: Goals | None = None,
    own_process: bool = False,
    guard: Callable[[Rig], AbstractContextManager[object]] | None = None,
    sense: str | None = None,
    feed: Sink | None = None,
    around: Callable[[Rig], Rig] | None = None,
    watch: Callable[[BehaviorTree, RunContext], None] | None = None,
) -> NavigationResult:
    """Bring the ball from one ring to another and return what happened.

    start, goal: ring numbers, or "ring1"; goal None: the centre
    rig: a packaged name, a YAML file, "module:Class", or a rig
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
    memory: file that keeps the results at openings for the next run
    goals: requests from other threads: another goal, close or open an opening, stop
    own_process: whether the watchdog may end the process when a leaf hangs and nothing else ends it
    guard: a context around the run that is entered with the rig, such as an emergency stop
    sense: how a simulated rig sees the ball, "ideal" or "camera" (rendered pictures); None: by its settings
    feed: called in the thread of the run with topic, rig time and document of each message of a log
    around: wraps the rig, for example to pace it by the wall clock
    watch: called with each tree and its context before it begins, for example by a monitor

    The tree is checked before anything moves, as `behavior check` does.

    Raises InputError for an argument that cannot be used, RigError when the rig fails.
    """
    maze = with_balls(map if isinstance(map, Maze) else load_map(map), balls)
    rig_name = rig if isinstance(rig, str) else None
    job = _job(maze, start, goal, start_angle_deg, seed, time_limit, closed, via)
    made = make_rig(rig, maze, sense) if isinstance(rig, str) else rig
    machine = watched(made if around is None else around(made), own_process=own_process)
    check_ready(machine)
    check_balls(maze, machine, job, policy is not None)
    own_effects(effects)
    kept = None if memory is None else load_memory(Path(memory), [o.name for o in maze.openings], maze.name)
    chosen = tree_of(maze, "policy" if policy is not None else "waypoints" if via else behavior)
    tree = chosen if behavior == "navigate" else behavior
    load_tree(
        tree, registry_with(behavior_modules), StaticContext(maze)
    )  # before the model, which may compile for minutes
    setup = Setup(
        maze,
        resolve_model(model, rig_name, maze),
        tree,
        rig_label(rig) if isinstance(rig, str) else type(rig).__name__,
        model_name="" if isinstance(model, RigModel | None) else str(model),
        settings=settings if isinstance(settings, Settings) else load_settings(settings),
        behavior_modules=tuple(behavior_modules),
        memory=kept,
        model_source=None if isinstance(model, RigModel) else model_source(model, rig_name),
        effects=effects,
        policy=policy if isinstance(policy, Policy | None) else load_policy(policy),
        watch=_checked(behavior, job.via, watch),
    )
    with _open_rig(machine, guard):
        result = run_job(machine, setup, job, log=log, display=display, goals=goals, feed=feed)
    if kept is not None and memory is not None:
        save_memory(kept, Path(memory), result.time_s, maze.name)
    try:
        machine.close()
    except RigError as error:  # the run itself has a result
        error.result = result
        raise
    return result


def _checked(
    behavior: str, via: Sequence[int], watch: Callable[[BehaviorTree, RunContext], None] | None
) -> Callable[[BehaviorTree, RunContext], None]:
    """Wraps `watch` so that it also refuses mistakes in the first tree of a run, before the rig moves.

    Trees of later goals come from the same file and are not checked again."""
    checked = False

    def looked(tree: BehaviorTree, context: RunContext) -> None:
        nonlocal checked
        if watch is not None:
            watch(tree, context)  # before the check, as it may give blackboard entries
        if checked:
            return
        checked = True
        refuse_mistakes(tree)
        if via and not reads_key(tree, "waypoints"):
            rings = ", ".join(f"ring{ring}" for ring in via)
            expected = "expected `waypoints`, or a tree that does"
            raise InputError(
                f"got {rings}, but the tree {one_line(behavior, 300)} does not read {{waypoints}}; {expected}",
                key="via",
            )

    return looked


@contextmanager
def _open_rig(machine: Rig, guard: Callable[[Rig], AbstractContextManager[object]] | None) -> Iterator[None]:
    """Enter the guard; close the rig on an error."""
    try:
        with nullcontext() if guard is None else guard(machine):
            yield
    except BaseException:
        with suppress(RigError):  # the first error matters
            machine.close()
        raise


def _job(
    maze: Maze,
    start: int | str,
    goal: int | str | None,
    start_angle_deg: float | None,
    seed: int,
    time_limit: float,
    closed: Sequence[str],
    via: Sequence[int | str],
) -> Job:
    """The job, checked. Raises InputError."""
    if start_angle_deg is not None and not math.isfinite(start_angle_deg):
        raise InputError(f"got {start_angle_deg}, expected a finite number of degrees", key="start angle")
    known = [opening.name for opening in maze.openings]
    for name in closed:
        if name not in known:
            raise InputError(f"got {name!r}, expected {one_of(known, name)}", key="closed opening")
    job = Job(
        ring_number(start, maze),
        len(maze.rings) if goal is None else ring_number(goal, maze),
        None if start_angle_deg is None else math.radians(start_angle_deg),
        seed,
        time_limit,
        tuple(closed),
        tuple(ring_number(ring, maze) for ring in via),
    )
    if start_angle_deg is not None:
        check_start_angle(start_angle_deg, job.start, maze, "start angle")
    return job
