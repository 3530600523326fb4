"""The reference of a rig: numbers of ball, table, camera and stage when its model was right.

They come from records of that time, or from the file that `learn` writes beside a model. A model alone knows less:
camera, table, and roughly the friction. The diagnosis then fits walls and spin to the record without comparing them.

`reference.yaml` beside a model has the numbers, and `of`: a stamp of the rings to which it belongs. `reference.npz`
keeps the record of that time: a record is compared with it under the same model, so that what the model lacks in both
cancels.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, replace
from itertools import product
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np
import yaml

from mazeplan.control.estimation.rigid_body_filter import BodyFilter, BodyModel
from mazeplan.control.estimation.rigid_body_fit import (
    DEFAULT_FREE,
    BodyFit,
    bead_stderr,
    bead_values,
    body_of,
    fit_body,
    value_of,
    with_values,
)
from mazeplan.core.errors import ModelError, one_of
from mazeplan.core.file_kinds import format_problem
from mazeplan.core.logs.table import Table, join
from mazeplan.core.side_by_side import in_processes, side_by_side
from mazeplan.core.whole_file import whole_file
from mazeplan.diagnosis.rig.fitting import (
    ENOUGH,
    HALF_GAIN_SHARE,
    HOLLOW,
    NEEDED,
    NOISE,
    ROUGH,
    SOLID,
    Reference,
    alternate,
)
from mazeplan.diagnosis.rig.imbalance import BALANCED, Imbalance, unbalanced
from mazeplan.diagnosis.rig.record import body_filter, filter_on_stage, first_guess, residual_summary
from mazeplan.diagnosis.rig.scores import errors_by_ring, roll_out_errors, starts_of
from mazeplan.diagnosis.stage.comparison import AXES, Known
from mazeplan.diagnosis.stage.plate_motion import USUAL
from mazeplan.learning.modelfile import PACKAGED, RigModel, entry, is_packaged_model
from mazeplan.learning.rigid_body_entries import ABSENT, LEAST_INERTIA, PARAMETERS, determined, stamp
from mazeplan.learning.stage_fit import fit_axis
from mazeplan.learning.unmeasured_tilt import stage_by_ball, tilt_is_measured, with_tilt_by_commands
from mazeplan.maze.geometry import Maze
from mazeplan.physics.effects.local_forces import FAMILY
from mazeplan.physics.registry import PACKAGED as EFFECTS
from mazeplan.physics.rig.stage import StageAxis, StageModel

NAME, RECORD, FORMAT = "reference.yaml", "reference.npz", 1
KEPT = ("t", "x", "y", "beta", "gamma", "u_beta", "u_gamma", "segment")  # columns of the record
GAINS = ("gain_beta", "gain_gamma", "cross_beta", "cross_gamma")
FITTED = (  # numbers that are fitted for a reference
    *DEFAULT_FREE, *GAINS, "inertia", "viscous", "angle", "scale",
)  # fmt: skip
REST = tuple(name for name in FITTED if name != "inertia")
SCALED = tuple(name for name in FITTED if name not in GAINS)
MOST = 18000  # maximum number of pictures: ten minutes
UNKNOWN = ("wall", "restitution", "hold", "spin", "strike")  # a model of beads does not know these
ROUND = 0.02  # standard error of the inertia of a solid or a hollow ball
SLIDES = 1.2 * LEAST_INERTIA  # inertia of a ball that slides
KINDS = (SLIDES, SOLID, HOLLOW)
DELAYS = tuple(0.004 * i for i in (*range(-10, 0), *range(1, 11)))  # s, changes of the delay that a fit tries
WALLS_AT = tuple(
    {"restitution": e, "hold": hold} for e, hold in product((0.1, 0.2, 0.35, 0.5, 0.7), (0.01, 0.05, 0.12, 0.25))
)
SLIPS = 3e-3  # m/s; with less grip of the floor, the ball slips in all but the slowest impacts
MOST_JUMPS = 20  # maximum number of jumps of a fit to one of these
TEXTBOOK_BALL = "a textbook ball"  # source of a reference without a model
FRICTION = (0.4, 1.4)  # friction over that of a model of beads: between these, friction counts as unchanged


@dataclass(frozen=True)
class RigReference:
    """A rig when its model was right."""

    body: Reference  # the ball
    stage: Known  # stage of the model
    # autocorrelation of the innovations, and their size over the noise (`record.residual_summary`); 0 if unknown
    memory: float = 0.0
    remaining: float = 0.0
    source: str = "the reference"  # where it comes from, in words
    # minimum and maximum of rolling friction by a model of beads, m/s^2; None if `body` knows friction
    friction: tuple[float, float] | None = None
    errors: dict[int, float] = field(default_factory=dict)  # of roll-outs by ring, rad (`scores.errors_by_ring`)
    imbalance: Imbalance = BALANCED  # of the ball
    table: Table | None = None  # record of that time, as a source of `then`; None if it was not kept
    then: BodyFilter | None = None  # this record, ready to be filtered; None if it was not kept


def reference_of(tables: Sequence[Table], maze: Maze, model: RigModel | None) -> RigReference:
    """The reference from records of a time when the model was right. Raises TableError."""
    table = tables[0] if len(tables) == 1 else join(tables)
    if not tilt_is_measured(table):
        moves = stage_by_ball(table, maze) if model is None else model.stage
        table = with_tilt_by_commands(table, moves)
        known = Known.of_model(RigModel(moves, {}, kind="pi"))
        body = filter_on_stage(table, maze, moves)
    else:
        body, stage = body_filter(table, maze, kind_of(table))
        known = Known({}, {})
        if stage is not None:
            known = Known.of_model(RigModel(StageModel(*stage.axes), {}, kind="pi"))
            known = replace(known, times_noise=max(stage.beta.times_noise, stage.gamma.times_noise)).seen_in(table)
    return replace(reference_by_filter(body, known, maze, model), table=table, then=body)


def kind_of(table: Table) -> StageModel:
    """The kind of stage that a record shows."""
    try:
        breaks = np.diff(table.segment, prepend=table.segment[0]) != 0.0
        axes = in_processes(lambda axis: fit_axis(table[f"u_{axis}"], table[axis], table.dt, breaks), AXES)
    except (KeyError, ValueError):  # too short, or without commands
        return USUAL
    return StageModel(*(fit.axis for fit in axes))


def reference_by_filter(
    body: BodyFilter, known: Known, maze: Maze, model: RigModel | None, guess: BodyModel | None = None
) -> RigReference:
    """The reference from pictures that are ready to be filtered, and the stage that moved the plate.

    guess: start of the fit; None: that of the model"""
    factors = [] if model is None else _factors(model)
    inertia = 1.0 / float(np.median(factors)) - 1.0 if factors else SOLID
    fit = fit_reference(body, with_values(guess or first_guess(model, maze), {"inertia": inertia}))
    starts = starts_of(body, fit.filtered, maze)
    found = errors_by_ring(body, fit.filtered, starts, roll_out_errors(body, fit.model, starts), maze)
    errors = {ring: mean for ring, (mean, _) in found.items()}
    return RigReference(
        Reference(fit.model, fit.stderr), known, *residual_summary(body, fit), errors=errors,
        imbalance=unbalanced(body, fit),
    )  # fmt: skip


def fit_reference(body: BodyFilter, guess: BodyModel) -> BodyFit:
    """The likeliest numbers of a reference. The ball has the inertia of a usual kind unless the record contradicts.

    Changes of inertia, of the tilt's scale and of the walls cause nearly the same motion. So a free inertia would
    change the other numbers, too. The ball is of the kind with which the scale of the tilt is nearest to 1."""
    part = alternate(body)
    near = _near(part, guess)
    kind = min(KINDS, key=lambda inertia: abs(math.log((1.0 + inertia) / (1.0 + near.value("inertia")))))
    near = fit_body(part, with_values(near.model, {"inertia": kind}), REST, enough=ENOUGH)  # costs less than on all
    near = _with_free_walls(part, near)
    held = fit_body(body, near.model, REST, enough=ROUGH)
    free = fit_body(part, held.model, FITTED, enough=ROUGH)
    if part.innovations(held.model).minus2 - free.minus2 > HALF_GAIN_SHARE * NEEDED:
        whole = fit_body(body, free.model, FITTED, enough=ROUGH)
        if held.minus2 - whole.minus2 > NEEDED:
            return whole
    wider = math.sqrt(len(part.pictures) / len(body.pictures))  # a standard error of a part of the pictures
    return replace(held, stderr={**held.stderr, "inertia": wider * free.stderr["inertia"]})


def _with_free_walls(part: BodyFilter, fit: BodyFit) -> BodyFit:
    """The fit without a floor on which the ball slips in every impact, if walls that return less explain as much.

    Both are the same for all but the slowest impacts (`rigid_body`), and the second one says what walls do."""
    ball = fit.model.ball
    if ball.hold > SLIPS:
        return fit
    walls = {"restitution": max((ball.restitution - ball.inertia) / (1.0 + ball.inertia), 0.0), "hold": ABSENT["hold"]}
    other = fit_body(part, with_values(fit.model, walls), REST, enough=ENOUGH)
    return other if other.minus2 < fit.minus2 + HALF_GAIN_SHARE * NEEDED else fit


def _near(part: BodyFilter, guess: BodyModel) -> BodyFit:
    """The likeliest numbers if the scale of the tilt is 1. Delay and walls are looked for further away, too.

    Where a plate jumps with its commands, small steps of the delay change nothing. And walls that return little in
    every impact look nearly like walls that return nothing in slow ones."""
    near = fit_body(part, guess, SCALED, enough=ENOUGH)
    for _ in range(MOST_JUMPS):
        later = [{"delay": max(near.value("delay") + d, part.soonest)} for d in DELAYS]
        tried = [with_values(near.model, values) for values in (*later, *WALLS_AT)]
        minus2 = [one.minus2 for one in side_by_side(part.innovations, tried)]
        least = int(np.argmin(minus2))
        if minus2[least] > near.minus2 - ENOUGH:
            break
        near = fit_body(part, tried[least], SCALED, enough=ENOUGH)
    return near


def shortened(table: Table) -> Table:
    """The first stretches of a record, about MOST pictures. More pictures would only take time."""
    if len(table) <= MOST:
        return table
    numbers, counts = np.unique(table.segment, return_counts=True)
    kept = numbers[: max(int(np.searchsorted(np.cumsum(counts), MOST, side="right")), 1)]
    # a segment is long if nobody places the ball again, as in a drive through all rings
    rows = np.isin(table.segment, kept) if len(numbers) > 1 else np.arange(len(table)) < MOST
    return replace(table, columns={name: column[rows] for name, column in table.columns.items()})


def reference_by_model(model: RigModel, maze: Maze) -> RigReference:
    """The reference from a model alone, without records."""
    known, guess = Known.of_model(model), first_guess(model, maze)
    own = body_of(model)
    if own is not None and model.body is not None:
        values = {name: getattr(own.view, name) for name in ("offset_x", "offset_y", "angle", "scale", "bend")}
        camera = {name: getattr(guess.view, name) for name in values}
        body = with_values(own, camera)
        stderr = {**bead_stderr(model, maze), **model.body.stderr}
        return RigReference(Reference(body, stderr), known, source="the model")
    said = bead_values(model, maze, "rolling")
    low, high = (factor * end for factor, end in zip(FRICTION, (min(said), max(said)), strict=True)) if said else (0, 1)
    drag = bead_values(model, maze, "quadratic")
    body = with_values(guess, {"inertia": _inertia(model), "quadratic": sum(drag) / max(len(drag), 1)})
    stderr = {**bead_stderr(model, maze), "inertia": ROUND}
    reference = Reference(body, stderr, ("rolling", *UNKNOWN))
    return RigReference(reference, known, source="the model", friction=(low, high))


def textbook() -> RigReference:
    """A solid ball that rolls without loss on a level table, seen without delay by a camera in the middle."""
    ideal = {"rolling": 0.0, "wall": 0.0, "spin": 0.0, "restitution": 0.0, "delay": 0.0}
    names = (*UNKNOWN, *(name for name in REST if name not in (*UNKNOWN, *NOISE)))
    body = with_values(BodyModel(), ideal)
    reference = Reference(body, {"inertia": ROUND}, names, start=BodyModel())
    return RigReference(reference, Known({}, {}), source=TEXTBOOK_BALL)


def _factors(model: RigModel) -> list[float]:
    """Factors of gravity of the rings in a model of beads, as of balls that roll or slide."""
    factors = (ball.parameter("rolling_inertia", "factor", 0.0) for ball in model.balls.values())
    return [min(factor, 1.0 / (1.0 + SLIDES)) for factor in factors if factor > 0.0]


def _inertia(model: RigModel) -> float:
    """Inertia over m R^2 by the model's factors.

    It is that of a solid ball if some contact with floor and walls explains the factors, otherwise the nearest
    possible one."""
    factors = _factors(model)
    if not factors:
        return SOLID
    low, high = max((1.0 / max(factors) - 1.0) / 2.0, SLIDES), 1.0 / min(factors) - 1.0
    return min(max(SOLID, low), high)


def reference_path(source: str | Path) -> Path:
    """Path of the reference of a model: a folder, its model.yaml, or the name of a packaged model."""
    path = PACKAGED / source if is_packaged_model(source) else Path(source)
    return (path.parent if path.suffix == ".yaml" else path) / NAME


def save_reference(was: RigReference, model: RigModel, folder: str | Path) -> Path:
    """Write the reference beside its model, and return its path. Raises ModelError."""
    body, path = was.body.model, Path(folder) / NAME
    document = {
        "format": FORMAT, "of": stamp(model.balls),
        "body": {name: entry(value_of(body, name), was.body.stderr.get(name), number.unit)
                 for name, number in PARAMETERS.items()
                 if determined(name, value_of(body, name), was.body.stderr.get(name))},
        "terms": {t.name: {k: float(f"{v:.6g}") for k, v in t.values().items()} for t in body.terms if not t.idle},
        "memory": round(was.memory, 4), "remaining": round(was.remaining, 4),
        "errors": {ring: {"value": round(error, 4), "unit": "rad"} for ring, error in was.errors.items()},
    }  # fmt: skip
    if was.imbalance.size > 0.0 and math.isfinite(was.imbalance.stderr):
        document["imbalance"] = entry(was.imbalance.size, was.imbalance.stderr, "m/s^2")
    if was.table is not None:
        document["stage"] = {axis: _axis_entry(getattr(was.stage.kind, axis)) for axis in AXES}
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with whole_file(path) as beside:
            beside.write_text(yaml.safe_dump(document, sort_keys=False, width=120), encoding="utf-8")
        if was.table is not None:
            with whole_file(path.parent / RECORD) as beside, beside.open("wb") as file:
                columns: dict[str, Any] = {name: was.table[name] for name in KEPT}
                np.savez_compressed(file, **columns)
    except OSError as problem:
        raise ModelError(f"cannot be written: {problem.strerror}", file=path) from None
    return path


def _axis_entry(axis: StageAxis) -> dict[str, Any]:
    """The numbers of an axis that are not at their defaults, with their standard errors."""
    usual = asdict(StageAxis())
    numbers = {
        key: type(usual[key])(value) for key, value in asdict(axis).items() if value != usual[key] and key != "stderr"
    }
    return {**numbers, "stderr": {key: float(f"{error:.3g}") for key, error in axis.stderr.items()}}


def load_reference(source: str | Path, model: RigModel) -> RigReference | None:
    """The reference of a model, None if it has none for its rings. Raises ModelError with file and key."""
    path, where, values, stderr, terms = reference_path(source), "format", {}, {}, []
    if not path.is_file():
        return None
    try:
        document = yaml.safe_load(path.read_text(encoding="utf-8"))
        if problem := format_problem(document.get("format"), FORMAT, document.get("version")):
            raise ValueError(problem)
        if document.get("of") != stamp(model.balls):
            return None
        for name, node in document.get("body", {}).items():
            where = f"body.{name}"
            if name not in PARAMETERS:
                raise ValueError(f"got {name}, expected {one_of(PARAMETERS, name)}")
            values[name] = _number(node, "value", PARAMETERS[name].low, PARAMETERS[name].high)
            if "stderr" in node:
                stderr[name] = _number(node, "stderr")
        for name, node in document.get("terms", {}).items():
            where, effect = f"terms.{name}", FAMILY.get(name) or EFFECTS.get(name)
            if effect is None:
                raise ValueError(f"got {name}, expected {one_of(FAMILY, name)}")
            terms.append(effect(**{key: float(value) for key, value in node.items()}))
        where = "memory, remaining, errors"
        memory, remaining = (_number(document, key) for key in ("memory", "remaining"))
        errors = {int(ring): _number(node, "value") for ring, node in document.get("errors", {}).items()}
        where = "imbalance"
        size, error = (_number(document.get("imbalance", {key: 0.0}), key) for key in ("value", "stderr"))
        where, table, known = "stage", None, Known.of_model(model)
        if "stage" in document and (path.parent / RECORD).is_file():
            stage = StageModel(*(StageAxis(**document["stage"][axis]) for axis in AXES))
            with np.load(path.parent / RECORD) as file:
                table = Table({name: file[name] for name in KEPT}, {"file": RECORD}, str(path.parent / RECORD))
            known = Known.of_model(replace(model, stage=stage)).seen_in(table)
    except (OSError, yaml.YAMLError, AttributeError, KeyError, TypeError, ValueError, BadZipFile) as problem:
        words = str(problem).splitlines()[0]
        raise ModelError(
            words if type(problem) is ValueError else f"cannot be read: {words}", file=path, key=where
        ) from None
    body = Reference(with_values(BodyModel(), {**ABSENT, **values})._replace(terms=tuple(terms)), stderr)
    imbalance = BALANCED._replace(size=size, stderr=error)
    return RigReference(body, known, memory, remaining, "its model", errors=errors, imbalance=imbalance, table=table)


def _number(node: Any, key: str, low: float = 0.0, high: float = math.inf) -> float:
    value = node.get(key) if isinstance(node, dict) else node
    if not isinstance(value, int | float) or isinstance(value, bool) or not low <= value <= high:
        raise ValueError(f"{key}: got {value!r}, expected a number from {low:g} to {high:g}")
    return float(value)


def known_reference(source: str | Path | None, model: RigModel | None, maze: Maze) -> RigReference:
    """The reference without logs: the file of the model's folder, or else the model alone, or else a textbook ball.

    Raises ModelError."""
    if model is None:
        return textbook()
    kept = None if source is None else load_reference(source, model)
    if kept is None:
        return reference_by_model(model, maze)
    return kept if kept.table is None else replace(kept, then=filter_on_stage(kept.table, maze, kept.stage.kind))
