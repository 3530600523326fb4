"""A ball in one ring as a system to diagnose: from a table to what the filter runs on, for any set of effects."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter

from mazeplan.diagnosis import terms
from mazeplan.diagnosis.anonymous import PAST
from mazeplan.diagnosis.kalman import NODES, TERM, Problem
from mazeplan.diagnosis.geometry import as_seen, bending, unbent
from mazeplan.diagnosis.library import CAMERA, DELAY, DRY, GATE, RING, STAGE, WALL, Candidate
from mazeplan.maths.compiled import address_of
from mazeplan.records import Array

GRAVITY = 9.81  # m/s^2
CACHED = 12  # motions of the plate kept
RING_SLOTS = {
    ("rolling_inertia", "factor"): 1, ("tilt_offset", "beta"): 2, ("tilt_offset", "gamma"): 3,
    ("axis_misalignment", "angle"): 4, ("tilt_gain", "beta"): 5, ("tilt_gain", "gamma"): 6,
}  # fmt: skip

Values = dict[str, dict[str, float]]  # effect -> parameter -> value


@dataclass(frozen=True)
class Tilt:
    """Motion of the plate on a fine grid: t (M,), angles, rates, accelerations (M, 6) as beta, its rate and
    acceleration, gamma's; where it comes from, in words."""

    t: Array
    motion: Array
    source: str

    def at(self, times: Array) -> Array:
        """Motion (K, 6) at any times, by cubic Hermite interpolation; held beyond the ends."""
        h = float(self.t[1] - self.t[0])
        at = np.clip((times - self.t[0]) / h, 0.0, len(self.t) - 1.000001)
        i = at.astype(np.int64)
        s = (at - i)[:, None]
        out = np.empty((len(times), 6))
        for axis in (0, 3):
            a, b = self.motion[i, axis : axis + 3], self.motion[i + 1, axis : axis + 3]
            for order in (0, 1):  # value and slope from the next column
                y0, y1, m0, m1 = a[:, order], b[:, order], h * a[:, order + 1], h * b[:, order + 1]
                u = s[:, 0]
                out[:, axis + order] = (
                    (1 + 2 * u) * (1 - u) ** 2 * y0 + u * (1 - u) ** 2 * m0 + u * u * (3 - 2 * u) * y1
                    + u * u * (u - 1) * m1
                )  # fmt: skip
            out[:, axis + 2] = a[:, 2] + s[:, 0] * (b[:, 2] - a[:, 2])
        return out


class RingSystem:
    """Problems for `kalman`, made from a record and the values of effects."""

    def __init__(
        self,
        t: Array,
        theta: Array,
        first: np.ndarray,
        radius: float,
        tilt: Tilt,
        declared: Values,
        restage: Callable[[dict[str, float]], Tilt] | None = None,
    ) -> None:
        """t, theta (N,): s, rad, unwrapped in each stretch, NaN where not seen; first (N,): a stretch begins; declared:
        what the model has already; restage: the tilt for relative errors of the stage's parameters."""
        self.t, self.theta, self.first, self.radius, self.tilt = t, theta, first, radius, tilt
        self.declared, self._restage = declared, restage
        self.target: Array | None = None
        self.dt = float(np.median(np.diff(t)))
        self._past = self._low_passed()
        self._nodes: dict[tuple[float, ...], Array] = {}
        self._addresses: dict[int, int] = {}

    def __len__(self) -> int:
        return len(self.t)

    def _low_passed(self) -> Array:
        """Speeds of the past (N, NODES, 3) as measured, low-passed with the time constants PAST."""
        out = np.zeros((len(self.t), NODES, len(PAST)))
        steps = np.diff(self.theta, prepend=self.theta[:1]) / self.dt
        steps = np.where(self.first | ~np.isfinite(steps), 0.0, steps)
        for i, tau in enumerate(PAST):
            keep = math.exp(-self.dt / tau)
            out[:, :, i] = np.asarray(lfilter([1.0 - keep], [1.0, -keep], steps))[:, None]
        return out

    def nodes(self, delay: float, stage: dict[str, float] | None = None) -> Array:
        """Motion of the plate (N, NODES, 6) from each sample on, `delay` s earlier, and behind it the low-passed
        speeds; stage: relative errors of its parameters."""
        key = (round(delay, 9), *(round(value, 12) for value in (stage or {}).values()))
        if key not in self._nodes:
            if len(self._nodes) > CACHED:
                del self._nodes[next(iter(self._nodes))]
            tilt = self.tilt if not stage or self._restage is None else self._restage(stage)
            grid = self.t[:, None] + self.dt * np.arange(NODES) / (NODES - 1) - delay
            motion = tilt.at(grid.ravel()).reshape(len(self.t), NODES, 6)
            self._nodes[key] = np.ascontiguousarray(np.concatenate([motion, self._past], axis=2))
        return self._nodes[key]

    def build(self, candidates: Sequence[Candidate], values: Values) -> tuple[Problem, Array]:
        """The problem with these effects at these values (of those left out: as declared), and its parameters."""
        p: list[float] = [GRAVITY / self.radius, 1.0, 0.0, 0.0, 0.0, 1.0, 1.0]
        places, functions, gates, gate_at = [(0, 7)], [terms.ring], [], []
        dry, wall, delay, stage = -1, -1, 0.0, None
        merged = {**self.declared, **values}
        for (effect, name), slot in RING_SLOTS.items():
            if effect in merged:
                p[slot] = merged[effect][name]
        known = {c.name: c for c in candidates}
        for effect, numbers in merged.items():
            c = known.get(effect)
            if c is None or c.acts in (RING, CAMERA):
                continue
            if c.acts == DELAY:
                delay = numbers["delay"]
                continue
            if c.acts == STAGE:
                stage = numbers
                continue
            at = len(p)
            p.extend(numbers[name] for name in c.parameters)
            if c.acts == DRY:
                dry = at
            elif c.acts == WALL:
                wall = at
            elif c.acts == GATE:
                gates += [(at, at + 1)] * len(c.pattern)
                gate_at += [(angle, c.side) for angle in c.pattern]
            else:
                places.append((at, len(p)))
                functions.append(c.term)
        problem = Problem(
            self.position(values), np.isfinite(self.theta), self.first, self.t, self.dt, self.nodes(delay, stage),
            np.array([self._address(f) for f in functions], dtype=np.int64), np.array(places, dtype=np.int64), dry,
            np.array(gates, dtype=np.int64).reshape(-1, 2), 2.0 * math.pi,
            np.array(gate_at, dtype=np.float64).reshape(-1, 2), wall, p[0],
        )  # fmt: skip
        return problem, np.array(p)

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

    def volume(self, values: Values, rows: np.ndarray) -> float:
        """-2 log of the determinant of the change from measured angles to `position`, of some rows: what turns a
        density of the one into that of the other."""
        offset = self.offset(values)
        return 0.0 if offset is None else -2.0 * float(np.sum(np.log(bending(self.theta[rows], self.radius, offset))))

    def _address(self, function: object) -> int:
        if id(function) not in self._addresses:
            self._addresses[id(function)] = address_of(function, TERM)
        return self._addresses[id(function)]
