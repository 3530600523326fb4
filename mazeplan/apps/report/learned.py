"""Judges a model folder on other logs: the scores of `compare`, for the model and for the bare equation.

Samples are made as `compare` makes them by default: rates and accelerations are smoothed (Savitzky-Golay, window 9),
and the tilt is taken earlier by the camera's delay. A filter with the model estimates the state at the start of a
roll-out.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np

from mazeplan.apps.report import words
from mazeplan.apps.report.documents import ComparedRing, Comparison
from mazeplan.apps.report.page import PageTable
from mazeplan.core.errors import InputError
from mazeplan.core.logs.table import Table
from mazeplan.core.records import Array
from mazeplan.learning.features import inputs
from mazeplan.learning.modelfile import RigModel, model_document
from mazeplan.learning.rig_gp import planned
from mazeplan.learning.ring_scores import residual_map
from mazeplan.learning.rollout import (
    CHECKED,
    PAST,
    Rollout,
    Windows,
    angle_noise,
    causal_start,
    choose_windows,
    roll_out,
)
from mazeplan.learning.samples import RingSamples, SampleOptions, joined, ring_samples
from mazeplan.learning.smoothing import Smoothing
from mazeplan.maze.geometry import Maze
from mazeplan.physics.ball_model import BallModel
from mazeplan.physics.effects.ball import rolling_inertia
from mazeplan.physics.formulas.arrays import RingKinematics, kinematic_terms

MISFIT = 0.5  # misfit that the filter at the start of a roll-out expects of any model, as a share of theta_dd's spread
FEWEST = 50  # minimum number of samples of a ring
Predict = Callable[[RingKinematics], Array]


def predictors(model: RigModel, ring: int) -> dict[str, Predict]:
    """Functions for theta_dd: by the model, as planner and estimator use it, and by the bare equation (p)."""
    ball, process = model.ball(ring), model.processes.get(ring)

    def learned(k: RingKinematics) -> Array:
        if process is None:
            return ball.acceleration(k)
        base = planned(ball, k) if model.by_effects(ring) else kinematic_terms(k)
        return base + process.mean(inputs(k))

    return {"p": BallModel((rolling_inertia(1.0),)).acceleration, "model": learned}


def judged(model: RigModel, tables: Sequence[Table], maze: Maze) -> Comparison:
    """Scores of each ring. Raises InputError if no ring has enough samples."""
    return {ring: _ring(model, ring, samples, maze) for ring, samples in samples_of(model, tables, maze).items()}


def samples_of(model: RigModel, tables: Sequence[Table], maze: Maze) -> dict[int, RingSamples]:
    """Samples of each ring that has enough of them. Raises InputError if no ring has enough."""
    found: dict[int, list[RingSamples]] = {}
    for table in tables:
        options = SampleOptions(delay=model.camera_delay, rates="smoothed")
        for ring, part in ring_samples(table, maze, Smoothing(window=9), options).items():
            found.setdefault(ring, []).append(part)
    together = {ring: joined(parts) for ring, parts in sorted(found.items())}
    enough = {ring: samples for ring, samples in together.items() if int(samples.good.sum()) >= FEWEST}
    if not enough:
        most = max((int(samples.good.sum()) for samples in together.values()), default=0)
        problem = f"got at most {most} usable samples in a ring, expected {FEWEST}: record for longer"
        raise InputError(f"the logs that the model is to be judged on: {problem}")
    return enough


def windows_of(samples: RingSamples, ring: int, maze: Maze) -> Windows:
    """The windows of the roll-outs in a ring."""
    openings = np.array([opening.angle for opening in maze.openings_of(ring)])
    # the filter that finds the start of a roll-out looks back PAST samples, all of which must be good
    bad = np.concatenate([[0], np.cumsum(~samples.good)])
    row = np.arange(len(samples))
    whole = (bad[row + 1] == bad[np.maximum(row - PAST, 0)]) & (row >= PAST)
    return choose_windows(samples, whole, openings)


def _ring(model: RigModel, ring: int, samples: RingSamples, maze: Maze) -> ComparedRing:
    rows = np.flatnonzero(samples.good)
    k, truth = samples.at(rows), samples.theta_ddot[rows]
    ways, windows = predictors(model, ring), windows_of(samples, ring, maze)
    left = {kind: truth - way(k) for kind, way in ways.items()}
    spread = max(float(np.std(truth)), 1e-300)
    rollout, bands = {}, {}
    for kind, way in ways.items() if len(windows) else ():
        done = rolled(way, samples, windows)
        rollout[kind] = {str(n): done.after(n) for n in CHECKED}
        bands[kind] = done.bands()
    return ComparedRing.model_validate({
        "n_train": 0, "n_test": len(rows), "rates": "smoothed", "delay_s": round(model.camera_delay, 4),
        "windows": len(windows), "windows_chosen": windows.chosen, "nrmse_train": {},
        "nrmse_test": {kind: float(np.sqrt(np.mean(e**2)) / spread) for kind, e in left.items()},
        "rollout": rollout, "bands": bands, "residual": residual_map(k.theta, k.theta_dot, left).document(),
    })  # fmt: skip


def rolled(way: Predict, samples: RingSamples, windows: Windows) -> Rollout:
    """Roll-outs of a model. A filter with the model estimates their start from earlier samples."""
    misfit = MISFIT * max(float(np.std(samples.theta_ddot[samples.good])), 1e-300)
    theta, rate, _ = causal_start(way, samples, windows.start, angle_noise(samples), misfit)
    return roll_out(way, samples, windows.start, theta, rate)


def effects_table(model: RigModel) -> PageTable:
    """A table of the effects of each ring in the model's file."""
    rings = model_document(model)["rings"]
    names = list(dict.fromkeys((effect, p) for found in rings.values() for effect, ps in found.items() for p in ps))
    rows = []
    for effect, parameter in names:
        entries = [found.get(effect, {}).get(parameter) for found in rings.values()]
        unit = next(entry["unit"] for entry in entries if entry)
        shown = words.in_unit(0.0, unit)[1]
        label = f"{words.spoken(effect)}: {words.parameter(effect, parameter)}" + (f", {shown}" if shown else "")
        cells = [words.MISSING if e is None else _entry(e, shown) for e in entries]
        rows.append([label, *cells, f"{effect}.{parameter}"])
    head = ("", *(f"ring {ring}" for ring in rings), "name")
    return PageTable("Effects, value ± standard error", head, rows, code=frozenset({len(head) - 1}))


