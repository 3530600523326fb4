"""The drive axis of the public benchmark EMPS (electro-mechanical positioning system): a mass under the drive's force.

The benchmark's MATLAB file has

    qm    measured position, m         vir   control voltage, V
    gtau  drive gain, N/V              t     time, s

A. Janot, M. Gautier, M. Brunot, "Data set and reference models of EMPS", Workshop on Nonlinear System Identification
Benchmarks, 2019. Other variables of the file are ignored. The program parses the file and runs nothing in it.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from mazeplan.core import file_kinds
from mazeplan.core.errors import TableError
from mazeplan.core.progress import Words, no_words
from mazeplan.core.records import Array
from mazeplan.diagnosis.document import Values
from mazeplan.diagnosis.engine.diagnosis import MotionDiagnosis, diagnose_motion
from mazeplan.diagnosis.engine.record import Record
from mazeplan.diagnosis.engine.system import System, system_of
from mazeplan.physics.effect import Parameter

COLUMNS, GAIN = ("t", "qm", "vir"), "gtau"
FEWEST = 1000  # samples
UNEVEN = 0.1  # share of the mean time step by which steps may differ
CUTOFF, PARALLEL = 100.0, 100.0  # Hz, of the filters of the force error, and rate at which it is compared
EDGE = 0.1  # s at both ends that the filters spoil


class Axis:
    """The axis: a force is its input, the position is its output."""

    position, unit, inputs = "qm", "m", ("force",)
    name, force, inertia = "moving_mass", "force", "mass"
    parameters = {"mass": Parameter("kg", 100.0, 1.0, 1e4)}  # noqa: RUF012  read only
    effects = (
        "viscous_friction", "viscous_asymmetry", "dry_friction", "quadratic_drag", "constant_force", "elastic_force",
        "friction_drift",
    )  # fmt: skip

    @staticmethod
    def motion(s: Any, p: Any) -> Any:
        """Acceleration of the mass under the force, m/s^2."""
        return s.force / p.mass


def read_drive(path: Path, gain: float | None = None) -> tuple[Record, float]:
    """The record in a .mat file (MATLAB 4 to 7.2), and the gain of its drive (N/V). The input is the force (N).

    gain: of the drive, for a file without a gain
    Raises TableError: file, variable, what was got, what is allowed."""
    found = _variables(path)
    if gain is not None:
        found.setdefault(GAIN, np.array([gain]))
    columns: dict[str, Array] = {}
    for name in (*COLUMNS, GAIN):
        if name not in found:
            problem = f"got only {', '.join(sorted(found)) or 'other variables'}, expected t, qm, vir and gtau"
            raise TableError(problem, file=path, key=name)
        got = np.asarray(found[name])
        if got.dtype.kind not in "fiu" or got.size != max(got.shape, default=0) or not np.isfinite(got).all():
            problem = f"got {got.dtype} of shape {got.shape}, expected a column of finite real numbers"
            raise TableError(problem, file=path, key=name)
        columns[name] = got.astype(np.float64).ravel()
    t, gains = columns["t"], columns[GAIN]
    if len(t) < FEWEST or not np.ptp(np.diff(t)) < UNEVEN * np.mean(np.diff(t)):
        raise TableError(f"got {len(t)} times, expected at least {FEWEST} at one rate", file=path, key="t")
    for name in COLUMNS[1:]:
        if len(columns[name]) != len(t) or np.ptp(columns[name]) == 0.0:
            problem = f"got {len(columns[name])} samples, expected {len(t)} as in t, which change"
            raise TableError(problem, file=path, key=name)
    if len(gains) != 1 or gains[0] == 0.0:
        raise TableError("expected one number other than 0, in N/V", file=path, key=GAIN)
    return Record(t - t[0], columns["qm"][:, None], float(gains[0]) * columns["vir"][:, None]), float(gains[0])


def _variables(path: Path) -> dict[str, Any]:
    from scipy.io import loadmat

    expected = "an intact .mat file (MATLAB 4 to 7.2) of the benchmark EMPS"
    if not path.is_file() or not path.stat().st_size:
        raise TableError(file_kinds.refused(path, expected), file=path)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # warnings about other variables
            found = loadmat(path, variable_names=[*COLUMNS, GAIN])
    except Exception:  # for a damaged file, the reader may raise anything
        raise TableError(file_kinds.refused(path, expected), file=path) from None
    return {name: value for name, value in found.items() if not name.startswith("__")}


def emps_result(
    system: System, record: Record, known: Values, along: Sequence[str], test: Record | None,
    progress: Words = no_words,
) -> MotionDiagnosis:  # fmt: skip
    """The diagnosis of the axis; its `nrmse` is the force error of the benchmark, over the whole record."""
    done = diagnose_motion(system, record, known, along, test=test, progress=progress)
    fits = [force_error(record, fit.values) for fit in done.fits]
    effects = tuple(
        {**e, "before": force_error(record, done.without[e["name"]].values), "after": fits[1]} for e in done.effects
    )
    before, after = (replace(s, nrmse=e, forces=True) for s, e in zip((done.before, done.after), fits, strict=True))
    tests = None
    if test is not None and done.test is not None:
        pairs = zip(done.test, done.fits, strict=True)
        one, two = (replace(s, nrmse=force_error(test, fit.values), forces=True) for s, fit in pairs)
        tests = (one, two)
    return replace(done, effects=effects, before=before, after=after, test=tests)


def force_error(record: Record, values: Values) -> float:
    """Relative force error ||e|| / ||y|| as the benchmark measures it: forces of the inverse model beside the measured
    one, from filtered derivatives, at a reduced rate."""
    from scipy.signal import butter, decimate, sosfiltfilt

    system, rate = system_of(Axis), 1.0 / record.step
    low = butter(4, min(CUTOFF, 0.4 * rate), fs=rate, output="sos")
    q = sosfiltfilt(low, record.y[:, 0])
    v = np.gradient(q, record.step)
    a = np.gradient(v, record.step)
    force = record.u[:, 0]
    needed = values[system.motion.name]["mass"] * a
    for effect in (e for name in values for e in system.effects if e.name == name):
        for term in system.terms[effect.name]:
            numbers = effect.numbers(values[effect.name])
            size = np.broadcast_to(term.values(q, v, record.t, [force], numbers), q.shape)
            needed = needed + (size * np.sign(v) if term.held else -size)
    every = max(1, round(rate / PARALLEL))
    e, y = needed - force, force
    if every > 1:
        e, y = (np.asarray(decimate(signal, every, ftype="iir", zero_phase=True)) for signal in (e, y))
    edge = round(EDGE * rate / every)
    size = float(np.linalg.norm(y[edge:-edge]))
    return float(np.linalg.norm(e[edge:-edge])) / size if size > 0.0 else math.nan
