"""The symbols that formulas are written in, and the functions that may stand in them.

Sympy is imported only when a formula is looked at: compiled code is kept on disk, so that most runs never do.
"""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Iterable

BALL = ("theta", "theta_dot", "t")  # rad, rad/s, s
# at any moment, in the order in which compiled code finds them. The plate: tilts as they are, rad, rad/s, rad/s^2;
# radius of the ball's track and of the ball, m
PLATE = ("beta", "beta_dot", "beta_ddot", "gamma", "gamma_dot", "gamma_ddot", "radius", "ball_radius")
# what a record tells besides: the speed low-passed over three times, rad/s; tilts of the record played backwards, which
# no ball can feel; tilts of late, rad
RECORDED = ("past_1", "past_2", "past_3", "backward_beta", "backward_gamma", "late_beta", "late_gamma")
INPUTS = PLATE + RECORDED


class State(SimpleNamespace):
    """Symbols by name. A name that is not there yet becomes a symbol: an input of some other system."""

    def __getattr__(self, name: str) -> Any:
        import sympy

        if name.startswith("_"):
            raise AttributeError(name)
        setattr(self, name, sympy.Symbol(name, real=True))
        return getattr(self, name)


@cache
def state() -> State:
    """The symbols of formulas: those of BALL and INPUTS; speed = |theta_dot|, direction = sign of theta_dot; position
    and velocity, which are theta and theta_dot in systems that are no ring."""
    import sympy

    symbols = {name: sympy.Symbol(name, real=True) for name in (*BALL, *INPUTS, "direction")}
    rate = symbols["theta_dot"]
    return State(**symbols, speed=size(rate), position=symbols["theta"], velocity=rate)


def symbols_of(names: Iterable[str], prefix: str) -> Any:
    """Symbols for the parameters of an effect, by name."""
    import sympy

    return SimpleNamespace(**{name: sympy.Symbol(f"{prefix}{name}", real=True) for name in names})


@cache
def _own() -> Any:
    """Functions that sympy lacks, or whose derivative it takes to be a distribution where it is nought."""
    import sympy

    def none(self: Any, argindex: int = 1) -> Any:
        return sympy.Integer(0)

    def one(self: Any, argindex: int = 1) -> Any:
        return sympy.Integer(1)

    def slope(self: Any, argindex: int = 1) -> Any:
        return made["sign"](self.args[0])

    def inside(self: Any, argindex: int = 1) -> Any:
        return made["between"](*self.args) if argindex == 1 else sympy.Integer(0)

    def steepness(self: Any, argindex: int = 1) -> Any:  # as one number: 1 - tanh^2 in two of them loses its digits
        return made["rest"](self)

    def falling(self: Any, argindex: int = 1) -> Any:
        return -2 * self.args[0]

    kinds = {
        "sign": none, "wrap": one, "size": slope, "clip": inside, "between": none, "tanh": steepness, "rest": falling,
    }  # fmt: skip
    made = {name: type(name, (sympy.Function,), {"fdiff": fdiff, "is_real": True}) for name, fdiff in kinds.items()}
    return SimpleNamespace(**made)


def sin(x: Any) -> Any:
    """Sine."""
    import sympy

    return sympy.sin(x)


def cos(x: Any) -> Any:
    """Cosine."""
    import sympy

    return sympy.cos(x)


def exp(x: Any) -> Any:
    """Exponential."""
    import sympy

    return sympy.exp(x)


def sqrt(x: Any) -> Any:
    """Square root."""
    import sympy

    return sympy.sqrt(x)


def tanh(x: Any) -> Any:
    """Hyperbolic tangent."""
    return _own().tanh(x)


def sign(x: Any) -> Any:
    """-1, 0 or 1."""
    return _own().sign(x)


def size(x: Any) -> Any:
    """Absolute value."""
    return _own().size(x)


def wrap(x: Any) -> Any:
    """An angle without whole turns, from -pi to pi."""
    return _own().wrap(x)


def clip(x: Any, low: float, high: float) -> Any:
    """x inside bounds."""
    return _own().clip(x, low, high)