def _entry(entry: dict[str, Any], unit: str) -> str:
    """Value and standard error without the unit, which is in the first cell of the row."""
    return words.measured(entry["value"], entry.get("stderr"), entry["unit"]).removesuffix(f"{words.HARD}{unit}")


def learned_from(model: RigModel, logs: Sequence[Path]) -> list[str]:
    """Names of those logs from which the model was learned.

    Compares by content (SHA-256) if the model's file has it, else by name."""
    data = [entry for entry in model.data if isinstance(entry, dict)]
    prints = {str(entry["sha256"]) for entry in data if entry.get("sha256")}
    names = {Path(str(entry["file"])).name for entry in data if entry.get("file") and not entry.get("sha256")}
    return [log.name for log in logs if log.name in names or sha256(log.read_bytes()).hexdigest() in prints]


def model_facts(model: RigModel, folder: Path) -> list[tuple[str, str]]:
    """(label, value) of the model: name, kind, delay of the camera, and logs."""
    facts = [
        ("model", folder.name),
        ("kind", words.kind(model.kind)),
        ("camera late by", f"{1e3 * model.camera_delay:.1f} ms"),
    ]
    files = [str(entry["file"]) for entry in model.data if isinstance(entry, dict) and entry.get("file")]
    return [*facts, *([("learned from", ", ".join(files))] if files else [])]
