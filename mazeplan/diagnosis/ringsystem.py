"""A ball in one ring as a system to diagnose: from a table to what the filter runs on, for any set of effects."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from numba import njit
from scipy.signal import lfilter

from mazeplan.diagnosis import terms, wallterms
from mazeplan.diagnosis.anonymous import PAST
from mazeplan.diagnosis.geometry import as_seen, bending, unbent
from mazeplan.diagnosis.kalman import NODES, TERM, Moves, Problem
from mazeplan.diagnosis.library import CAMERA, DELAY, DRY, GATE, RING, STAGE, WALL, Candidate
from mazeplan.diagnosis.system import Values
from mazeplan.maths.compiled import address_of, pointer_to
from mazeplan.records import Array

GRAVITY = 9.81  # m/s^2
KEPT_MOTIONS, KEPT_INPUTS = 4, 4  # motions of the plate, and inputs made of them, that are kept
WIDTH = wallterms.LEAN_AT + wallterms.LEANS
BESIDE = terms.RING_AT - terms.PAST_AT  # inputs between the plate's motion and the coefficients of `ring`
AVERAGE = np.array([[1.0, 4.0, 2.0, 4.0, 1.0], [2.0, 6.0, 2.0, 2.0, 0.0]]) / 12.0  # Simpson: of f, of 2 (1 - s) f
RING_SLOTS = {  # parameters of `ring_coefficients`, with what they are without the effect
    ("rolling_inertia", "factor"): 1.0, ("tilt_offset", "beta"): 0.0, ("tilt_offset", "gamma"): 0.0,
    ("tilt_gain", "beta"): 1.0, ("tilt_gain", "gamma"): 1.0,
}  # fmt: skip


@dataclass(frozen=True)
class Tilt:
    """Motion of the plate on a fine grid: t (M,), angles, rates, accelerations (M, 6) as beta, its rate and
    acceleration, gamma's; where it comes from, in words; by_stage: {parameter: derivative (M, 6) of the motion by a
    relative error of it}, for what is not known exactly of the stage."""

    t: Array
    motion: Array
    source: str
    by_stage: dict[str, Array] = field(default_factory=dict)

    def at(self, times: Array, parameter: str | None = None) -> Array:
        """Motion (K, 6) at any times, or its derivative by a parameter, by cubic Hermite interpolation; held beyond
        the ends."""
        out = np.empty((len(times), 6))
        motion = self.motion if parameter is None else self.by_stage[parameter]
        _hermite(motion, float(self.t[0]), float(self.t[1] - self.t[0]), np.ascontiguousarray(times), out)
        return out


@njit(cache=True, error_model="numpy")
def _hermite(motion, start, h, times, out):
    """Motion (M, 6) on a grid from `start` in steps h, at times (K,), into out (K, 6)."""
    for k in range(len(times)):
        at = min(max((times[k] - start) / h, 0.0), len(motion) - 1.000001)
        i = int(at)
        s = at - i
        w0, d0 = (1.0 + 2.0 * s) * (1.0 - s) * (1.0 - s), s * (1.0 - s) * (1.0 - s) * h
        w1, d1 = s * s * (3.0 - 2.0 * s), s * s * (s - 1.0) * h
        for axis in range(0, 6, 3):
            for c in range(axis, axis + 2):  # value, and slope from the next column
                a, b = motion[i], motion[i + 1]
                out[k, c] = w0 * a[c] + d0 * a[c + 1] + w1 * b[c] + d1 * b[c + 1]
            out[k, axis + 2] = motion[i, axis + 2] + s * (motion[i + 1, axis + 2] - motion[i, axis + 2])


@njit(cache=True, error_model="numpy")
def _fill(motions, errors, beside, p, out):
    """Inputs (N, nodes, W) from motions (1 + S, N, nodes, 6), relative errors (S,) of the stage's parameters, what
    stands beside them (N, 7): past speeds, inputs of placebos, tilts of late; the parameters of `ring_coefficients`."""
    for k in range(out.shape[0]):
        for i in range(out.shape[1]):
            w = pointer_to(out, (k * out.shape[1] + i) * out.shape[2])
            for c in range(6):
                w[c] = motions[0, k, i, c]
            for j in range(len(errors)):
                if errors[j] != 0.0:
                    for c in range(6):
                        w[c] += errors[j] * motions[1 + j, k, i, c]
            for c in range(BESIDE):
                w[terms.PAST_AT + c] = beside[k, c]
            for c in range(wallterms.LEANS):
                w[wallterms.LEAN_AT + c] = beside[k, BESIDE + c]
            terms.ring_coefficients(w, pointer_to(p, 0))


def _forget(kept: dict, most: int) -> None:
    """Make room for one more."""
    while len(kept) >= most:
        del kept[next(iter(kept))]


def _span(acts: str, effect: str, names: Sequence[str]) -> tuple[int, int]:
    """Which of the terms, by the names of their effects, a parameter of an effect changes: from one up to another."""
    if acts == RING:  # what it changes of the inputs is for `ring` alone
        return 0, 1
    if acts in (DELAY, STAGE):
        return 0, len(names)
    return (names.index(effect, 1), names.index(effect, 1) + 1) if effect in names[1:] else (0, 0)


class RingSystem:
    """Problems for `kalman`, made from a record and the values of effects."""

    weakest = 0.08  # rad/s^2

    def __init__(self, t: Array, theta: Array, first: np.ndarray, radius: float, tilt: Tilt, declared: Values) -> None:
        """t, theta (N,): s, rad, unwrapped in each stretch, NaN where not seen; first (N,): a stretch begins; declared:
        what the model has already."""
        # contiguous: for strided ones all that is compiled would be compiled once more
        self.t, self.theta = np.ascontiguousarray(t), np.ascontiguousarray(theta)
        self.first, self.radius, self.tilt = first, radius, tilt
        self.declared = declared
        self.target: Array | None = None  # accelerations that the record brings, rad/s^2
        self.dt = float(np.median(np.diff(t)))
        self._beside = np.hstack([self._low_passed(), self._backwards(), self._leaning()])
        self._motions: dict[tuple[float, bool], Array] = {}
        self._averages: dict[tuple[float, bool], Array] = {}
        self._inputs: dict[tuple[float, ...], Array] = {}
        self._addresses: dict[int, int] = {}

    def __len__(self) -> int:
        return len(self.t)

    def _low_passed(self) -> Array:
        """Speeds of the past (N, 3) as measured, low-passed with the time constants PAST."""
        out = np.zeros((len(self.t), len(PAST)))
        steps = np.diff(self.theta, prepend=self.theta[:1]) / self.dt
        steps = np.where(self.first | ~np.isfinite(steps), 0.0, steps)
        for i, tau in enumerate(PAST):
            keep = math.exp(-self.dt / tau)
            out[:, i] = np.asarray(lfilter([1.0 - keep], [1.0, -keep], steps))
        return out

    def _backwards(self) -> Array:
        """Tilts (N, 2) of the record played backwards: what no ball can feel, for placebos."""
        return self.tilt.at(self.t[::-1])[:, [0, 3]]

    def _leaning(self) -> Array:
        """Tilts (N, 2) of late, low-passed from the beginning of each stretch on."""
        tilts, keep = self.tilt.at(self.t)[:, [0, 3]], math.exp(-self.dt / wallterms.LEAN_S)
        out = tilts.copy()
        for a, b in pairwise([*np.flatnonzero(self.first), len(self.t)]):
            out[a:b] = lfilter([1.0 - keep], [1.0, -keep], tilts[a:b], axis=0, zi=keep * tilts[a : a + 1])[0]
        return out

    def _motion(self, delay: float, stage: bool = True) -> Array:
        """Motion of the plate (1 + S, N, NODES, 6) from each sample on, `delay` s earlier; behind it, if wanted, its
        derivatives by the S parameters of the stage."""
        key = (round(delay, 9), stage)
        if key not in self._motions:
            _forget(self._motions, KEPT_MOTIONS)
            grid = (self.t[:, None] + self.dt * np.arange(NODES) / (NODES - 1) - delay).ravel()
            parts = [self.tilt.at(grid, name) for name in (None, *(self.tilt.by_stage if stage else ()))]
            self._motions[key] = np.stack(parts).reshape(len(parts), len(self.t), NODES, 6)
        return self._motions[key]

    def _parts(self, values: Values) -> tuple[float, Array, Array]:
        """Delay of the camera, relative errors of the stage's parameters, parameters of `ring_coefficients`."""
        merged = {**self.declared, **values}
        stage = merged.get("stage", {})
        p = [GRAVITY / self.radius, *(merged.get(effect, {}).get(name, d) for (effect, name), d in RING_SLOTS.items())]
        errors = np.array([stage.get(name, 0.0) for name in self.tilt.by_stage])
        return merged.get("sensor_delay", {}).get("delay", 0.0), errors, np.array(p)

    def inputs(self, values: Values) -> Array:
        """Inputs of the terms (N, NODES, W): the plate's motion, past speeds, and what `ring` needs."""
        delay, errors, p = self._parts(values)
        key = (delay, *errors, *p)
        if key not in self._inputs:
            _forget(self._inputs, KEPT_INPUTS)
            out = np.empty((len(self.t), NODES, WIDTH))
            _fill(self._motion(delay), errors, self._beside, p, out)
            self._inputs[key] = out
        return self._inputs[key]

    def _averaged(self, delay: float, stage: bool = True) -> Array:
        """Motions (1 + S, N, 2, 6) as `_motion`, averaged over each sample: as they act on speed and on position."""
        key = (round(delay, 9), stage)
        if key not in self._averages:
            _forget(self._averages, KEPT_MOTIONS)
            self._averages[key] = np.ascontiguousarray(np.einsum("snkc,wk->snwc", self._motion(delay, stage), AVERAGE))
        return self._averages[key]

    def build(self, candidates: Sequence[Candidate], values: Values) -> tuple[Problem, Array]:
        """The problem with these effects at these values (of those left out: as declared), and its parameters."""
        functions, _, places, p, gates, dry, wall = self._parameters(candidates, values)
        problem = Problem(
            self.position(values), np.isfinite(self.theta), self.first, self.t, self.dt, self.inputs(values),
            np.array([self._address(f) for f in functions], dtype=np.int64), np.array(places, dtype=np.int64), dry,
            np.array([at for at, *_ in gates], dtype=np.int64), 2.0 * math.pi,
            np.array([where for _, *where in gates], dtype=np.float64).reshape(-1, 3), wall, GRAVITY / self.radius,
        )  # fmt: skip
        return problem, np.array(p)

    def _parameters(
        self, candidates: Sequence[Candidate], values: Values
    ) -> tuple[list[object], list[str], list[int], list[float], list[tuple[int, float, float, float]], int, int]:
        """Terms, of which effect each is, where in p each has its parameters, p, gates (where in p, angle to add, side,
        how many parameters follow angle and loss), where dry friction has its parameters, and where friction at the
        walls."""
        merged = {**self.declared, **values}
        p: list[float] = [merged.get("axis_misalignment", {}).get("angle", 0.0)]
        functions: list[object] = [terms.ring]
        names = ["ring"]
        gates: list[tuple[int, float, float, float]] = []
        places, dry, wall = [0], -1, -1
        known = {c.name: c for c in candidates}
        for effect, numbers in merged.items():
            c = known.get(effect)
            if c is None or c.acts in (RING, DELAY, STAGE, CAMERA):
                continue
            at = len(p)
            if c.acts == GATE:
                for i, angle in enumerate(c.pattern):
                    mine = c.of_gate(numbers, i)
                    gates.append((len(p), angle, c.side, len(mine) - 2.0))
                    p.extend(mine)
                continue
            p.extend(c.numbers(numbers))
            if c.acts == DRY:
                dry = at
            elif c.acts == WALL:
                wall = at
            else:
                places.append(at)
                functions.append(c.term)
                names.append(effect)
        return functions, names, places, p, gates, dry, wall

    def moves(self, candidates: Sequence[Candidate], values: Values, steps: Sequence[tuple[str, str, float]]) -> Moves:
        """What moving each of some parameters (effect, name, step) changes."""
        acts = {c.name: c.acts for c in candidates}
        delay, errors, slots = self._parts(values)
        names = self._parameters(candidates, values)[1]
        spans = [_span(acts[effect], effect, names) for effect, *_ in steps]
        outside = [acts[effect] in (RING, DELAY, STAGE) and effect != "axis_misalignment" for effect, *_ in steps]
        w = np.empty((1 + sum(outside), len(self.t), 2, WIDTH))
        _fill(self._averaged(delay), errors, self._beside, slots, w[0])
        p, which = [], []
        for (effect, name, step), out in zip(steps, outside, strict=True):
            moved = {**values, effect: {**values[effect], name: values[effect][name] + step}}
            p.append(self._parameters(candidates, moved)[3])
            which.append(1 + sum(outside[: len(which)]) if out else -1)
            if not out:
                continue
            later, changed, coefficients = self._parts(moved)
            motions = self._averaged(delay)
            if acts[effect] == DELAY:  # what is uncertain of the stage changes little by that
                motions = motions.copy()
                motions[0] += self._averaged(later, False)[0] - self._averaged(delay, False)[0]
            _fill(motions, changed, self._beside, coefficients, w[which[-1]])
        return Moves(
            np.array(p).reshape(len(steps), -1), w, np.array(which, dtype=np.int64),
            np.array([step for *_, step in steps]), np.array(spans, dtype=np.int64).reshape(-1, 2),
        )  # fmt: skip

    def offset(self, values: Values) -> tuple[float, float] | None:
        """Where the camera takes the centre of the ring to be (m), None where it is not off."""
        found = {**self.declared, **values}.get("camera_offset")
        return None if found is None else (found["x"], found["y"])

    def position(self, values: Values) -> Array:
        """Angles (N,) about the true centre."""
        offset = self.offset(values)
        return self.theta if offset is None else unbent(self.theta, self.radius, offset)

    def seen_at(self, values: Values, angle: Array) -> Array:
        """Angles as the camera tells them, from angles about the true centre; any shape."""
        offset = self.offset(values)
        return angle if offset is None else as_seen(angle, self.radius, offset)

    def slope(self, values: Values) -> Array:
        """Derivative (N,) of `position` by the measured angle."""
        offset = self.offset(values)
        return np.ones(len(self.t)) if offset is None else bending(self.theta, self.radius, offset)

    def volume(self, values: Values, rows: np.ndarray) -> float:
        """-2 log of the determinant of the change from measured angles to `position`, of some rows: what turns a
        density of the one into that of the other."""
        return 0.0 if self.offset(values) is None else -2.0 * float(np.sum(np.log(self.slope(values)[rows])))

    def _address(self, function: object) -> int:
        if id(function) not in self._addresses:
            self._addresses[id(function)] = address_of(function, TERM)
        return self._addresses[id(function)]
