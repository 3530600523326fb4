"""Finite-horizon linear-quadratic regulator, time-varying, by the discrete Riccati recursion.

    minimise  sum_{k<T} 1/2 (x' Q_k x + u' R_k u) + 1/2 x_T' Q_T x_T   subject to   x_{k+1} = A_k x_k + B_k u_k

    K_k = -(R_k + B' P_{k+1} B)^-1 B' P_{k+1} A,   P_k = Q_k + A' P_{k+1} (A + B K_k),   P_T = Q_T

The optimal cost from x_0 is 1/2 x_0' P_0 x_0, with u_k = K_k x_k. (Anderson, Moore, Optimal Control, 1990, chapter 2.)
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class LqrSolution:
    """gains: (T, m, n), u = gains[k] @ x; values: (T+1, n, n), the cost to go is 1/2 x' values[k] x."""

    gains: Array
    values: Array


def riccati(A: Array, B: Array, Q: Array, R: Array, Q_final: Array) -> LqrSolution:
    """Gains and values for A (T, n, n), B (T, n, m), Q (T, n, n) and R (T, m, m), Q_final (n, n).

    Raises numpy.linalg.LinAlgError when R + B' P B is not positive definite, ValueError when shapes do not fit.
    """
    T, n, m = B.shape
    expected = {"A": (A, (T, n, n)), "Q": (Q, (T, n, n)), "R": (R, (T, m, m)), "Q_final": (Q_final, (n, n))}
    for name, (got, shape) in expected.items():
        if got.shape != shape:
            raise ValueError(f"{name}: got shape {got.shape}, expected {shape}")
    gains, values = np.zeros((T, m, n)), np.zeros((T + 1, n, n))
    values[T] = P = Q_final
    for k in range(T - 1, -1, -1):
        factor = np.linalg.cholesky(R[k] + B[k].T @ P @ B[k])
        gains[k] = -np.linalg.solve(factor.T, np.linalg.solve(factor, B[k].T @ P @ A[k]))
        P = Q[k] + A[k].T @ P @ (A[k] + B[k] @ gains[k])
        values[k] = P = 0.5 * (P + P.T)
    return LqrSolution(gains, values)
