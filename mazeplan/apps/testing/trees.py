"""Runs trees for tests: `run_tree` on a rig on which things may go wrong, `tick_tree` without a rig."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np

from mazeplan.apps.testing.leafscript import Script
from mazeplan.apps.testing.lightrig import RATE, LightRig, Mishap, identified
from mazeplan.apps.testing.record import Record
from mazeplan.apps.testing.watch import Watch
from mazeplan.behavior.context import RunContext, Steering
from mazeplan.behavior.own_nodes import registry_with
from mazeplan.behavior.trees import load_tree
from mazeplan.control.cost import CostParameters
from mazeplan.control.policy import Policy
from mazeplan.control.ring_planner import RingPlanner
from mazeplan.control.tilt import Plate
from mazeplan.core.errors import InputError, RigError
from mazeplan.core.events import FailureReported, OtherEvent, TimedEvent
from mazeplan.core.records import Array, Failure, FailureKind, NavigationResult, State
from mazeplan.maze.geometry import Maze
from mazeplan.maze.graph import RouteGraph
from mazeplan.maze.mapfile import load_map
from mazeplan.physics.dynamics.ring_parameters import RingParameters
from mazeplan.rigs.interface import Rig
from mazeplan.rigs.registry import make_rig
from mazeplan.run.execution import execute
from mazeplan.run.request import NO_DEADLINE, Company, NavigationRequest
from mazeplan.run.resolve import resolve_model
from mazeplan.run.settings import Settings, load_settings
from mazeplan.run.specification import TIME_LIMIT

Leaves = Mapping[str, str | Script]
Ball = Callable[[float], tuple[int, float] | None]  # time -> ring and angle (deg) of the ball, or None
FASTEST = 1.0  # m/s; a faster change of place is a jump, not a speed
OF_THE_RUN = (FailureKind.OUT_OF_TIME, FailureKind.ELSEWHERE, FailureKind.BALL_OUT)  # perhaps no leaf reported them


def run_tree(
    tree: str | Path = "navigate",
    leaves: Leaves | None = None,
    *,
    mishap: Mishap | None = None,
    rig: str | Rig = "light",
    map: str | Path | Maze = "cme",
    start: int | str = 1,
    goal: int | str | None = None,
    start_angle_deg: float = 0.0,
    closed: Sequence[str] = (),
    behavior_modules: Sequence[str] = (),
    settings: str | Path | Settings | None = None,
    policy: Policy | None = None,
    time_limit: float = TIME_LIMIT,
    seed: int = 0,
    log: str | Path | None = None,
) -> Record:
    """Run one navigation with a tree on a rig. The Record holds what happened, tick by tick.

    tree: packaged name, file, or XML text
    leaves: {name, kind or path of leaves: script that replaces their work}
    mishap: what goes wrong on the light rig: a function that gets the rig before each sample (see `LightRig`)
    rig: "light", name or file of a simulated rig, or a rig
    goal: goal ring; by default the last ring
    closed: openings that are closed
    policy: for leaves that follow a policy
    log: file for the log of the run

    Raises InputError for arguments that cannot be used."""
    if log is not None and str(tree).lstrip().startswith("<"):
        raise InputError("a log names the file of its tree; write the text into one", key="log")
    maze, light = map if isinstance(map, Maze) else load_map(map), rig == "light"
    if mishap is not None and not light:
        raise InputError("mishaps happen on the light rig; a simulated rig has `faults` in its file", key="rig")
    machine = LightRig(maze, mishap=mishap) if light else make_rig(rig, maze) if isinstance(rig, str) else rig
    model = resolve_model(None, rig, maze) if isinstance(rig, str) and not light else identified(maze)
    request = NavigationRequest(
        start, goal, maze, machine, model, policy, str(tree), tuple(behavior_modules), settings=settings,
        start_angle_deg=start_angle_deg, closed=tuple(closed), seed=seed, time_limit=time_limit, log=log,
        deadline=False,
    )  # fmt: skip
    watch, aim = Watch(leaves, _truth(machine)), request.job.goal
    try:
        result = execute(request, Company(watch=watch))
    except RigError as problem:
        watch.events.append(
            TimedEvent(watch.ticks[-1].t if watch.ticks else 0.0, OtherEvent("rig_failed", {"detail": str(problem)}))
        )
        return _record(watch, maze, aim, "rig_failed", False)
    if result.reason in OF_THE_RUN:
        last = result.failures[-1]
        failure = FailureReported(str(last.kind), last.where, last.words)
        if not any(timed.event == failure for timed in watch.events):
            watch.events.append(TimedEvent(last.t, failure))
    return _record(watch, maze, aim, result.reason, result.success, result)


def _truth(rig: Rig) -> Callable[[], tuple[int, float] | None]:
    if isinstance(rig, LightRig):
        return lambda: (rig.ring, rig.theta)
    return lambda: None


def _record(
    watch: Watch, maze: Maze, goal: int, reason: str, success: bool, result: NavigationResult | None = None
) -> Record:
    return Record(
        watch.tree_name, tuple(watch.nodes), tuple(watch.ticks), tuple(watch.steps), tuple(watch.events), reason,
        success, goal, maze, result,
    )  # fmt: skip


# -- without a rig -----------------------------------------------------------------------------------------------------


class _Planners(dict[int, RingPlanner]):
    """The planner of each ring, made at its first use, because most tests of leaves use none."""

    def __init__(self, maze: Maze) -> None:
        super().__init__()
        self._maze, self._model = maze, identified(maze)

    def __missing__(self, ring: int) -> RingPlanner:
        radius, limit = self._maze.track_radius(ring), self._maze.tilt_limit
        self[ring] = RingPlanner(RingParameters.from_model(self._model, ring, radius), limit, cost=CostParameters())
        return self[ring]


def tick_tree(
    tree: str | Path = "navigate",
    leaves: Leaves | None = None,
    *,
    main: str | None = None,
    ball: Ball | None = None,
    failures: Sequence[str] = (),
    keys: Mapping[str, Any] | None = None,
    map: str | Path | Maze = "cme",
    goal: int | str | None = None,
    closed: Sequence[str] = (),
    behavior_modules: Sequence[str] = (),
    ticks: int = 100,
) -> Record:
    """Tick a tree without a rig, at 30 Hz of rig time, until it ends or `ticks` are over.

    leaves: {name, kind or path of leaves: script that replaces their work}
    main: name of the tree in its file; by default the main tree
    ball: gives for a time, s, the ring of the ball and its angle, deg, or None while the ball is not seen; leaves
        without a script see this place without error. Default: at rest in ring 1
    failures: kinds of failure before the first tick, the latest one last
    keys: values on the blackboard
    closed: openings that are closed
    ticks: maximum number of ticks

    Raises InputError for arguments that cannot be used."""
    maze = map if isinstance(map, Maze) else load_map(map)
    job, options = NavigationRequest(1, goal, maze, closed=tuple(closed)).job, load_settings()
    path = _states(ball or (lambda t: (1, 0.0)), maze, options.estimator.lost_after)
    context = RunContext(
        maze=maze,
        graph=RouteGraph(maze),
        plate=Plate(maze.tilt_limit),
        goal=job.goal,
        steering=Steering(_Planners(maze), options.with_values(NO_DEADLINE).leaves),
        ahead=lambda seconds: _carried(context.here, seconds, maze),
        report=lambda event: None,
    )
    for name in job.closed:
        context.graph.close(name)
    for kind in failures:
        context.failed(Failure(_kind(kind), "before", 0.0))
    watch = Watch(leaves)
    loaded = load_tree(tree, registry_with(behavior_modules), context, main)
    for key, value in {"goal": job.goal, **(keys or {})}.items():
        loaded.blackboard.set_external(key, value)
    watch(loaded, context)
    for _ in range(ticks):
        state = next(path)
        context.begin(state.t, state, state)
        if loaded.tick().name != "RUNNING":
            break
    reason = watch.ticks[-1].status if watch.ticks else ""
    return _record(watch, maze, job.goal, reason, reason == "SUCCESS")


def _states(ball: Ball, maze: Maze, lost_after: float) -> Iterator[State]:
    """The states that an estimator without errors gives, one for each sample.

    lost_after: time without the ball after which it counts as lost, s"""

    def place(k: int) -> Array | None:
        there = ball(k / RATE)
        if there is None:
            return None
        theta = math.radians(there[1])
        return maze.track_radius(there[0]) * np.array([math.cos(theta), math.sin(theta)])

    last, velocity, last_seen = np.zeros(2), np.zeros(2), 0.0
    for k in count():
        t, now = k / RATE, place(k)
        if now is not None:
            a, b = place(max(k, 1) - 1), place(max(k, 1))
            velocity = np.zeros(2) if a is None or b is None else RATE * (b - a)
            velocity = velocity if math.hypot(*velocity) < FASTEST else np.zeros(2)
            last, last_seen = now, t
        (x, y), (vx, vy) = map(float, last), map(float, velocity)
        ring = maze.ring_at(math.hypot(x, y))
        yield State(t, x, y, vx, vy, 0.0, 0.0, 0.0, 0.0, ring, now is not None, t - last_seen > lost_after)


def _kind(name: str) -> FailureKind:
    try:
        return FailureKind(name)
    except ValueError:
        kinds = ", ".join(str(kind) for kind in FailureKind)
        raise InputError(f"got {name!r}, expected one of {kinds}", key="failures") from None


def _carried(state: State, seconds: float, maze: Maze) -> State:
    """The state `seconds` later if the ball goes straight on at its velocity."""
    x, y = state.x + seconds * state.vx, state.y + seconds * state.vy
    return State(
        state.t + seconds, x, y, state.vx, state.vy, state.beta, state.beta_dot, state.gamma, state.gamma_dot,
        maze.ring_at(math.hypot(x, y)), state.seen, state.lost,
    )  # fmt: skip
