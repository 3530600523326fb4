"""How well the model of a drive axis does on what took no part: in force, and running free.

Force error, ||e|| / ||y||, as inverse dynamic identification by least squares does it (IDIM-LS; Gautier, "Dynamic
identification of robots with power model", ICRA 1997; Janot, Vandanjon, Gautier, IEEE Trans. Control Systems
Technology 22(1), 2014): the position goes through a Butterworth filter of order 4 forwards and backwards (CUTOFF) and
is differentiated by central differences, so that neither shifts it in time; y is the measured force, e what the model
needs beyond it for the acceleration seen. Both are decimated to PARALLEL with a zero-phase low-pass filter, and EDGE at
either end, where the filters ring, is left out.

Free run: the model is driven by the measured force from one filtered state on and sees no position again; root mean
square error of its position. The axis has no spring, so that the error of the force adds up: this is the harder test,
and a model that is better in force may be worse here. A run in closed loop would say less: the controller pulls any
model back to the reference.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from scipy.signal import decimate

from mazeplan.data.drivelog import DriveLog
from mazeplan.diagnosis.axislibrary import Scale
from mazeplan.diagnosis.axissystem import AxisSystem, low_passed
from mazeplan.diagnosis.fit import Fit, Likelihood
from mazeplan.diagnosis.kalman import NODES, accelerations, roll_out
from mazeplan.records import Array

CUTOFF = 100.0  # Hz, of the position before it is differentiated
PARALLEL = 100.0  # Hz, at which forces are compared
EDGE = 0.1  # s
BEGUN = 0.1  # s, after which the filter knows the state


@dataclass(frozen=True)
class AxisScore:
    """nrmse: relative force error; free_run: m, root mean square error of the position; seconds of either."""

    nrmse: float
    free_run: float
    seconds: float
    floor: float = math.nan
    labels: ClassVar[dict[str, str]] = {
        "nrmse": "relative force error ||e|| / ||y||",
        "free_run": "position error of the free run, m rms",
    }
    drawn: ClassVar[str] = "nrmse"
    axes: ClassVar[tuple[str, str]] = ("position, m", "speed, m/s")

    def document(self) -> dict[str, Any]:
        """Plain and rounded."""
        values = {name: getattr(self, name) for name in self.labels}
        return {name: round(value, 6) if math.isfinite(value) else None for name, value in values.items()}


def axis_score(log: DriveLog, likelihood: Likelihood, fitted: Fit, begin: float) -> AxisScore:
    """Scores from the time `begin` (s) to the end of a record."""
    force = force_error(log, likelihood, fitted, begin)
    return AxisScore(force, free_run(likelihood, fitted, begin), log.dt * len(log) - begin)


def force_error(log: DriveLog, likelihood: Likelihood, fitted: Fit, begin: float) -> float:
    """||e|| / ||y|| from a time on."""
    rate = 1.0 / log.dt
    position = low_passed(log.position, min(CUTOFF, 0.4 * rate), rate)
    v = np.gradient(position, log.dt)
    a = np.gradient(v, log.dt)
    nodes = np.repeat(log.force[:, None], NODES, axis=1)
    fine = AxisSystem(log.dt, position, nodes, likelihood.system.declared, Scale())
    problem, p = fine.build(likelihood.library, fitted.values)
    model = np.empty(len(log))
    accelerations(problem, p, position, v, model)
    every = max(1, round(rate / PARALLEL))
    e, y = (_parallel((a - model) / p[0], every), _parallel(log.force, every))  # p0: over the mass
    t = log.dt * every * np.arange(len(y))
    keep = (t >= begin + EDGE) & (t <= t[-1] - EDGE)
    size = float(np.linalg.norm(y[keep]))
    return float(np.linalg.norm(e[keep])) / size if size > 0.0 else math.nan


def _parallel(signal: Array, every: int) -> Array:
    return signal if every == 1 else np.asarray(decimate(signal, every, ftype="iir", zero_phase=True))


def free_run(likelihood: Likelihood, fitted: Fit, begin: float) -> float:
    """Root mean square error of the position (m) from a time on."""
    system = likelihood.system
    states = likelihood.filtered(fitted.values, fitted.q)
    start = max(int(np.ceil(begin / system.dt)), round(BEGUN / system.dt))
    steps = len(system) - 1 - start
    if steps < 1:
        return math.nan
    problem, p = system.build(likelihood.library, fitted.values)
    out = np.empty((1, steps + 2))
    roll_out(problem, p, states, np.array([start]), steps, out)
    return float(np.sqrt(np.mean((out[0, 1:-1] - system.theta[start + 1 :]) ** 2)))
