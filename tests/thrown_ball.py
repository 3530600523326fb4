"""Runs on simulated rigs whose ball jumps out of the maze on the way."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from mazeplan.core.records import Failure, FailureKind, NavigationResult, Observation
from mazeplan.maze.mapfile import load_map
from mazeplan.rigs.interface import RigWrapper
from mazeplan.rigs.registry import make_rig
from mazeplan.rigs.sim.simulated import SimulatedRig
from mazeplan.run.execution import run_job
from mazeplan.run.resolve import resolve_model
from mazeplan.run.settings import load_settings
from mazeplan.run.specification import Job, Setup

MAZE = load_map("cme")
RIM = MAZE.walls[0].outer_radius
PATIENT = load_settings().with_values({"travel": {"deadline_ms": 1e6}})
RIGS = ("ideal", "toy", "rough")
LIMIT_S = 0.2
JUMP_S, UP = 0.12, 0.5  # s from where it is to beyond the rim; m/s upwards


class Thrown(RigWrapper):
    """A rig simulated in MuJoCo whose ball jumps out of the maze at the first sample from `at_s` on. path: time and
    true radius of the ball at each sample, s and m."""

    def __init__(self, rig: SimulatedRig, at_s: float) -> None:
        super().__init__(rig)
        self._machine, self._at_s, self._jumped = rig, at_s, False
        self.path: list[tuple[float, float]] = []

    def observe(self) -> Observation:
        """The next sample."""
        sample = super().observe()
        x, y = self._machine.truth()[:2]
        r = math.hypot(x, y)
        self.path.append((sample.t, r))
        if not self._jumped and sample.t >= self._at_s:
            self._jumped = True
            out, up = np.array([x, y, 0.0]) / max(r, 1e-9), np.array([0.0, 0.0, 1.0])
            place = r * out + 1.5 * MAZE.wall_height * up  # over the walls already
            self._machine.machine.set_ball(place, (RIM + 0.02 - r) / JUMP_S * out + UP * up, np.zeros(3))
        return sample

    @property
    def passed_at(self) -> float:
        """When the centre of the ball passed the outer edge of the rim, s; between two samples, evenly."""
        k = next(k for k, (_, r) in enumerate(self.path) if r > RIM)
        (before, inside), (after, outside) = self.path[k - 1 : k + 1]
        return before + (after - before) * (RIM - inside) / (outside - inside)


def thrown_run(name: str, seed: int, log: Path | None = None) -> tuple[Thrown, NavigationResult]:
    """A run to the centre on a packaged rig, its ball thrown out of the maze on the way. The seed says from which ring,
    and when."""
    machine = make_rig(name, MAZE)
    assert isinstance(machine, SimulatedRig)
    rig = Thrown(machine, 0.1 + 0.11 * (seed % 10))
    setup = Setup(MAZE, resolve_model(None, name, MAZE), rig_name=name, settings=PATIENT)
    try:
        return rig, run_job(rig, setup, Job(1 + seed % 4, 5, None, seed), log=log)
    finally:
        rig.close()


def told(result: NavigationResult) -> Failure | None:
    """The first failure that says that the ball is out."""
    return next((failure for failure in result.failures if failure.kind is FailureKind.BALL_OUT), None)
