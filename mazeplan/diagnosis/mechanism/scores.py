"""Errors of a mechanism's model on held-out rows, and the smallest sizes of effects that matter in a record.

Relative error of the acceleration, ||e|| / ||a||: a is the measured acceleration, e = a - the model's acceleration.

1. The position goes through a Butterworth filter of order 4, forwards and backwards. Central differences give a. So
   neither step shifts the record in time.
2. The filter's band is CUTOFF. For a noisy record, the band is lower: white noise of the position may cause at most
   NOISE of the acceleration. Noise sigma of the position at a rate f causes sigma (2 pi)^2 sqrt(2 band^5 / (5 f)) of
   the acceleration. With a lower band, the model's acceleration goes through the filter, too.
3. If effects are forces, e is a force, and the error is ||e|| / ||y|| with the measured force y. This is the error of
   inverse dynamic identification by least squares (IDIM-LS; Gautier, "Dynamic identification of robots with power
   model", ICRA 1997; Janot, Vandanjon, Gautier, IEEE Trans. Control Systems Technology 22(1), 2014).
4. e and a (or y) are decimated to PARALLEL with a zero-phase low-pass filter. EDGE seconds at both ends and around
   unseen samples are left out, because the filters ring there.

Free run: the model starts at one filtered state. The measured inputs drive it, and it sees no further position. The
error is the root mean square of the position error. Without a spring, errors of a force add up. So this is the harder
test: a model with a smaller error of the force may have a larger error here. A run in closed loop would say less,
because the controller pulls every model back to the reference.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
from scipy.signal import decimate

from mazeplan.core.errors import InputError
from mazeplan.core.records import Array
from mazeplan.diagnosis.coordinate.diagnosis import Score
from mazeplan.diagnosis.coordinate.fit import Fit, Likelihood, start_of
from mazeplan.diagnosis.coordinate.kalman import NODES, roll_out
from mazeplan.diagnosis.coordinate.system import Values
from mazeplan.diagnosis.mechanism.drive_log import MotionLog
from mazeplan.diagnosis.mechanism.mechanism import Mechanism
from mazeplan.diagnosis.mechanism.system import MechanismSystem, filled, low_passed
from mazeplan.physics.effect import DRY, Effect
from mazeplan.physics.effects.coordinate import NAMELESS

CUTOFF = 100.0  # Hz, band of the low-pass filter before differentiation
HIGHEST = 0.4  # maximum band, as a share of the record's rate
NOISE = 0.05  # maximum noise of the acceleration, as a share of its root mean square
NARROWER = 0.9  # factor from one tried band to the next
ORDER = 5  # of the differences that show the noise of the position
MEDIAN = 0.6745  # median of the absolute value of white noise, in standard deviations
LOWEST = 1e-3  # minimum band, as a share of the record's rate
PARALLEL = 100.0  # Hz, rate at which model and measurement are compared
EDGE = 0.1  # s
BEGUN = 0.1  # s, after which the filter knows the state
WORTH = 0.02  # smallest relevant size, as a share of the root mean square of acceleration or force
FINE = 0.1  # step of numeric derivatives, in smallest sizes
SLIDING = 10.0  # start value of dry friction in fits, in smallest sizes


@dataclass(frozen=True)
class Course:
    """A record with low-passed positions, speed and acceleration.

    system: the system on the low-passed positions
    band: of the low-pass filter, Hz
    inputs: measured inputs (N, W)
    seen: False (N,) near positions that were not measured
    v, a: speed and acceleration (N,)"""

    system: MechanismSystem
    band: float
    inputs: Array
    seen: np.ndarray
    v: Array
    a: Array

    @property
    def seconds(self) -> float:
        """Length of the record, s."""
        return self.system.dt * len(self.v)


def course_of(mechanism: Mechanism, log: MotionLog, declared: Values) -> Course:
    """The record with low-passed positions, speed and acceleration."""
    raw, rate = filled(log.position), 1.0 / log.dt
    differences = np.abs(np.diff(log.position[np.isfinite(log.position)], ORDER))
    noise = float(np.median(differences)) / (MEDIAN * math.sqrt(math.comb(2 * ORDER, ORDER)))
    band = min(CUTOFF, HIGHEST * rate)
    while True:
        x = low_passed(raw, band, rate)
        v = np.gradient(x, log.dt)
        a = np.gradient(v, log.dt)
        left = noise * (2.0 * math.pi) ** 2 * math.sqrt(0.4 * band**5 / rate)
        if left <= NOISE * _rms(a) or band < LOWEST * rate:
            break
        band *= NARROWER
    nodes = np.repeat(log.inputs[:, None, :], NODES, axis=1)
    system = MechanismSystem(mechanism, log.dt, x, nodes, declared)
    half = round(EDGE * rate)
    near = np.convolve(np.isnan(log.position), np.ones(2 * half + 1))  # mode="same" is longer than a short record
    seen = near[half : half + len(raw)] < 0.5
    return Course(system, band, log.inputs, seen, v, a)


def _rms(signal: Array) -> float:
    return float(np.sqrt(np.mean(signal**2)))


def sized(course: Course) -> tuple[list[Effect], list[Effect], float]:
    """Named effects, terms without a name, and the smallest relevant acceleration in this record.

    Parameters of named effects get a smallest relevant size for this record, if they have none. Raises InputError for
    a formula that gives no finite number."""
    system, mechanism = course.system, course.system.mechanism
    known, motion = system.declared.get(mechanism.motion.name, {}), mechanism.motion
    if mechanism.inertia and mechanism.inertia not in known:  # guess it by least squares of force on acceleration
        force = course.inputs[:, mechanism.inputs.index(mechanism.force)]
        guess = abs(float(course.a @ force)) / max(float(course.a @ course.a), 1e-300)
        heavy = motion.parameters[mechanism.inertia]
        heavy = replace(heavy, default=min(max(guess, heavy.low), heavy.high), low=max(heavy.low, 1e-4 * guess))
        motion = replace(motion, parameters={**motion.parameters, mechanism.inertia: heavy})
    first: Values = {motion.name: {name: known.get(name, p.default) for name, p in motion.parameters.items()}}
    base = _given(course, [motion], first)
    strong = _rms(base if mechanism.inertia else course.a)

    def one(c: Effect) -> Effect:
        at = first[c.name] if c is motion else start_of(c)
        here = _given(course, [motion, c], {**first, c.name: at})
        parameters = dict(c.parameters)
        for name, p in c.parameters.items():
            if p.smallest > 0.0 or p.fixed or name in c.places:
                continue
            step = -p.step if at[name] + p.step > p.high else p.step
            change = np.abs(_given(course, [motion, c], {**first, c.name: {**at, name: at[name] + step}}) - here)
            per = (_rms(change) if c is motion else float(change.max())) / p.step
            if per > 0.0:
                least = WORTH * strong / per
                parameters[name] = replace(p, smallest=least if c.named else 0.0, step=FINE * least)
        starts = c.starts
        if c.acts == DRY and not starts:
            name = next(iter(parameters))
            starts = ((SLIDING * parameters[name].smallest, *(p.default for p in list(parameters.values())[1:])),)
        return replace(c, parameters=parameters, starts=starts)

    return [one(c) for c in (motion, *mechanism.effects)], [one(c) for c in NAMELESS], WORTH * strong


def _given(course: Course, effects: list[Effect], values: Values) -> Array:
    """Acceleration (N,) that some effects cause. Raises InputError if it is not finite."""
    out = course.system.modelled(effects, values, course.v)
    if not np.isfinite(out).all():
        bad, c = int(np.flatnonzero(~np.isfinite(out))[0]), effects[-1]
        numbers = ", ".join(f"{name} {value:g}" for name, value in values[c.name].items())
        where = f"position {course.system.theta[bad]:.4g}, speed {course.v[bad]:.4g}" + (
            f", {numbers}" if numbers else ""
        )
        raise InputError(f"the formula of {c.name} gives {out[bad]} at {where}; expected a finite number")
    return out


@dataclass(frozen=True)
class MechanismScore(Score):
    """Errors on some rows.

    nrmse: relative error of force or acceleration
    free_run: root mean square error of the position in a free run
    seconds: length of these rows, s"""

    mechanism: Mechanism
    nrmse: float
    free_run: float
    seconds: float
    floor: float = math.nan
    drawn: ClassVar[str] = "nrmse"
    digits: ClassVar[int] = 6

    @property
    def labels(self) -> dict[str, str]:
        """Words with the unit for each error."""
        scored, unit = self.mechanism.scored, self.mechanism.unit
        return {
            "nrmse": f"relative {scored} error ||e|| / ||{'y' if self.mechanism.inertia else 'a'}||",
            "free_run": f"position error of the free run (root mean square), {unit}",
        }

    @property
    def axes(self) -> tuple[str, str]:
        """Words with the unit for position and speed."""
        return f"position, {self.mechanism.unit}", f"speed, {self.mechanism.unit}/s"

    def nothing_found(self) -> str:
        """The sentence of a record in which no effect was found."""
        times, unit = self.mechanism.shown
        run = f"{self.seconds:.1f} s of free run {times * self.free_run:.3g} {unit} off"
        return f"Nothing is missing: {self.mechanism.scored} error {self.nrmse:.2%}, {run}."

    def both(self, after: MechanismScore) -> str:
        """These errors and those after the effects were found, in words."""
        times, unit = self.mechanism.shown
        error = f"{self.mechanism.scored} error {self.nrmse:.2%} -> {after.nrmse:.2%}"
        off = f"{times * self.free_run:.3g} -> {times * after.free_run:.3g} {unit} off"
        return f"{error}, {self.seconds:.1f} s of free run {off}"


def score(course: Course, likelihood: Likelihood, fitted: Fit, begin: float) -> MechanismScore:
    """Scores from the time `begin` (s) to the end of a record."""
    error, run = relative_error(course, likelihood, fitted, begin), free_run(likelihood, fitted, begin)
    return MechanismScore(course.system.mechanism, error, run, course.seconds - begin)


def relative_error(course: Course, likelihood: Likelihood, fitted: Fit, begin: float) -> float:
    """||e|| / ||a||, or ||e|| / ||y|| for forces, from the time `begin` (s) on."""
    system, mechanism = course.system, course.system.mechanism
    model, y = system.modelled(likelihood.library, fitted.values, course.v), course.a
    if mechanism.inertia:
        y = course.inputs[:, mechanism.inputs.index(mechanism.force)]
    if course.band < CUTOFF:
        model, y = (low_passed(signal, course.band, 1.0 / system.dt) for signal in (model, y))
    e = (course.a - model) * system.inertia(fitted.values)
    every = max(1, round(1.0 / (PARALLEL * system.dt)))
    if every > 1:
        e, y = (np.asarray(decimate(signal, every, ftype="iir", zero_phase=True)) for signal in (e, y))
    t = system.dt * every * np.arange(len(y))
    keep = (t >= begin + EDGE) & (t <= t[-1] - EDGE) & course.seen[::every]
    size = float(np.linalg.norm(y[keep]))
    return float(np.linalg.norm(e[keep])) / size if size > 0.0 else math.nan


def free_run(likelihood: Likelihood, fitted: Fit, begin: float) -> float:
    """Root mean square error of the position in a free run from the time `begin` (s) on."""
    system = likelihood.system
    states = likelihood.filtered(fitted.values, fitted.q)
    start = max(int(np.ceil(begin / system.dt)), round(BEGUN / system.dt))
    steps = len(system) - 1 - start
    left = system.theta[start + 1 :]
    if steps < 1 or not np.isfinite(left).any():
        return math.nan
    problem, p = system.build(likelihood.library, fitted.values)
    positions, _ = roll_out(problem, p, states, np.array([start]), steps)
    return float(np.sqrt(np.nanmean((positions[0, 1:] - left) ** 2)))
