"""The ball in one ring as a system: a bead on a circle of a plate that tilts.

    theta_dd = gravity and rotation of the plate along the ring + sum of effects

The motion of the plate drives it. Effects of gravity, of the tilt sensor and of the delay of the camera change this
motion. The camera's offset changes the angle at which the ball is seen: with the offset (x_0, y_0) and the track radius
R, it sees a ball at the angle phi at the angle of (x_0 + R cos(phi), y_0 + R sin(phi)).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numba import njit
from scipy.signal import lfilter

from mazeplan.core.maths.compiled import pointer_to
from mazeplan.core.records import Array
from mazeplan.diagnosis.effect_entry import Values
from mazeplan.diagnosis.engine.record import Record
from mazeplan.diagnosis.engine.system import System, Term
from mazeplan.diagnosis.record import RingRecord
from mazeplan.diagnosis.stage.plate_motion import Tilt
from mazeplan.physics.effect import BALL, DRY, GRAVITY, OPENING, WALL, Effect, Parameter
from mazeplan.physics.effects.nameless import NAMELESS, PAST, oscillation
from mazeplan.physics.effects.openings import WALLS
from mazeplan.physics.effects.rig import axis_misalignment
from mazeplan.physics.formulas.arrays import BALL_RADIUS
from mazeplan.physics.formulas.compiled import base_functions, call_plate, term_functions
from mazeplan.physics.formulas.symbols import INPUTS, PLATE
from mazeplan.physics.registry import EFFECTS, PACKAGED

GAP = 6  # samples; a ball that was not seen for longer may have turned any number of times
NODES = 3  # moments of a step at which the plate's motion is known
KEPT = 40  # cached inputs
# rows of the windows: errors grow with time, as those of a pendulum; on a rig without commands, blows come often
LONG, SHORT = (24, 54, 120), (8, 12)
WEAKEST = 0.1  # rad/s^2; smallest amplitude of a force that swings in time
STAGE = "stage"  # errors of the fitted stage, in standard errors along its directions
COUNT = len(INPUTS)  # number of inputs; the coefficients of the plate follow them
# effects of the rig that the ball shows; `stage.comparison` compares stage and tilt sensor with the model
BY_THE_BALL = ("tilt_gain", "axis_misalignment", "camera_offset", "sensor_delay")
# named by other means: a draught looks like a table that is not level, unless somebody turns the maze; a rocking table
# shows as a force that swings with time, as sin and cos of theta; an unbalanced ball loses its phase with every slip
NOT_SEARCHED = ("constant_force", "table_rocking", "ball_imbalance", "local_friction", *(e.name for e in WALLS))


def ring_library() -> list[Effect]:
    """All packaged effects that a diagnosis can name on a ring without a map."""
    known = PACKAGED.items()
    return [e for name, e in known if name not in NOT_SEARCHED and (e.acts in BALL or name in BY_THE_BALL)]


def ring_record(record: RingRecord, rows: np.ndarray | None = None) -> Record:
    """The record for the engine. rows: True (N,) where the ball counts; None: everywhere"""
    seen = np.isfinite(record.theta) if rows is None else rows & np.isfinite(record.theta)
    last = np.maximum.accumulate(np.where(np.isfinite(record.theta), np.arange(len(record)), -1))
    lost = np.append(False, np.isfinite(record.theta[1:]) & (np.arange(1, len(record)) - last[:-1] > GAP))
    y = np.where(seen, record.theta, np.nan)[:, None]
    breaks = np.flatnonzero(record.begins | lost)
    return Record(record.t, y, np.empty((len(record), 0)), breaks=breaks)


@njit(cache=True, error_model="numpy")
def _fill(motion, beside, gains, p, t, radii, plate, out):
    """Fill the inputs out (N, NODES, W) of the terms: the plate's motion (N, NODES, 6), what is beside it (N, R), and
    the coefficients of gravity."""
    width = out.shape[2]
    for k in range(out.shape[0]):
        for i in range(out.shape[1]):
            at = (k * out.shape[1] + i) * width
            for c in range(6):
                out[k, i, c] = motion[k, i, c] / gains[c // 3]
            out[k, i, 6], out[k, i, 7] = radii[0], radii[1]
            for c in range(beside.shape[1]):
                out[k, i, 8 + c] = beside[k, c]
            call_plate(plate, (t[k, i], pointer_to(out, at), pointer_to(p, 0), pointer_to(out, at + COUNT)))


class _Drive:
    """Inputs of the terms of a record, under some values."""

    def __init__(self, record: RingRecord, radius: float, tilt: Tilt, gravity: Sequence[Effect]) -> None:
        assert len(PLATE) == 8, "what is beside the plate begins at 8, see `_fill`"
        self.record, self.tilt, self.gravity = record, tilt, gravity
        self.radii = np.array([radius, BALL_RADIUS])
        self.base = base_functions(gravity)
        self.beside = _low_passed(record)
        self.kept: dict[tuple[float, ...], Array] = {}

    def __call__(self, values: Values) -> Array:
        delay = values.get("sensor_delay", {}).get("delay", 0.0)
        stage, gain = values.get(STAGE, {}), values.get("tilt_gain", {})
        errors = [stage.get(name, 0.0) for name in self.tilt.by_stage]
        p = [0.0, *(number for e in self.gravity for number in e.numbers(values.get(e.name, {})))]
        gains = [gain.get("beta", 1.0), gain.get("gamma", 1.0)]
        key = (delay, *errors, *gains, *p)
        if key not in self.kept:
            if len(self.kept) >= KEPT:
                self.kept.clear()
            self.kept[key] = self._inputs(delay, errors, np.array(gains), np.array(p))
        return self.kept[key]

    def _inputs(self, delay: float, errors: Sequence[float], gains: Array, p: Array) -> Array:
        t = self.record.t[:, None] + self.record.dt * np.arange(NODES) / (NODES - 1) - delay
        motion = self.tilt.at(t.ravel())
        for name, error in zip(self.tilt.by_stage, errors, strict=True):
            if error:
                motion = motion + error * self.tilt.at(t.ravel(), name)
        out = np.empty((*t.shape, COUNT + self.base.counts["coefficients"]))
        motion = motion.reshape(*t.shape, 6)
        _fill(motion, self.beside, gains, p, np.ascontiguousarray(t), self.radii, self.base.address["plate"], out)
        return out


def _low_passed(record: RingRecord) -> Array:
    """Measured speeds (N, 3), low-passed with the time constants PAST."""
    out = np.zeros((len(record), len(PAST)))
    steps = np.diff(record.theta, prepend=record.theta[:1]) / record.dt
    steps = np.where(record.begins | ~np.isfinite(steps), 0.0, steps)
    for i, tau in enumerate(PAST):
        keep = math.exp(-record.dt / tau)
        out[:, i] = np.asarray(lfilter([1.0 - keep], [1.0, -keep], steps))
    return out


def ring_system(
    record: RingRecord, radius: float, tilt: Tilt, candidates: Sequence[Effect], declared: Mapping[str, object]
) -> System:
    """The ball in a ring with these candidates. radius: of the track, m; declared: names of effects that exist"""
    gravity = tuple(e for e in EFFECTS.values() if e.acts == GRAVITY)
    drive = _Drive(record, radius, tilt, gravity)
    one = Parameter("1", 0.0, -10.0, 10.0, step=0.1)
    errors = Effect(STAGE, dict.fromkeys(tilt.by_stage, one), STAGE, named=False)
    known = {e.name: e for e in (*EFFECTS.values(), *candidates)}
    candidates = [*candidates, *NAMELESS, oscillation(Parameter("rad/s^2", 0.0, -50.0, 50.0, WEAKEST, 1e-3))]
    effects = [*candidates, *(known[name] for name in declared if name not in {c.name for c in candidates}), errors]
    terms = {e.name: _terms(e) for e in effects}
    terms[axis_misalignment.name] = (Term(drive.base.address["base"], 0, False, code=drive.base),)
    effects = [e for e in effects if e.name != axis_misalignment.name]

    def seen(values: Values, states: Array) -> Array:
        offset = values.get("camera_offset")
        if offset is None:
            return states
        x, y, phi = offset["x"], offset["y"], states[:, 0]
        c, s = np.cos(phi), np.sin(phi)
        return np.column_stack([phi + np.arctan2(y * c - x * s, radius + x * c + y * s), states[:, 1:]])

    return System(
        ("theta",), ("rad",), known[axis_misalignment.name], (), (), tuple(effects), "", "", terms, {}, drive, seen,
        disturbed=True, lengths=SHORT if record.u is None else LONG,
    )  # fmt: skip


def _terms(effect: Effect) -> tuple[Term, ...]:
    """Compiled terms of an effect; none for what changes the plate's motion or the picture."""
    if effect.acts == GRAVITY or effect.formula is None:
        return ()
    code = term_functions(effect)
    if effect.acts == OPENING:
        angle, loss = code.address["angle"], code.address["loss"]
        return tuple(Term(angle, 0, False, loss, at, code) for at in effect.pattern)
    held = effect.acts in (DRY, WALL)
    return (Term(code.address["hold" if held else "term"], 0, held, code=code),)


def from_declared(candidate: Effect, declared: Values) -> Effect:
    """The candidate with its declared values in the place of its defaults, so that a change of them is a finding."""
    had = declared.get(candidate.name)
    if had is None:
        return candidate
    parameters = {n: replace(p, default=had.get(n, p.default)) for n, p in candidate.parameters.items()}
    return replace(candidate, parameters=parameters)
