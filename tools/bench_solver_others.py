"""The planner's problems given to other solvers: IPOPT, BoxFDDP, SLSQP, L-BFGS-B, on the same compiled functions.

All start from level commands, all may use exact first derivatives, and the final cost is in every case that of the
commands they return, rolled out by the planner's own code. Second derivatives are those of the cost alone
(Gauss-Newton) for BoxFDDP, as in the planner; IPOPT is given true ones, without which it did not converge on a rough
process. Casadi, crocoddyl and scipy are no dependencies of the package: each solver imports what it needs when it is
called, and is left out where that is missing. Those in C++ stand in tools/solvers. Used by tools/bench_solver.py.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import njit

from mazeplan.control import ilqg_core as core
from mazeplan.control import ilqg_workspace as workspace
from mazeplan.control.ilqg import PATIENCE, Cost, Dynamics, IlqgOptions
from mazeplan.control.ring_planner import RING_COST
from mazeplan.core.maths.compiled import address_of
from mazeplan.core.records import Array, IntArray

N, M = 6, 2  # states and controls
STAGE = N + M
ITERATIONS = 1000  # most of any solver
TOLERANCE = 1e-6  # relative, of the cost, for those that know gradients alone: with the planner's own they end early
DIFFERENCE = 1e-6  # rad or rad/s, for second derivatives; a process may be rough over 0.003 rad of tilt


@dataclass(frozen=True)
class Answer:
    """controls (T, 2); whether the solver itself calls them optimal; where it has a stopwatch of its own, ms of the
    solve, its iterations, and ms of the quadratic problems inside it."""

    controls: Array
    converged: bool
    ms: float | None = None
    iterations: int | None = None
    qp_ms: float = 0.0


@njit(cache=True)
def _adjoint(A, B, lx, lu, out):
    """Gradient of the total cost by the controls, into out (T, 2), from the derivatives along the trajectory."""
    T, n = len(A), A.shape[1]
    value, before = lx[T].copy(), np.empty(n)
    for t in range(T - 1, -1, -1):
        for i in range(2):
            out[t, i] = lu[t, i]
            for m in range(n):
                out[t, i] += B[t, m, i] * value[m]
        for i in range(n):
            before[i] = lx[t, i]
            for m in range(n):
                before[i] += A[t, m, i] * value[m]
        value[:] = before


class Problem:
    """One problem: roll-out, cost and derivatives for solvers written in Python, and a stopwatch for all of them."""

    def __init__(self, dynamics: Dynamics, horizon: int, s0: Array, q: Array, limit: float) -> None:
        """s0: (6,) planner state; q: the cost's vector; limit: of the commands, rad."""
        self.dynamics, self.costs, self.horizon = dynamics, RING_COST, horizon
        self.s0, self.q, self.limit, self.inside_s = s0, q, limit, 0.0
        self._p = np.array(dynamics.parameters, dtype=float)
        self._w = workspace.make_workspace(self.horizon, N, np.full(M, -limit), np.full(M, limit))
        self._f = functions_of(dynamics, RING_COST)

    def roll_out(self, controls: Array, *, derive: bool = False) -> tuple[float, Array]:
        """Cost (inf where it is not finite) and states (T+1, 6) of controls (T, 2), clipped to the limits."""
        began = time.perf_counter()
        w = self._w
        w.states[:] = self.s0
        w.K[:] = 0.0
        w.controls[:] = controls.reshape(-1, M)
        w.k[:] = 0.0
        cost = core.roll_out(w, self._f, self._p, self.q, w.states, 0.0, derive)
        self.inside_s += time.perf_counter() - began
        return cost, w.new_states

    def gradient(self, controls: Array) -> tuple[float, Array]:
        """Cost and its gradient (2 T,) by controls (2 T,): one roll-out, one linearisation, the adjoint backwards."""
        cost, states = self.roll_out(controls, derive=True)
        began = time.perf_counter()
        out = np.empty((self.horizon, M))
        w = self._w
        w.states[:], w.A[:], w.B[:] = states, w.new_a, w.new_b
        w.controls[:] = w.new_controls
        w.numbers[workspace.STALE] = workspace.COST_STALE
        core.derivatives(self._w, self._f, self._p, self.q)
        _adjoint(self._w.A, self._w.B, self._w.lx, self._w.lu, out)
        self.inside_s += time.perf_counter() - began
        return cost, out.ravel()

    def along(self, states: Array, controls: Array) -> workspace.Workspace:
        """Derivatives along states (T+1, 6) and controls (T, 2) that need not belong together."""
        began = time.perf_counter()
        self._w.states[:] = states
        self._w.controls[:] = controls
        self._w.numbers[workspace.STALE] = workspace.ALL_STALE
        core.derivatives(self._w, self._f, self._p, self.q)
        self.inside_s += time.perf_counter() - began
        return self._w

    def step(self, s: Array, u: Array) -> Array:
        """The state one step later."""
        began = time.perf_counter()
        out = np.empty(N)
        self.dynamics.step(s, u, self._p, out)
        self.inside_s += time.perf_counter() - began
        return out

    def linearise(self, s: Array, u: Array, A: Array, B: Array) -> None:
        """Derivatives of a step into A (6, 6) and B (6, 2)."""
        began = time.perf_counter()
        self.dynamics.linearise(s, u, self._p, np.empty(6), A, B)
        self.inside_s += time.perf_counter() - began


