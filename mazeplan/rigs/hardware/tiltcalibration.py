"""Fits tilt sensor and servos to readings of a clinometer.

Terms of the polynomial: as many as the readings determine twice over, up to cubes. `e_i / (1 - h_ii)` is the error of
the fit without reading i (Allen's PRESS; Belsley, Kuh, Welsch, "Regression Diagnostics", 1980).

Outliers: wrong readings are reported and not used. A robust fit (Cauchy's loss) without cubes shows the gross ones.
Then one reading after another is removed, each by its error in the fit without it.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.optimize import least_squares

from mazeplan.core import file_kinds
from mazeplan.core.errors import InputError, TableError
from mazeplan.core.records import Array
from mazeplan.core.whole_file import whole_file
from mazeplan.maze.yamltree import shown
from mazeplan.rigs.hardware.tiltsensor import DiodeSensor, design
from mazeplan.rigs.link.messages import HARD_US

LINEAR: tuple[str, ...] = ("one", "a", "b")
SQUARES: tuple[str, ...] = (*LINEAR, "ab", "aa", "bb")
CUBES: tuple[str, ...] = (*SQUARES, "aaa", "aab", "abb", "bbb")
COLUMNS = ("v0", "v1", "beta_deg", "gamma_deg")
PULSES = ("pulse_beta_us", "pulse_gamma_us")
LEAST = 8  # minimum number of readings
LEAST_RANGE = 1.0  # deg, minimum range of the readings of an axis
VOLTS, DEGREES = (-0.5, 5.5, "V"), (-30.0, 30.0, "degrees")  # allowed range of a reading
LEAST_RANGE_V = 0.02  # V, minimum range of each channel
ENDS_V = (0.02, 4.98)  # V; beyond these, a channel is at an end of the board's converter
MOST_STUCK = 0.3  # largest share of readings at an end of the converter
CLINOMETER = 0.1  # deg, last digit of the clinometer
GROSS = 1.0  # deg; larger errors of the robust fit are outliers
FINE, VISIBLE = 4.5, 0.2  # standard deviations, and deg, beyond which a reading is an outlier later


@dataclass(frozen=True)
class Reading:
    """One reading.

    v: voltages of the diode's two channels, V.
    beta_deg, gamma_deg: tilt by the clinometer.
    line: line in the file.
    pulses: pulses of the servos of beta and gamma, us; None: unknown."""

    v: tuple[float, float]
    beta_deg: float
    gamma_deg: float
    line: int
    pulses: tuple[float, float] | None = None


@dataclass(frozen=True)
class Outlier:
    """A reading that was not used for an axis.

    line: line in the file.
    axis: beta or gamma.
    got: value of the reading, deg.
    expected: value of the fit, deg."""

    line: int
    axis: str
    got: float
    expected: float


@dataclass(frozen=True)
class AxisFit:
    """Fit of one axis.

    terms: {term: coefficient, deg}.
    rms: rms residual, deg.
    worst: largest residual, deg.
    left_out: rms error at a left-out reading, deg.
    used: number of used readings."""

    terms: dict[str, float]
    rms: float
    worst: float
    left_out: float
    used: int


@dataclass(frozen=True)
class TiltFit:
    """Result of a calibration.

    sensor: the calibrated sensor.
    beta, gamma: fit of each axis.
    outliers: readings that were not used.
    readings: number of all readings.
    level_us: pulses of the level plate for beta and gamma, us; None without pulses in the readings.
    us_per_deg: change of the pulses for 1 deg of tilt; None without pulses in the readings."""

    sensor: DiodeSensor
    beta: AxisFit
    gamma: AxisFit
    outliers: tuple[Outlier, ...]
    readings: int
    level_us: tuple[float, float] | None = None
    us_per_deg: tuple[float, float] | None = None

    @property
    def error_deg(self) -> float:
        """rms error of the worse axis at a left-out reading, deg. It includes the error of the clinometer."""
        return max(self.beta.left_out, self.gamma.left_out)

    def section(self, date: str) -> dict[str, object]:
        """Content of the section `tilt:` in a rig's file."""
        return {
            "centre_v": [round(v, 5) for v in self.sensor.centre],
            "scale_v": [round(v, 5) for v in self.sensor.scale],
            "beta_deg": {name: round(k, 6) for name, k in self.sensor.beta.items()},
            "gamma_deg": {name: round(k, 6) for name, k in self.sensor.gamma.items()},
            "error_deg": round(self.error_deg, 4),
            "readings": self.readings,
            "date": date,
        }


