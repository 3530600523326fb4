"""iLQG with the control limits inside the backward pass, and a deadline.

    minimise  sum_{k<T} l_k(s_k, u_k) + l_T(s_T)   subject to   s_{k+1} = f(s_k, u_k),  low <= u_k <= high

Tassa, Mansard, Todorov, ICRA 2014, with second derivatives of f by a secant update (`ilqg_core`). Each iteration
linearises along the trajectory and goes backwards through the steps, with a box-limited quadratic problem in each. Then
it rolls out the new policy with shorter and shorter steps alpha until the cost falls enough. The cost never rises.
`Plan.reason` says why the search stopped:

    1. CONVERGED     regularisation is at most MU_MIN, and one of these is small enough:
                     - the largest correction of a control: below control_tolerance
                     - the expected or the actual reduction of the cost: below tolerance * (1 + |cost|)
                     - the reduction by the last PATIENCE iterations together: below the same limit
    2. MAX_ITERATIONS
    3. DEADLINE      the next iteration would probably end after the deadline (the longest so far is the estimate)
    4. NO_DESCENT    regularisation above MU_MAX and still no step that lowers the cost
    5. NOT_FINITE    dynamics, cost or a derivative gave NaN or infinity; the controls are then level (the allowed
                     controls nearest zero)

The plan is usable in all cases but the last. Its controls are inside the limits, and its states and gains belong to
these controls. A gain is zero in rows where the control is at its limit.

A `Stopwatch` ends a search at its deadline by the wall clock, and records where. `Recorded` ends the searches of a
replayed run at the same iterations, so that the replay is exact.
"""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numba import typeof

from mazeplan.control import ilqg_core as core
from mazeplan.control import ilqg_workspace as workspace
from mazeplan.core.errors import SettingsError
from mazeplan.core.field_checks import check_numbers
from mazeplan.core.maths.compiled import address_of
from mazeplan.core.records import Array, Plan, StopReason

PATIENCE = 5  # iterations
MAX_COST_RATIO = 1.1  # maximum ratio to the cost of the last plan for an early stop
WORTHWHILE_GAIN = 0.01  # share of the cost; a warm search goes on while an iteration lowers the cost by more
WHOLE = "-"  # a search that ended before its deadline
MOST = 1000  # maximum number of searches kept; one tick makes far fewer


class Stopwatch:
    """Measures one search after the other. It expects the next iteration to take as long as the longest one so far.

    clock: function that returns the time in s."""

    def __init__(self, clock: Callable[[], float] = time.perf_counter) -> None:
        self._clock = clock
        self._cuts: deque[str] = deque(maxlen=MOST)
        self._began = self._end = self._last = self._longest = 0.0

    def begin(self, deadline_ms: float) -> None:
        """Start a search with this deadline."""
        self._began, self._longest = self._clock(), 0.0
        self._end = self._began + 1e-3 * deadline_ms
        self._cuts.append(WHOLE)

    def over(self, done: int) -> bool:
        """Whether to end the search after `done` iterations. The first iteration is always made."""
        last, self._last = self._last, self._clock()
        if done == 0:
            return False
        self._longest = max(self._longest, self._last - last)
        if self._last + self._longest <= self._end:
            return False
        self._cuts[-1] = str(done)
        return True

    def end(self) -> float:
        """End the search. Returns its duration, ms."""
        return 1e3 * (self._clock() - self._began)

    def pop_cuts(self) -> str | None:
        """One word for each search since the last call; None if no deadline ended any of them.

        The word is the number of iterations until the deadline, or `-` for a search that ended before it."""
        cuts = list(self._cuts)
        self._cuts.clear()
        return " ".join(cuts) if any(cut != WHOLE for cut in cuts) else None


class Recorded(Stopwatch):
    """Ends searches where a `Stopwatch` ended them, and measures no time; call `load` before each tick."""

    def __init__(self) -> None:
        super().__init__(lambda: 0.0)
        self._ends: deque[int | None] = deque()
        self._cut: int | None = None

    def load(self, cuts: str | None) -> None:
        """Set the text that `pop_cuts` returned for the next tick. Raises ValueError for other text."""
        self._ends = deque(None if cut == WHOLE else int(cut) for cut in (cuts or "").split())

    def begin(self, deadline_ms: float) -> None:
        """See `Stopwatch.begin`."""
        self._cut = self._ends.popleft() if self._ends else None

    def over(self, done: int) -> bool:
        """See `Stopwatch.over`."""
        return done == self._cut


