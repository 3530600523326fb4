"""Functions that generated code calls: compiled ones, and the same functions for arrays and tensors."""

from __future__ import annotations

import math
from types import ModuleType
from typing import Any

from numba import njit

from mazeplan.core.maths.exponential import exp2_below
from mazeplan.core.maths.trigonometry import sine_and_cosine

TWICE_LOG2E = 2.0 / math.log(2.0)
TURN = 2.0 * math.pi


@njit(cache=True, error_model="numpy", inline="always")
def sine(x):
    """sin x, fast for small x."""
    return sine_and_cosine(x)[0]


@njit(cache=True, error_model="numpy", inline="always")
def cosine(x):
    """cos x, fast for small x."""
    return sine_and_cosine(x)[1]


@njit(cache=True, error_model="numpy", inline="always")
def tanh(x):
    """tanh x without a library call."""
    gone = exp2_below(max(-TWICE_LOG2E * abs(x), -1000.0))
    return math.copysign((1.0 - gone) / (1.0 + gone), x)


@njit(cache=True, error_model="numpy", inline="always")
def size(x):
    """|x|."""
    return abs(x)


@njit(cache=True, error_model="numpy", inline="always")
def sign(x):
    """-1, 0 or 1."""
    return 1.0 if x > 0.0 else (-1.0 if x < 0.0 else 0.0)


@njit(cache=True, error_model="numpy", inline="always")
def wrap(x):
    """x without whole turns, from -pi to pi."""
    return x - TURN * math.floor(x / TURN + 0.5)


@njit(cache=True, error_model="numpy", inline="always")
def clip(x, low, high):
    """x limited to the bounds."""
    return min(max(x, low), high)


@njit(cache=True, error_model="numpy", inline="always")
def between(x, low, high):
    """1 inside the bounds, else 0: the derivative of `clip`."""
    return 1.0 if low < x < high else 0.0


@njit(cache=True, error_model="numpy", inline="always")
def rest(x):
    """1 - x^2: the derivative of tanh where tanh has the value x."""
    return 1.0 - x * x


def vectorised(library: ModuleType) -> dict[str, Any]:
    """The same functions for arrays of NumPy or tensors of torch; plain numbers stay plain numbers."""

    def of(name: str) -> Any:
        plain, many = getattr(math, name), getattr(library, name)
        return lambda x: plain(x) if isinstance(x, float | int) else many(x)

    floor = of("floor")

    def clipped(x: Any, low: float, high: float) -> Any:
        return min(max(x, low), high) if isinstance(x, float | int) else library.clip(x, low, high)

    names = {name: of(name) for name in ("sin", "cos", "exp", "sqrt", "tanh")}
    return names | {
        "sine": names["sin"],
        "cosine": names["cos"],
        "size": abs,
        "sign": lambda x: sign.py_func(x) if isinstance(x, float | int) else library.sign(x),
        "wrap": lambda x: x - TURN * floor(x / TURN + 0.5),
        "clip": clipped,
        "rest": rest.py_func,
        "between": lambda x, low, high: (low < x) * (x < high) * 1.0,
    }
