"""Symbolic equation of motion of a ball on a circle of a tilting plate.

A plate R = Ry(beta) Rx(gamma) has the angular velocity w = (gamma_d, beta_d cos(gamma), -beta_d sin(gamma)). In its
frame a point at q = (x, y, 0) accelerates by

    q_dd = R' (0, 0, -g) - w_d x q - 2 w x q_d - w x (w x q)

On a circle of radius r only the part along it counts: theta_dd = (y_dd cos(theta) - x_dd sin(theta)) / r. A test
compares this with Lagrange's equation. Effects of gravity add to tilt and acceleration and scale gravity; forces, drag
and friction are further terms:

    theta_dd = turning + factor * gravity + sum of forces - theta_d * sum of drag - direction * sum of dry friction
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import sympy

from mazeplan.core.constants import GRAVITY as G
from mazeplan.physics.effect import DRAG, DRY, FORCE, GRAVITY, WALL, Effect
from mazeplan.physics.formulas.symbols import sign, state, symbols_of, tanh

# text of the parts of an effect of gravity
OF_GRAVITY = {"factor": "gravity * {1}", **dict.fromkeys(("beta", "gamma", "x", "y"), "{0} + ({1})")}
WIDTH = "dry_width"  # rad/s over which dry friction changes its sign in a plan; near zero: at once


def gravity_in_plane(effects: Sequence[Effect]) -> tuple[Any, Any, Any]:
    """Gravity along x and y of the plate, m/s^2, with all effects of gravity but without their factor; and the
    factor."""
    s = state()
    beta, gamma, x, y, factor = s.beta, s.gamma, sympy.Integer(0), sympy.Integer(0), sympy.Integer(1)
    for effect in effects:
        if effect.acts == GRAVITY:
            change = _formula(effect)
            beta, gamma = beta + change.get("beta", 0), gamma + change.get("gamma", 0)
            x, y, factor = x + change.get("x", 0), y + change.get("y", 0), factor * change.get("factor", 1)
    return G * sympy.sin(beta) + x, -G * sympy.sin(gamma) * sympy.cos(beta) + y, factor


def inertial_acceleration() -> Any:
    """Acceleration along the ring from the plate's rotation, rad/s^2."""
    s = state()
    c, sn, cos_c, sin_c = sympy.symbols("c sn cos_c sin_c", real=True)  # of theta and gamma
    rate = sympy.Matrix([s.gamma_dot, s.beta_dot * cos_c, -s.beta_dot * sin_c])
    both = s.beta_dot * s.gamma_dot
    spin_up = sympy.Matrix([s.gamma_ddot, s.beta_ddot * cos_c - both * sin_c, -s.beta_ddot * sin_c - both * cos_c])
    place, speed = sympy.Matrix([c, sn, 0]), s.theta_dot * sympy.Matrix([-sn, c, 0])  # divided by the radius
    felt = -spin_up.cross(place) - 2 * rate.cross(speed) - rate.cross(rate.cross(place))
    along = sympy.expand(felt[1] * c - felt[0] * sn)
    _, left = sympy.reduced(along, [c**2 + sn**2 - 1, sin_c**2 + cos_c**2 - 1], c, sin_c, sn, cos_c)
    back = {c: sympy.cos(s.theta), sn: sympy.sin(s.theta), cos_c: sympy.cos(s.gamma), sin_c: sympy.sin(s.gamma)}
    return sympy.expand(left.subs(back))


def gravity(effects: Sequence[Effect]) -> Any:
    """Part of gravity along the ring, with its factor, rad/s^2."""
    s = state()
    x, y, factor = gravity_in_plane(effects)
    return factor / s.radius * (y * sympy.cos(s.theta) - x * sympy.sin(s.theta))


def ring_forces(
    effects: Sequence[Effect], kinds: Sequence[str] = (FORCE, DRAG, DRY, WALL), *, exact: bool = False
) -> Any:
    """Forces, drag and friction along the ring, rad/s^2.

    exact: True changes the sign of dry friction at once, False over WIDTH."""
    s, total = state(), sympy.Integer(0)
    width = sympy.Symbol(WIDTH, real=True)
    direction = sign(s.theta_dot) if exact else tanh(s.theta_dot / width)
    for effect in effects:
        if effect.acts not in kinds:
            continue
        f = sympy.sympify(_formula(effect))
        if effect.acts == FORCE:
            total += f
        elif effect.acts == DRAG:
            total -= f * s.theta_dot
        elif effect.acts in (DRY, WALL):  # direction^2 = 1, and less near rest in a plan
            total -= direction * f.subs(s.direction, direction)
    return total


def summed(effects: Sequence[Effect], kind: str) -> Any:
    """Sum of the formulas of all effects of one kind, such as DRY."""
    return sum((sympy.sympify(_formula(e)) for e in effects if e.acts == kind), sympy.Integer(0))


def passing(effect: Effect) -> tuple[Any, Any]:
    """Angle (rad) and loss (share) of an effect of openings."""
    found: Mapping[str, Any] = _formula(effect)
    return sympy.sympify(found["angle"]), sympy.sympify(found["loss"])


def _formula(effect: Effect) -> Any:
    if effect.formula is None:
        raise ValueError(f"{effect.name} has no formula: it acts on the {effect.acts}")
    return effect.formula(state(), symbols_of(effect.parameters, f"{effect.name}__"))


def fingerprint(effect: Effect) -> str:
    """The formula as text, to the last digit."""
    found = _formula(effect)
    parts = found if isinstance(found, Mapping) else {"": found}
    return ", ".join(f"{key}: {sympy.srepr(sympy.sympify(part))}" for key, part in parts.items())


def names_of(effects: Sequence[Effect]) -> list[str]:
    """Symbols of all parameters of some effects, in the order of compiled code."""
    return [f"{effect.name}__{name}" for effect in effects for name in effect.parameters]


def text(effect: Effect) -> str:
    """The formula as text: its term in theta_dd, or the changes of gravity or of a passage; empty for parts of the
    rig."""
    if effect.formula is None:
        return ""
    found = _formula(effect)

    def printed(x: Any) -> str:
        x = sympy.sympify(x)
        x = x.xreplace({n: sympy.Float(n, 4) for n in x.atoms(sympy.Float)})
        return sympy.sstr(x).replace(f"{effect.name}__", "")

    if isinstance(found, Mapping):
        shown = {key: printed(value) for key, value in found.items()}
        return ", ".join(OF_GRAVITY.get(key, "{0} = {1}").format(key, value) for key, value in shown.items())
    behind = {FORCE: "", DRAG: " * theta_dot", DRY: " * direction", WALL: " * direction"}[effect.acts]
    text = printed(found)
    if not behind:
        return text
    whole = sympy.sympify(found).is_Symbol or sympy.sympify(found).is_Mul
    return f"-{text}{behind}" if whole else f"-({text}){behind}"
