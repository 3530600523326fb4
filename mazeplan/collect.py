"""Excite a rig and log it: the data that models are fitted to."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mazeplan.data.excitation import multisine
from mazeplan.data.runlog import RunLogWriter
from mazeplan.maze.geometry import Maze
from mazeplan.maze.mapfile import dump_map
from mazeplan.records import Command, Observation
from mazeplan.rigs.interface import Rig

STRETCH_S = 20.0  # s in one ring before the ball is placed in the next


@dataclass(frozen=True)
class Collection:
    """How long (s), in which rings the ball is placed in turn (one: it is placed once), and the seed."""

    seconds: float
    rings: tuple[int, ...]
    seed: int = 0


def run_collection(
    rig: Rig, maze: Maze, plan: Collection, output: str | Path, *, rig_name: str = "",
    progress: Callable[[int], None] | None = None,
) -> int:  # fmt: skip
    """Drive the rig with random sines and log each sample; returns the number of samples. The plate is level
    afterwards.

    Each placing of the ball begins a new segment; time goes on through all of them."""
    rng = np.random.default_rng(plan.seed)
    commands = multisine(rng, plan.seconds, rig.rate_hz, maze.tilt_limit)
    stretch = len(commands) if len(plan.rings) == 1 else max(1, round(STRETCH_S * rig.rate_hz))
    header = {
        "program": "mazeplan", "rig": rig_name, "map": dump_map(maze), "map_name": maze.name, "seed": plan.seed,
        "excitation": "multisine", "seconds": plan.seconds, "rings": list(plan.rings),
    }  # fmt: skip
    dt, rows = 1.0 / rig.rate_hz, 0
    try:
        with RunLogWriter(output, header) as log:
            for segment, start in enumerate(range(0, len(commands), stretch)):
                ring = plan.rings[segment % len(plan.rings)]
                rig.reset(
                    ring=ring,
                    theta=float(rng.uniform(-math.pi, math.pi)),
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
        try:
            rig.level()
        finally:
            rig.close()
    return rows
