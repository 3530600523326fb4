"""exp for loops that the compiler turns into vector instructions: a polynomial, no call.

`exp_below` is accurate to the last digits. `exp2_below` is for the innermost loop of planning, where it is most of the
cost of a row of a Gaussian process. It is faster for three reasons: powers of two need no multiplication to find the
exponent, nine coefficients instead of twelve leave an error of 1e-12, and even and odd powers are summed side by side.
"""

from __future__ import annotations

import math

import numpy as np
from llvmlite import ir
from numba import njit, types
from numba.extending import intrinsic

LOG2E, LN2_HIGH, LN2_LOW = 1.4426950408889634, 0.6931471803691238, 1.9082149292705877e-10  # fdlibm's split of ln 2


@intrinsic
def _double_of_bits(context, bits):
    """The float64 with these 64 bits."""

    def generate(context, builder, signature, arguments):
        return builder.bitcast(arguments[0], ir.DoubleType())

    return types.float64(types.int64), generate


@intrinsic
def _bits_of_double(context, x):
    """The 64 bits of this float64."""

    def generate(context, builder, signature, arguments):
        return builder.bitcast(arguments[0], ir.IntType(64))

    return types.int64(types.float64), generate


# 2^r on [-1/2, 1/2] with the smallest largest error there, 8.1e-13 (Chebyshev interpolation in 40 digits, mpmath)
_C0, _C1, _C2, _C3 = 1.0, 0.69314718054593345493, 0.2402265069581298821, 0.055504109412059329931
_C4, _C5, _C6 = 0.0096181291594025581885, 0.0013333450568000645685, 1.5403455852453839442e-4
_C7, _C8 = 1.5310079402249297437e-5, 1.3255224878668816975e-6
_ROUND = 1.5 * 2.0**52  # added to a small number, it leaves the nearest whole one in the last bits


@njit(cache=True, error_model="numpy", fastmath={"contract"})  # no reordering: x + _ROUND - _ROUND is not x
def exp2_below(x):
    """2^x of x in [-1000, 0], within 2e-12 relative."""
    t = x + _ROUND
    r = x - (t - _ROUND)
    s = r * r
    even = _C0 + s * (_C2 + s * (_C4 + s * (_C6 + s * _C8)))
    odd = _C1 + s * (_C3 + s * (_C5 + s * _C7))
    return _double_of_bits(_bits_of_double(even + r * odd) + (_bits_of_double(t) << 52))  # pyright: ignore


@njit(cache=True, error_model="numpy", fastmath=True, inline="always")
def exp_below(x):
    """exp of x in [-700, 0], within 4e-14 relative; math.exp would keep the loop around it from being vectorised."""
    k = math.floor(x * LOG2E + 0.5)
    r = (x - k * LN2_HIGH) - k * LN2_LOW
    q = 1.0 + r * (1.0 + r * (0.5 + r * (1.0 / 6.0 + r * (1.0 / 24.0 + r * (1.0 / 120.0 + r * (
        1.0 / 720.0 + r * (1.0 / 5040.0 + r * (1.0 / 40320.0 + r * (1.0 / 362880.0 + r * (1.0 / 3628800.0 + r * (
        1.0 / 39916800.0)))))))))))  # fmt: skip
    return q * _double_of_bits((np.int64(k) + 1023) << 52)  # pyright: ignore[reportCallIssue]  (Numba hands the context)