@dataclass(frozen=True)
class IlqgOptions:
    """Settings of the search. Raises SettingsError.

    horizon            number of steps of a plan
    max_iterations     maximum number of iterations of a search
    tolerance          a search stops at a smaller relative reduction of the cost
    warm_tolerance     the same for a search from the last tick's plan, which the next tick improves again
    warm_iterations    iterations after which a search from the last plan may stop early (see `Planner.solve`)
    control_tolerance  a search stops if the largest correction of a control is smaller, rad
    deadline_ms        time limit of one search, ms
    """

    horizon: int
    max_iterations: int = 100
    tolerance: float = 5e-5
    warm_tolerance: float = 3e-4
    warm_iterations: int = 4
    control_tolerance: float = 1e-7
    deadline_ms: float = math.inf

    def __post_init__(self) -> None:
        check_numbers(self, positive=("horizon", "max_iterations", "warm_iterations"), most={"deadline_ms": math.inf})


@dataclass(frozen=True)
class Dynamics:
    """f and its derivatives: a function compiled by numba.njit, at module level with cache=True.

    Without the cache, each Python process would compile it again.

    linearise:   linearise(s, u, p, out, A, B) -> None: writes the next state into out (n,), from s (n,) and u (2,), and
                 all of its derivatives A (n, n) and B (n, 2)"""

    linearise: Any
    parameters: Array  # p, a float64 vector that the solver only passes on; its tail may serve as scratch space
    n: int  # number of states


class Cost(NamedTuple):
    """l_k and l_T and their derivatives, compiled like `Dynamics`. q: the vector given to `solve`.

    Hessians must be positive semidefinite, l_uu positive definite. The cost must have no mixed term of s and u."""

    running: Any  # running(k, s, u, q) -> float
    running_derivatives: Any  # running_derivatives(k, s, u, q, lx, lu, lxx, luu) -> None
    final: Any  # final(s, q) -> float
    final_derivatives: Any  # final_derivatives(s, q, lx, lxx) -> None


_REASONS = {
    workspace.CONVERGED: StopReason.CONVERGED,
    workspace.NO_DESCENT: StopReason.NO_DESCENT,
    workspace.NOT_FINITE: StopReason.NOT_FINITE,
}


