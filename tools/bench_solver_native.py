"""Solvers written in C++, compiled when they are needed, that call the planner's own compiled dynamics and cost.

A solver is a file of tools/solvers with three or four plain functions (see problem.hpp), called by ctypes. What it
calls back are the planner's functions, at the addresses at which the planner calls them, each through a C function
made by Numba that takes pointers. The stopwatch is inside the compiled solver, so that Python is not on it.
"""

from __future__ import annotations

import ctypes
import hashlib
import os
import shutil
import subprocess
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from bench_solver_others import Answer, M, N, functions_of
from numba import cfunc, types
from numba.np.numpy_support import carray

from mazeplan.control import ilqg_workspace as workspace
from mazeplan.control.cost import CostParameters
from mazeplan.control.ilqg import PATIENCE, Dynamics, IlqgOptions
from mazeplan.control.ring_planner import RING_COST
from mazeplan.core.maths.compiled import INTEGER, POINTER, REAL, caller
from mazeplan.core.records import Array

SOURCES = Path(__file__).resolve().parent / "solvers"
BUILT = SOURCES.parents[1] / "build" / "solvers"
ROLL_OUT, FOLLOW, TAKE = range(3)  # how a start is meant; see problem.hpp

_step, _linearise = caller(workspace.STEP), caller(workspace.LINEARISE)
_running, _running_derivatives = caller(workspace.RUNNING), caller(workspace.RUNNING_DERIVATIVES)
_final, _final_derivatives = caller(workspace.FINAL), caller(workspace.FINAL_DERIVATIVES)


@cfunc(types.void(INTEGER, POINTER, POINTER, POINTER, INTEGER, POINTER), cache=True)
def _c_step(at, s, u, p, size, out):
    _step(at, (carray(s, (6,)), carray(u, (2,)), carray(p, (size,)), carray(out, (6,))))


@cfunc(types.void(INTEGER, POINTER, POINTER, POINTER, INTEGER, POINTER, POINTER, POINTER), cache=True)
def _c_linearise(at, s, u, p, size, out, A, B):
    numbers = carray(s, (6,)), carray(u, (2,)), carray(p, (size,)), carray(out, (6,))
    _linearise(at, (*numbers, carray(A, (6, 6)), carray(B, (6, 2))))


@cfunc(REAL(INTEGER, INTEGER, POINTER, POINTER, POINTER, INTEGER), cache=True)
def _c_running(at, k, s, u, q, size):
    return _running(at, (k, carray(s, (6,)), carray(u, (2,)), carray(q, (size,))))


@cfunc(types.void(INTEGER, INTEGER, POINTER, POINTER, POINTER, INTEGER, *[POINTER] * 4), cache=True)
def _c_running_derivatives(at, k, s, u, q, size, lx, lu, lxx, luu):
    numbers = k, carray(s, (6,)), carray(u, (2,)), carray(q, (size,))
    slopes = carray(lx, (6,)), carray(lu, (2,)), carray(lxx, (6, 6)), carray(luu, (2, 2))
    _running_derivatives(at, (*numbers, *slopes))


@cfunc(REAL(INTEGER, POINTER, POINTER, INTEGER), cache=True)
def _c_final(at, s, q, size):
    return _final(at, (carray(s, (6,)), carray(q, (size,))))


@cfunc(types.void(INTEGER, POINTER, POINTER, INTEGER, POINTER, POINTER), cache=True)
def _c_final_derivatives(at, s, q, size, lx, lxx):
    _final_derivatives(at, (carray(s, (6,)), carray(q, (size,)), carray(lx, (6,)), carray(lxx, (6, 6))))


CALLED: tuple[Any, ...] = (_c_step, _c_linearise, _c_running, _c_running_derivatives, _c_final, _c_final_derivatives)
NAMES = ("step", "linearise", "running", "running_derivatives", "final", "final_derivatives")


class _Model(ctypes.Structure):
    _fields_ = (
        *((name, ctypes.c_void_p) for name in NAMES),
        *((f"at_{name}", ctypes.c_int64) for name in NAMES),
        ("p", ctypes.c_void_p),
        ("p_size", ctypes.c_int64),
        ("q", ctypes.c_void_p),
        ("q_size", ctypes.c_int64),
        ("limit", ctypes.c_double),
        ("horizon", ctypes.c_int64),
    )