def functions_of(dynamics: Dynamics, cost: Cost) -> workspace.Functions:
    """Addresses of what the planner calls."""
    return workspace.Functions(
        address_of(dynamics.step, workspace.STEP),
        address_of(dynamics.linearise, workspace.LINEARISE),
        address_of(cost.running, workspace.RUNNING),
        address_of(cost.running_derivatives, workspace.RUNNING_DERIVATIVES),
        address_of(cost.final, workspace.FINAL),
        address_of(cost.final_derivatives, workspace.FINAL_DERIVATIVES),
    )


def _scipy(problem: Problem, method: str, options: dict[str, Any]) -> Answer:
    from scipy.optimize import minimize

    size = M * problem.horizon
    found = minimize(
        problem.gradient,
        np.zeros(size),
        jac=True,
        method=method,
        bounds=[(-problem.limit, problem.limit)] * size,
        options={"maxiter": ITERATIONS, **options},
    )
    return Answer(found.x.reshape(-1, M), bool(found.success))


def slsqp(problem: Problem) -> Answer:
    """Sequential quadratic programming by single shooting, scipy."""
    return _scipy(problem, "SLSQP", {"ftol": TOLERANCE})


def lbfgsb(problem: Problem) -> Answer:
    """Limited-memory BFGS inside bounds by single shooting, scipy."""
    return _scipy(problem, "L-BFGS-B", {"ftol": TOLERANCE, "gtol": 1e-6, "maxfun": 10 * ITERATIONS})


def box_fddp(problem: Problem) -> Answer:
    """BoxFDDP of crocoddyl, models in Python around the compiled functions, from the roll-out of level commands.
    It ends by the planner's rules, as tools/solvers/box_fddp.cpp does."""
    import crocoddyl  # pyright: ignore[reportMissingImports]

    # its base comes from a compiled module without types, and crocoddyl names the methods it calls (calc, calcDiff)
    class Step(crocoddyl.ActionModelAbstract):  # type: ignore[misc]
        def __init__(self, number: int) -> None:
            super().__init__(crocoddyl.StateVector(N), M, 0)
            self.number = number
            self.u_lb, self.u_ub = np.full(M, -problem.limit), np.full(M, problem.limit)
            self.A, self.B = np.empty((N, N)), np.empty((N, M))
            self.lx, self.lu, self.lxx, self.luu = np.empty(N), np.empty(M), np.empty((N, N)), np.empty((M, M))

        def calc(self, data: Any, x: Array, u: Array | None = None) -> None:
            if u is None:
                data.cost = problem.costs.final(x, problem.q)
                return
            data.xnext = problem.step(x, u)
            data.cost = problem.costs.running(self.number, x, u, problem.q)

        def calcDiff(self, data: Any, x: Array, u: Array | None = None) -> None:  # noqa: N802
            if u is None:
                problem.costs.final_derivatives(x, problem.q, self.lx, self.lxx)
                data.Lx, data.Lxx = self.lx, self.lxx
                return
            problem.linearise(x, u, self.A, self.B)
            problem.costs.running_derivatives(self.number, x, u, problem.q, self.lx, self.lu, self.lxx, self.luu)
            data.Fx, data.Fu = self.A, self.B
            data.Lx, data.Lu, data.Lxx, data.Luu = self.lx, self.lu, self.lxx, self.luu

    class Ending(crocoddyl.CallbackAbstract):  # type: ignore[misc]
        def __init__(self) -> None:
            super().__init__()
            self.costs: list[float] = []

        def __call__(self, solver: Any) -> None:
            small = IlqgOptions().tolerance * (1.0 + abs(solver.cost))
            self.costs.append(solver.cost)
            plain = len(self.costs) > PATIENCE and solver.preg <= IlqgOptions().mu_min
            stalls = plain and abs(self.costs[-1 - PATIENCE] - solver.cost) < small
            solver.th_stop = np.inf if stalls else small

    steps = [Step(t) for t in range(problem.horizon + 1)]
    shooting = crocoddyl.ShootingProblem(problem.s0, steps[:-1], steps[-1])  # in Python it has one thread
    solver = crocoddyl.SolverBoxFDDP(shooting)
    solver.th_stop = np.finfo(float).tiny
    solver.setCallbacks([Ending()])
    zeros = np.zeros((problem.horizon, M))
    _, states = problem.roll_out(zeros)
    converged = solver.solve([s.copy() for s in states], list(zeros), ITERATIONS, True)
    return Answer(np.array(solver.us), bool(converged))


