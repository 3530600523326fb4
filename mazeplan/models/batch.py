"""Thousands of plans at once on the model of a ring: on all cores by the planner's own compiled step, or by torch.

    u_k     = clip(c_k + K_k (s_k - r_k), -limit, limit)        without feedback c_k alone
    u'_k    = what deadband and play of the servos pass on of u_0 ... u_k (see `stage`)
    s_{k+1} = step(s_k, u'_k), and a push e_k: theta += e_k dt^2 / 2, theta_dot += e_k dt

s = (theta, theta_dot, beta, beta_dot, gamma, gamma_dot), at the moment at which the command acts: delays are counted
before, as for plans. Ways: `compiled`, the step of `ring_dynamics` or `learned_dynamics` in as many threads as there
are cores; `cpu` and `cuda`, the same equations by torch (`torch_dynamics`), equal within 1e-6; `auto`, cuda where
torch sees such a device, else compiled, which on a processor is the fastest.
"""

from __future__ import annotations

import importlib.util
import math
import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numba import njit, types

from mazeplan.errors import InputError, SettingsError
from mazeplan.maths.compiled import VECTOR, address_of, caller
from mazeplan.models import learned_dynamics
from mazeplan.models.gaussian_process import GaussianProcess
from mazeplan.physics import ring_dynamics
from mazeplan.physics.ring_parameters import RingParameters
from mazeplan.physics.stage import StageModel
from mazeplan.records import Array, IntArray
from mazeplan.resources import to_install

if TYPE_CHECKING:
    from mazeplan.models.modelfile import RigModel

DEVICES = ("auto", "compiled", "cpu", "cuda")
PIECES = 4  # of a batch for each thread, so that none waits long for the slowest
STEP = types.void(VECTOR, VECTOR, VECTOR, VECTOR)  # s, u, p, out
_step = caller(STEP)


@dataclass(frozen=True)
class Plans:
    """P plans of T steps. commands (P, T, 2), rad; with feedback gains (P, T, 2, 6) and the states (P, T+1, 6) that
    they belong to. Raises ValueError for shapes that do not fit."""

    commands: Array
    gains: Array | None = None
    states: Array | None = None

    def __post_init__(self) -> None:
        count, steps = np.shape(self.commands)[:2]
        wanted = {"commands": (count, steps, 2), "gains": (count, steps, 2, 6), "states": (count, steps + 1, 6)}
        for name, shape in wanted.items():
            got = getattr(self, name)
            if got is not None and np.shape(got) != shape:
                raise ValueError(f"{name}: got shape {np.shape(got)}, expected {shape}")
        if (self.gains is None) != (self.states is None):
            raise ValueError("gains and states belong together, got one of them")

    def feedback(self) -> tuple[Array, Array]:
        """Gains and states, of no plan where there is none."""
        if self.gains is None or self.states is None:
            return np.zeros((0, 0, 2, 6)), np.zeros((0, 0, 6))
        return np.ascontiguousarray(self.gains, dtype=float), np.ascontiguousarray(self.states, dtype=float)


