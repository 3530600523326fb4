"""Builds the parts of a run from maze, model and settings."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext

from mazeplan.behavior.context import LeafOptions, RunContext
from mazeplan.control.cost import CostParameters, running
from mazeplan.control.deadline import Stopwatch
from mazeplan.control.estimation.rigid_body_parameters import body_of
from mazeplan.control.first_guess import compile_guess
from mazeplan.control.ilqg import IlqgOptions, compile_solver
from mazeplan.control.ilqg_workspace import RUNNING
from mazeplan.control.keeping import SafetyFilter
from mazeplan.control.opening_rollout import OpeningRollout
from mazeplan.control.ring_planner import RingPlanner
from mazeplan.control.tilt import Plate
from mazeplan.core.maths.compiled import address_of
from mazeplan.core.records import State
from mazeplan.core.side_by_side import beside
from mazeplan.learning.modelfile import RigModel
from mazeplan.maze.geometry import Maze
from mazeplan.physics.dynamics.planar import PlanarModel
from mazeplan.physics.dynamics.ring_parameters import RingParameters


@contextmanager
def compiled_beside(more: Callable[[], None]) -> Iterator[None]:
    """The first time, compile the planners' solver and what `more` needs on a second core, beside the body."""

    def work() -> None:
        compile_solver()
        compile_guess()
        more()

    address_of(running, RUNNING)  # its cache tells whether anything was compiled before
    with beside(work) if running.stats.cache_misses else nullcontext():
        yield


def plate_of(maze: Maze, model: RigModel) -> Plate:
    """The plate: tilt limit of the maze, and the tilt of the table that the model states."""
    ball = model.ball(1)
    return Plate(
        maze.tilt_limit,
        ball.parameter("tilt_offset", "beta", 0.0),
        ball.parameter("tilt_offset", "gamma", 0.0),
    )


def planners_of(
    maze: Maze,
    model: RigModel,
    cost: CostParameters,
    watch: Stopwatch | None = None,
    *,
    late_s: float | None = None,
    horizon: int = IlqgOptions.horizon,
) -> dict[int, RingPlanner]:
    """A planner for each channel, by ring number.

    watch: stopwatch for the planners' deadlines
    late_s: time from a sample until the command computed from it acts, s; None: the model's
    horizon: length of a plan, ticks
    """
    cost = cost.seen_late(model.late_s if late_s is None else late_s)
    return {
        ring.number: RingPlanner(
            RingParameters.from_model(model, ring.number, ring.track_radius),
            maze.tilt_limit,
            IlqgOptions(horizon=horizon),
            cost=cost,
            process=model.processes.get(ring.number),
            watch=watch,
        )
        for ring in maze.rings
        if not ring.is_disc
    }


def rollout_of(
    maze: Maze, model: RigModel, options: LeafOptions, late_s: float, rate_hz: float = 30.0
) -> OpeningRollout | None:
    """The roll-outs that try commands in front of openings; None if the delay `late_s` (s) is too long for them."""
    most = options.rollout.late_s if body_of(model) is None else options.rollout.late_body_s
    if late_s > most:
        return None
    planar = PlanarModel.build(maze, model)
    return OpeningRollout(maze, planar, plate_of(maze, model), options.gate, options.rollout, 1.0 / rate_hz)


def safety_filter_of(maze: Maze, model: RigModel) -> SafetyFilter | None:
    """The filter that keeps waiting balls in the disc; None for a maze with one ball, which never waits."""
    return None if maze.balls == 1 else SafetyFilter(maze, PlanarModel.build(maze, model), plate_of(maze, model))


def passed_by(run: RunContext, before: int, ring: int, ball: State | None = None) -> str | None:
    """Name of the opening by which a ball changed from ring `before` to `ring`; None if no opening joins the two rings.

    The nearest opening that joins them counts. ball: None: the ball that the leaves lead."""
    joining = [o for o in run.maze.openings if {o.outer, o.inner} == {before, ring}]
    nearest = min(joining, key=lambda o: abs(run.turn_to(o, ball)), default=None)
    return None if nearest is None else nearest.name
