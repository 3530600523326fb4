"""How far the toy can be predicted at all: the simulator itself as the model, begun from what is known of the ball.

A model of angle and rate knows neither how the ball spins nor where in the channel it is. Here the simulator is set
back to the beginning of each of `compare`'s windows and runs on under the same commands, with

    start estimated         angle and rate as the filter of `compare` found them, spin and place as they were
    spin, place unknown     angle and rate as they were; the ball lies on the wall that it is pressed to and rolls on it
    both                    what the state of a model holds, and no more

The last is one guess of what a model's state does not hold. How good a model of angle, rate and tilt can be is another
column: `bench_taught`. Used by tools/bench.py.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from bench_taught import DRAWN, FITTED, Truth, taught_errors

from mazeplan.core.constants import GRAVITY
from mazeplan.core.logs.table import read_table
from mazeplan.core.maths.angles import difference
from mazeplan.core.records import Array, Observation
from mazeplan.learning.comparison import by_ring, prepare
from mazeplan.learning.fitting import FitOptions, fit_kind
from mazeplan.learning.ring_scores import THOROUGH, CompareOptions, RingData
from mazeplan.learning.rollout import STEPS, Windows, angle_noise, causal_start, choose_windows, roll_out
from mazeplan.learning.samples import SampleOptions
from mazeplan.maze.geometry import Maze
from mazeplan.maze.mapfile import load_map
from mazeplan.rigs.registry import make_rig
from mazeplan.rigs.sim.settings import SimulatedSettings
from mazeplan.rigs.sim.simulated import SimulatedRig, Snapshot
from mazeplan.run.collect import Collection, run_tour
from mazeplan.run.resolve import resolve_model
from mazeplan.run.specification import Setup

RINGS = (1, 2, 3, 4)
CASES = ("start estimated", "spin, place unknown", "both")
LATE = 2  # samples that the toy's picture is late: row i shows the ball of sample i - 2


class Recorder(SimulatedRig):
    """A simulated rig that remembers how it was at each sample, and what it was told then."""

    def __init__(self, maze: Maze, settings: Mapping[str, Any] | SimulatedSettings | None = None) -> None:
        super().__init__(maze, settings)
        self.snapshots: list[Snapshot] = []
        self.angles: list[float] = []
        self.truths: list[Array] = []  # rows as `Truth.of` takes them
        self.commands: list[tuple[float, float]] = []

    def observe(self) -> Observation:
        """The next sample."""
        seen = super().observe()
        self.snapshots.append(self.snapshot())
        self.angles.append(_angle(self))
        true, spin = self.truth(), self.ball()[2]
        self.truths.append(np.array([*true[:2], *true[3:5], spin[2], *true[5:]]))
        self.commands.append((0.0, 0.0))
        return seen

    def command(self, u_beta: float, u_gamma: float) -> None:
        """Hold this tilt from now on."""
        super().command(u_beta, u_gamma)
        self.commands[-1] = (u_beta, u_gamma)

    def close(self) -> None:
        """Not yet: the machine is still needed."""

    def again(self, sample: int, start: tuple[float, float] | None, hidden: bool, ring: int) -> Array:
        """True angles (STEPS + 1,), rad, from a sample on; start: angle and rate instead of the true ones; hidden:
        with spin and place in the channel taken for those of a ball that rolls along the wall it is pressed to."""
        self.restore(self.snapshots[sample])
        if start is not None or hidden:
            self.set_ball(*_moved(self, start, hidden, ring))
        out = [_angle(self)]
        for u in self.commands[sample : sample + STEPS]:
            super().command(*u)
            super().observe()
            out.append(_angle(self))
        return np.unwrap(out)


def _angle(rig: SimulatedRig) -> float:
    x, y = rig.truth()[:2]
    return math.atan2(y, x)


def _moved(rig: SimulatedRig, start: tuple[float, float] | None, hidden: bool, ring: int) -> tuple[Array, Array, Array]:
    """Position, velocity and spin of the ball with some of it replaced; it rolls on the floor in any case."""
    position, velocity, spin = rig.ball()
    beta, gamma = rig.truth()[5:]
    theta, r = math.atan2(position[1], position[0]), math.hypot(position[0], position[1])
    out = np.array([math.cos(theta), math.sin(theta)])
    radial, along = float(velocity[:2] @ out), float(velocity[1] * out[0] - velocity[0] * out[1])
    if start is not None:
        theta, along = start[0], r * start[1]
        out = np.array([math.cos(theta), math.sin(theta)])
    upright = float(spin[2])
    if hidden:
        place, ball = rig.maze.ring(ring), rig.maze.ball.radius
        outwards = along**2 / r + GRAVITY * (math.sin(beta) * out[0] - math.sin(gamma) * out[1]) > 0.0
        r = place.outer_radius - ball if outwards else place.inner_radius + ball
        radial, upright = 0.0, (-along if outwards else along) / ball
    v = radial * out + along * np.array([-out[1], out[0]])
    at = np.array([r * out[0], r * out[1], position[2]])
    rolling = np.array([-v[1], v[0]]) / rig.maze.ball.radius
    return at, np.array([v[0], v[1], velocity[2]]), np.array([rolling[0], rolling[1], upright])


def predictability_section(quick: bool) -> list[str]:
    """The table, and what it says."""
    seconds = 200 if quick else 1500
    log = Path(__file__).resolve().parent.parent / "build" / "predictability.mcap"
    log.parent.mkdir(exist_ok=True)
    return [
        "## How far the toy can be predicted",
        "",
        f"The drives of `mazeplan collect --rig toy --rings --seconds {seconds} --seed 7` once more, the simulator set",
        "back to the beginning of each window and run on under the same commands. In the last column it knows what a",
        "model of angle and rate knows: where the ball is and how fast, as estimated, but not its spin nor its place",
        "in the channel (those of a ball are taken that rolls along the wall it is pressed to). It follows one",
        "guess of what is unknown; a model that expects the mean of all can be nearer: these are no lower bounds.",
        "",
        "Taught by the truth: the same process, trained on as many rows of the simulator's own angle, rate,",
        "acceleration and tilt, without noise or smoothing, and begun at the true angle and rate. What is left has",
        "nothing to do with measurement: the state of such a model does not hold how the ball spins and on which wall",
        "it lies. Told that too, at every sample of the roll-out (which no prediction could know), it still has",
        "to learn from as many rows what a blow at an edge does. Mean or typical, whichever is better. Begun by",
        f"pictures: from starts off by what a straight line through {FITTED} noisy pictures is off, {DRAWN} drawn for",
        "each window: what a filter could know of it at best that knew all forces.",
        "",
        *predictability_rows(seconds, log),
    ]


def predictability_rows(seconds: int, log: Path) -> list[str]:
    """A table of mean absolute errors after 40 samples, by ring and by what is unknown."""
    maze = load_map("cme")
    toy = make_rig("toy", maze)
    assert isinstance(toy, SimulatedRig)
    recorder = Recorder(maze, toy.settings)
    setup = Setup(maze, resolve_model(None, "toy", maze), rig_name="toy")
    run_tour(recorder, setup, Collection(float(seconds), (1, 2, 3, 4, 5), 7), log)
    options = CompareOptions()
    found = by_ring([read_table(log)], maze, options, SampleOptions(delay=LATE / recorder.rate_hz))
    columns = ("sp", "taught by the truth", "told spin and place, too", "begun by pictures")
    rows = [
        f"| theta error after 40 samples, rad | {' | '.join((*columns, *(f'simulator, {case}' for case in CASES)))} |",
        "|---" * (len(CASES) + len(columns) + 1) + "|",
    ]
    truth = Truth.of(np.array(recorder.truths), 1.0 / recorder.rate_hz)
    for ring in RINGS:
        data = prepare(found[ring], None, options)
        windows = choose_windows(data.test, data.test_mask, np.array([o.angle for o in maze.openings_of(ring)]))
        errors = _errors(recorder, ring, data, windows)
        noise = 1e-3 * recorder.settings.camera_noise_mm
        errors[1:1] = taught_errors(truth, data, windows, data.test.row - LATE, maze, noise)
        cells = " | ".join(f"{error:.3f}" for error in errors)
        rows.append(f"| ring{ring}: {len(windows)} windows, {windows.chosen} | {cells} |")
    return rows


def _errors(recorder: Recorder, ring: int, data: RingData, windows: Windows) -> list[float]:
    """Of sp, and of the simulator in each case."""
    options = FitOptions(inputs="local", training=replace(THOROUGH, family="exponential"))
    model = fit_kind("sp", data.train, data.train_rows, options).model
    misfit = 0.5 * float(np.std(data.train.theta_ddot[data.train_rows]))
    theta, rate, _ = causal_start(model.mean, data.test, windows.start, angle_noise(data.train), misfit)
    found = [roll_out(model.mean, data.test, windows.start, theta, rate).after(STEPS)]
    samples = data.test.row[windows.start] - LATE
    for estimated, hidden in ((True, False), (False, True), (True, True)):
        errors = []
        for i, sample in enumerate(samples.tolist()):
            start = (float(theta[i]), float(rate[i])) if estimated else None
            angle = recorder.again(sample, start, hidden, ring)
            begun = angle[0] + difference(recorder.angles[sample], angle[0])
            true = np.unwrap([begun, *recorder.angles[sample + 1 : sample + STEPS + 1]])
            errors.append(abs(angle[STEPS] - true[STEPS]))
        found.append(float(np.mean(errors)))
    return found
