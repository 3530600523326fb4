"""Generates source code of values and derivatives from formulas, with common subexpressions, for any backend.

Terms that depend only on the plate's motion and the parameters are computed once a step, into coefficients c. The rest
is a function of the ball, computed at each evaluation of the acceleration:

    theta_dd = sum_i c_i(t, w, p) rest_i(theta, theta_dot)

sympy takes the derivatives by theta, theta_dot and the plate's beta, beta_d, beta_dd, gamma, gamma_d. Sines and
cosines of multiples of theta follow by recurrence from those of theta.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import sympy
from sympy.printing.pycode import PythonCodePrinter

from mazeplan.physics.effect import DRAG, DRY, FORCE, OPENING, WALL, Effect
from mazeplan.physics.formulas import equation
from mazeplan.physics.formulas.symbols import BALL, INPUTS, PLATE, sign, size, state

BY = ("theta", "theta_dot", "beta", "beta_dot", "beta_ddot", "gamma", "gamma_dot")  # derivatives, in this order
MOVING = ("theta", "theta_dot", "speed", "direction")  # of the ball in the plane
SPEED = sympy.Symbol("speed", real=True)


@dataclass
class Routine:
    """Source of one function: arguments, lines, and output expressions."""

    name: str
    arguments: tuple[str, ...]
    lines: list[str] = field(default_factory=list)
    outputs: list[str] = field(default_factory=list)
    into: str = ""  # the argument for the outputs; "": the only output is returned

    def text(self) -> str:
        """The function for Numba: outputs go into an argument."""
        ends = [f"{self.into}[{i}] = {value}" for i, value in enumerate(self.outputs)]
        body = [*self.lines, *(ends if self.into else [f"return {self.outputs[0]}"])] or ["pass"]
        return "\n".join([f"def {self.name}({', '.join(self.arguments)}):", *(f"    {line}" for line in body)])

    def plain(self) -> str:
        """The function for arrays and tensors: outputs are returned as a tuple."""
        arguments = [a for a in self.arguments if a != self.into]
        several = f"({', '.join(self.outputs)}{',' if self.outputs else ''})"
        value = f"return {several if self.into else self.outputs[0]}"
        return "\n".join([f"def {self.name}({', '.join(arguments)}):", *(f"    {x}" for x in [*self.lines, value])])

    def asks_for(self, pattern: str) -> bool:
        """Whether a name in the source matches."""
        return any(re.search(pattern, text) for text in (*self.lines, *self.outputs))


def routines_of(
    kind: str, effects: Sequence[Effect], inputs: Sequence[str] = INPUTS
) -> tuple[list[Routine], dict[str, int]]:
    """Routines of one kind (ring, plane, term, base), and facts about them; inputs: names in w."""
    if kind == "ring":
        return _ring_routines(effects)
    if kind == "plane":
        return _moment_routines(effects)
    if kind == "base":
        return _base_routines(effects)
    (effect,) = effects
    if effect.acts == OPENING:
        angle, loss = equation.passing(effect)
        expressions = {"angle": _signed(angle), "loss": _signed(loss)}
    elif effect.acts in (DRY, WALL):
        expressions = {"hold": _signed(equation.summed([effect], effect.acts))}
    else:
        expressions = {"term": equation.ring_forces([effect], (FORCE, DRAG), exact=True)}
    arguments, names = ("theta", "theta_dot", "t", "w", "p"), equation.names_of(effects)
    return [_routine(name, arguments, [e], names, first=0, inputs=inputs) for name, e in expressions.items()], {}


def _signed(expression: Any) -> Any:
    """The expression with sign(theta_dot) in place of `direction`."""
    s = state()
    return expression.subs(s.direction, sign(s.theta_dot))


def _ring_routines(effects: Sequence[Effect]) -> tuple[list[Routine], dict[str, int]]:
    """plate, value, plate_partials and partials of a set of effects, and `plane` with these outputs, in this order:

    gravity along x and y, m/s^2, without the factor of gravity
    force along the ring, rad/s^2
    drag, 1/s
    dry friction anywhere and dry friction at a wall, rad/s^2
    factor of gravity
    """
    total = equation.inertial_acceleration() + equation.gravity(effects) + equation.ring_forces(effects)
    slopes = [total.diff(getattr(state(), name)) for name in BY]
    coefficients, (value,) = _hoisted([total])
    every, all_of_them = _hoisted([total, *slopes])
    parameters, ball = equation.names_of(effects), ("theta", "theta_dot", "sin_theta", "cos_theta", "c", "p")
    plane = _routine("plane", (*MOVING, "t", "w", "p", "out"), _in_plane(effects), parameters, into="out")
    routines = [
        _routine("plate", ("t", "w", "p", "c"), coefficients, parameters, into="c"),
        _routine("value", ball, [value], parameters),
        _routine("plate_partials", ("t", "w", "p", "c"), every, parameters, into="c"),
        _routine("partials", (*ball, "out"), all_of_them, parameters, into="out"),
        plane,
    ]
    return routines, {"every": len(every), "angled": int(plane.asks_for(r"theta|direction"))}


def _moment_routines(effects: Sequence[Effect]) -> tuple[list[Routine], dict[str, int]]:
    """Two routines that share the work of `plane`, and facts about them.

    moment:   evaluates function calls that do not depend on the ball, such as sines of the time, into c
    plane_at: gives the outputs of `plane`, computed from c
    """
    expressions, names = _in_plane(effects), equation.names_of(effects)
    moving = {SPEED, *(getattr(state(), n) for n in ("theta", "theta_dot", "direction", "radius", "ball_radius"))}
    calls = _outermost(expressions, moving)
    held = {call: sympy.Symbol(f"c[{i}]", real=True) for i, call in enumerate(calls)}
    arguments, expressions = (*MOVING, "t", "w", "p", "c", "out"), [e.xreplace(held) for e in expressions]
    plane = _routine("plane_at", arguments, expressions, names, into="out", inputs=PLATE)
    moment = _routine("moment", ("t", "w", "p", "c"), calls, names, into="c", inputs=PLATE)
    return [moment, plane], {"held": len(calls), "angled": int(plane.asks_for(r"\btheta\b"))}


def _in_plane(effects: Sequence[Effect]) -> list[Any]:
    """The outputs of `plane`."""
    x, y, factor = equation.gravity_in_plane(effects)
    sums = [equation.summed(effects, kind) for kind in (FORCE, DRAG, DRY, WALL)]
    sums = [part.subs(size(state().theta_dot), SPEED) for part in sums]
    return [sympy.sympify(e) for e in (x, y, *sums, factor)]


def _outermost(expressions: Sequence[Any], moving: set[Any]) -> list[Any]:
    """Outermost function calls that contain no moving symbols."""
    found: dict[Any, None] = {}

    def look(part: Any) -> None:
        if isinstance(part, sympy.Function) and not part.free_symbols & moving:
            found[part] = None
        else:
            for argument in part.args:
                look(argument)

    for expression in expressions:
        look(expression)
    return list(found)


def _base_routines(effects: Sequence[Effect]) -> tuple[list[Routine], dict[str, int]]:
    """Two routines for effects of gravity, and the number of coefficients.

    plate: gives the coefficients
    base:  gives their sum for a ball at theta, seen by a camera turned by p[0]; its inputs w end with the coefficients
    """
    coefficients, (value,) = _hoisted([equation.inertial_acceleration() + equation.gravity(effects)])
    plate = _routine("plate", ("t", "w", "p", "c"), coefficients, equation.names_of(effects), into="c")
    base = _routine("base", ("theta", "theta_dot", "sin_theta", "cos_theta", "c", "p"), [value], [])
    base.arguments = ("theta", "theta_dot", "t", "w", "p")
    behind = partial(re.compile(r"\bc\[(\d+)\]").sub, lambda found: f"w[{len(INPUTS) + int(found[1])}]")
    base.lines = ["sin_theta, cos_theta = sin(theta - p[0]), cos(theta - p[0])", *map(behind, base.lines)]
    base.outputs = [*map(behind, base.outputs)]
    return [plate, base], {"coefficients": len(coefficients)}


def _hoisted(expressions: Sequence[Any]) -> tuple[list[Any], list[Any]]:
    """Coefficients that depend on the plate only, and the expressions with symbols c[i] in their place."""
    ball = {state().theta, state().theta_dot}
    plate = {sympy.Symbol(name, real=True) for name in (*INPUTS, "t")}
    found: dict[Any, Any] = {}  # symbols by coefficient

    def named(coefficient: Any) -> Any:
        """The symbol of a coefficient; a number or a parameter is not replaced."""
        key = coefficient if not coefficient.could_extract_minus_sign() else -coefficient
        if not key.free_symbols or (key.is_Symbol and "__" in key.name):
            return coefficient
        symbol = found.setdefault(key, sympy.Symbol(f"c[{len(found)}]", real=True))
        return symbol if key == coefficient else -symbol

    def inside(factor: Any) -> Any:
        """A factor that contains the ball, with the terms of the plate inside it replaced."""
        if not factor.free_symbols & plate:
            return factor
        return factor.func(*(hoisted(a) if a.free_symbols & plate else a for a in factor.args))

    def hoisted(expression: Any) -> Any:
        parts: dict[Any, Any] = {}
        for term in sympy.Add.make_args(_multiplied_out(expression)):
            factors = sympy.Mul.make_args(term)
            rest = sympy.Mul(*(inside(f) for f in factors if f.free_symbols & ball))
            parts[rest] = parts.get(rest, 0) + sympy.Mul(*(f for f in factors if not f.free_symbols & ball))
        return sum((named(c) * rest for rest, c in parts.items()), sympy.Integer(0))

    out = [hoisted(expression) for expression in expressions]
    return list(found), out


def _multiplied_out(expression: Any) -> Any:
    """The expression as a sum of products; arguments of functions stay as they are."""
    inside = (sympy.sin, sympy.cos)
    functions = [f for f in expression.atoms(sympy.Function) if not isinstance(f, inside)]
    functions.sort(key=sympy.count_ops, reverse=True)  # the outer ones first
    held = {f: sympy.Dummy(real=True) for f in functions}
    return sympy.expand(expression.xreplace(held)).xreplace({new: old for old, new in held.items()})


def _routine(
    name: str, arguments: tuple[str, ...], expressions: Sequence[Any], parameters: Sequence[str], *,
    into: str = "", first: int = 1, inputs: Sequence[str] = INPUTS,
) -> Routine:  # fmt: skip
    """The routine that computes some expressions. Raises ValueError for an unknown symbol.

    parameters: their names in p, from p[first] on; inputs: names in w."""
    places = {equation.WIDTH: "p[0]"} if first else {}
    places |= {p: f"p[{first + i}]" for i, p in enumerate(parameters)}
    places |= {symbol: f"w[{i}]" for i, symbol in enumerate(inputs)}
    given = {sympy.Symbol(old, real=True): sympy.Symbol(new, real=True) for old, new in places.items()}
    expressions = [sympy.sympify(e) for e in expressions]
    known = {*places, *(a for a in arguments if a.isidentifier())}
    asked = {x.name for e in expressions for x in e.free_symbols if not x.name.startswith("c[")}
    if unknown := asked - known:
        allowed = ", ".join((*BALL, "speed", "direction", *inputs))
        raise ValueError(f"got {', '.join(sorted(unknown))} in a formula, expected {allowed} and its parameters")
    expressions = [e.subs(given) for e in expressions]
    lines, waves = _waves(expressions, state().theta, "sin_theta" in arguments)
    expressions = [e.xreplace(waves) for e in expressions]
    shared, reduced = sympy.cse(expressions, symbols=sympy.numbered_symbols("x_"), optimizations="basic")
    printer: Any = _Printer({"fully_qualified_modules": False, "strict": False, "precision": 17})
    lines += [f"{symbol} = {printer.doprint(value)}" for symbol, value in shared]
    return Routine(name, arguments, lines, [printer.doprint(e) for e in reduced], into)


def _waves(expressions: Sequence[Any], theta: Any, given: bool) -> tuple[list[str], dict[Any, Any]]:
    """Lines of code for the sines and cosines of theta and its multiples, and the symbols that stand for them."""
    found = {f for e in expressions for f in e.atoms(sympy.sin, sympy.cos)}
    orders = {f: f.args[0] / theta for f in found}
    orders = {f: int(n) for f, n in orders.items() if n.is_Integer}
    if not orders:
        return [], {}
    signs = {f: (-1 if n < 0 and isinstance(f, sympy.sin) else 1) for f, n in orders.items()}
    most = max(abs(n) for n in orders.values())
    names = {1: ("sin_theta", "cos_theta")} | {n: (f"s_{n}", f"c_{n}") for n in range(2, most + 1)}
    lines = [] if given else ["sin_theta, cos_theta = sin(theta), cos(theta)"]
    for n in range(2, most + 1):
        s, c = names[n - 1]
        lines += [f"s_{n} = {s} * cos_theta + {c} * sin_theta", f"c_{n} = {c} * cos_theta - {s} * sin_theta"]
    return lines, {
        f: signs[f] * sympy.Symbol(names[abs(n)][0 if isinstance(f, sympy.sin) else 1], real=True)
        for f, n in orders.items() if n
    }  # fmt: skip


class _Printer(PythonCodePrinter):
    """Prints Python code with bare names of functions; sin and cos of the small tilts become `sine` and `cosine`."""

    def _print_Function(self, expr: Any) -> str:  # noqa: N802  SymPy looks for this name
        name = type(expr).__name__
        name = {"sin": "sine", "cos": "cosine"}.get(name, name)
        return f"{name}({', '.join(self._print(a) for a in expr.args)})"

    _print_sin = _print_cos = _print_exp = _print_tanh = _print_sign = _print_Function  # pyright: ignore

    def _print_Pow(self, expr: Any, rational: bool = False) -> str:  # noqa: N802  SymPy looks for this name
        base, power = expr.args
        text = self.parenthesize(base, 60)
        if power.is_Integer and 2 <= abs(int(power)) <= 4:
            product = "*".join([text] * abs(int(power)))
            return f"({product})" if power > 0 else f"(1/({product}))"
        if power == -1:
            return f"(1/{text})"
        if power == 0.5 or str(power) == "1/2":
            return f"sqrt({self._print(base)})"
        return f"{text}**{self._print(power)}"

    def _print_Rational(self, expr: Any) -> str:  # noqa: N802  SymPy looks for this name
        return f"({expr.p}/{expr.q})" if expr.q != 1 else str(expr.p)