def read_readings(path: Path) -> list[Reading]:
    """Readings of a CSV file with the columns `COLUMNS` and, optionally, `PULSES`. Raises TableError with the line."""
    try:
        with path.open(newline="", encoding="utf-8-sig") as stream:
            rows = csv.reader(stream)
            header = [name.strip() for name in next(rows, [])]
            missing = [name for name in COLUMNS if name not in header]
            if missing:
                got = f"got the header {shown(','.join(header))}"
                raise TableError(f"{got}, expected a table (CSV) with {', '.join(COLUMNS)}", file=path, line=1)
            return [_reading(header, row, path, rows.line_num) for row in rows if any(cell.strip() for cell in row)]
    except (OSError, UnicodeDecodeError, csv.Error):
        raise TableError(file_kinds.refused(path, f"a table (CSV) with {', '.join(COLUMNS)}"), file=path) from None


def _reading(header: list[str], row: list[str], path: Path, line: int) -> Reading:
    if len(row) > len(header):
        raise TableError(f"got {len(row)} columns, the header has {len(header)}", file=path, line=line)
    cells = dict(zip(header, row, strict=False))

    def number(name: str) -> float:
        try:
            value = float(cells.get(name, ""))
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            raise TableError(f"got {cells.get(name, '')!r}, expected a number", file=path, line=line, key=name)
        return value

    def checked(name: str, value: float, allowed: tuple[float, float, str]) -> None:
        low, high, unit = allowed
        if not low <= value <= high:
            problem = f"got {value:g}, expected {low:g} to {high:g} {unit}"
            raise TableError(problem, file=path, line=line, key=name)

    v0, v1, beta, gamma = (number(name) for name in COLUMNS)
    for name, value in zip(COLUMNS, (v0, v1, beta, gamma), strict=True):
        checked(name, value, VOLTS if name in COLUMNS[:2] else DEGREES)
    pulses = None
    if all(cells.get(name, "").strip() for name in PULSES):
        pulses = number(PULSES[0]), number(PULSES[1])
        for name, value in zip(PULSES, pulses, strict=True):
            checked(name, value, (*HARD_US, "us"))
    return Reading((v0, v1), beta, gamma, line, pulses)