@dataclass(frozen=True)
class RingBatch:
    """The model of one ring for batches. process: what it learned beyond its parameters; stage: whose servos' deadband
    and play count; limit: of a command, rad; device: one of DEVICES; threads: 0 for as many as there are cores;
    precision: of torch, float64 or float32. Raises SettingsError, or InputError where there is no such device."""

    parameters: RingParameters
    process: GaussianProcess | None = None
    stage: StageModel = field(default_factory=StageModel)
    limit: float = math.inf
    device: str = "auto"
    threads: int = 0
    precision: str = "float64"

    def __post_init__(self) -> None:
        if self.precision not in ("float64", "float32"):
            raise SettingsError(f"got {self.precision!r}, expected float64 or float32", key="precision")
        if not self.limit > 0.0:
            raise SettingsError(f"got {self.limit}, expected a number > 0", key="limit")
        object.__setattr__(self, "device", choose_device(self.device))

    @classmethod
    def of_model(cls, model: RigModel, ring: int, radius: float, **more: Any) -> RingBatch:
        """That of a ring of a rig's model, with its process and its play; radius: of the track, m."""
        parameters = RingParameters.from_model(model, ring, radius)
        return cls(parameters, model.processes.get(ring), model.stage, **more)

    def roll_out(
        self, starts: Array, plans: Plans, *, which: IntArray | None = None, pushes: Array | None = None
    ) -> Array:
        """States (B, T+1, 6) from starts (B, 6). which (B,): the plan of each, by default one after the other; pushes
        (B, T): rad/s^2. Raises ValueError for shapes that do not fit."""
        starts = np.ascontiguousarray(starts, dtype=float)
        count, steps = len(starts), plans.commands.shape[1]
        which = np.arange(count) if which is None else np.asarray(which, dtype=np.int64)
        pushes = np.zeros((0, 0)) if pushes is None else np.ascontiguousarray(pushes, dtype=float)
        known = len(plans.commands)
        if (
            starts.shape != (count, 6)
            or which.shape != (count,)
            or (count and not 0 <= which.min() <= which.max() < known)
        ):
            raise ValueError(f"got starts {starts.shape} and plans {which.shape} of {known}, expected (B, 6) and (B,)")
        if pushes.size and pushes.shape != (count, steps):
            raise ValueError(f"pushes: got shape {pushes.shape}, expected {(count, steps)}")
        if self.device == "compiled":
            return self._compiled(starts, plans, which, pushes)
        from mazeplan.models.torch_dynamics import roll_out

        return roll_out(self, starts, plans, which, pushes)

    def servos(self) -> Array:
        """limit, half the play of beta and gamma, deadband of beta and gamma, dt."""
        beta, gamma = self.stage.beta, self.stage.gamma
        play = 0.5 * beta.backlash, 0.5 * gamma.backlash
        return np.array([self.limit, *play, beta.deadband, gamma.deadband, self.parameters.dt])

    def _compiled(self, starts: Array, plans: Plans, which: IntArray, pushes: Array) -> Array:
        """By the planner's own step, in threads: compiled code needs no lock of the interpreter."""
        commands = np.ascontiguousarray(plans.commands, dtype=float)
        gains, reference = plans.feedback()
        if self.process is None:
            address, packed = address_of(ring_dynamics.step, STEP), self.parameters.pack()
        else:
            address = address_of(learned_dynamics.step, STEP)
            packed = learned_dynamics.pack(self.parameters, self.process)
        out, servos = np.empty((len(starts), commands.shape[1] + 1, 6)), self.servos()
        threads = self.threads or cores()
        borders = np.linspace(0, len(starts), (threads * PIECES if threads > 1 else 1) + 1).astype(int).tolist()

        def piece(a: int, b: int) -> None:
            some = pushes[a:b] if len(pushes) else pushes
            own = packed.copy()  # a process has scratch space behind its rows
            _many(address, own, servos, starts[a:b], commands, gains, reference, which[a:b], some, out[a:b])

        if threads == 1:
            piece(0, len(starts))
            return out
        with ThreadPoolExecutor(threads) as pool:
            list(pool.map(piece, borders[:-1], borders[1:]))
        return out


def cores() -> int:
    """How many this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def choose_device(device: str, option: str = "--device") -> str:
    """compiled, cpu or cuda, from one of DEVICES. Raises InputError for others, where torch is not installed or where
    it sees no such device."""
    if device not in DEVICES:
        raise InputError(f"{option}: got {device!r}, expected one of {', '.join(DEVICES)}")
    if device == "compiled" or (device == "auto" and importlib.util.find_spec("torch") is None):
        return "compiled"
    try:
        import torch
    except ImportError as problem:
        if device == "auto":  # a broken installation of what is not asked for
            return "compiled"
        advice = f"{option} {device} needs torch: {to_install('learn')}, or {option} compiled"
        raise InputError(f"{advice} ({problem})") from None
    if device == "auto":
        return "cuda" if torch.cuda.is_available() else "compiled"
    if device == "cuda" and not torch.cuda.is_available():
        raise InputError(f"{option}: got cuda, but torch sees no such device; expected compiled or cpu")
    return device


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