class _Blocks:
    """Where derivatives go in the multiple-shooting problem: variables s_0, u_0, s_1, u_1 ... s_T, STAGE numbers a
    stage; constraints s_{t+1} - f(s_t, u_t), N a stage."""

    def __init__(self, T: int) -> None:
        t, i, j = np.arange(T)[:, None, None], np.arange(N)[:, None], np.arange(STAGE)
        size = STAGE * T + N
        here = (N * t + i, STAGE * t + j)
        after = (N * t + i, STAGE * (t + 1) + i)
        self.jacobian = _Pattern(N * T, size, here, after)
        self.upper, self.last = np.triu_indices(STAGE), np.triu_indices(N)
        stages = (STAGE * t[:, 0] + self.upper[0], STAGE * t[:, 0] + self.upper[1])
        self.hessian = _Pattern(size, size, stages, (STAGE * T + self.last[0], STAGE * T + self.last[1]))


class _Pattern:
    """A sparse matrix whose values come block by block."""

    def __init__(self, rows: int, columns: int, *blocks: tuple[IntArray, IntArray]) -> None:
        import casadi  # pyright: ignore[reportMissingImports]

        spread = [np.broadcast_arrays(*block) for block in blocks]
        r, c = (np.concatenate([block[i].ravel() for block in spread]) for i in range(2))
        self._order = np.lexsort((r, c))  # by column, as casadi keeps them
        self.sparsity = casadi.Sparsity.triplet(rows, columns, r.tolist(), c.tolist())

    def matrix(self, *values: Array) -> Any:
        import casadi  # pyright: ignore[reportMissingImports]

        return casadi.DM(self.sparsity, np.concatenate([v.ravel() for v in values])[self._order])


