"""Roll out thousands of plans at once on the model of a ring, by the planner's compiled step, on all cores.

    u_k     = clip(c_k + K_k (s_k - r_k), -limit, limit)        without feedback: clip(c_k, -limit, limit)
    u'_k    = what deadband and play of the servos make of u_0 ... u_k (see `stage`)
    s_{k+1} = step(s_k, u'_k), and a push e_k: theta += e_k dt^2 / 2, theta_dot += e_k dt

s = (theta, theta_dot, beta, beta_dot, gamma, gamma_dot) is the state at the moment when the command acts. As for plans,
all delays lie before that moment. step is the function of `ring_dynamics` or `gp_dynamics`.
"""

from __future__ import annotations

import math
import os
import warnings
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numba import njit, types

from mazeplan.core.errors import InputError, SettingsError
from mazeplan.core.maths.compiled import VECTOR, address_of, caller
from mazeplan.core.records import Array, IntArray
from mazeplan.learning import gp_dynamics
from mazeplan.learning.learned_part import LearnedPart
from mazeplan.learning.rig_model import RigModel
from mazeplan.physics.dynamics import ring_dynamics
from mazeplan.physics.dynamics.ring_parameters import RingParameters
from mazeplan.physics.rig.stage import StageModel

DEVICES = ("auto", "compiled", "cpu", "cuda")  # cpu and cuda are accepted, but run compiled, too: torch was slower
PIECES = 4  # pieces of a batch for each thread, to balance the load
STEP = types.void(VECTOR, VECTOR, VECTOR, VECTOR)  # s, u, p, out
_step = caller(STEP)


@dataclass(frozen=True)
class Plans:
    """P plans of T steps. Raises ValueError for shapes that do not fit.

    commands (P, T, 2):   rad
    gains (P, T, 2, 6):   for feedback
    states (P, T+1, 6):   reference states, for feedback"""

    commands: Array
    gains: Array | None = None
    states: Array | None = None

    def __post_init__(self) -> None:
        count, steps = np.shape(self.commands)[:2]
        shapes = {"commands": (count, steps, 2), "gains": (count, steps, 2, 6), "states": (count, steps + 1, 6)}
        for name, shape in shapes.items():
            got = getattr(self, name)
            if got is not None and np.shape(got) != shape:
                raise ValueError(f"{name}: got shape {np.shape(got)}, expected {shape}")
        if (self.gains is None) != (self.states is None):
            raise ValueError("gains and states belong together, got one of them")

    def feedback(self) -> tuple[Array, Array]:
        """Gains and states; empty without feedback."""
        if self.gains is None or self.states is None:
            return np.zeros((0, 0, 2, 6)), np.zeros((0, 0, 6))
        return np.ascontiguousarray(self.gains, dtype=float), np.ascontiguousarray(self.states, dtype=float)


