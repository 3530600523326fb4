"""`learn`: from logs to a model that a run can use.

1. The stage, the camera's delay and the effects on a bead in each ring are fitted (`learning.identification`).
2. A rigid ball is fitted to the same part of each stretch; the rest of the stretch is for the judgement. The ball is
   the reference for later diagnoses, too.
3. Gaussian processes are learned, if the kind has them.
4. The model is judged as a run would use it (`judge`). What predicts worse than a textbook description is left out.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from mazeplan.control.estimation.rigid_body_filter import BodyFilter, BodyModel
from mazeplan.control.estimation.rigid_body_fit import fit_body, value_of, with_body
from mazeplan.core.errors import InputError, TableError
from mazeplan.core.logs.columns import parse_columns
from mazeplan.core.logs.table import Table, as_table, join, name_of, several
from mazeplan.core.progress import Advance, Words, no_advance, no_words
from mazeplan.core.records import Array
from mazeplan.core.results import DocumentResult
from mazeplan.core.side_by_side import side_by_side
from mazeplan.diagnosis.rig.fitting import ENOUGH, PART, alternate
from mazeplan.diagnosis.rig.record import filter_on_stage, why_not_whole
from mazeplan.diagnosis.rig.reference import (
    RigReference,
    reference_by_filter,
    reference_path,
    save_reference,
    shortened,
)
from mazeplan.diagnosis.stage.comparison import Known
from mazeplan.learning.fitting import FitOptions
from mazeplan.learning.gp_training import TrainingOptions
from mazeplan.learning.identification import TEST_SHARE, BallPrior, RigFit, fit_rig
from mazeplan.learning.model_score import ring_errors, score_document
from mazeplan.learning.modelfile import KINDS, RigModel, model_document, save_model
from mazeplan.learning.policy_training import DEVICES
from mazeplan.learning.rig_gp import learn_processes
from mazeplan.learning.rig_model import FITS
from mazeplan.learning.unmeasured_tilt import finer_axes, stage_by_ball, tilt_is_measured, with_tilt_by_commands
from mazeplan.maze.geometry import Maze
from mazeplan.physics.rig.stage import StageAxis, StageModel
from mazeplan.run.commands.log_context import logged_map
from mazeplan.run.judge import PARTS, Judgement, judge

WITH_BODY = ("pi", "sp")  # kinds with effects that were fitted; the others leave physics out on purpose
DELAY_STEPS_S = (-0.008, -0.004, 0.0, 0.004, 0.008)  # s, of the delay around the likeliest one
DELAY_RANGE_S, DELAY_STEP_S = 0.016, 0.008  # s, of the delay around those that keep the sum of lag and delay
RATE_LIMIT_GAIN = 20.0  # of -2 log L by which a limited rate has to be likelier: the likelihood is that rough
RATE_LIMIT_STEPS = (0.8, 0.87, 0.93, 1.07, 1.15, 1.25)  # times a limited rate, tried at last
MAX_AXES = 12  # axes that are tried on all pictures ...
MAX_AXIS_LOSS = 200.0  # ... if their -2 log L by half of the pictures is at most this far from that of the best one
# The fit of the beads is misled by a short record, which has few stretches in which a bead moves freely. If it differs
# from the fit of the rigid ball by one of these, the beads are fitted again with the rigid ball's values as a prior.
MISSED_DELAY_S = 0.03
MISSED_TILT_RAD = 0.003
MISSED_FACTOR = 1.05  # of the rolling factor: walls only hold a bead back, so it is at most that of the free ball
PRIOR_TILT_RAD = 5e-4  # standard error of that prior
WALL_FACTOR = 0.92  # factor of a bead over that of the free ball: .85 to .97 in records of 600 s
PRIOR_FACTOR = 0.04  # its spread
COARSE_FREQUENCY = 0.1  # standard error of a frequency on the finer grid, as a share of it


@dataclass(frozen=True)
class Learned:
    """A model, and how it was found.

    reference:  of the rig, for later diagnoses; None if the logs do not show a whole rig, because of `why`"""

    model: RigModel
    fit: RigFit
    reference: RigReference | None
    why: str
    judgement: Judgement  # of the model on parts of the logs that were not fitted
    remaining: float  # rms of the innovations of the rigid ball over the camera's noise; NaN without one

    def fits(self) -> dict[str, float]:
        """How well stage and ball fit the logs, in times the noise."""
        stage = max(axis.times_noise for axis in self.fit.stage)
        known = {"stage": stage, "ball": self.remaining}
        return {part: round(times, 2) for part, times in known.items() if math.isfinite(times)}


def learn_model(
    tables: Sequence[Table], maze: Maze, kind: str, options: FitOptions | None = None, *,
    progress: Words = no_words, advance: Advance = no_advance,
) -> Learned:  # fmt: skip
    """The model of a rig from its logs. Raises ValueError or TableError for logs that do not show enough.

    kind: one of `modelfile.KINDS`"""
    table = join(tables)
    sources = tuple(one.source for one in tables)
    ball = stage = None
    if not tilt_is_measured(table):
        progress("stage, by the ball")
        stage, ball = sharper_stage(table, maze, stage_by_ball(table, maze))
        table = with_tilt_by_commands(table, stage)
    fit = fit_rig(table, maze, sources, stage=stage, progress=progress)
    why = why_not_whole([table])
    short = shortened(table)
    later = later_part(short)
    reference, remaining = None, math.nan
    if not why:
        progress("rigid ball")
        body = filter_on_stage(short, maze, fit.model.stage).part(~later)
        reference = replace(reference_by_filter(body, Known.of_model(fit.model), maze, fit.model, ball), table=short)
        remaining, seen = reference.remaining, reference.body
        if _far_off(fit.model, seen.model):
            known = BallPrior(
                (WALL_FACTOR * rolling_factor(seen.model), PRIOR_FACTOR),
                (np.array([value_of(seen.model, f"tilt_{axis}") for axis in ("beta", "gamma")]), PRIOR_TILT_RAD),
                # as the fit of the beads: no picture before the plate moved
                (max(seen.model.view.delay, -fit.model.stage.dead_time), seen.stderr.get("delay", math.nan)),
            )
            again = fit_rig(table, maze, sources, stage=fit.model.stage, prior=known, progress=progress)
            fit = replace(again, stage=fit.stage)
            reference = replace(reference, stage=Known.of_model(fit.model))
    model = fit.model
    if kind == "p":
        model = replace(model, kind="p", balls=RigModel.nominal(maze).balls, scores={})
    elif kind != "pi":
        model = learn_processes(table, maze, model, kind, options, progress=progress, advance=advance)
    if reference is not None and kind in WITH_BODY:
        model = with_body(model, reference.body.model, reference.body.stderr)
    progress("judging as a run would use it")
    parts = PARTS if kind in WITH_BODY else ()
    judgement = judge(model, short, maze, later, parts=parts, fits=not remaining > FITS)
    model = judgement.model
    done = Learned(model, fit, reference, why, judgement, remaining)
    scores: dict[str, Any] = {**model.scores, "fits": done.fits(), "judged": judgement.document()}
    return replace(done, model=replace(model, scores=scores))


def _far_off(beads: RigModel, ball: BodyModel) -> bool:
    one, free = next(iter(beads.balls.values())), rolling_factor(ball)
    tilts = [
        abs(one.parameter("tilt_offset", axis, 0.0) - value_of(ball, f"tilt_{axis}")) for axis in ("beta", "gamma")
    ]
    factor = one.parameter("rolling_inertia", "factor", free)
    late = abs(ball.view.delay - beads.camera_delay)
    return late > MISSED_DELAY_S or max(tilts) > MISSED_TILT_RAD or factor > MISSED_FACTOR * free


def rolling_factor(ball: BodyModel) -> float:
    """Rolling factor of a ball on a floor without walls."""
    return 1.0 / (1.0 + ball.ball.inertia)


def sharper_stage(table: Table, maze: Maze, stage: StageModel) -> tuple[StageModel, BodyModel | None]:
    """The stage of a rig without a tilt sensor by the filter of the rigid ball, near a first guess; and the ball.

    The ball is fitted with the first guess; then each axis of a finer grid is tried. The sum of its lag and of the
    delay of the pictures stays nearly the same."""
    table = shortened(with_tilt_by_commands(table, stage))
    if why_not_whole([table]):
        return stage, None
    few = partial(alternate, most=PART // 2, short=PART)
    first = filter_on_stage(table, maze, stage)
    ball = fit_body(few(first), BodyModel(), enough=ENOUGH).model
    total, tried = stage.lag + ball.view.delay, []
    for axis in finer_axes():
        body = filter_on_stage(table, maze, StageModel(axis, axis), first)
        # small motions have less lag if the rate is limited, down to that of the axis without a limit
        late = axis.lag - replace(axis, rate_limit=math.inf).lag
        shifts = np.arange(-DELAY_RANGE_S, late + DELAY_RANGE_S, DELAY_STEP_S).tolist() if late else (0.0,)
        tried += [(axis, body, delay) for delay in sorted({max(total - axis.lag + s, 0.0) for s in shifts})]

    def minus2(part: Callable[[BodyFilter], BodyFilter]) -> list[float]:
        def run(one: tuple[StageAxis, BodyFilter, float]) -> float:
            _, body, delay = one
            return part(body).innovations(ball._replace(view=ball.view._replace(delay=delay))).minus2

        return side_by_side(run, tried)

    rough = sorted(zip(minus2(few), range(len(tried)), strict=True))
    likely: dict[int, tuple[StageAxis, BodyFilter, float]] = {}  # of each axis the best delay, the best axis first
    for one, i in rough:
        if one <= rough[0][0] + MAX_AXIS_LOSS and len(likely) < MAX_AXES:
            likely.setdefault(id(tried[i][1]), tried[i])
    tried = [(axis, body, max(delay + shift, 0.0)) for axis, body, delay in likely.values() for shift in DELAY_STEPS_S]
    doubts = [RATE_LIMIT_GAIN if math.isfinite(axis.rate_limit) else 0.0 for axis, *_ in tried]
    losses = np.add(minus2(alternate), doubts)
    axis, body, delay = tried[int(np.argmin(losses))]
    if math.isfinite(axis.rate_limit):
        near = [(axis, body)]
        for times in RATE_LIMIT_STEPS:
            other = replace(axis, rate_limit=times * axis.rate_limit)
            near.append((other, filter_on_stage(table, maze, StageModel(other, other), first)))
        tried = [(*one, max(delay + shift, 0.0)) for one in near for shift in DELAY_STEPS_S]
        axis, _, delay = tried[int(np.argmin(minus2(alternate)))]
    ball = ball._replace(view=ball.view._replace(delay=delay))
    name = "natural_frequency" if axis.order else "rate_limit"
    if math.isfinite(getattr(axis, name)):
        axis = replace(axis, stderr={name: COARSE_FREQUENCY * getattr(axis, name)})
    return StageModel(axis, axis), ball


def later_part(table: Table) -> np.ndarray:
    """The rows (N,) of the last part of each segment, which no fit of stretches uses."""
    numbers, first, count = np.unique(table.segment, return_index=True, return_counts=True)
    at = np.searchsorted(numbers, table.segment)
    place: Array = (np.arange(len(table)) - first[at]) / count[at]
    return place > 1.0 - TEST_SHARE


@dataclass(frozen=True)
class LearnedModel(DocumentResult):
    """A learned model: the document of `learn --json`, and how the model was found."""

    kind: ClassVar[str] = "model"

    learned: Learned

    @property
    def model(self) -> RigModel:
        """The model, for `model=` of other functions."""
        return self.learned.model


def learn(
    logs: Any,
    output: str | Path | None = None,
    *,
    kind: str = "sp",
    device: str = "cpu",
    most: int = 4000,
    seed: int = 0,
    map: str | Path | Maze | None = None,
    columns: Iterable[str] | Mapping[str, str] = (),
    progress: Words = no_words,
    advance: Advance = no_advance,
) -> LearnedModel:
    """Fit the model of a rig, stage and ball, to its logs.

    logs: logs and tables: a path, a Table, {column: numbers} or a DataFrame, or several of them
    output: folder of the model; None: the model is only returned
    kind: p, pi, np or sp
    most: most training rows of a Gaussian process, per ring
    columns: names and units of columns, {"t": "time:ms"} or texts as of `--columns`

    Raises InputError, TableError."""
    if kind not in KINDS:
        raise InputError(f"--kind: got {kind!r}, expected one of {', '.join(KINDS)}")
    if device not in DEVICES:
        raise InputError(f"--device: got {device!r}, expected one of {', '.join(DEVICES)}")
    options = FitOptions(most=most, training=TrainingOptions(starts=2), seed=seed)
    given, named = several(logs), parse_columns(columns)
    maze = logged_map(map, *given).maze
    progress("reading")
    tables = [as_table(log, named) for log in given]
    try:
        done = learn_model(tables, maze, kind, options, progress=progress, advance=advance)
    except ValueError as problem:
        where = ", ".join(str(log) if isinstance(log, str | Path) else name_of(log) for log in given)
        raise TableError(str(problem), file=where) from None
    path, kept = None, None
    if output is not None:
        path = save_model(done.model, output)
        if done.reference is None:  # of another rig
            reference_path(output).unlink(missing_ok=True)
        else:
            kept = str(save_reference(done.reference, done.model, output))
    progress("judging")
    verdict = _verdict(done.model, tables, maze, "MODEL" if output is None else str(output))
    document = {
        "model": None if path is None else str(path), "reference": kept, **model_document(done.model),
        "windows": done.fit.windows, "fits": done.fits(), "judged": done.judgement.document(),
        "verdict": verdict["verdict"], "advice": verdict["advice"], "score": verdict,
    }  # fmt: skip
    return LearnedModel(document, done)


def _verdict(model: RigModel, tables: list[Table], maze: Maze, folder: str) -> dict[str, Any]:
    try:
        rings = ring_errors(model, tables, maze)
    except InputError:  # the logs are too short for any ring
        rings = {}
    document = score_document(rings, folder, "LOG", [r.number for r in maze.rings[:-1]])
    document["because"] += "; on the logs that it was learned from"
    document["advice"].append(f"judge it on a log that it has not seen: mazeplan score {folder} NEW.mcap")
    return document
