"""A ball in one ring as a system to diagnose: the problem of the filter for a record and any set of effects.

The definition of an effect says where it enters the problem:

    gravity                                       coefficients of the plate
    force, drag                                   terms
    dry friction                                  can hold the ball at rest
    opening                                       acts at its angle
    scale of the tilt sensor, delay of the camera change the motion of the plate
    offset of the camera                          changes the measured angles
    angle of the camera                           enters the term of gravity
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any, TypeVar

import numpy as np
from numba import njit

from mazeplan.core.maths.compiled import KERNEL, pointer_to, shifted
from mazeplan.core.records import Array
from mazeplan.diagnosis.document import Values, changed
from mazeplan.diagnosis.ring.camera import seen_angle, true_angle, true_angle_slope
from mazeplan.diagnosis.ring.kalman import NODES, Moves, Problem
from mazeplan.diagnosis.stage.plate_motion import Tilt
from mazeplan.physics.ball_model import BALL_RADIUS
from mazeplan.physics.effect import BALL, DRAG, DRY, FORCE, GRAVITY, OPENING, WALL, Effect, Parameter
from mazeplan.physics.effects.nameless import PAST
from mazeplan.physics.effects.openings import WALLS
from mazeplan.physics.formulas.compiled import base_functions, call_plate, term_functions
from mazeplan.physics.formulas.symbols import INPUTS, PLATE
from mazeplan.physics.registry import EFFECTS, PACKAGED

KEPT = 4  # cached motions of the plate, and cached inputs
LEAN_S = 0.05  # s; time constant of the low-passed tilt
AVERAGE = np.array([[1.0, 4.0, 2.0, 4.0, 1.0], [2.0, 6.0, 2.0, 2.0, 0.0]]) / 12.0  # Simpson: of f, of 2 (1 - s) f
COUNT = len(INPUTS)  # number of inputs; the coefficients of the plate follow them
assert len(PLATE) == 8, "what is beside the plate begins at 8, see `_fill`"
STAGE_ERRORS = "stage"  # the pseudo-effect of `stage_errors`
MOTION = ("tilt_gain", "sensor_delay", STAGE_ERRORS)  # effects that change the plate's motion as the ball feels it
# effects of the rig that the ball shows; `stage.comparison` compares stage and tilt sensor with the model
BY_THE_BALL = ("tilt_gain", "axis_misalignment", "camera_offset", "sensor_delay")
# named by other means: a draught looks like a table that is not level, unless somebody turns the maze; a rocking table
# shows as a force that swings with time, as sin and cos of theta; an unbalanced ball loses its phase with every slip
NOT_SEARCHED = ("constant_force", "table_rocking", "ball_imbalance", "local_friction", *(e.name for e in WALLS))
Made = TypeVar("Made")


def ring_library() -> list[Effect]:
    """All packaged effects that a diagnosis can name on a ring without a map."""
    known = PACKAGED.items()
    return [e for name, e in known if name not in NOT_SEARCHED and (e.acts in BALL or name in BY_THE_BALL)]


def stage_errors(directions: Iterable[str]) -> Effect:
    """Errors of the fitted stage, in standard errors along independent directions (`plate_motion.Stage`).

    They are fitted together with the effects where values and intervals are reported. They are never a finding."""
    one = Parameter("1", 0.0, -10.0, 10.0, step=0.1, prior=1.0)
    return Effect(STAGE_ERRORS, dict.fromkeys(directions, one), STAGE_ERRORS, named=False)


def remembered(kept: dict[Any, Made], most: int, key: Any, make: Callable[[], Made]) -> Made:
    """What was made for a key before, else what `make` makes. At most so many are kept, the latest ones."""
    if key not in kept:
        while len(kept) >= most:
            del kept[next(iter(kept))]
        kept[key] = make()
    return kept[key]


@njit(**KERNEL)
def _fill(motions, errors, beside, gains, p, t, radii, plate, out):
    """Fill the inputs out (N, nodes, W) of the terms.

    motions: motion (1 + S, N, nodes, 6) of the plate, then its derivatives by the stage's S directions
    errors: errors (S,) of the stage along these directions, in standard errors
    beside: past speeds, inputs of placebos and low-passed tilts (N, 7)
    gains: scales (2,) of the tilt sensor
    p: parameters of gravity's effects
    t: times (N, nodes), s
    radii: radii (2,) of ring and ball, m
    plate: address of the function that computes the plate's coefficients"""
    for k in range(out.shape[0]):
        for i in range(out.shape[1]):
            w = pointer_to(out, (k * out.shape[1] + i) * out.shape[2])
            for c in range(6):
                w[c] = motions[0, k, i, c]
            for j in range(len(errors)):
                if errors[j] != 0.0:
                    for c in range(6):
                        w[c] += errors[j] * motions[1 + j, k, i, c]
            for c in range(6):
                w[c] /= gains[c // 3]
            w[6], w[7] = radii[0], radii[1]
            for c in range(beside.shape[1]):
                w[8 + c] = beside[k, c]
            call_plate(plate, (t[k, i], w, pointer_to(p, 0), shifted(w, COUNT)))


@dataclass
class _Assembled:
    """Effects as the filter needs them: fields as in `Problem`; names: effects of the terms; p: all parameters."""

    terms: list[int]
    names: list[str]
    place: list[int]
    p: list[float]
    holds: list[tuple[int, int]] = field(default_factory=list)
    openings: list[tuple[int, int, int]] = field(default_factory=list)
    opening_offsets: list[float] = field(default_factory=list)


class RingSystem:
    """Problems for `kalman`, made from a record and the values of effects.

    t: times (N,), s
    theta: measured angles (N,), rad, unwrapped in each stretch, NaN if not seen
    begins: True (N,) where a stretch begins
    radius: of the track, m
    tilt: motion of the plate
    declared: known effects
    target: accelerations (N,) in the record's own column, rad/s^2"""

    def __init__(
        self, t: Array, theta: Array, begins: np.ndarray, radius: float, tilt: Tilt, declared: Values,
        target: Array | None = None,
    ) -> None:  # fmt: skip
        # contiguous, because strided arrays would make Numba compile all functions once more
        self.t, self.theta = np.ascontiguousarray(t), np.ascontiguousarray(theta)
        self.begins, self.radius, self.tilt = begins, radius, tilt
        self.declared, self.target = declared, target
        self.dt = float(np.median(np.diff(t)))
        self._beside = self._beside_the_plate()
        self._motions: dict[float, tuple[Array, Array]] = {}
        self._inputs: dict[tuple[float, ...], Array] = {}
        self._gravity = tuple(e for e in EFFECTS.values() if e.acts == GRAVITY)
        self._base = base_functions(self._gravity)
        self._width = len(INPUTS) + self._base.counts["coefficients"]

    def __len__(self) -> int:
        return len(self.t)

    def _beside_the_plate(self) -> Array:
        """Speeds low-passed with the time constants PAST, tilts played backwards (for placebos: no ball can feel
        them), and tilts low-passed with LEAN_S from the beginning of each stretch on (N, 7)."""
        from scipy.signal import lfilter  # slow to import

        steps = np.diff(self.theta, prepend=self.theta[:1]) / self.dt
        steps = np.where(self.begins | ~np.isfinite(steps), 0.0, steps)
        decays = [math.exp(-self.dt / tau) for tau in PAST]
        past = [np.asarray(lfilter([1.0 - keep], [1.0, -keep], steps)) for keep in decays]
        backwards = self.tilt.at(self.t[::-1])[:, [0, 3]]
        tilts, keep = self.tilt.at(self.t)[:, [0, 3]], math.exp(-self.dt / LEAN_S)
        leaning = tilts.copy()
        for a, b in pairwise([*np.flatnonzero(self.begins), len(self.t)]):
            leaning[a:b] = lfilter([1.0 - keep], [1.0, -keep], tilts[a:b], axis=0, zi=keep * tilts[a : a + 1])[0]
        return np.column_stack([*past, backwards, leaning])

    def _motion(self, delay: float) -> tuple[Array, Array]:
        """Motion of the plate `delay` s earlier, then its derivatives by the stage's S directions: from each sample to
        the next (1 + S, N, NODES, 6), and its averages over each sample, for speed and position (1 + S, N, 2, 6)."""

        def make() -> tuple[Array, Array]:
            grid = (self.t[:, None] + self.dt * np.arange(NODES) / (NODES - 1) - delay).ravel()
            parts = [self.tilt.at(grid, name) for name in (None, *self.tilt.by_stage)]
            motion = np.stack(parts).reshape(len(parts), len(self.t), NODES, 6)
            return motion, np.ascontiguousarray(np.einsum("snkc,wk->snwc", motion, AVERAGE))

        return remembered(self._motions, KEPT, round(delay, 9), make)

    def _parts(self, values: Values) -> tuple[float, Array, Array, Array]:
        """Delay of the camera (s), errors of the stage (standard errors), scales of the tilt sensor, parameters.

        The parameters are those of gravity's effects, after one number that these effects do not use."""
        merged = {**self.declared, **values}
        stage, gain = merged.get(STAGE_ERRORS, {}), merged.get("tilt_gain", {})
        p = [0.0, *(number for e in self._gravity for number in e.numbers(merged.get(e.name, {})))]
        errors = np.array([stage.get(name, 0.0) for name in self.tilt.by_stage])
        gains = np.array([gain.get("beta", 1.0), gain.get("gamma", 1.0)])
        return merged.get("sensor_delay", {}).get("delay", 0.0), errors, gains, np.array(p)

    def _filled(self, motions: Array, parts: tuple[float, Array, Array, Array], out: Array) -> Array:
        """Fill and return the inputs out (N, nodes, W). parts: the result of `_parts`"""
        delay, errors, gains, p = parts
        nodes = out.shape[1]
        t = self.t[:, None] + self.dt * np.arange(nodes) / max(nodes - 1, 1) - delay
        radii = np.array([self.radius, BALL_RADIUS])
        _fill(motions, errors, self._beside, gains, p, t, radii, self._base.address["plate"], out)
        return out

    def inputs(self, values: Values) -> Array:
        """Inputs of the terms (N, NODES, W): motion of the plate, past speeds, coefficients of the plate."""
        parts = self._parts(values)
        key = (parts[0], *(number for part in parts[1:] for number in part))

        def make() -> Array:
            return self._filled(self._motion(parts[0])[0], parts, np.empty((len(self.t), NODES, self._width)))

        return remembered(self._inputs, KEPT, key, make)

    def build(self, candidates: Sequence[Effect], values: Values) -> tuple[Problem, Array]:
        """The problem and its parameters, with these effects at these values; other effects stay as declared."""
        built = self._assembled(candidates, values)
        problem = Problem(
            self.position(values), np.isfinite(self.theta), self.begins, self.t, self.dt, self.inputs(values),
            np.array(built.terms, dtype=np.int64), np.array(built.place, dtype=np.int64),
            np.array(built.holds, dtype=np.int64).reshape(-1, 2),
            np.array(built.openings, dtype=np.int64).reshape(-1, 3), np.array(built.opening_offsets, dtype=np.float64),
        )  # fmt: skip
        return problem, np.array(built.p)

    def _assembled(self, candidates: Sequence[Effect], values: Values) -> _Assembled:
        """Terms, friction and openings of the effects, each with its place in the parameters."""
        merged = {**self.declared, **values}
        angle = merged.get("axis_misalignment", {}).get("angle", 0.0)
        out = _Assembled([self._base.address["base"]], ["gravity"], [0], [angle])
        known = {c.name: c for c in candidates}
        for name, numbers in merged.items():
            effect = known.get(name)
            if effect is None or effect.acts not in (FORCE, DRAG, DRY, WALL, OPENING):
                continue
            address = term_functions(effect).address
            if effect.acts == OPENING:
                out.openings += [(address["angle"], address["loss"], len(out.p))] * len(effect.pattern)
                out.opening_offsets += effect.pattern
            elif effect.acts in (DRY, WALL):
                out.holds.append((address["hold"], len(out.p)))
            else:
                out.terms.append(address["term"])
                out.names.append(name)
                out.place.append(len(out.p))
            out.p += effect.numbers(numbers)
        return out

    def moves(self, candidates: Sequence[Effect], values: Values, steps: Sequence[tuple[str, str, float]]) -> Moves:
        """Changes when each parameter (effect, name, step) moves by its step."""
        known = {c.name: c for c in candidates}
        parts = self._parts(values)
        delay, names = parts[0], self._assembled(candidates, values).names
        spans = [_span(known[effect], names) for effect, *_ in steps]
        outside = [known[effect].acts == GRAVITY or effect in MOTION for effect, *_ in steps]
        w = np.empty((1 + sum(outside), len(self.t), 2, self._width))
        self._filled(self._motion(delay)[1], parts, w[0])
        p, which = [], []
        for (effect, name, step), out in zip(steps, outside, strict=True):
            moved = changed(values, effect, name, values[effect][name] + step)
            p.append(self._assembled(candidates, moved).p)
            which.append(1 + sum(outside[: len(which)]) if out else -1)
            if not out:
                continue
            there, motions = self._parts(moved), self._motion(delay)[1]
            if effect == "sensor_delay":  # the derivatives by the stage hardly depend on the delay
                motions = motions.copy()
                motions[0] += self._motion(there[0])[1][0] - motions[0]
            self._filled(motions, there, w[which[-1]])
        return Moves(
            np.array(p).reshape(len(steps), -1), w, np.array(which, dtype=np.int64),
            np.array([step for *_, step in steps]), np.array(spans, dtype=np.int64).reshape(-1, 2),
        )  # fmt: skip

    def _offset(self, values: Values) -> tuple[float, float]:
        """The camera's offset from the centre of the ring, m."""
        found = {**self.declared, **values}.get("camera_offset", {})
        return found.get("x", 0.0), found.get("y", 0.0)

    def position(self, values: Values) -> Array:
        """Angles (N,) about the true centre."""
        return true_angle(self.theta, self.radius, self._offset(values))

    def seen_at(self, values: Values, angle: Array) -> Array:
        """Angles that the camera sees, from angles about the true centre; any shape."""
        return seen_angle(angle, self.radius, self._offset(values))

    def volume(self, values: Values, rows: np.ndarray) -> float:
        """-2 log of the determinant of the change of variables from measured angles to `position`, of some rows."""
        return -2.0 * float(np.sum(np.log(true_angle_slope(self.theta, self.radius, self._offset(values))[rows])))


def _span(effect: Effect, names: Sequence[str]) -> tuple[int, int]:
    """First of the terms (effects `names`) that a parameter of an effect changes, and the one behind the last."""
    if effect.acts == GRAVITY or effect.name == "axis_misalignment":  # these act through the first term alone
        return 0, 1
    if effect.name in MOTION:
        return 0, len(names)
    return (names.index(effect.name, 1), names.index(effect.name, 1) + 1) if effect.name in names[1:] else (0, 0)
