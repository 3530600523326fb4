"""Takes readings of a clinometer over a grid of tilts, and fits tilt sensor and servos to them.

The board levels the plate after 200 ms without a command. So a thread repeats the current pulses while a person reads
the clinometer and types.

Terms of the polynomial: as many as the readings determine twice over, up to cubes. `e_i / (1 - h_ii)` is the error of
the fit without reading i (Allen's PRESS; Belsley, Kuh, Welsch, "Regression Diagnostics", 1980).

Outliers: wrong readings are reported and not used. A robust fit (Cauchy's loss) without cubes shows the gross ones.
Then one reading after another is removed, each by its error in the fit without it.
"""

from __future__ import annotations

import csv
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from io import StringIO
from pathlib import Path
from time import monotonic, sleep

import numpy as np
from scipy.optimize import least_squares

from mazeplan.core import file_kinds
from mazeplan.core.errors import InputError, RigError, TableError
from mazeplan.core.records import Array
from mazeplan.core.whole_file import write_text
from mazeplan.maze.yamltree import shown
from mazeplan.rigs.hardware.clocks import SILENT_S
from mazeplan.rigs.hardware.settings import POWERS, Servo, Term, TiltSensor
from mazeplan.rigs.link.board import Board
from mazeplan.rigs.link.protocol import HARD_US

Pair = tuple[float, float]  # of beta and gamma
Ask = Callable[[int, Pair], Pair | None]
AGAIN_S = 0.05  # s between commands
SETTLE_S, AVERAGE_S = 0.8, 0.4  # s: wait for the plate to settle; average of the voltages
GRID_REACH = 1.15  # the grid goes to this many times the tilt limit: a polynomial is worst at the end of its range
LINEAR: tuple[Term, ...] = ("one", "a", "b")
SQUARES: tuple[Term, ...] = (*LINEAR, "ab", "aa", "bb")
CUBES: tuple[Term, ...] = (*SQUARES, "aaa", "aab", "abb", "bbb")
COLUMNS = ("v0", "v1", "beta_deg", "gamma_deg")
PULSES = ("pulse_beta_us", "pulse_gamma_us")
VOLTS, DEGREES, PULSE = (-0.5, 5.5, "V"), (-30.0, 30.0, "degrees"), (*HARD_US, "us")
ALLOWED = dict[str, tuple[float, float, str]](
    zip((*COLUMNS, *PULSES), (VOLTS, VOLTS, DEGREES, DEGREES, PULSE, PULSE), strict=True)
)
MIN_READINGS = 8  # minimum number of readings
LEAST_RANGE = 1.0  # deg, minimum range of the readings of an axis
LEAST_RANGE_V = 0.02  # V, minimum range of each channel
ENDS_V = (0.02, 4.98)  # V; beyond these, a channel is at an end of the board's converter
MOST_STUCK = 0.3  # largest share of readings at an end of the converter
CLINOMETER = 0.1  # deg, last digit of the clinometer
GROSS = 1.0  # deg; larger errors of the robust fit are outliers
FINE, VISIBLE = 4.5, 0.2  # standard deviations, and deg, beyond which a reading is an outlier later


@dataclass(frozen=True)
class Reading:
    """One reading: voltages of the diode's two channels, V, and the tilt by the clinometer."""

    v: tuple[float, float]
    beta_deg: float
    gamma_deg: float
    line: int  # in the file
    pulses: tuple[float, float] | None = None  # of the servos of beta and gamma, us; None: unknown


@dataclass(frozen=True)
class Outlier:
    """A reading that was not used for an axis: its line, and its value and that of the fit, deg."""

    line: int
    axis: str
    got: float
    expected: float


@dataclass(frozen=True)
class AxisFit:
    """Fit of one axis."""

    terms: dict[Term, float]  # coefficients, deg
    rms_deg: float  # of the residuals
    worst_deg: float
    left_out_deg: float  # rms error at a left-out reading
    used: int  # number of used readings


@dataclass(frozen=True)
class TiltFit:
    """Result of a calibration.

    servos: {axis: {"level_us": pulse of the level plate, "us_per_deg": change of the pulse for 1 deg of tilt}}; empty
        if the readings have no pulses, or hardly any range of tilt."""

    sensor: TiltSensor  # rounded as in a rig's file
    beta: AxisFit
    gamma: AxisFit
    outliers: tuple[Outlier, ...]
    servos: dict[str, dict[str, float]]


def read_readings(path: Path) -> list[Reading]:
    """Readings of a CSV file with the columns `COLUMNS` and, optionally, `PULSES`. Raises TableError with the line."""
    wanted = f"a table (CSV) with {', '.join(COLUMNS)}"
    try:
        with path.open(newline="", encoding="utf-8-sig") as stream:
            rows = csv.DictReader(stream)
            rows.fieldnames = header = [name.strip() for name in rows.fieldnames or ()]
            if not set(COLUMNS) <= set(header):
                raise TableError(f"got the header {shown(','.join(header))}, expected {wanted}", file=path, line=1)
            return [_reading(row, path, rows.line_num) for row in rows]
    except (OSError, UnicodeDecodeError, csv.Error):
        raise TableError(file_kinds.refused(path, wanted), file=path) from None


