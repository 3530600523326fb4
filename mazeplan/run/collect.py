"""Excite a rig and log it: the data that models are fitted to.

Sines alone starve the inner rings: the ball leaves them after seconds and comes back by chance. Two ways to give every
ring its share of the time:

    run_collection   the ball is placed in each ring in turn, each placing a segment of its own; on a real rig a
                     person does that
    run_tour         the ball is placed once; then it is driven to the ring that has had the least time, by estimator,
                     tree and planner as in a navigation, and excited there, in turn and in one segment

All commands are logged, those of the drives too, so that every row can be learned from. The column `leaf` names the
phase: EXCITE, or the leaf of the tree that drove.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Container, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from mazeplan.core.display import NullDisplay
from mazeplan.core.events import DriveFailed, DriveStarted, ExcitationStarted, OpeningPassed
from mazeplan.core.logs.run_log import RunLogWriter
from mazeplan.core.maths.angles import difference
from mazeplan.core.records import Array, Command, FailureKind, Observation, State
from mazeplan.maze.geometry import Maze
from mazeplan.maze.mapfile import dump_map
from mazeplan.maze.regions import leading_to
from mazeplan.rigs.interface import Rig, check_ready
from mazeplan.run.excitation import BAND_HZ, multisine
from mazeplan.run.loop import Run
from mazeplan.run.specification import Job, Setup, log_shape

STRETCH_S = 20.0  # s in one ring before the ball is placed in the next
# 1/s; drives change the tilt by this times its limit at most: half of what the fastest sine would, alone and at full
# height. A servo with a limit of its own would show it in faster commands, and the linear model of the stage, fitted
# to them, would be wrong: 20 for 26 rad/s on the toy with its 120 deg/s
DRIVE_SLEW = math.pi * BAND_HZ[1]
BLEND_S = 0.5  # s from the last command of a drive to the sines, for the same reason
EXCITE = "Excite"  # in the column `leaf`: the sines command


@dataclass(frozen=True)
class Collection:
    """How long (s), in which rings the ball is placed in turn (one: it is placed once), and the seed; tilt: rad, the
    largest that is commanded (None: the limit of the map); highest_hz: of the sines; rig_given, map_given: what
    they were called, for the log alone."""

    seconds: float
    rings: tuple[int, ...]
    seed: int = 0
    tilt: float | None = None
    highest_hz: float = BAND_HZ[1]
    rig_given: str = ""
    map_given: str = ""

    def commands(self, rng: np.random.Generator, rate_hz: float, limit: float) -> Array:
        """Sines (N, 2) in rad, within the limit of the map."""
        most = limit if self.tilt is None else min(self.tilt, limit)
        return multisine(rng, self.seconds, rate_hz, most, band_hz=(BAND_HZ[0], self.highest_hz))


@dataclass(frozen=True)
class TourOptions:
    """When a tour moves on.

    dwell_s: of excitation in a ring; away_s: outside it after which the dwell ends early; drive_s: limit of a drive;
    disc_share: time that the disc gets for each second of another ring (no ball model is fitted to it); spare: how
    many more times than the rarest opening of its wall one may have been passed and still be used by a drive.
    """

    dwell_s: float = 20.0
    away_s: float = 2.0
    drive_s: float = 15.0
    disc_share: float = 0.5
    spare: int = 1


@dataclass(frozen=True)
class Collected:
    """What a tour did: samples, s in each ring, times each opening was passed, changes of ring, drives, and drives
    that did not arrive."""

    rows: int
    ring_s: dict[int, float]
    passed: dict[str, int]
    changes: int
    drives: int
    failed: int


def run_collection(
    rig: Rig, maze: Maze, plan: Collection, output: str | Path, *, rig_name: str = "",
    progress: Callable[[int], None] | None = None,
) -> int:  # fmt: skip
    """Drive the rig with random sines and log each sample; returns the number of samples. The plate is level
    afterwards.

    Each placing of the ball begins a new segment; time goes on through all of them."""
    check_ready(rig)
    rng = np.random.default_rng(plan.seed)
    commands = plan.commands(rng, rig.rate_hz, maze.tilt_limit)
    stretch = len(commands) if len(plan.rings) == 1 else max(1, round(STRETCH_S * rig.rate_hz))
    header = {**_header(maze, plan, rig_name), "rings": list(plan.rings)}
    dt, rows = 1.0 / rig.rate_hz, 0
    try:
        with RunLogWriter(output, header, log_shape(maze)) as log:
            for segment, start in enumerate(range(0, len(commands), stretch)):
                ring = plan.rings[segment % len(plan.rings)]
                rig.reset(
                    ring=ring,
                    theta=maze.clear_angle(ring, float(rng.uniform(-math.pi, math.pi))),
                    rng=np.random.default_rng([plan.seed, segment]),
                )
                for u in commands[start : start + stretch]:
                    o = rig.observe()
                    command = Command(float(u[0]), float(u[1]))
                    rig.command(command.u_beta, command.u_gamma)
                    log.sample(Observation(start * dt + o.t, o.x, o.y, o.beta, o.gamma), command, segment=segment)
                    rows += 1
                    if progress is not None and rows % 30 == 0:
                        progress(round(rows * dt))
    finally:
        _end(rig)
    return rows


def run_tour(
    rig: Rig, setup: Setup, plan: Collection, output: str | Path, *, options: TourOptions | None = None,
    progress: Callable[[int], None] | None = None,
) -> Collected:  # fmt: skip
    """Excite the ball in each ring of `plan.rings` in turn, driving it from one to the next, and log each sample.

    The ball is placed once, in the first of the rings. A drive that does not arrive is counted, and the sines go on
    where the ball is. The plate is level and the rig closed afterwards, whatever happens."""
    check_ready(rig)
    rng = np.random.default_rng(plan.seed)
    commands = plan.commands(rng, rig.rate_hz, setup.maze.tilt_limit)
    theta = setup.maze.clear_angle(plan.rings[0], float(rng.uniform(-math.pi, math.pi)))
    header = _header(setup.maze, plan, setup.rig_name) | {
        "rings": list(plan.rings), "model": setup.model_name or setup.model.kind, "start_ring": plan.rings[0],
        "drives": True,
    }  # fmt: skip
    try:
        with RunLogWriter(output, header, log_shape(setup.maze)) as log:
            job = Job(plan.rings[0], plan.rings[0], theta, plan.seed, plan.seconds)
            run = Run(rig, setup.on(rig), job, log, NullDisplay(), segment=0, slew=DRIVE_SLEW * setup.maze.tilt_limit)
            rig.reset(ring=job.start, theta=theta, rng=np.random.default_rng([plan.seed, 0]))
            tour = _Tour(rig, run, log, setup.maze, plan, commands, options or TourOptions(), progress)
            return tour.whole()
    finally:
        _end(rig)


def left_alone(maze: Maze, passed: Mapping[str, int], refused: Container[str], spare: int) -> tuple[str, ...]:
    """Openings that a drive does not use, so that all are passed about equally often: those that refused the ball,
    and those passed more often than the rarest of their wall by more than `spare`.

    passed: how often, by name; a wall of which all openings refused the ball is left as it is, and so are all where
    radial walls would leave no way without those."""
    names: list[str] = []
    for wall in maze.walls:
        usable = [o.name for o in wall.openings if not o.closed and o.name not in refused]
        if usable:
            most = min(passed[name] for name in usable) + spare
            names += [o.name for o in wall.openings if o.name not in usable or passed[o.name] > most]
    if maze.radial_walls:
        last, shut = len(maze.rings), [o.name for o in maze.openings if o.closed]
        if leading_to(maze, last, [*names, *shut]) != leading_to(maze, last, shut):
            return ()
    return tuple(names)


def _header(maze: Maze, plan: Collection, rig_name: str) -> dict[str, object]:
    given = {"rig_given": plan.rig_given, "map_given": plan.map_given}
    return {
        **{name: text for name, text in given.items() if text},
        "program": "mazeplan", "rig": rig_name, "map": dump_map(maze), "map_name": maze.name, "seed": plan.seed,
        "excitation": "multisine", "seconds": plan.seconds,
    }  # fmt: skip


def _end(rig: Rig) -> None:
    try:
        rig.level()
    finally:
        rig.close()


@dataclass
class _Tour:
    """A tour in progress, and its counts."""

    rig: Rig
    run: Run
    log: RunLogWriter
    maze: Maze
    plan: Collection
    commands: Array
    options: TourOptions
    progress: Callable[[int], None] | None
    rows: int = 0
    ring: int = 0
    ring_s: dict[int, float] = field(default_factory=dict)
    passed: dict[str, int] = field(default_factory=dict)
    changes: int = 0
    drives: int = 0
    failed: int = 0
    gave_up: bool = False  # the last drive did
    refused: set[str] = field(default_factory=set)  # openings where a drive gave up and that were not passed since

    def whole(self) -> Collected:
        """All of it."""
        self.ring = self.plan.rings[0]
        self.ring_s = {ring.number: 0.0 for ring in self.maze.rings}
        self.passed = {opening.name: 0 for opening in self.maze.openings}
        while self.going:
            wanted = self._next_ring()
            if self.ring != wanted:
                self._drive(wanted)
            self._excite(wanted)
        return Collected(self.rows, self.ring_s, self.passed, self.changes, self.drives, self.failed)

    @property
    def going(self) -> bool:
        """Whether there is time left."""
        return self.rows < len(self.commands)

    def _next_ring(self) -> int:
        """The ring that has had the least of its share."""
        shares = {n: self.options.disc_share if self.maze.ring(n).is_disc else 1.0 for n in self.plan.rings}
        return min(shares, key=lambda ring: self.ring_s[ring] / shares[ring])

    def _excite(self, wanted: int) -> None:
        """Sines until the dwell is over or the ball has been elsewhere for a while."""
        began, inside, before = self.rows, self.rows, np.array([self.run.sent.u_beta, self.run.sent.u_gamma])
        dt = 1.0 / self.rig.rate_hz
        self.log.event(self.run.context.now, ExcitationStarted(wanted))
        while self.going and (self.rows - began) * dt < self.options.dwell_s:
            share = min(1.0, (self.rows - began) * dt / BLEND_S)
            u = share * self.commands[self.rows] + (1.0 - share) * before
            self._tick(Command(float(u[0]), float(u[1])))
            if self.ring == wanted:
                inside = self.rows
            elif (self.rows - inside) * dt >= self.options.away_s:
                return

    def _drive(self, wanted: int) -> None:
        """Closed loop until the ball has arrived, the tree gives up, or the time is over."""
        began, dt = self.rows, 1.0 / self.rig.rate_hz
        closed = () if self.gave_up else left_alone(self.maze, self.passed, self.refused, self.options.spare)
        self.drives += 1
        self.run.aim(wanted, closed)
        run, status = self.run.context, "RUNNING"
        self.log.event(run.now, DriveStarted(wanted, closed))
        while self.going and status == "RUNNING" and (self.rows - began) * dt < self.options.drive_s:
            status = self._tick(None)
        self.gave_up = status == "FAILURE" or (status == "RUNNING" and self.going)
        if self.gave_up:
            self.failed += 1
            if run.opening is not None:
                self.refused.add(run.opening.name)
            kind = run.last_failure.kind if run.last_failure is not None else FailureKind.OUT_OF_TIME
            self.log.event(run.now, DriveFailed(wanted, str(kind)))

    def _tick(self, given: Command | None) -> str:
        status = self.run.tick(self.rig.observe(), given, EXCITE if given is not None else "")
        measured = self.run.context.measured
        self.rows += 1
        if measured is not None and not measured.lost:
            if measured.ring != self.ring:
                self._changed(measured, announce=given is not None)
            self.ring_s[self.ring] += 1.0 / self.rig.rate_hz
        if self.progress is not None and self.rows % 30 == 0:
            self.progress(round(self.rows / self.rig.rate_hz))
        return status

    def _changed(self, measured: State, announce: bool) -> None:
        """The ball is in another ring: count, and in the log name the opening that no leaf names."""
        between = self.maze.openings_between(self.ring, measured.ring)
        self.changes += 1
        self.ring = measured.ring
        if between:
            opening = min(between, key=lambda o: abs(difference(o.angle, measured.theta)))
            self.passed[opening.name] += 1
            self.refused.discard(opening.name)
            if announce:
                self.log.event(self.run.context.now, OpeningPassed(opening.name, self.ring))
