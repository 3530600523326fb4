"""A change of the stage that no tilt sensor shows: play behind the sensor, or any play or limited rate without one.

Such a plate moves later than the commands through the known stage say, which looks like a later camera. So where the
camera seems later, the changed stage moves the plate instead, with the camera as it was. The record decides: the change
of the stage has to be likelier than the later camera by `NEEDED`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import minimize_scalar

from mazeplan.control.estimation.rigid_body_filter import BodyFilter
from mazeplan.control.estimation.rigid_body_fit import fit_body
from mazeplan.control.estimation.rigid_body_parameters import value_of
from mazeplan.diagnosis.effect_entry import Entry, effect_entry
from mazeplan.diagnosis.rig.fitting import ENOUGH, NOISE, STEPS, Reference, without_finding
from mazeplan.diagnosis.rig.search import NEEDED, STDERR_SCALE, SearchResult
from mazeplan.diagnosis.stage.comparison import AXES
from mazeplan.physics.effect import Effect
from mazeplan.physics.effects import rig
from mazeplan.physics.rig.stage import StageModel

LATER = "sensor_delay"
PLAY = (rig.backlash, (math.radians(0.05), math.radians(2.0)))  # its smallest and largest size that is tried, rad
RATE = (rig.rate_limit, (0.05, 2.0))  # rad/s
TRIED = 9  # sizes on a grid
CURVED = 0.2  # relative change of a size that shows the curvature of the rough likelihood


@dataclass(frozen=True)
class UnseenChange:
    """A changed stage: both axes, the filter on it, and its effect as an entry of the document."""

    moves: StageModel
    body: BodyFilter
    entry: Entry


def unseen_change(
    searched: SearchResult, was: Reference, moves: StageModel, filter_on: Callable[[StageModel], BodyFilter],
    measured: bool,
) -> UnseenChange | None:  # fmt: skip
    """The change of the stage that explains a record better than a later camera, or None.

    moves: the stage that moves the plate
    filter_on: makes the filter of the same record with another stage
    measured: whether the tilt is measured, so that only play behind the sensor stays unseen"""
    later = next((c for c in searched.found if c.effect == LATER), None)
    if later is None or searched.fit.value("delay") <= value_of(was.model, "delay"):
        return None
    model = without_finding(searched.fit.model, was, later)
    beside = tuple(name for c in searched.found if c is not later for name in c.fitted)
    best: tuple[float, UnseenChange] | None = None
    for effect, within in (PLAY,) if measured else (PLAY, RATE):

        def minus2(sizes: list[float], effect: Effect = effect) -> float:
            return filter_on(_changed(moves, effect, sizes)).innovations(model).minus2

        sizes, stderr = _likeliest(minus2, within)
        there = _changed(moves, effect, sizes)
        on_it = filter_on(there)
        gained = searched.fit.minus2 - fit_body(on_it, model, (*NOISE, *beside), STEPS, ENOUGH).minus2
        if gained > max(NEEDED, best[0] if best else 0.0):
            error = {axis: STDERR_SCALE * was.misfit * s for axis, s in zip(AXES, stderr, strict=True)}
            entry = effect_entry(effect, _values(there, effect), error, _values(moves, effect))
            best = gained, UnseenChange(there, on_it, entry)
    return None if best is None else best[1]


def _changed(moves: StageModel, effect: Effect, sizes: list[float]) -> StageModel:
    """The stage with more play behind it, or with limited rates."""
    axes = (moves.beta, moves.gamma)
    if effect is rig.backlash:
        return StageModel(*(
            replace(axis, backlash=axis.backlash + more, behind=True) for axis, more in zip(axes, sizes, strict=True)
        ))  # fmt: skip
    return StageModel(*(
        replace(axis, rate_limit=min(limit, axis.rate_limit)) for axis, limit in zip(axes, sizes, strict=True)
    ))  # fmt: skip


def _values(stage: StageModel, effect: Effect) -> dict[str, float]:
    return {
        axis: min(float(getattr(getattr(stage, axis), effect.name)), p.high) for axis, p in effect.parameters.items()
    }


def _likeliest(minus2: Callable[[list[float]], float], within: tuple[float, float]) -> tuple[list[float], list[float]]:
    """Sizes of both axes at which a record is likeliest, and their standard errors by the curvature there.

    Both axes are alike on a grid; then each is refined by itself."""
    grid = np.geomspace(*within, TRIED)
    best = int(np.argmin([minus2([size, size]) for size in grid]))
    sizes = [float(grid[best])] * 2
    around = float(grid[1] / grid[0])
    for axis in (0, 1, 0, 1):

        def along(log: float, axis: int = axis) -> float:
            return minus2([math.exp(log) if i == axis else size for i, size in enumerate(sizes)])

        at = math.log(sizes[axis])
        found = minimize_scalar(
            along, bounds=(at - math.log(around), at + math.log(around)), method="bounded", options={"maxiter": 8}
        )
        sizes[axis] = math.exp(float(found.x))
    least, stderr = minus2(sizes), []
    for axis in (0, 1):
        rises = [
            minus2([size * (1.0 + sign * CURVED * (i == axis)) for i, size in enumerate(sizes)]) - least
            for sign in (1.0, -1.0)
        ]
        stderr.append(CURVED * sizes[axis] * math.sqrt(2.0 / max(sum(rises), 1e-9)))
    return sizes, stderr