def _reading(row: dict[str, str], path: Path, line: int) -> Reading:
    if None in row:
        raise TableError("got more columns than the header has", file=path, line=line)

    def number(name: str) -> float:
        low, high, unit = ALLOWED[name]
        try:
            value = float(row[name] or "")
        except ValueError:
            value = np.nan
        if not low <= value <= high:
            problem = f"got {row[name]!r}, expected a number from {low:g} to {high:g} {unit}"
            raise TableError(problem, file=path, line=line, key=name)
        return value

    v0, v1, beta, gamma = (number(name) for name in COLUMNS)
    known = all((row.get(name) or "").strip() for name in PULSES)
    return Reading((v0, v1), beta, gamma, line, (number(PULSES[0]), number(PULSES[1])) if known else None)


def write_readings(path: Path, readings: Sequence[Reading]) -> None:
    """Write a file for `read_readings`, and make its folder. Raises InputError if the file cannot be written."""
    text = StringIO(newline="")
    rows = csv.writer(text)
    rows.writerow((*COLUMNS, *PULSES))
    for r in readings:
        rows.writerow([f"{v:.5f}" for v in r.v] + [r.beta_deg, r.gamma_deg, *(r.pulses or ("", ""))])
    write_text(path, text.getvalue())


def grid(servo: Servo, limit_deg: float, count: int) -> list[Pair]:
    """Pulses (beta, gamma), us, for a grid of count x count tilts around level. The rows alternate in direction."""
    steps = np.linspace(-GRID_REACH * limit_deg, GRID_REACH * limit_deg, count)
    beta, gamma = (
        [min(max(axis.level_us + axis.us_per_deg * float(step), axis.min_us), axis.max_us) for step in steps]
        for axis in (servo.beta, servo.gamma)
    )
    return [(b, g) for i, b in enumerate(beta) for g in (gamma if i % 2 == 0 else gamma[::-1])]


Keep = Callable[[list[Reading]], object]


class PulseHolder:
    """Sends the same pulses again and again inside a `with` block; at its end, levels the plate.

    pulses: beta and gamma, us; may change inside the block."""

    def __init__(self, board: Board, pulses: Pair) -> None:
        self.pulses = pulses
        self._board = board
        self._ended = threading.Event()
        self._problem: RigError | None = None
        self._thread = threading.Thread(target=self._work, name="mazeplan hold", daemon=True)

    def __enter__(self) -> PulseHolder:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ended.set()
        self._thread.join()
        self._board.level()

    def _work(self) -> None:
        while not self._ended.wait(AGAIN_S):
            try:
                self._board.command(*self.pulses)
            except RigError as problem:
                self._problem = problem
                return

    def volts(self, over_s: float) -> np.ndarray:
        """Mean of both channels over the last `over_s` seconds, V, (2,).

        Raises RigError if the board is silent or lost: then it did not hold the plate."""
        if self._problem is not None:
            raise self._problem
        reports = self._board.recent()
        if not reports or monotonic() - reports[-1].received_s > SILENT_S:
            raise RigError(f"{self._board.port}: the board has sent no report for {SILENT_S:g} s; is its cable in?")
        latest = [report.volts for report in reports if report.received_s > reports[-1].received_s - over_s]
        return np.mean(latest, axis=0)


def take_readings(board: Board, pulses: list[Pair], ask: Ask, keep: Keep | None = None) -> list[Reading]:
    """Take a reading at each pair of pulses. Raises RigError if the board is silent or lost.

    ask(number from 1, pulses): returns beta and gamma by the clinometer, deg, or None to skip these pulses, or raises
      EOFError to end the readings.
    keep: called after each reading, with all readings so far."""
    readings: list[Reading] = []
    with PulseHolder(board, pulses[0]) as holder:
        for number, pair in enumerate(pulses, start=1):
            holder.pulses = pair
            sleep(SETTLE_S + AVERAGE_S)
            first, second = holder.volts(AVERAGE_S)
            try:
                tilt = ask(number, pair)
            except EOFError:
                break
            if tilt is not None:
                holder.volts(AVERAGE_S)  # a board that fell silent meanwhile did not hold the plate
                readings.append(Reading((float(first), float(second)), *tilt, number, pair))
                if keep is not None:
                    keep(readings)
    return readings