@dataclass(frozen=True)
class RingBatch:
    """The model of one ring for batches. Raises SettingsError, or InputError for an unknown device.

    process:            Gaussian process or networks, added to the parameters
    stage:              for deadband and play of the servos
    limit:              largest command, rad
    threads:            number of threads; 0: one for each core
    device, precision:  checked, but without effect: every roll-out is compiled, in float64"""

    parameters: RingParameters
    process: LearnedPart | None = None
    stage: StageModel = field(default_factory=StageModel)
    limit: float = math.inf
    device: str = "auto"
    threads: int = 0
    precision: str = "float64"

    def __post_init__(self) -> None:
        if self.device not in DEVICES:
            raise InputError(f"--device: got {self.device!r}, expected one of {', '.join(DEVICES)}")
        if self.precision not in ("float64", "float32"):
            raise SettingsError(f"got {self.precision!r}, expected float64 or float32", key="precision")
        if not self.limit > 0.0:
            raise SettingsError(f"got {self.limit}, expected a number > 0", key="limit")
        if self.device in ("cpu", "cuda"):
            warnings.warn(f"device {self.device}: roll-outs run compiled on the CPU", DeprecationWarning, stacklevel=3)

    @classmethod
    def of_model(cls, model: RigModel, ring: int, radius: float, **more: Any) -> RingBatch:
        """A ring of a rig's model, with its learned part and the play of the stage; radius: of the track, m."""
        parameters = RingParameters.from_model(model, ring, radius)
        return cls(parameters, model.processes.get(ring), model.stage, **more)

    def roll_out(
        self, starts: Array, plans: Plans, *, which: IntArray | None = None, pushes: Array | None = None
    ) -> Array:
        """States (B, T+1, 6) from starts (B, 6). Raises ValueError for shapes that do not fit.

        which (B,):      index of the plan of each start; by default in order
        pushes (B, T):   additional acceleration, rad/s^2"""
        starts = np.ascontiguousarray(starts, dtype=float)
        count, steps = len(starts), plans.commands.shape[1]
        which = np.arange(count) if which is None else np.asarray(which, dtype=np.int64)
        pushes = np.zeros((0, 0)) if pushes is None else np.ascontiguousarray(pushes, dtype=float)
        known = len(plans.commands)
        unknown = count and which.shape == (count,) and not 0 <= which.min() <= which.max() < known
        if starts.shape != (count, 6) or which.shape != (count,) or unknown:
            raise ValueError(f"got starts {starts.shape} and plans {which.shape} of {known}, expected (B, 6) and (B,)")
        if pushes.size and pushes.shape != (count, steps):
            raise ValueError(f"pushes: got shape {pushes.shape}, expected {(count, steps)}")
        commands = np.ascontiguousarray(plans.commands, dtype=float)
        gains, reference = plans.feedback()
        if self.process is None:
            address, packed = address_of(ring_dynamics.step, STEP), self.parameters.pack()
        else:
            address = address_of(gp_dynamics.step, STEP)
            packed = gp_dynamics.pack(self.parameters, self.process)
        out, servos = np.empty((count, steps + 1, 6)), self._servos()
        threads = self.threads or cores()
        borders = np.linspace(0, count, (threads * PIECES if threads > 1 else 1) + 1).astype(int).tolist()

        def piece(a: int, b: int) -> None:
            some = pushes[a:b] if len(pushes) else pushes
            own = packed.copy()  # own scratch space
            _many(address, own, servos, starts[a:b], commands, gains, reference, which[a:b], some, out[a:b])

        with ThreadPoolExecutor(threads) as pool:  # compiled code does not hold the interpreter's lock
            list(pool.map(piece, borders[:-1], borders[1:]))
        return out

    def _servos(self) -> Array:
        """limit, half the play of beta and gamma, deadband of beta and gamma, dt."""
        beta, gamma = self.stage.beta, self.stage.gamma
        play = 0.5 * beta.backlash, 0.5 * gamma.backlash
        return np.array([self.limit, *play, beta.deadband, gamma.deadband, self.parameters.dt])


def cores() -> int:
    """Number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@njit(cache=True, error_model="numpy", nogil=True)
def _many(step, p, servos, starts, commands, gains, reference, which, pushes, out):
    """Roll out each start (B, 6) under its plan, into out (B, T+1, 6). step: address of a compiled step on p."""
    steps, limit, dt = commands.shape[1], servos[0], servos[5]
    u, obeyed, passed = np.empty(2), np.empty(2), np.empty(2)
    for b in range(len(starts)):
        plan = which[b]
        out[b, 0] = starts[b]
        for t in range(steps):
            s = out[b, t]
            for i in range(2):
                v = commands[plan, t, i]
                if len(gains):
                    for j in range(6):
                        v += gains[plan, t, i, j] * (s[j] - reference[plan, t, j])
                v = min(max(v, -limit), limit)
                if t == 0 or abs(v - obeyed[i]) >= servos[3 + i]:
                    obeyed[i] = v
                if t == 0:
                    passed[i] = obeyed[i]
                half = servos[1 + i]
                passed[i] = min(max(passed[i], obeyed[i] - half), obeyed[i] + half)
                u[i] = passed[i]
            _step(step, (s, u, p, out[b, t + 1]))
            if len(pushes):
                out[b, t + 1, 0] += 0.5 * dt * dt * pushes[b, t]
                out[b, t + 1, 1] += dt * pushes[b, t]
