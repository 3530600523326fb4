"""Sequential quadratic programming on HPIPM (tools/solvers/sqp_hpipm.cpp), and single steps of it (RTI).

What it needs: g++, and HPIPM with BLASFEO. Both come with the package casadi, libraries and headers, compiled for any
processor. HPIPM_PREFIX names a folder (include, lib) with others, compiled for this one. Used by tools/bench_solver.py.
"""

from __future__ import annotations

import ctypes
import os
from pathlib import Path

from bench_solver_native import compiled


def hpipm_place() -> tuple[Path, Path]:
    """Folders of the headers and of the libraries; raises ImportError where there are none."""
    own = os.environ.get("HPIPM_PREFIX")
    if own:
        headers, libraries = Path(own) / "include", Path(own) / "lib"
    else:
        import casadi  # pyright: ignore[reportMissingImports]

        libraries = Path(str(casadi.__file__)).resolve().parent
        headers = libraries / "include"
    if not (headers / "hpipm_d_ocp_qp.h").exists() or not list(libraries.glob("libhpipm*")):
        raise ImportError(f"no HPIPM in {libraries}", name="HPIPM")
    return headers, libraries


def hpipm_target() -> str:
    """The processor that BLASFEO, which HPIPM counts with, was compiled for."""
    text = (hpipm_place()[0] / "blasfeo_target.h").read_text()
    names = (line.split()[1] for line in text.splitlines() if line.startswith("#define TARGET_"))
    return next((name.removeprefix("TARGET_") for name in names if name != "TARGET_PHANTOM"), "unknown")


def sqp_library() -> ctypes.CDLL:
    """Compiled and loaded; raises ImportError for what is missing."""
    headers, libraries = hpipm_place()
    link = [f"-L{libraries}", "-lhpipm", "-lblasfeo", f"-Wl,-rpath,{libraries},--disable-new-dtags"]  # theirs, too
    return compiled("sqp_hpipm.cpp", ("-march=native", "-isystem", str(headers), *link))
