"""The step of `ring_dynamics` for a whole batch of states, by torch, on any device; and what servos pass on.

The same scheme on the same formulas: the stage by its tables, the ball by Runge and Kutta.
"""

from __future__ import annotations

import math
from typing import Any

from mazeplan.physics.arrays import packed
from mazeplan.physics.ball import rolling_inertia
from mazeplan.physics.compiled import ring_functions, term_functions
from mazeplan.physics.effect import OPENING, Term
from mazeplan.physics.ring_parameters import (
    AXES,
    BALL,
    COUPLING,
    DAMPING,
    GAIN,
    NODE,
    OFFSET,
    RADIUS,
    STEP,
    STIFFNESS,
    SUBSTEP_COUNT,
    TABLE,
    RingParameters,
)
from mazeplan.records import Array

TURN = 2.0 * math.pi
Tensor = Any


class Ring:
    """The step of one ring."""

    def __init__(self, parameters: RingParameters) -> None:
        """parameters: as the planner has them."""
        import torch

        self._p = parameters.pack().tolist()
        size = TABLE + NODE * (2 * int(self._p[SUBSTEP_COUNT]) + 1)
        self._axes = AXES, AXES + size
        terms = parameters.effects if parameters.physics else (Term(rolling_inertia, (0.0,)),)
        along = [term for term in terms if term.effect.acts != OPENING]
        self._functions = ring_functions([term.effect for term in along]).vectorised(torch)
        self._numbers = packed(along, parameters.dry_width)
        opening = [term for term in terms if term.effect.acts == OPENING]
        self._openings = [(term_functions(term.effect).vectorised(torch), list(term.numbers)) for term in opening]

    def _tilt(self, axis: int, node: int, angle: Tensor, rate: Tensor, u: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Angle, rate and acceleration of one axis at a node of its table."""
        p, at = self._p, axis + TABLE + NODE * node
        rest = p[axis + GAIN] * u + p[axis + OFFSET]
        a = rest + p[at] * (angle - rest) + p[at + 1] * rate
        r = p[at + 2] * (angle - rest) + p[at + 3] * rate
        return a, r, p[axis + STIFFNESS] * (rest - a) - p[axis + DAMPING] * r

    def _plate(self, s: Tensor, u: Tensor, node: int) -> tuple[Any, ...]:
        """The plate's motion at a node, as formulas see it."""
        b, c = self._axes
        ub, uc = u[0] + self._p[b + COUPLING] * u[1], u[1] + self._p[c + COUPLING] * u[0]
        both = (*self._tilt(b, node, s[2], s[3], ub), *self._tilt(c, node, s[4], s[5], uc))
        return (*both, self._p[RADIUS], self._p[BALL])

    def _node(self, s: Tensor, u: Tensor, node: int) -> tuple[Any, ...]:
        """What effects make of the plate at a node."""
        return self._functions["plate"](0.0, self._plate(s, u, node), self._numbers)

    def _acceleration(self, plate: tuple[Any, ...], theta: Tensor, theta_d: Tensor, extra: Tensor | float) -> Tensor:
        """theta_dd with the plate as at a node."""
        import torch

        found = self._functions["value"](theta, theta_d, torch.sin(theta), torch.cos(theta), plate, self._numbers)
        return found + extra

    def _pass_openings(self, s: Tensor, u: Tensor, node: int, before: Tensor, theta: Tensor, theta_d: Tensor) -> Any:
        """Angle and rate behind the openings that were passed since the angle `before`."""
        import torch

        plate = self._plate(s, u, node)
        for functions, numbers in self._openings:
            angle = functions["angle"](before, theta_d, 0.0, plate, numbers)
            turn, late = torch.floor((before - angle) / TURN), torch.floor((theta - angle) / TURN)
            kept = 1.0 - functions["loss"](before, theta_d, 0.0, plate, numbers)
            there, passed = angle + TURN * torch.maximum(turn, late), turn != late
            theta = torch.where(passed, there + kept * (theta - there), theta)
            theta_d = torch.where(passed, kept * theta_d, theta_d)
        return theta, theta_d

    def step(self, s: Tensor, u: Tensor, extra: Tensor | float) -> Tensor:
        """States (6, B) one dt later; u (2, B); extra: theta_dd held over the step, (B,) or a number."""
        import torch

        h, n = self._p[STEP], int(self._p[SUBSTEP_COUNT])
        theta, theta_d, last = s[0], s[1], self._node(s, u, 0)
        for i in range(n):
            first, middle, last = last, self._node(s, u, 2 * i + 1), self._node(s, u, 2 * i + 2)
            before = theta
            a1 = self._acceleration(first, theta, theta_d, extra)
            d2 = theta_d + 0.5 * h * a1
            a2 = self._acceleration(middle, theta + 0.5 * h * theta_d, d2, extra)
            d3 = theta_d + 0.5 * h * a2
            a3 = self._acceleration(middle, theta + 0.5 * h * d2, d3, extra)
            a4 = self._acceleration(last, theta + h * d3, theta_d + h * a3, extra)
            theta = theta + h * theta_d + h * h / 6.0 * (a1 + a2 + a3)
            theta_d = theta_d + h / 6.0 * (a1 + 2.0 * (a2 + a3) + a4)
            if self._openings:
                theta, theta_d = self._pass_openings(s, u, 2 * i + 1, before, theta, theta_d)
        beta, beta_d, _, gamma, gamma_d, *_ = self._plate(s, u, 2 * n)
        return torch.stack([theta, theta_d, beta, beta_d, gamma, gamma_d])


class Servos:
    """Limits, deadband and play of the two servos along a roll-out."""

    def __init__(self, numbers: Array, **where: Any) -> None:
        """numbers: as `RingBatch.servos` gives them."""
        import torch

        self._limit = float(numbers[0])
        self._half, self._deadband = (torch.tensor(part, **where)[:, None] for part in (numbers[1:3], numbers[3:5]))
        self._obeyed: Tensor = None
        self._passed: Tensor = None

    def pass_on(self, u: Tensor) -> Tensor:
        """What reaches the plate of the next commands (2, B)."""
        import torch

        u = u.clamp(-self._limit, self._limit)
        if self._obeyed is None:
            self._obeyed = self._passed = u
        self._obeyed = torch.where((u - self._obeyed).abs() >= self._deadband, u, self._obeyed)
        low, high = self._obeyed - self._half, self._obeyed + self._half
        self._passed = torch.minimum(torch.maximum(self._passed, low), high)
        return self._passed
