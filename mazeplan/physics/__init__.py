"""Physical effects, each defined once. For effects of your own: `Effect`, `Parameter` and the functions of formulas."""

from mazeplan.physics.effect import Effect, Parameter, Term
from mazeplan.physics.formulas.symbols import clip, cos, exp, sign, sin, size, sqrt, tanh, wrap

__all__ = ["Effect", "Parameter", "Term", "clip", "cos", "exp", "sign", "sin", "size", "sqrt", "tanh", "wrap"]
