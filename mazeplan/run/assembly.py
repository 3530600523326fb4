"""The parts of a run, from maze, model and settings: plate, planners, roll-outs, and the estimators of its balls."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import replace

from mazeplan.behavior.context import BallView, LeafOptions
from mazeplan.control.command_chain import SafetyFilter
from mazeplan.control.cost import running
from mazeplan.control.estimation.delay_bank import DelayBank, estimator_for
from mazeplan.control.estimation.estimator import Estimator
from mazeplan.control.estimation.rigid_body_fit import body_of
from mazeplan.control.estimation.sample_check import Out, RimWatch
from mazeplan.control.ilqg import IlqgOptions, Stopwatch, compile_solver
from mazeplan.control.ilqg_workspace import RUNNING
from mazeplan.control.opening_rollout import OpeningRollout
from mazeplan.control.ring_planner import RingPlanner, compile_guess
from mazeplan.control.tilt import Plate
from mazeplan.core.errors import InputError, RigError
from mazeplan.core.maths.compiled import address_of
from mazeplan.core.records import LEVEL, Command, Observation, State
from mazeplan.core.side_by_side import beside
from mazeplan.learning.modelfile import RigModel
from mazeplan.maze.geometry import Maze
from mazeplan.maze.mapschema import MAX_BALLS, crowded
from mazeplan.rigs.interface import Rig, traits
from mazeplan.run.specification import Job, Setup


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
        maze.tilt_limit, ball.parameter("tilt_offset", "beta", 0.0), ball.parameter("tilt_offset", "gamma", 0.0)
    )


def planners_of(
    maze: Maze,
    model: RigModel,
    leaves: LeafOptions,
    watch: Stopwatch | None = None,
    *,
    late_s: float | None = None,
) -> dict[int, RingPlanner]:
    """A planner for each channel, by ring number.

    watch: stopwatch for the planners' deadlines
    late_s: time from a sample until the command computed from it acts, s; None: the model's"""
    cost = leaves.cost.seen_late(model.late_s if late_s is None else late_s)
    return {
        ring.number: RingPlanner(
            model.ring_parameters(ring.number, ring.track_radius),
            maze.tilt_limit,
            IlqgOptions(leaves.travel.horizon),
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
    planar = model.planar(maze)
    return OpeningRollout(maze, planar, plate_of(maze, model), options.gate, options.rollout, 1.0 / rate_hz)


def safety_filter_of(maze: Maze, model: RigModel) -> SafetyFilter | None:
    """The filter that keeps waiting balls in the disc; None for a maze with one ball, which never waits."""
    return None if maze.balls == 1 else SafetyFilter(maze, model.planar(maze), plate_of(maze, model))


RECENT_S = 2.0  # s of samples and commands that new estimators take in


def with_balls(maze: Maze, balls: int | None) -> Maze:
    """The maze with this number of balls; None: the number in its map. Raises InputError."""
    if balls is None or balls == maze.balls:
        return maze
    if balls not in range(1, MAX_BALLS + 1):
        raise InputError(f"got {balls}, expected 1 to {MAX_BALLS}", key="balls")
    return replace(maze, balls=balls)


def check_balls(maze: Maze, rig: Rig, job: Job, policy: bool) -> None:
    """Raises InputError if the maze has several balls but centre, rig, policy or job allow only one."""
    if maze.balls == 1:
        return
    has, why = traits(rig).balls, None
    if problem := crowded(maze.balls, 1e3 * maze.ball.radius, 1e3 * maze.rings[-1].outer_radius):
        why = f"expected 1: {problem}"
    elif has < maze.balls:
        why = f"expected {has}: the rig has no more"
    elif policy or job.via:
        why = f"expected 1 with {'a policy' if policy else 'waypoints (via)'}"
    elif not maze.ring(job.goal).is_disc:
        why = f"expected 1 on the way to ring {job.goal}: several balls go to the centre, ring {len(maze.rings)}"
    if why is not None:
        raise InputError(f"got {maze.balls}, {why}", key="balls")


class Balls:
    """The estimates of all balls. `Rig.reset` places the first ball; the others follow in the rig's order."""

    def __init__(self, setup: Setup, rate_hz: float) -> None:
        maze, options = setup.maze, setup.settings.estimator
        self._setup = setup
        self._rate_hz = rate_hz
        self._camera = setup.driving_model.camera
        self._all = self._estimators(setup.driving_model)
        self._recent: deque[Sequence[Observation] | tuple[Command, float]] = deque(
            maxlen=round(2.0 * RECENT_S * rate_hz)
        )
        self._rims = [] if setup.out_s is None else [RimWatch(maze, options.camera_sigma) for _ in range(maze.balls)]

    def _estimators(self, model: RigModel) -> list[Estimator | DelayBank]:
        maze, options = self._setup.maze, self._setup.settings.estimator
        return [estimator_for(maze, model, options, self._rate_hz) for _ in range(maze.balls)]

    def adopt(self, model: RigModel) -> None:
        """Go on with another model: new estimators take in the last RECENT_S of samples and commands."""
        self._camera = model.camera
        self._all = self._estimators(model)
        for one in self._recent:
            if isinstance(one[0], Command):
                for estimator in self._all:
                    estimator.sent(*one)  # pyright: ignore[reportArgumentType]
            else:
                for estimator, sample in zip(self._all, one, strict=True):
                    estimator.update(sample)  # pyright: ignore[reportArgumentType]

    @property
    def ahead(self) -> tuple[Callable[..., State], ...]:
        """`Estimator.ahead` of each ball."""
        return tuple(estimator.ahead for estimator in self._all)

    @property
    def doubts(self) -> set[str]:
        """Words of `records.Doubt` for the last sample."""
        return set().union(*(estimator.doubts for estimator in self._all))

    def warm_up(self) -> None:
        """Compile everything before the rig moves."""
        (twin, *_), dt = self._estimators(self._setup.driving_model), 1.0 / self._rate_hz
        radius = max(self._setup.maze.track_radius(1), 1e-3)
        for k in range(3):
            twin.update(Observation(k * dt, radius, 0.0, 0.0, 0.0))
            twin.sent(LEVEL, k * dt)
        twin.ahead(dt)  # the only prediction of queued commands where commands act at once

    def sent(self, command: Command, t: float) -> None:
        """Note a command given to the rig at time t."""
        self._recent.append((command, t))
        for estimator in self._all:
            estimator.sent(command, t)

    def update(self, observation: Observation) -> tuple[BallView, ...]:
        """Take in one sample; returns a view of each ball. Its state is predicted for when a command sent now will act.

        Raises RigError if the sample does not have as many balls as the run."""
        each = (observation, *observation.others)
        if len(each) != len(self._all):
            raise RigError(f"observe() of the rig: got {len(each)} balls, expected {len(self._all)}")
        self._recent.append(each)
        states = [e.update(sample) for e, sample in zip(self._all, each, strict=True)]
        return tuple(BallView(s, e.filtered or s) for s, e in zip(states, self._all, strict=True))

    def out(self, observation: Observation) -> Out | None:
        """The first ball in order that has left the maze, and where it is; None if all balls are inside."""
        found = None
        for rim, sample in zip(self._rims, (observation, *observation.others), strict=False):
            x, y = sample.x, sample.y
            out = rim.update(sample.t, None if x is None or y is None else self._camera.true(x, y))
            found = found or out
        return found
