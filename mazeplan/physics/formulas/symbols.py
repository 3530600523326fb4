"""Symbols and functions of formulas.

Importing this module does not import sympy: compiled code is on disk, so most runs never evaluate a formula.
"""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

BALL = ("theta", "theta_dot", "t")  # rad, rad/s, s
# inputs of compiled code at one moment, in this order: true tilts, rad, rad/s, rad/s^2; radius of the ball's track and
# of the ball, m
PLATE = ("beta", "beta_dot", "beta_ddot", "gamma", "gamma_dot", "gamma_ddot", "radius", "ball_radius")
# further inputs from a record: the speed, low-passed with three time constants, rad/s; the tilts of the record in
# reverse order of time (placebos), rad; low-passed tilts, rad
RECORDED = ("past_1", "past_2", "past_3", "backward_beta", "backward_gamma", "late_beta", "late_gamma")
INPUTS = PLATE + RECORDED


class Symbols(SimpleNamespace):
    """Symbols by name. An unknown name becomes a new symbol, for the inputs of systems other than a ring."""

    def __getattr__(self, name: str) -> Any:
        import sympy

        if name.startswith("_"):
            raise AttributeError(name)
        setattr(self, name, sympy.Symbol(name, real=True))
        return getattr(self, name)


@cache
def state() -> Symbols:
    """The symbols of formulas: BALL, INPUTS, speed = |theta_dot| and direction = sign of theta_dot.

    In systems other than a ring, position and velocity stand for theta and theta_dot."""
    import sympy

    symbols = {name: sympy.Symbol(name, real=True) for name in (*BALL, *INPUTS, "direction")}
    rate = symbols["theta_dot"]
    return Symbols(**symbols, speed=size(rate), position=symbols["theta"], velocity=rate)


def symbols_of(names: Iterable[str], prefix: str) -> Any:
    """Symbols for the parameters of an effect, by name."""
    import sympy

    return SimpleNamespace(**{name: sympy.Symbol(f"{prefix}{name}", real=True) for name in names})


@cache
def _own() -> Any:
    """Functions that sympy lacks, or that sympy differentiates into a distribution."""
    import sympy

    slopes = {  # derivative of f by its argument i; `rest` stays one number: as two terms, 1 - tanh^2 loses its digits
        "sign": lambda f, i=1: sympy.Integer(0),
        "wrap": lambda f, i=1: sympy.Integer(1),
        "size": lambda f, i=1: made["sign"](f.args[0]),
        "clip": lambda f, i=1: made["between"](*f.args) if i == 1 else sympy.Integer(0),
        "between": lambda f, i=1: sympy.Integer(0),
        "tanh": lambda f, i=1: made["rest"](f),
        "rest": lambda f, i=1: -2 * f.args[0],
    }
    made = {name: type(name, (sympy.Function,), {"fdiff": slope, "is_real": True}) for name, slope in slopes.items()}
    return SimpleNamespace(**made)


def _function(name: str, text: str) -> Callable[..., Any]:
    """A function of formulas: one of `_own`, else that of sympy."""

    def made(*args: Any) -> Any:
        import sympy

        return getattr(_own() if hasattr(_own(), name) else sympy, name)(*args)

    made.__name__ = name
    made.__doc__ = text
    return made


sin, cos = _function("sin", "Sine."), _function("cos", "Cosine.")
exp, sqrt = _function("exp", "Exponential."), _function("sqrt", "Square root.")
tanh = _function("tanh", "Hyperbolic tangent.")
sign = _function("sign", "-1, 0 or 1.")
size = _function("size", "Absolute value.")
wrap = _function("wrap", "An angle without whole turns, from -pi to pi.")
clip = _function("clip", "clip(x, low, high): x inside bounds.")