def write_readings(path: Path, readings: Sequence[Reading]) -> None:
    """Write a file for `read_readings`, and make its folder. Raises TableError if the file cannot be written."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with whole_file(path) as beside, beside.open("w", newline="", encoding="utf-8") as stream:
            rows = csv.writer(stream)
            rows.writerow((*COLUMNS, *PULSES))
            for r in readings:
                rows.writerow([f"{v:.5f}" for v in r.v] + [r.beta_deg, r.gamma_deg, *(r.pulses or ("", ""))])
    except OSError as problem:
        raise TableError(f"cannot be written: {problem.strerror}", file=path) from None


def fit_tilt(readings: Sequence[Reading]) -> TiltFit:
    """Fit sensor and servos. Raises InputError for too few readings, or readings along one line."""
    if len(readings) < LEAST:
        raise InputError(
            f"got {len(readings)} readings, expected at least {LEAST}: {LEAST - len(readings)} are missing"
        )
    v = np.array([r.v for r in readings])
    low, high = v.min(axis=0), v.max(axis=0)
    _check_spread(v, low, high)
    centre, scale = 0.5 * (low + high), 0.5 * (high - low)
    fits, outliers = {}, []
    for axis in ("beta", "gamma"):
        y = np.array([getattr(r, f"{axis}_deg") for r in readings])
        if np.ptp(y) < LEAST_RANGE:
            got = f"got {y.min():g} to {y.max():g} deg"
            raise InputError(
                f"{axis}_deg: {got}, expected readings over {LEAST_RANGE:g} deg at least; are they degrees?"
            )
        fit, good, said = _fit_axis(v, y, centre, scale)
        fits[axis] = fit
        outliers += [
            Outlier(readings[i].line, axis, float(y[i]), float(said[i])) for i in np.flatnonzero(~good).tolist()
        ]
    beta, gamma = fits["beta"], fits["gamma"]
    sensor = DiodeSensor(
        (float(centre[0]), float(centre[1])), (float(scale[0]), float(scale[1])), beta.terms, gamma.terms
    )
    slips = {(o.line, o.axis) for o in outliers}
    level, per_deg = _fit_servos(readings, slips)
    ordered = tuple(sorted(outliers, key=lambda o: (o.line, o.axis)))
    return TiltFit(sensor, beta, gamma, ordered, len(readings), level, per_deg)


def _check_spread(v: Array, low: Array, high: Array) -> None:
    """Raises InputError if a channel is constant or saturated, or if all voltages lie on one line."""
    for name, values, least, most in zip(COLUMNS[:2], v.T, low, high, strict=True):
        end = "upper" if least > ENDS_V[1] else "lower"
        if least > ENDS_V[1] or most < ENDS_V[0]:
            what = f"it is at its {end} end all the time: is the laser's spot on the diode, the channel connected?"
            raise InputError(f"got {least:.3f} to {most:.3f} V, {what}", key=name)
        if most - least < LEAST_RANGE_V:
            what = f"expected a change of {LEAST_RANGE_V:g} V at least: does the laser hit the diode, the plate tilt?"
            raise InputError(f"got {least:.3f} to {most:.3f} V, {what}", key=name)
        stuck = float(np.mean((values < ENDS_V[0]) | (values > ENDS_V[1])))
        if stuck > MOST_STUCK:
            what = "at an end of its range: the laser's spot leaves the diode"
            raise InputError(f"{100.0 * stuck:.0f} % of the readings are {what}", key=name)
    spread = np.linalg.svd((v - v.mean(axis=0)) / float(np.max(high - low)), compute_uv=False)
    if spread[-1] < 0.05 * spread[0]:
        raise InputError(
            "the voltages v0 and v1 of the readings all lie on one line: tilt the plate about both axes; if it was, one"
            " signal is at both channels"
        )


def _fit_axis(v: Array, y: Array, centre: Array, scale: Array) -> tuple[AxisFit, np.ndarray, Array]:
    """The fit of one axis, which readings it uses (N,) bool, and its value at each reading (N,)."""
    terms = next((s for s in (CUBES, SQUARES) if len(y) >= 2 * len(s)), LINEAR)
    rough = design(SQUARES if terms == CUBES else terms, v, centre, scale)
    start, *_ = np.linalg.lstsq(rough, y, rcond=None)
    found = least_squares(lambda k: rough @ k - y, start, loss="cauchy", f_scale=CLINOMETER)
    good = np.abs(rough @ found.x - y) <= GROSS
    x = design(terms, v, centre, scale)
    while True:
        k, rms, studentised = _leave_one_out(x, y, good)
        said = x @ k
        worst = int(np.argmax(np.abs(studentised)))
        out = abs(studentised[worst]) > FINE and abs(y[worst] - said[worst]) > VISIBLE
        if not out or good.sum() - 1 < max(LEAST, len(terms) + 3) or good.sum() - 1 < 0.6 * len(y):
            break
        good[worst] = False
    good = good | (np.abs(y - said) <= max(VISIBLE, 3.0 * rms))  # take back readings that were excluded wrongly
    k, rms, _ = _leave_one_out(x, y, good)
    said = x @ k
    left = (y - said)[good]
    named = dict(zip(terms, (float(c) for c in k), strict=True))
    fit = AxisFit(named, float(np.sqrt(np.mean(left**2))), float(np.max(np.abs(left))), rms, int(good.sum()))
    return fit, good, said


def _leave_one_out(x: Array, y: Array, good: np.ndarray) -> tuple[Array, float, Array]:
    """Coefficients from the good readings, rms error at a left-out reading, and studentised residuals (N,)."""
    k, *_ = np.linalg.lstsq(x[good], y[good], rcond=None)
    inverse = np.linalg.pinv(x[good].T @ x[good])
    leverage = np.clip(np.einsum("ij,jk,ik->i", x[good], inverse, x[good]), 0.0, 0.999)
    residual = (y - x @ k)[good]
    error = residual / (1.0 - leverage)
    n, p = x[good].shape
    squares = max(float(residual @ residual), n * (0.1 * CLINOMETER) ** 2)
    without = np.maximum(squares - residual**2 / (1.0 - leverage), 1e-3 * squares) / max(n - p - 1, 1)
    studentised = np.zeros(len(y))
    studentised[good] = residual / np.sqrt(without * (1.0 - leverage))
    return np.asarray(k, dtype=float), float(np.sqrt(np.mean(error**2))), studentised


def _fit_servos(
    readings: Sequence[Reading], slips: set[tuple[int, str]]
) -> tuple[tuple[float, float] | None, tuple[float, float] | None]:
    """Pulse of the level plate, us, and us per degree, for each axis.

    None if the readings have no pulses or hardly any range of tilt."""
    found = []
    for i, axis in enumerate(("beta", "gamma")):
        rows = [
            (getattr(r, f"{axis}_deg"), r.pulses[i]) for r in readings
            if r.pulses is not None and (r.line, axis) not in slips
        ]  # fmt: skip
        angles = np.array([angle for angle, _ in rows])
        if len(rows) < LEAST or np.ptp(angles) < 1.0:
            return None, None
        slope, level = np.polyfit(angles, np.array([pulse for _, pulse in rows]), 1)
        found.append((float(level), float(slope)))
    return (found[0][0], found[1][0]), (found[0][1], found[1][1])
