"""Runs trees for tests: `run_tree` on a rig on which things may go wrong, `tick_tree` without a rig."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np

from mazeplan.apps.testing.lightrig import RATE, LightRig, Mishap, identified
from mazeplan.apps.testing.record import Record
from mazeplan.apps.testing.watch import Script, Watch
from mazeplan.behavior.context import RunContext, Steering
from mazeplan.behavior.registry import registry_with
from mazeplan.behavior.trees import load_tree
from mazeplan.control.estimation.estimator import LOST_AFTER
from mazeplan.control.policy import Policy
from mazeplan.control.tilt import Plate
from mazeplan.core.constants import TIME_LIMIT
from mazeplan.core.errors import InputError, RigError
from mazeplan.core.events import OtherEvent, TimedEvent
from mazeplan.core.records import Array, Failure, FailureKind, State
from mazeplan.maze.geometry import Maze
from mazeplan.maze.graph import RouteGraph
from mazeplan.maze.mapfile import load_map
from mazeplan.rigs.interface import Rig
from mazeplan.run.assembly import planners_of
from mazeplan.run.execution import execute
from mazeplan.run.request import NO_DEADLINE, Company, NavigationRequest
from mazeplan.run.settings import load_settings

Leaves = Mapping[str, str | Script]
Ball = Callable[[float], tuple[int, float] | None]  # time -> ring and angle (deg) of the ball, or None
FASTEST = 1.0  # m/s; a faster change of place is a jump, not a speed


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
    policy: Policy | None = None,
    time_limit: float = TIME_LIMIT,
    seed: int = 0,
) -> Record:
    """Run one navigation with a tree on a rig. The Record holds what happened, tick by tick.

    tree: packaged name, file, or XML text
    leaves: {name, kind or path of leaves: script that replaces their work}
    mishap: what goes wrong on the light rig: a function that gets the rig before each sample (see `LightRig`)
    rig: "light", name or file of a simulated rig, or a rig
    goal: goal ring; by default the last ring
    closed: openings that are closed
    policy: for leaves that follow a policy

    Raises InputError for arguments that cannot be used."""
    if mishap is not None and rig != "light":
        raise InputError("mishaps happen on the light rig; a simulated rig has `faults` in its file", key="rig")
    maze = map if isinstance(map, Maze) else load_map(map)
    machine = LightRig(maze, mishap=mishap) if rig == "light" else rig
    request = NavigationRequest(
        start, goal, maze, machine, None if isinstance(machine, str) else identified(maze), policy, str(tree),
        tuple(behavior_modules), start_angle_deg=start_angle_deg, closed=tuple(closed), seed=seed,
        time_limit=time_limit, deadline=False,
    )  # fmt: skip
    record = Record(maze, request.job.goal)
    watch = Watch(record, leaves, machine if isinstance(machine, LightRig) else None)
    try:
        record.result = result = execute(request, Company(watch=watch))
        record.reason, record.success = result.reason, result.success
    except RigError as problem:
        record.events.append(TimedEvent(record.time_s, OtherEvent("rig_failed", {"detail": str(problem)})))
        record.reason = "rig_failed"
    return record


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
    ticks: maximum number of ticks

    Raises InputError for arguments that cannot be used."""
    maze = map if isinstance(map, Maze) else load_map(map)
    options, goal = load_settings(), NavigationRequest(1, goal, maze).job.goal
    leaf_options = options.with_values(NO_DEADLINE).leaves
    context = RunContext(
        maze=maze,
        graph=RouteGraph(maze),
        plate=Plate(maze.tilt_limit),
        goal=goal,
        steering=Steering(planners_of(maze, identified(maze), leaf_options), leaf_options),
        ahead=lambda seconds, beside=(0.0, 0.0): _rolled_on(context.here, seconds, beside, maze),
        report=lambda event: None,
    )
    for kind in failures:
        if kind not in list(FailureKind):
            raise InputError(f"got {kind!r}, expected one of {', '.join(FailureKind)}", key="failures")
        context.failed(Failure(FailureKind(kind), "before", 0.0))
    record = Record(maze, goal)
    loaded = load_tree(tree, registry_with(behavior_modules), context, main)
    for key, value in {"goal": goal, **(keys or {})}.items():
        loaded.blackboard.set_external(key, value)
    Watch(record, leaves)(loaded, context)
    path = _states(ball or (lambda t: (1, 0.0)), maze)
    for state, _ in zip(path, range(ticks), strict=False):
        context.begin(state.t, state, state)
        record.reason = loaded.tick().name
        if record.reason != "RUNNING":
            break
    record.success = record.reason == "SUCCESS"
    return record


def _states(ball: Ball, maze: Maze) -> Iterator[State]:
    """The states that an estimator without errors gives, one for each sample."""

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
        yield State(t, x, y, vx, vy, 0.0, 0.0, 0.0, 0.0, ring, now is not None, t - last_seen > LOST_AFTER)


def _rolled_on(state: State, seconds: float, beside: tuple[float, float], maze: Maze) -> State:
    """The state `seconds` later, shifted by `beside`, m, if the ball goes straight on at its velocity."""
    x, y = state.x + seconds * state.vx + beside[0], state.y + seconds * state.vy + beside[1]
    return replace(state, t=state.t + seconds, x=x, y=y, ring=maze.ring_at(math.hypot(x, y)))
