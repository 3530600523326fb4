"""BoxFDDP of crocoddyl with an action model in C++ (tools/solvers/box_fddp.cpp), as its users would write one.

What it needs: the packages crocoddyl (its headers and library come with it), cmeel-eigen (or casadi, which brings
Eigen's headers, too) and g++. It is compiled without the processor's own instructions, as Eigen's memory must be
aligned as in crocoddyl's library. Used by tools/bench_solver.py.
"""

from __future__ import annotations

import ctypes
from importlib.util import find_spec
from pathlib import Path

from bench_solver_native import compiled


def box_fddp_library() -> ctypes.CDLL:
    """Compiled and loaded; raises ImportError for what is missing."""
    import crocoddyl  # pyright: ignore[reportMissingImports]

    prefix = (
        Path(str(crocoddyl.__file__)).resolve().parents[4]
    )  # PREFIX/lib/python3.x/site-packages/crocoddyl/__init__.py
    if not (prefix / "include" / "crocoddyl").is_dir():
        raise ImportError("crocoddyl came without its headers", name="crocoddyl's headers")
    headers = [str(prefix / "include"), str(_eigen(prefix))]
    flags = [*(flag for path in headers for flag in ("-isystem", path)), f"-L{prefix / 'lib'}", "-lcrocoddyl"]
    return compiled("box_fddp.cpp", (*flags, f"-Wl,-rpath,{prefix / 'lib'}"))


def _eigen(prefix: Path) -> Path:
    """Folder of Eigen's headers."""
    casadi = find_spec("casadi")
    places = [prefix / "include" / "eigen3", Path("/usr/include/eigen3")]
    if casadi is not None and casadi.origin:
        places.insert(1, Path(casadi.origin).parent / "include" / "eigen3")
    for place in places:
        if (place / "Eigen").is_dir():
            return place
    raise ImportError("no headers of Eigen", name="cmeel-eigen")
