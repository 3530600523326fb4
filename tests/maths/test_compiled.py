from __future__ import annotations

import numpy as np
import pytest
from numba import njit

from mazeplan.core.maths.compiled import REAL, VECTOR, address_of, caller

SIGNATURE = REAL(VECTOR, REAL)
call = caller(SIGNATURE)


@njit
def first(x, a):
    return a * x.sum()


@njit
def second(x, a):
    x[0] = a
    return -1.0


@njit
def failing(x, a):
    if a > 0.0:
        raise ValueError("too large")
    return 0.0


@njit
def twice(address, x, a):
    return call(address, (x, a)) + call(address, (x, a))


def test_one_compiled_caller_serves_several_functions():
    x = np.array([1.0, 2.0])
    assert twice(address_of(first, SIGNATURE), x, 3.0) == 18.0
    assert twice(address_of(second, SIGNATURE), x, 7.0) == -2.0
    assert x[0] == 7.0
    assert len(twice.signatures) == 1


def test_an_exception_comes_through():
    address = address_of(failing, SIGNATURE)
    assert twice(address, np.zeros(1), -1.0) == 0.0
    with pytest.raises(ValueError, match="too large"):
        twice(address, np.zeros(1), 1.0)


def test_a_plain_function_is_refused():
    with pytest.raises(TypeError, match=r"numba\.njit"):
        address_of(lambda x, a: 0.0, SIGNATURE)