def fit_tilt(readings: Sequence[Reading]) -> TiltFit:
    """Fit sensor and servos. Raises InputError for too few readings, or readings along one line."""
    if len(readings) < MIN_READINGS:
        raise InputError(f"got {len(readings)} readings, expected at least {MIN_READINGS}")
    v = np.array([r.v for r in readings])
    low, high = v.min(axis=0), v.max(axis=0)
    _check_spread(v, low, high)
    centre, scale = 0.5 * (low + high), 0.5 * (high - low)
    fits, outliers = [], []
    for axis in ("beta", "gamma"):
        y = np.array([getattr(r, f"{axis}_deg") for r in readings])
        if np.ptp(y) < LEAST_RANGE:
            raise InputError(f"got {y.min():g} to {y.max():g}, expected {LEAST_RANGE:g} deg or more", key=f"{axis}_deg")
        fit, good, said = _fit_axis(v, y, centre, scale)
        fits.append(fit)
        left_out = np.flatnonzero(~good).tolist()
        outliers += [Outlier(readings[i].line, axis, float(y[i]), float(said[i])) for i in left_out]
    beta, gamma = fits
    sensor = TiltSensor(
        centre_v=(round(float(centre[0]), 5), round(float(centre[1]), 5)),
        scale_v=(round(float(scale[0]), 5), round(float(scale[1]), 5)),
        beta_deg={name: round(k, 6) for name, k in beta.terms.items()},
        gamma_deg={name: round(k, 6) for name, k in gamma.terms.items()},
        error_deg=round(max(beta.left_out_deg, gamma.left_out_deg), 4),
        readings=len(readings),
    )
    ordered = tuple(sorted(outliers, key=lambda o: (o.line, o.axis)))
    return TiltFit(sensor, beta, gamma, ordered, _fit_servos(readings, {(o.line, o.axis) for o in outliers}))


def _check_spread(v: Array, low: Array, high: Array) -> None:
    """Raises InputError if a channel is constant or saturated, or if all voltages lie on one line."""
    for name, values, least, most in zip(COLUMNS[:2], v.T, low, high, strict=True):
        stuck = float(np.mean((values < ENDS_V[0]) | (values > ENDS_V[1])))
        if most - least < LEAST_RANGE_V or stuck > MOST_STUCK:
            got = f"got {least:.3f} to {most:.3f} V, {100.0 * stuck:.0f} % of the readings at an end of the range"
            raise InputError(f"{got}: is the laser's spot on the diode, the channel connected?", key=name)
    spread = np.linalg.svd((v - v.mean(axis=0)) / float(np.max(high - low)), compute_uv=False)
    if spread[-1] < 0.05 * spread[0]:
        problem = "the voltages v0 and v1 of the readings all lie on one line"
        raise InputError(f"{problem}: tilt the plate about both axes; if it was, one signal is at both channels")


def _design(terms: tuple[Term, ...], v: Array, centre: Array, scale: Array) -> Array:
    """Values (N, len(terms)) of the terms at voltages v (N, 2)."""
    a, b = ((v - centre) / scale).T
    return np.column_stack([a ** POWERS[name][0] * b ** POWERS[name][1] for name in terms])


def _fit_axis(v: Array, y: Array, centre: Array, scale: Array) -> tuple[AxisFit, np.ndarray, Array]:
    """The fit of one axis, which readings it uses (N,) bool, and its value at each reading (N,)."""
    terms = next((s for s in (CUBES, SQUARES) if len(y) >= 2 * len(s)), LINEAR)
    rough = _design(SQUARES if terms == CUBES else terms, v, centre, scale)
    start, *_ = np.linalg.lstsq(rough, y, rcond=None)
    found = least_squares(lambda k: rough @ k - y, start, loss="cauchy", f_scale=CLINOMETER)
    good = np.abs(rough @ found.x - y) <= GROSS
    x = _design(terms, v, centre, scale)
    while True:
        k, rms, studentised = _leave_one_out(x, y, good)
        said = x @ k
        worst = int(np.argmax(np.abs(studentised)))
        out = abs(studentised[worst]) > FINE and abs(y[worst] - said[worst]) > VISIBLE
        if not out or good.sum() - 1 < max(MIN_READINGS, len(terms) + 3) or good.sum() - 1 < 0.6 * len(y):
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


def _fit_servos(readings: Sequence[Reading], slips: set[tuple[int, str]]) -> dict[str, dict[str, float]]:
    found = {}
    for i, axis in enumerate(("beta", "gamma")):
        used = [r for r in readings if r.pulses is not None and (r.line, axis) not in slips]
        angles = np.array([getattr(r, f"{axis}_deg") for r in used])
        if len(used) < MIN_READINGS or np.ptp(angles) < LEAST_RANGE:
            return {}
        slope, level = np.polyfit(angles, np.array([r.pulses[i] for r in used if r.pulses is not None]), 1)
        found[axis] = {"level_us": float(level), "us_per_deg": float(slope)}
    return found