class _MultipleShooting:
    """Objective, constraints and their derivatives as casadi asks for them; x as in `_Blocks`."""

    def __init__(self, problem: Problem) -> None:
        self.problem, self.T, self.blocks = problem, problem.horizon, _Blocks(problem.horizon)
        self.size = STAGE * self.T + N

    def split(self, x: Any) -> tuple[Array, Array]:
        """States (T+1, 6) and controls (T, 2)."""
        padded = np.append(np.array(x, dtype=float).ravel(), np.zeros(M)).reshape(self.T + 1, STAGE)
        return padded[:, :N].copy(), padded[:-1, N:].copy()

    def joined(self, states: Array, controls: Array) -> Array:
        """x of states and controls."""
        return np.hstack([states, np.vstack([controls, np.zeros(M)])]).ravel()[: self.size]

    def cost(self, x: Any, *_: Any) -> float:
        """The objective."""
        states, controls = self.split(x)
        costs, q = self.problem.costs, self.problem.q
        return sum(costs.running(t, states[t], controls[t], q) for t in range(self.T)) + costs.final(states[-1], q)

    def gaps(self, x: Any, *_: Any) -> Array:
        """The constraints (6 T,)."""
        states, controls = self.split(x)
        return np.concatenate([states[t + 1] - self.problem.step(states[t], controls[t]) for t in range(self.T)])

    def gradient(self, x: Any, *_: Any) -> Array:
        """Of the objective."""
        w = self.problem.along(*self.split(x))
        return self.joined(w.lx, w.lu)

    def jacobian(self, x: Any, *_: Any) -> Any:
        """Of the constraints."""
        w = self.problem.along(*self.split(x))
        return self.blocks.jacobian.matrix(-np.dstack([w.A, w.B]), np.ones(N * self.T))

    def hessian(self, x: Any, _p: Any, factor: Any, multipliers: Any, *_: Any) -> Any:
        """Upper half of the Lagrangian's: that of the last cost as it is, the stages by central differences of exact
        gradients, as the dynamics have no second derivatives to offer."""
        states, controls = self.split(x)
        factor, multipliers = float(factor), np.array(multipliers, dtype=float).reshape(self.T, N)
        H = np.empty((self.T, STAGE, STAGE))
        for j in range(STAGE):
            slopes = []
            for shift in (DIFFERENCE, -DIFFERENCE):
                moved = [states.copy(), controls.copy()]
                moved[j // N][:, j % N] += shift
                w = self.problem.along(*moved)
                by_state = factor * w.lx[:-1] - np.einsum("tij,ti->tj", w.A, multipliers)
                by_control = factor * w.lu - np.einsum("tij,ti->tj", w.B, multipliers)
                slopes.append(np.hstack([by_state, by_control]))
            H[:, :, j] = (slopes[0] - slopes[1]) / (2.0 * DIFFERENCE)
        H = 0.5 * (H + H.transpose(0, 2, 1))
        last = factor * self.problem.along(states, controls).lxx[-1]
        return self.blocks.hessian.matrix(H[:, *self.blocks.upper], last[self.blocks.last])


def ipopt(problem: Problem) -> Answer:
    """IPOPT through casadi by multiple shooting, from the roll-out of level commands."""
    return _ipopt(problem, np.zeros((problem.horizon, M)), {})


def ipopt_from(problem: Problem, controls: Array) -> Answer:
    """The same from given controls, staying near them: to find the minimum that they belong to."""
    near = {"mu_init": 1e-7, **dict.fromkeys(("bound_push", "bound_frac"), 1e-7)}
    return _ipopt(problem, controls, near)


def _ipopt(problem: Problem, controls: Array, rules: dict[str, Any]) -> Answer:
    import casadi  # pyright: ignore[reportMissingImports]

    m, dense = _MultipleShooting(problem), casadi.Sparsity.dense
    variables, none, one, gaps = dense(m.size), casadi.Sparsity(0, 0), dense(1), dense(N * m.T)
    f, g = _callback("f", [variables], [(one, m.cost)]), _callback("g", [variables], [(gaps, m.gaps)])
    at = [variables, none]
    derivatives = {
        "grad_f": _callback("grad_f", at, [(one, m.cost), (variables, m.gradient)]),
        "jac_g": _callback("jac_g", at, [(gaps, m.gaps), (m.blocks.jacobian.sparsity, m.jacobian)]),
        "hess_lag": _callback("hess_lag", [*at, one, gaps], [(m.blocks.hessian.sparsity, m.hessian)]),
    }
    quiet = {"print_time": False, "no_nlp_grad": True, "calc_lam_p": False}
    rules = {"print_level": 0, "sb": "yes", "tol": 1e-7, "max_iter": ITERATIONS, "bound_relax_factor": 0.0, **rules}
    options = {**quiet, **derivatives, **{f"ipopt.{name}": value for name, value in rules.items()}}
    x = casadi.MX.sym("x", m.size)
    solver = casadi.nlpsol("solver", "ipopt", {"x": x, "f": f(x), "g": g(x)}, options)
    free, most = np.full((m.T, N), np.inf), np.full((m.T, M), problem.limit)
    low, high = (m.joined(np.vstack([problem.s0, sign * free]), sign * most) for sign in (-1.0, 1.0))
    start = m.joined(problem.roll_out(controls)[1], controls)
    found = solver(x0=start, lbx=low, ubx=high, lbg=0.0, ubg=0.0)
    return Answer(m.split(found["x"])[1], bool(solver.stats()["success"]))


def _callback(name: str, inputs: list[Any], outputs: list[tuple[Any, Callable[..., Any]]]) -> Any:
    """A casadi function whose outputs are computed by Python."""
    import casadi  # pyright: ignore[reportMissingImports]

    class Called(casadi.Callback):
        def __init__(self) -> None:
            super().__init__()
            self.construct(name, {})

        def get_n_in(self) -> int:
            return len(inputs)

        def get_n_out(self) -> int:
            return len(outputs)

        def get_sparsity_in(self, i: int) -> Any:
            return inputs[i]

        def get_sparsity_out(self, i: int) -> Any:
            return outputs[i][0]

        def eval(self, arguments: Any) -> list[Any]:
            return [compute(*arguments) for _, compute in outputs]

    return Called()


SOLVERS: dict[str, Callable[[Problem], Answer]] = {
    "IPOPT": ipopt,
    "BoxFDDP": box_fddp,
    "SLSQP": slsqp,
    "L-BFGS-B": lbfgsb,
}
