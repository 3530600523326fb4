"""A simulated rig to drive in tests."""

from __future__ import annotations

import numpy as np

from mazeplan.maze.mapfile import load_map
from mazeplan.rigs.sim.simulated import SimulatedRig

MAZE = load_map("cme")


def rig(ring=1, theta=0.0, seed=0, **settings):
    machine = SimulatedRig(MAZE, settings)
    machine.reset(ring=ring, theta=theta, rng=np.random.default_rng(seed))
    return machine


def drive(machine, seconds, u_beta=0.0, u_gamma=0.0):
    """Observations and truths over some time under one command."""
    seen, true = [], []
    for _ in range(round(seconds * machine.rate_hz)):
        seen.append(machine.observe())
        true.append(machine.truth())
        machine.command(u_beta, u_gamma)
    return seen, np.array(true)
