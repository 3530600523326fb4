"""`collect`: excite a rig and log it, for the data that models are fitted to.

With sines alone the inner rings get too few samples. Two functions give every ring its share: `run_collection` places
the ball in each ring in turn (on a real rig a person does it), each placing a segment of the log; `run_tour` places it
once and drives it to the ring that has had the least time, as in a navigation. The log has all commands, so every row
can be used for learning. The column `leaf` names the phase: EXCITE, or the leaf of the tree that drove.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Container, Mapping
from contextlib import AbstractContextManager, nullcontext
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import ClassVar

import numpy as np

from mazeplan.control.estimation.sample_check import SampleCheck
from mazeplan.core.errors import InputError, RigError
from mazeplan.core.events import DriveFailed, DriveStarted, ExcitationStarted, OpeningPassed
from mazeplan.core.logs.run_log import RunLogWriter
from mazeplan.core.maths.angles import difference
from mazeplan.core.progress import Advance, Display, no_advance, of_total
from mazeplan.core.records import Array, Command, FailureKind, Observation, State
from mazeplan.core.results import DocumentResult
from mazeplan.learning.modelfile import RigModel
from mazeplan.maze.geometry import Maze, leading_to
from mazeplan.maze.mapfile import dump_map, load_map
from mazeplan.rigs.interface import Rig, traits
from mazeplan.rigs.registry import make_rig, rig_label
from mazeplan.rigs.watchdog import watched
from mazeplan.run.loop import Run
from mazeplan.run.resolve import resolve_model, ring_number
from mazeplan.run.specification import Job, Setup

LEAST_TILT = 0.2  # degrees; a smaller tilt hardly moves a ball
# the sines of the published rig: 50 per axis, with frequencies drawn from [0, 1.5] Hz and phases from [0, 2 pi), 30 Hz
SINES = 50
BAND_HZ = (0.0, 1.5)
CREST = 2.5  # peak over standard deviation that is kept; rarer peaks are clipped at the limit
STRETCH_S = 20.0  # s in one ring before the ball is placed in the next, or driven there
AWAY_S = 2.0  # s outside the ring after which a tour leaves it
DRIVE_S = 15.0  # s, time limit of a drive
DISC_SHARE = 0.5  # time of the disc, relative to another ring; less than 1 because no ball model is fitted to the disc
SPARE = 1  # a drive uses an opening that was passed at most so many times more than the rarest opening of its wall
# 1/s; drives change the tilt at most this fast, times the tilt limit: half the rate of the fastest sine, alone and at
# full amplitude. Faster commands would reach the speed limit of a servo, and the linear model of the stage that is
# fitted to them would be wrong: 20 instead of 26 rad/s on the toy with its 120 deg/s
DRIVE_SLEW = math.pi * BAND_HZ[1]
# ticks; least length of a plan of a drive. The plate follows such slow commands later. With 30 ticks, 8 of 169 drives
# of a ball without friction missed an opening (planar rig of the tests, seeds 3 to 12), with 40 ticks 1 of 173
DRIVE_HORIZON = 40
BLEND_S = 0.5  # s from the last command of a drive to the sines, for the same reason
EXCITE = "Excite"  # in the column `leaf`: the sines give the command


@dataclass(frozen=True)
class Collection:
    """The plan of a collection.

    seconds: duration of the excitation
    rings: where the ball is placed, in turn; with one ring it is placed once
    seed: of the sines and the start angles
    tilt: largest tilt that is commanded, rad; None: the limit of the map
    highest_hz: highest frequency of the sines
    """

    seconds: float
    rings: tuple[int, ...]
    seed: int = 0
    tilt: float | None = None
    highest_hz: float = BAND_HZ[1]

    def commands(self, rng: np.random.Generator, rate_hz: float, limit: float) -> Array:
        """The sines (N, 2) in rad; `limit` is the tilt limit of the map, rad."""
        most = limit if self.tilt is None else min(self.tilt, limit)
        return multisine(rng, self.seconds, rate_hz, most, band_hz=(BAND_HZ[0], self.highest_hz))


@dataclass(frozen=True)
class Collected:
    """What a tour did."""

    rows: int  # number of samples
    ring_s: dict[int, float]  # time in each ring, s
    passed: dict[str, int]  # how often each opening was passed
    changes: int  # number of changes of ring
    drives: int  # number of drives
    failed: int  # number of drives that did not arrive


@dataclass(frozen=True)
class RecordResult(DocumentResult):
    """A record of a rig: the document of `collect --json`, the log, and what the tour did, if the ball was driven."""

    kind: ClassVar[str] = "record"

    log: Path
    tour: Collected | None


def collect(
    output: str | Path,
    seconds: float = 300.0,
    *,
    rig: str | Path | Rig | type = "toy",
    map: str | Path | Maze = "cme",
    ring: int | str = 1,
    rings: bool = False,
    place: bool = False,
    model: str | Path | RigModel | None = None,
    seed: int = 0,
    tilt: float | None = None,
    highest_hz: float = 1.5,
    own_process: bool = False,
    guard: Callable[[Rig], AbstractContextManager[object]] = nullcontext,
    advance: Advance = no_advance,
) -> RecordResult:
    """Excite a rig with 50 random sines per axis and write a log.

    output: run log (MCAP) to write
    seconds: length of the record, s of rig time
    ring: where the ball is placed; rings: whether the ball visits all rings, driven with the model
    place: with `rings`: whether a person places the ball in each ring instead
    tilt: largest tilt, degrees; None: the map's limit
    highest_hz: highest frequency of the sines
    guard: context in which the rig is driven, such as an emergency stop
    advance: gets the progress, s

    Raises InputError, RigError."""
    if (model is not None and (place or not rings)) or (place and not rings):
        raise InputError("--model needs --rings without --place, --place needs --rings: else they have no effect")
    if not 0.0 < seconds < math.inf:
        raise InputError(f"got {seconds:g}, expected a finite number > 0 of s", key="--seconds")
    maze = map if isinstance(map, Maze) else load_map(map)
    first = ring_number(ring, maze)
    others = [r.number for r in maze.rings if r.number != first] if rings else []
    if tilt is not None and not (tilt >= LEAST_TILT and math.radians(tilt) <= maze.tilt_limit):
        allowed = f"{LEAST_TILT:g} to {math.degrees(maze.tilt_limit):g}"
        raise InputError(f"--tilt: got {tilt:g}, expected {allowed} degrees")
    spec, label = str(rig) if isinstance(rig, str | Path) else None, rig_label(rig)
    plan = Collection(seconds, (first, *others), seed, None if tilt is None else math.radians(tilt), highest_hz)
    setup, tour = None, None
    if rings and not place:
        name = "" if isinstance(model, RigModel | None) else str(model)
        setup = Setup(maze, resolve_model(model, spec, maze), rig_name=label, model_name=name)
    machine = watched(make_rig(rig, maze), own_process=own_process)
    if highest_hz > 0.5 * machine.rate_hz:
        why = f"expected at most {0.5 * machine.rate_hz:g} Hz: half the samples a second of the rig"
        raise InputError(f"--highest-hz: got {highest_hz:g}, {why}")
    shown = of_total(advance, math.ceil(seconds))
    with guard(machine):
        if setup is not None:
            tour = run_tour(machine, setup, plan, output, progress=shown)
        samples = tour.rows if tour else run_collection(machine, maze, plan, output, rig_name=label, progress=shown)
    document = {
        "log": str(output), "samples": samples, "seconds": seconds, "rig": label, "seed": seed,
        "map": maze.name if isinstance(map, Maze) else str(map), "tour": None if tour is None else asdict(tour),
    }  # fmt: skip
    return RecordResult(document, Path(output), tour)


def multisine(
    rng: np.random.Generator, duration_s: float, rate_hz: float, limit: float, *,
    band_hz: tuple[float, float] = BAND_HZ,
) -> Array:  # fmt: skip
    """Commands (N, 2) in rad for both axes over duration_s, each within +- limit."""
    t = np.arange(round(duration_s * rate_hz)) / rate_hz
    axes = []
    for _ in range(2):
        frequency, phase = rng.uniform(*band_hz, SINES), rng.uniform(0.0, 2.0 * np.pi, SINES)
        total = np.sin(2.0 * np.pi * np.outer(t, frequency) + phase).sum(axis=1)
        axes.append(np.clip(total / (CREST * np.sqrt(0.5 * SINES)), -1.0, 1.0) * limit)
    return np.stack(axes, axis=1)


def run_collection(
    rig: Rig, maze: Maze, plan: Collection, output: str | Path, *, rig_name: str = "",
    progress: Callable[[int], None] | None = None,
) -> int:  # fmt: skip
    """Drive the rig with random sines and log each sample; returns the number of samples.

    Each placing of the ball begins a new segment; the time in the log goes on through all segments. A sample whose time
    is no number, or not newer than the last one, is skipped. Afterwards the plate is level and the rig closed."""
    traits(rig).ready()
    rng = np.random.default_rng(plan.seed)
    commands = plan.commands(rng, rig.rate_hz, maze.tilt_limit)
    stretch = len(commands) if len(plan.rings) == 1 else max(1, round(STRETCH_S * rig.rate_hz))
    header = {**_header(maze, plan, rig_name), "rings": list(plan.rings)}
    dt, rows = 1.0 / rig.rate_hz, 0
    try:
        with RunLogWriter(output, header) as log:
            for segment, start in enumerate(range(0, len(commands), stretch)):
                ring = plan.rings[segment % len(plan.rings)]
                rig.reset(
                    ring=ring,
                    theta=maze.clear_angle(ring, float(rng.uniform(-math.pi, math.pi))),
                    rng=np.random.default_rng([plan.seed, segment]),
                )
                check = SampleCheck(rig.rate_hz)
                for u in commands[start : start + stretch]:
                    o = rig.observe()
                    command = Command(float(u[0]), float(u[1]))
                    rig.command(command.u_beta, command.u_gamma)
                    if check.admit(o) is None:  # no reader of the table could use it
                        continue
                    log.sample(Observation(start * dt + o.t, o.x, o.y, o.beta, o.gamma), command, segment=segment)
                    rows += 1
                    if progress is not None and rows % 30 == 0:
                        progress(round(rows * dt))
    finally:
        _end(rig)
    return rows


def run_tour(
    rig: Rig, setup: Setup, plan: Collection, output: str | Path, *, progress: Callable[[int], None] | None = None
) -> Collected:
    """Excite the ball in each ring of `plan.rings`, drive it from one ring to the next, and log each sample.

    The ball is placed once, in the first of the rings. If a drive does not arrive, the tour counts it as failed and
    excites the ball where it is. Afterwards the plate is level and the rig closed, whatever happens."""
    traits(rig).ready()
    rng = np.random.default_rng(plan.seed)
    commands = plan.commands(rng, rig.rate_hz, setup.maze.tilt_limit)
    theta = setup.maze.clear_angle(plan.rings[0], float(rng.uniform(-math.pi, math.pi)))
    header = _header(setup.maze, plan, setup.rig_name) | {
        "rings": list(plan.rings), "model": setup.named_model, "start_ring": plan.rings[0],
        "drives": True,
    }  # fmt: skip
    try:
        with RunLogWriter(output, header) as log:
            job = Job(plan.rings[0], plan.rings[0], theta, plan.seed, plan.seconds)
            slew = DRIVE_SLEW * setup.maze.tilt_limit
            horizon = max(DRIVE_HORIZON, setup.settings.leaves.travel.horizon)
            driving = replace(setup, settings=setup.settings.with_values({"travel": {"horizon": horizon}}))
            run = Run(rig, driving.on(rig), job, log, Display(), segment=0, slew=slew)
            rig.reset(ring=job.start, theta=theta, rng=np.random.default_rng([plan.seed, 0]))
            return _Tour(rig, run, log, setup.maze, plan, commands, progress).whole()
    finally:
        _end(rig)


def openings_to_avoid(maze: Maze, passed: Mapping[str, int], refused: Container[str], spare: int) -> tuple[str, ...]:
    """Names of the openings that a drive does not use, so that all openings are passed about equally often.

    A drive leaves out the openings in `refused`. It also leaves out an opening that was passed more often than the
    rarest opening of its wall by more than `spare`. If all openings of a wall refused the ball, none of this wall is
    left out. If radial walls would then block a way to the innermost ring, no opening at all is left out.

    passed: number of passages, by name of the opening
    refused: names of openings where a drive failed
    """
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
    return {
        "program": "mazeplan", "rig": rig_name, "map": dump_map(maze), "map_name": maze.name, "seed": plan.seed,
        "excitation": "multisine", "seconds": plan.seconds,
    }  # fmt: skip


def _end(rig: Rig) -> None:
    """Level the plate and close the rig. An error that ended the record is not replaced by one of a level plate."""
    failed = sys.exception()
    try:
        rig.level()
    except RigError:
        if failed is None:
            raise
    finally:
        rig.close()


@dataclass
class _Tour:
    """A tour in progress, with its counts."""

    rig: Rig
    run: Run
    log: RunLogWriter
    maze: Maze
    plan: Collection
    commands: Array
    progress: Callable[[int], None] | None
    rows: int = 0
    ring: int = 0
    ring_s: dict[int, float] = field(default_factory=dict)
    passed: dict[str, int] = field(default_factory=dict)
    changes: int = 0
    drives: int = 0
    failed: int = 0
    gave_up: bool = False  # whether the last drive failed
    refused: set[str] = field(default_factory=set)  # openings where a drive failed, until the ball passes them

    def whole(self) -> Collected:
        self.ring = self.plan.rings[0]
        self.ring_s = {ring.number: 0.0 for ring in self.maze.rings}
        self.passed = {opening.name: 0 for opening in self.maze.openings}
        while self.going:
            shares = {n: DISC_SHARE if self.maze.ring(n).is_disc else 1.0 for n in self.plan.rings}
            wanted = min(shares, key=lambda ring: self.ring_s[ring] / shares[ring])
            if self.ring != wanted:
                self._drive(wanted)
            self._excite(wanted)
        return Collected(self.rows, self.ring_s, self.passed, self.changes, self.drives, self.failed)

    @property
    def going(self) -> bool:
        return self.rows < len(self.commands)

    def _excite(self, wanted: int) -> None:
        began, inside, last = self.rows, self.rows, self.run.chain.wanted
        before = np.array([last.u_beta, last.u_gamma])
        dt = 1.0 / self.rig.rate_hz
        self.log.event(self.run.context.now, ExcitationStarted(wanted))
        while self.going and (self.rows - began) * dt < STRETCH_S:
            share = min(1.0, (self.rows - began) * dt / BLEND_S)
            u = share * self.commands[self.rows] + (1.0 - share) * before
            self._tick(Command(float(u[0]), float(u[1])))
            if self.ring == wanted:
                inside = self.rows
            elif (self.rows - inside) * dt >= AWAY_S:
                return

    def _drive(self, wanted: int) -> None:
        began, dt = self.rows, 1.0 / self.rig.rate_hz
        closed = () if self.gave_up else openings_to_avoid(self.maze, self.passed, self.refused, SPARE)
        self.drives += 1
        self.run.aim(wanted, closed)
        run, status = self.run.context, "RUNNING"
        self.log.event(run.now, DriveStarted(wanted, closed))
        while self.going and status == "RUNNING" and (self.rows - began) * dt < DRIVE_S:
            status = self._tick(None)
        self.gave_up = status == "FAILURE" or (status == "RUNNING" and self.going)
        if self.gave_up:
            self.failed += 1
            if run.leg.opening is not None:
                self.refused.add(run.leg.opening.name)
            last = run.last_failure
            kind = FailureKind.OUT_OF_TIME if last is None else last.kind
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
        """Count a change of ring. `announce` logs the opening: during excitation no leaf does it."""
        between = self.maze.openings_between(self.ring, measured.ring)
        self.changes += 1
        self.ring = measured.ring
        if between:
            opening = min(between, key=lambda o: abs(difference(o.angle, measured.theta)))
            self.passed[opening.name] += 1
            self.refused.discard(opening.name)
            if announce:
                self.log.event(self.run.context.now, OpeningPassed(opening.name, self.ring))
