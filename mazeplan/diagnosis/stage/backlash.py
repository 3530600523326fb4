"""Play between servo and plate, and a dead band of the servo, seen in commands and measured tilt.

    play:       passed on_k = clip(passed on_(k-1), u_k - b/2, u_k + b/2)
    dead band:  obeyed_k = u_k where |u_k - obeyed_(k-1)| >= d, else obeyed_(k-1)

`fit_axis` finds play. Here the axis is also fitted to the obeyed command, with the d that fits best. The better one of
these two fits is kept.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from mazeplan.core.records import Array
from mazeplan.learning.stage_fit import StageFit, fit_axis
from mazeplan.physics.rig.stage import StageAxis
from mazeplan.physics.rig.stage_simulation import apply_deadband, simulate_axis

MOST = 0.08  # rad, maximum dead band
ENOUGH = 2400  # samples for the search
SMALLEST_BAND, BANDS = 1e-3, 24  # rad, smallest dead band to report; number of coarse dead bands that are tried
STRIDE = (MOST / SMALLEST_BAND) ** (1.0 / (BANDS - 1))
LOOKED_AT = 4  # coarse dead bands that are refined
MUCH_LESS = 0.4  # share of the rms of a dead band before its axis is fitted; gears that are the cause leave 0.1 to 0.25
SURE = 15.0  # of -2 log L
SECOND_ORDER = StageAxis()


def fit_with_play_or_deadband(
    u: Array, angle: Array, dt: float, begins: np.ndarray, rows: np.ndarray, kind: StageAxis = SECOND_ORDER
) -> StageFit:
    """The axis with the play or the dead band that its record shows, if any. Raises ValueError as `fit_axis`.

    u, angle: commands and measured angles (N,), rad
    dt: time between samples, s
    begins: True (N,) where a stretch begins
    rows: rows (N,) to fit
    kind: an axis of the same order, with a limited rate if that is fitted in any case"""
    found = fit_axis(u[rows], angle[rows], dt, begins[rows].astype(float), kind=kind)
    plain = found if not found.axis.backlash else fit_axis(
        u[rows], angle[rows], dt, begins[rows].astype(float), replace(found.axis, backlash=0.0)
    )  # fmt: skip
    with_band = _fit_with_band(u, angle, dt, begins, rows, plain, found.rms)
    return with_band if with_band is not None and with_band.rms < found.rms else found


def _fit_with_band(
    u: Array, angle: Array, dt: float, begins: np.ndarray, rows: np.ndarray, plain: StageFit, other: float
) -> StageFit | None:
    """The axis with a dead band, None if the record shows none, or if another fit leaves much less (other, rad).

    The obeyed command jumps when the band changes, so the search uses a grid of bands."""
    breaks = begins[rows].astype(float)

    def off(axis: StageAxis, band: float) -> float:
        return float(np.std((angle - simulate_axis(axis, apply_deadband(u, band), dt))[rows]))

    bands: list[float] = np.geomspace(SMALLEST_BAND, MOST, BANDS).tolist()
    level = off(plain.axis, 0.0)
    least = min(off(plain.axis, band) for band in bands)
    if 2.0 * plain.samples * math.log(level / least) < SURE or other < MUCH_LESS * least:
        return None
    few = rows & (np.cumsum(rows) <= ENOUGH)  # refit the axis: without the band, its lag stands in for the band

    def refitted(band: float) -> StageFit:
        return fit_axis(apply_deadband(u, band)[few], angle[few], dt, begins[few].astype(float), plain.axis)

    def refined(coarse: float) -> tuple[StageFit, float, float]:
        """The axis with the best band near a coarse band, this best band, and the step of the grid."""
        axis = fit_axis(apply_deadband(u, coarse)[rows], angle[rows], dt, breaks, near[coarse].axis).axis
        fine: list[float] = np.linspace(coarse / STRIDE, coarse * STRIDE, 2 * BANDS).tolist()
        band = min(fine, key=lambda b: off(axis, b))
        return fit_axis(apply_deadband(u, band)[rows], angle[rows], dt, breaks, axis), band, fine[1] - fine[0]

    # with a band near the true one, the servo obeys at other moments: the best coarse band may be far from the true one
    near = {band: refitted(band) for band in bands if band < 0.5 * float(np.ptp(u))}
    coarse = sorted(near, key=lambda band: near[band].rms)[:LOOKED_AT]
    found, band, width = min((refined(band) for band in coarse), key=lambda one: one[0].rms)
    if 2.0 * plain.samples * math.log(plain.rms / found.rms) < SURE:
        return None
    stderr = {**found.axis.stderr, "deadband": width}
    return replace(found, axis=replace(found.axis, deadband=band, stderr=stderr))
