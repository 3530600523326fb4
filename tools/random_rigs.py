"""Simulated rigs drawn at random, and the models that identification would give them. Used by tune.py and bench."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from mazeplan.core.records import NavigationResult
from mazeplan.learning.modelfile import RigModel
from mazeplan.maze.mapfile import load_map
from mazeplan.physics.ball_model import BallModel
from mazeplan.physics.effects.ball import dry_friction, rolling_inertia, tilt_offset, viscous_friction
from mazeplan.physics.rig.stage import StageAxis, StageModel
from mazeplan.rigs.registry import make_rig
from mazeplan.rigs.sim.simulated import SimulatedRig
from mazeplan.run.execution import run_job
from mazeplan.run.resolve import resolve_model
from mazeplan.run.settings import Settings
from mazeplan.run.specification import Job, Setup

RANGES = {  # key of a simulated rig: lowest, highest; whole numbers where both are
    "camera_noise_mm": (0.0, 1.2), "camera_delay_frames": (0, 3), "tilt_noise_deg": (0.0, 0.1),
    "table_x_deg": (-0.5, 0.5), "table_y_deg": (-0.5, 0.5), "servo_frequency_rad_s": (18.0, 30.0),
    "servo_damping": (0.7, 1.1), "servo_slew_deg_s": (80.0, 200.0), "command_delay_ms": (0.0, 30.0),
    "backlash_deg": (0.0, 0.3), "rolling_friction_m": (1e-5, 1e-4), "wall_grip": (0.05, 0.4),
    "floor_friction": (0.15, 0.5), "contact_damping_ratio": (0.22, 1.0), "outlier_probability": (0.0, 0.02),
    "ball_lost_probability": (0.0, 0.01),
}  # fmt: skip

_packaged: dict[str, RigModel] = {}  # a cached function could not be sent to workers without this file


def draw(seed: int) -> dict[str, Any]:
    """Settings of one rig, uniform in RANGES."""
    rng = np.random.default_rng([seed, 77])
    out: dict[str, Any] = {"drawn": seed}
    for key, (low, high) in RANGES.items():
        whole = isinstance(low, int) and isinstance(high, int)
        out[key] = int(rng.integers(low, high + 1)) if whole else float(rng.uniform(low, high))
    return out


def model_of(rig: dict[str, Any]) -> RigModel:
    """What a log of such a rig would give, with errors drawn by its seed: delay 4 ms, tilt of the table .05 deg,
    servo 5 %, friction 30 %, rolling factor 3 %; backlash, bounce, noise and slip stay unknown."""
    maze, rng = load_map("cme"), np.random.default_rng([rig["drawn"], 78])
    error = rng.standard_normal(12)
    rate, radius = 30.0, maze.ball.radius
    delay = rig["camera_delay_frames"] / rate + 4e-3 * error[0]
    dead = max(0.0, 1e-3 * rig["command_delay_ms"] + 2e-3 * error[1])
    frequency = rig["servo_frequency_rad_s"] * (1.0 + 0.05 * error[2])
    axis = StageAxis(1.0, frequency, rig["servo_damping"] * (1.0 + 0.05 * error[3]), dead_time=dead)
    # the table about x tilts against gamma, about y against beta, as its weight in the plate's frame has it
    beta = math.radians(rig["table_y_deg"] + 0.05 * error[4])
    gamma = math.radians(rig["table_x_deg"] + 0.05 * error[5])
    stiction = 9.81 * rig["rolling_friction_m"] / radius * 5.0 / 7.0 * max(0.0, 1.0 + 0.3 * error[6])
    factor = (5.0 / 7.0 - 0.3 * min(rig["wall_grip"], 0.4)) * (1.0 + 0.03 * error[7])
    balls = {}
    for ring in maze.rings:
        r = max(ring.track_radius, 0.5 * ring.outer_radius)
        effects = (
            rolling_inertia(5.0 / 7.0 if ring.is_disc else factor),
            viscous_friction(0.3 + 2.0 * rig["wall_grip"] * max(0.0, 1.0 + 0.3 * error[8])),
            dry_friction(min(stiction / r, 19.0)),
            tilt_offset(beta, gamma),
        )
        balls[ring.number] = BallModel(effects)
    return RigModel(StageModel(axis, axis), balls, camera_delay=max(0.0, delay), kind="pi")


def packaged_model(rig: str) -> RigModel:
    """That of a packaged rig."""
    if rig not in _packaged:
        _packaged[rig] = resolve_model(None, rig, load_map("cme"))
    return _packaged[rig]


def drive(rig: str | dict[str, Any], settings: Settings, seed: int, time_limit: float = 20.0) -> NavigationResult:
    """One navigation from ring 1 to the centre; rig: a packaged name, or one drawn. The start angle: by the seed."""
    maze = load_map("cme")
    if isinstance(rig, str):
        machine, model, name = make_rig(rig, maze), packaged_model(rig), rig
    else:
        machine = SimulatedRig(maze, {key: value for key, value in rig.items() if key != "drawn"})
        model, name = model_of(rig), f"drawn {rig['drawn']}"
    try:
        return run_job(machine, Setup(maze, model, rig_name=name, settings=settings), Job(1, 5, None, seed, time_limit))
    finally:
        machine.close()
