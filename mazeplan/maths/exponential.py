"""exp for loops that the compiler is to turn into vector instructions: a polynomial, no call."""

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


@njit(cache=True, error_model="numpy", fastmath=True, inline="always")
def exp_below(x):
    """exp of x in [-700, 0], within 4e-14 relative; math.exp would keep the loop around it from being vectorised."""
    k = math.floor(x * LOG2E + 0.5)
    r = (x - k * LN2_HIGH) - k * LN2_LOW
    q = 1.0 + r * (1.0 + r * (0.5 + r * (1.0 / 6.0 + r * (1.0 / 24.0 + r * (1.0 / 120.0 + r * (
        1.0 / 720.0 + r * (1.0 / 5040.0 + r * (1.0 / 40320.0 + r * (1.0 / 362880.0 + r * (1.0 / 3628800.0 + r * (
        1.0 / 39916800.0)))))))))))  # fmt: skip
    return q * _double_of_bits((np.int64(k) + 1023) << 52)  # pyright: ignore[reportCallIssue]  (Numba hands the context)
