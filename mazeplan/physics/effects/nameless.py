"""Nameless terms: dependences of an acceleration that no effect explains.

Each term is a small sum of products of the variables in its `depends_on`. `past` are speeds, low-passed with the time
constants PAST. The diagnosis tries these terms beside the named effects. Without them, it might explain one unknown
cause by several wrong effects. It reports what they find as a dependence, never as an effect.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from mazeplan.physics.effect import FORCE, Effect, Parameter
from mazeplan.physics.formulas.symbols import cos, sin, size, sqrt, tanh

PAST = (0.15, 0.5, 1.5)  # s
TURNING = 0.05  # rad/s, over which a direction changes


def _lean(s: Any) -> Any:
    """The outward tilt, rad."""
    return s.beta * cos(s.theta) - s.gamma * sin(s.theta)


def _swing(s: Any, p: Any) -> Any:
    phase = 2.0 * math.pi * p.frequency * s.t
    return p.cos * cos(phase) + p.sin * sin(phase)


def oscillation(amplitude: Parameter) -> Effect:
    """A force that oscillates in time."""
    return Effect(
        "oscillation", {"frequency": Parameter("Hz", 0.0, 0.0, 15.0, step=1e-5), "cos": amplitude, "sin": amplitude},
        FORCE, _swing, named=False, depends_on=("time",), places=("frequency",), why_not="it has no name",
    )  # fmt: skip


def _term(name: str, formula: Callable[[Any, Any], Any], count: int, *depends_on: str, placebo: bool = False) -> Effect:
    parameters = {f"p{i}": Parameter("", 0.0, -1e3, 1e3, step=1e-3) for i in range(count)}
    return Effect(
        name, parameters, FORCE, formula, named=False, depends_on=depends_on, placebo=placebo, why_not="it has no name"
    )


def _past(s: Any, p: Any) -> Any:
    return p.p0 * s.past_1 + p.p1 * s.past_2 + p.p2 * s.past_3


def _rates(s: Any, p: Any) -> Any:
    along = p.p2 * s.beta_dot * sin(s.theta) + p.p3 * s.gamma_dot * cos(s.theta)
    return p.p0 * s.beta_dot + p.p1 * s.gamma_dot + along


def _speed_angle(s: Any, p: Any) -> Any:
    first = p.p0 * cos(s.theta) + p.p1 * sin(s.theta)
    return s.theta_dot * (first + p.p2 * cos(2 * s.theta) + p.p3 * sin(2 * s.theta))


def _ripples(s: Any, p: Any) -> Any:
    return sum(
        getattr(p, f"p{2 * i}") * cos((4 + i) * s.theta) + getattr(p, f"p{2 * i + 1}") * sin((4 + i) * s.theta)
        for i in range(4)
    )


NAMELESS = (
    _term("speed and tilt", lambda s, p: s.theta_dot * (p.p0 * s.beta + p.p1 * s.gamma), 2, "theta_dot", "beta",
          "gamma"),
    _term("speed and lean", lambda s, p: s.theta_dot * (p.p0 * sqrt(s.beta**2 + s.gamma**2) + p.p1 * _lean(s)
                                                        + p.p2 * size(_lean(s))),
          3, "theta_dot", "theta", "beta", "gamma"),
    _term("direction and lean", lambda s, p: tanh(s.theta_dot / TURNING) * (p.p0 * _lean(s) + p.p1 * size(_lean(s))), 2,
          "theta_dot", "theta", "beta", "gamma"),
    _term("speed and angle", _speed_angle, 4, "theta_dot", "theta"),
    _term("tilt rates", _rates, 4, "beta_dot", "gamma_dot", "theta"),
    _term("tilt squared", lambda s, p: p.p0 * s.beta**2 + p.p1 * s.gamma**2 + p.p2 * s.beta * s.gamma, 3, "beta",
          "gamma"),
    _term("powers of the speed", lambda s, p: p.p0 * s.theta_dot**3 + p.p1 * s.theta_dot**2, 2, "theta_dot"),
    _term("past speed", _past, 3, "theta_dot", "past of theta_dot"),
    _term("ripples along the ring", _ripples, 8, "theta"),
)  # fmt: skip

# Placebos: terms that cannot be present. They are tried like the other terms and must lose. A term is accepted only if
# it explains clearly more than the best placebo.
PLACEBOS = (
    _term("placebo: tilt played backwards",
          lambda s, p: p.p0 * s.backward_beta * sin(s.theta) + p.p1 * s.backward_gamma * cos(s.theta), 2, placebo=True),
    _term("placebo: friction with it", lambda s, p: s.theta_dot * (p.p0 * s.backward_beta + p.p1 * s.backward_gamma),
          2, placebo=True),
)  # fmt: skip