class Planner:
    """Solves problems with the same dynamics, cost and limits in one workspace. Use it from one thread only."""

    def __init__(
        self,
        dynamics: Dynamics,
        cost: Cost,
        low: Array,
        high: Array,
        options: IlqgOptions,
        *,
        dt: float = 1.0 / 30.0,
        watch: Stopwatch | None = None,
    ) -> None:
        """low, high: control limits (2,).

        dt:     duration of a step, s, for the plans
        watch:  stopwatch for deadlines"""
        self.options = options
        self.dt, self._watch = dt, watch or Stopwatch()
        low, high = np.asarray(low, dtype=float), np.asarray(high, dtype=float)
        if low.shape != (2,) or high.shape != (2,) or not (np.isfinite(low).all() and (low <= high).all()):
            raise SettingsError(f"got limits {low} to {high}, expected two finite numbers each, low <= high")
        self._p = np.ascontiguousarray(dynamics.parameters, dtype=float)
        self._w = workspace.make_workspace(self.options.horizon, dynamics.n, low, high)
        compiled = zip((dynamics.linearise, *cost), workspace.SIGNATURES, strict=True)
        self._f = workspace.Functions(*(address_of(function, signature) for function, signature in compiled))

    def solve(
        self,
        s0: Array,
        cost_parameters: Array,
        warm: Plan | Array | None = None,
        *,
        t0: float = 0.0,
        deadline_ms: float | None = None,
        tolerance: float | None = None,
        early_stop_after: int | None = None,
    ) -> Plan:
        """A plan from s0 (n,).

        warm:         first guess: a former plan, shifted to t0 and followed with its gains; controls (T, 2); or None
                      for zeros
        t0:           rig time of s0, s
        deadline_ms:  counts from the call, ms; one iteration is always made; None: that of the options
        tolerance:    relative tolerance of the cost; None: that of the options
        early_stop_after:  number of iterations, after which the search stops as soon as an iteration lowers the cost
                      by less than the share WORTHWHILE_GAIN; it goes on if the former plan now costs more than
                      MAX_COST_RATIO times as much as before
        """
        self._watch.begin(self.options.deadline_ms if deadline_ms is None else deadline_ms)
        w, f, q = self._w, self._f, np.ascontiguousarray(cost_parameters, dtype=float)
        w.states[:] = s0
        code = workspace.NOT_FINITE
        if warm is not None:
            code = core.begin(w, f, self._p, q, self._guess(warm, t0))
        if code != workspace.GO_ON:  # no guess, or its roll-out is not finite: start from level
            w.states[:] = s0
            code = core.begin(w, f, self._p, q, self._guess(None, t0))
        tolerance = self.options.tolerance if tolerance is None else tolerance
        if isinstance(warm, Plan) and float(w.numbers[workspace.COST]) > MAX_COST_RATIO * (1.0 + warm.cost):
            early_stop_after = None
        reason, done = self._improve(q, tolerance, code, early_stop_after)
        if reason is StopReason.NOT_FINITE:
            w.K[:] = 0.0
            w.controls[:] = np.clip(0.0, w.low, w.high)
        ms, cost = self._watch.end(), float(w.numbers[workspace.COST])
        return Plan(w.states.copy(), w.controls.copy(), w.K.copy(), cost, reason, done, ms, t0, self.dt)

    def _improve(self, q: Array, tolerance: float, code: int, early_stop_after: int | None) -> tuple[StopReason, int]:
        """Iterate until a stopping rule holds. Returns the reason and the number of iterations."""
        w = self._w
        done, reason = 0, StopReason.MAX_ITERATIONS
        costs = [float(w.numbers[workspace.COST])]
        while code == workspace.GO_ON and done < self.options.max_iterations:
            if self._watch.over(done):
                reason = StopReason.DEADLINE
                break
            code = core.iterate(w, self._f, self._p, q, tolerance, self.options.control_tolerance)
            done += 1
            costs.append(float(w.numbers[workspace.COST]))
            got = costs[-2] - costs[-1]
            late = early_stop_after is not None and done >= early_stop_after
            if code == workspace.GO_ON and late and got < WORTHWHILE_GAIN * (1.0 + abs(costs[-1])):
                break
            if code == workspace.GO_ON and self._stalls(costs, tolerance):
                code = workspace.CONVERGED
        if code != workspace.NOT_FINITE:
            code = max(code, self._finish(q))
        return _REASONS.get(code, reason), done

    def _finish(self, q: Array) -> int:
        """Compute the gains of the final plan, without the curvature M. Returns a code."""
        numbers = self._w.numbers
        if numbers[workspace.SECANT] == 0.0 and numbers[workspace.STALE] == 0.0:
            return workspace.GO_ON  # no candidate since the last policy
        numbers[workspace.SECANT] = 0.0
        return core.policy(self._w, self._f, q)

    def _stalls(self, costs: list[float], tolerance: float) -> bool:
        """Whether the last PATIENCE iterations gained almost nothing, with regularisation at most MU_MIN."""
        if len(costs) <= PATIENCE or self._w.numbers[workspace.MU] > core.MU_MIN:
            return False
        return costs[-1 - PATIENCE] - costs[-1] < tolerance * (1.0 + abs(costs[-1]))

    def _guess(self, warm: Plan | Array | None, t0: float) -> Array:
        """Put the first guess into the workspace (controls, K). Returns the reference states for K, shape (T+1, n)."""
        w, T = self._w, self.options.horizon
        w.K[:] = 0.0
        w.controls[:] = 0.0
        if warm is None:
            return w.states
        if not isinstance(warm, Plan):
            w.controls[:] = warm
            return w.states
        had = len(warm.controls)
        shift = max(0, round((t0 - warm.t0) / warm.dt))
        index = np.minimum(np.arange(T) + shift, had - 1)
        w.controls[:] = warm.controls[index]
        w.K[:] = np.where((np.arange(T) + shift < had)[:, None, None], warm.gains[index], 0.0)
        return warm.states[np.minimum(np.arange(T + 1) + shift, had)]


def compile_solver() -> None:
    """Compile the solver for plans of a ring (6 states), apart from dynamics and cost; runs nothing."""
    w = workspace.make_workspace(1, 6, np.zeros(2), np.zeros(2))
    f, p = workspace.Functions(0, 0, 0, 0, 0), np.zeros(1)
    core.begin.compile(tuple(map(typeof, (w, f, p, p, w.states))))
    core.iterate.compile(tuple(map(typeof, (w, f, p, p, 0.0, 0.0))))
    core.policy.compile(tuple(map(typeof, (w, f, p))))
