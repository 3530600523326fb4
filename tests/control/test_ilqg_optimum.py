"""The cost that the planner reaches against IPOPT, on the same problems written down a second time in CasADi."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from ring_numbers import G, numbers_of, ring_of
from scipy.linalg import expm

from mazeplan.control.cost import CostParameters
from mazeplan.control.ilqg import IlqgOptions
from mazeplan.control.ring_planner import RingPlanner
from mazeplan.core.records import StopReason
from mazeplan.physics.dynamics.ring_parameters import SUBSTEPS, RingParameters

RING_2 = RingParameters(0.0689)
RING_4_ROUGH = ring_of(0.0287, viscous=0.3, dry=0.4, offset_beta=0.003, offset_gamma=-0.004)
LIMIT = np.radians(5.0)
LEVEL = np.zeros(6)


def acceleration(p, theta, theta_d, plate, commands):
    """theta_dd, symbolic; plate: (beta, beta_d, gamma, gamma_d)."""
    beta, beta_d, gamma, gamma_d = plate[0], plate[1], plate[2], plate[3]
    wn, zeta = p.beta.natural_frequency, p.beta.damping
    beta_dd = wn**2 * (p.beta.gain * commands[0] + p.beta.offset - beta) - 2 * zeta * wn * beta_d
    n = numbers_of(p)
    g = n.rolling_factor * G / p.radius
    b, c = beta + n.offset_beta, gamma + n.offset_gamma
    return (
        beta_dd * ca.sin(gamma)
        - beta_d**2 * ca.sin(theta) * ca.cos(theta) * ca.cos(gamma) ** 2
        + 2 * beta_d * gamma_d * ca.cos(gamma) * ca.sin(theta) ** 2
        + 0.5 * gamma_d**2 * ca.sin(2 * theta)
        - g * (ca.sin(b) * ca.sin(theta) + ca.sin(c) * ca.cos(b) * ca.cos(theta))
        - n.viscous * theta_d
        - n.dry * ca.tanh(theta_d / p.dry_width)
    )


def symbolic_step(p):
    s, u = ca.SX.sym("s", 6), ca.SX.sym("u", 2)

    def plate(t):
        parts = []
        for axis, at, command in ((p.beta, 2, u[0]), (p.gamma, 4, u[1])):
            wn, zeta = axis.natural_frequency, axis.damping
            phi = expm(np.array([[0.0, 1.0], [-wn * wn, -2.0 * zeta * wn]]) * t)
            rest = axis.gain * command + axis.offset
            parts += ca.vertsplit(ca.vertcat(rest, 0) + phi @ (s[at : at + 2] - ca.vertcat(rest, 0)))
        return parts

    x, h = s[:2], p.dt / SUBSTEPS
    for i in range(SUBSTEPS):
        start, middle, end = (plate((i + c) * h) for c in (0.0, 0.5, 1.0))

        def f(x, tilt):
            return ca.vertcat(x[1], acceleration(p, x[0], x[1], tilt, u))

        k1 = f(x, start)
        k2 = f(x + h / 2 * k1, middle)
        k3 = f(x + h / 2 * k2, middle)
        k4 = f(x + h * k3, end)
        x = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return ca.Function("step", [s, u], [ca.vertcat(x, *plate(p.dt))])


def symbolic_cost(c, goal, speed, lean):
    s, u = ca.SX.sym("s", 6), ca.SX.sym("u", 2)

    def phi(e, a):
        return ca.sqrt(e**2 + a**2) - a

    e, v = s[0] - goal, s[1] - speed
    outward = ca.sin(s[2]) * ca.cos(s[0]) - ca.sin(s[4]) * ca.cos(s[2]) * ca.sin(s[0]) - lean
    past = ca.if_else(e * speed > 0, c.past, 1.0)
    near = c.arrival * ca.exp(-0.5 * (e / c.arrival_zone) ** 2) if speed else 0.0

    def of_state(theta, rate, leaning):
        first = theta * past * phi(e, c.width_theta) + (rate + near) * phi(v, c.width_speed)
        return first + leaning * phi(outward, c.width_lean)

    control = c.control * (ca.cosh(u[0] / c.control_scale) + ca.cosh(u[1] / c.control_scale) - 2)
    running = of_state(c.theta, c.speed, c.lean) + 0.5 * c.rate * (s[3] ** 2 + s[5] ** 2) + control
    final = of_state(c.final_theta, c.final_speed, c.final_lean)
    return ca.Function("running", [s, u], [running]), ca.Function("final", [s], [final])


def ipopt(p, c, s0, wishes, horizon=40):
    """Optimal cost by multiple shooting from a level plate."""
    step, (running, final) = symbolic_step(p), symbolic_cost(c, *wishes)
    S, U = ca.MX.sym("S", 6, horizon + 1), ca.MX.sym("U", 2, horizon)
    cost = sum((running(S[:, k], U[:, k]) for k in range(horizon)), final(S[:, horizon]))
    gaps = [S[:, 0] - s0] + [S[:, k + 1] - step(S[:, k], U[:, k]) for k in range(horizon)]
    problem = {"x": ca.veccat(S, U), "f": cost, "g": ca.vertcat(*gaps)}
    options = {"print_time": False, "ipopt": {"print_level": 0, "sb": "yes", "tol": 1e-9, "max_iter": 2000}}
    solver = ca.nlpsol("solver", "ipopt", problem, options)
    n = 6 * (horizon + 1)
    bound = np.concatenate([np.full(n, np.inf), np.full(2 * horizon, LIMIT)])
    start = np.concatenate([np.tile(s0, horizon + 1), np.zeros(2 * horizon)])
    solution = solver(x0=start, lbx=-bound, ubx=bound, lbg=0, ubg=0)
    assert solver.stats()["success"], solver.stats()["return_status"]
    return float(solution["f"])


STOP = CostParameters()
PROBLEMS = {
    "an eighth of a turn in ring 2": (RING_2, STOP, LEVEL, (np.pi / 4, 0.0, 0.0)),
    "the same, leaning inwards": (RING_2, STOP, LEVEL, (np.pi / 4, 0.0, -0.03)),
    "half a turn in ring 2": (RING_2, STOP, np.array([0.5, 0, 0, 0, 0, 0]), (0.5 - 3.0, 0.0, 0.0)),
    "ring 4 with friction, table off level, ball and plate moving": (
        RING_4_ROUGH,
        STOP,
        np.array([2.0, -1.5, 0.03, 0.2, -0.02, -0.3]),
        (1.2, 0.0, 0.02),
    ),
    "passing the goal at speed": (RING_2, STOP, LEVEL, (np.pi / 4, 0.58, -0.03)),
}


@pytest.mark.parametrize("name", PROBLEMS)
def test_the_cost_equals_that_of_an_interior_point_optimiser(name):
    p, c, s0, wishes = PROBLEMS[name]
    planner = RingPlanner(p, LIMIT, IlqgOptions(40), c)
    plan = planner.plan(s0, wishes[0], goal_theta_dot=wishes[1], lean=wishes[2])
    reference = ipopt(p, c, s0, wishes)
    assert plan.reason is StopReason.CONVERGED
    assert plan.cost == pytest.approx(reference, rel=1e-4)
    if name in list(PROBLEMS)[:4]:
        assert np.mean(np.abs(plan.controls) == LIMIT) > 0.05, "the problem presses against the limits"