class _Rules(ctypes.Structure):
    _fields_ = (("tolerance", ctypes.c_double), ("patience", ctypes.c_int64), ("iterations", ctypes.c_int64))


class _Trajectory(ctypes.Structure):
    _fields_ = (
        ("kind", ctypes.c_int64),
        *((name, ctypes.c_void_p) for name in ("s0", "states", "controls", "gains")),
        ("ms", ctypes.c_double),
        ("qp_ms", ctypes.c_double),
        ("iterations", ctypes.c_int64),
        ("converged", ctypes.c_int64),
    )


@dataclass(frozen=True)
class Start:
    """Where a solve begins. kind: ROLL_OUT of controls (T, 2), FOLLOW them with gains (T, 2, 6) around states
    (T+1, 6), or TAKE both as they are; ms: what it took to get there, which counts."""

    kind: int
    controls: Array
    states: Array | None = None
    gains: Array | None = None
    ms: float = 0.0


class NativeSolver:
    """One compiled solver for one model, to solve many problems with; its memory is allocated once."""

    def __init__(
        self, library: ctypes.CDLL, dynamics: Dynamics, limit: float, options: IlqgOptions, iterations: int
    ) -> None:
        """limit: of the commands, rad; options: of the planner, whose horizon and tolerance are taken."""
        self._library, self.horizon, self._dynamics = library, options.horizon, dynamics
        self._p, self._q = np.array(dynamics.parameters, dtype=float), CostParameters().pack(0.0)
        self._model = _Model(
            *(function.address for function in CALLED),
            *functions_of(dynamics, RING_COST),
            self._p.ctypes.data,
            len(self._p),
            self._q.ctypes.data,
            len(self._q),
            limit,
            options.horizon,
        )
        self._rules = _Rules(options.tolerance, PATIENCE, iterations)
        library.make.restype = ctypes.c_void_p
        self._solver = ctypes.c_void_p(library.make(ctypes.byref(self._model), ctypes.byref(self._rules)))

    def close(self) -> None:
        """Give its memory back."""
        self._library.unmake(self._solver)

    def solve(
        self, s0: Array, q: Array, start: Start, *, tolerance: float | None = None, entry: str = "solve"
    ) -> Answer:
        """From s0 (6,) with the cost's vector q; tolerance: in place of that of the options; entry: which function."""
        T, kept = self.horizon, self._rules.tolerance
        first, controls = np.array(s0, dtype=float), np.array(start.controls, dtype=float)
        states = np.zeros((T + 1, N)) if start.states is None else np.array(start.states, dtype=float)
        gains = np.zeros((T, M, N)) if start.gains is None else np.ascontiguousarray(start.gains, dtype=float)
        self._q[:] = q
        path = _Trajectory(start.kind, *(v.ctypes.data for v in (first, states, controls, gains)))
        self._rules.tolerance = kept if tolerance is None else tolerance
        getattr(self._library, entry)(self._solver, ctypes.byref(path))
        self._rules.tolerance = kept
        return Answer(controls, bool(path.converged), path.ms + start.ms, int(path.iterations), path.qp_ms)


@cache
def compiled(source: str, flags: Sequence[str]) -> ctypes.CDLL:
    """The library made of a file of tools/solvers, compiled where it was not before; raises ImportError where it cannot
    be."""
    compiler = shutil.which("g++")
    if compiler is None:
        raise ImportError("no C++ compiler", name="g++")
    texts = [(SOURCES / name).read_text() for name in (source, "problem.hpp")]
    mark = hashlib.sha256("\0".join([*texts, *flags]).encode()).hexdigest()[:16]
    library = BUILT / f"{Path(source).stem}-{mark}.so"
    if not library.exists():
        BUILT.mkdir(parents=True, exist_ok=True)
        made = library.with_suffix(f".{os.getpid()}")  # others may be at it, too
        command = [compiler, "-std=c++17", "-O2", "-fPIC", "-shared", str(SOURCES / source), "-o", str(made), *flags]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode:
            reason = next((line for line in done.stderr.splitlines() if "error" in line), "no reason given")
            raise ImportError(f"{source} cannot be compiled: {reason}", name=source)
        made.replace(library)
    try:
        return ctypes.CDLL(str(library))
    except OSError as problem:
        raise ImportError(f"{source} cannot be loaded: {problem}", name=source) from problem
