"""What a rig was like when its model was right: the numbers of the ball's body, of table and camera, and of the stage.

They come from records of that time, or from the file that `learn` leaves beside a model. A model without either says
less: where camera and table are, how much friction there is about, nothing of walls and spin. Those numbers are then
fitted to the record itself, and nothing is said of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mazeplan.data.table import Table, join
from mazeplan.diagnosis.bodyrecord import body_filter, first_guess, left_over
from mazeplan.diagnosis.bodysearch import ENOUGH, NOISE, Reference
from mazeplan.diagnosis.parts import Known
from mazeplan.estimation.bodyfilter import BodyModel
from mazeplan.estimation.bodyfit import ORDINARY, fit_body
from mazeplan.estimation.bodynumbers import body_of, said_by, stderr_by, with_values
from mazeplan.maze.geometry import Maze
from mazeplan.models.modelfile import RigModel
from mazeplan.physics.stage import StageModel

GAINS = ("gain_beta", "gain_gamma", "cross_beta", "cross_gamma")
FITTED = (  # of a reference
    *ORDINARY, *GAINS, "inertia", "viscous", "angle", "scale",
)  # fmt: skip
MOST = 18000  # pictures, ten minutes of them
UNTOLD = ("wall", "restitution", "hold", "spin", "strike")  # what a model of beads does not say
SOLID, ROUND = 0.4, 0.02  # inertia over m R^2 of a solid ball, and how sure that is
FRICTION = (0.4, 1.4)  # times what a model of beads says: between these, friction is as it was


@dataclass(frozen=True)
class RigReference:
    """body: of the ball; stage: what is known of it; memory, remaining: of the innovations then (`left_over`), 0
    where unknown; source: in words; friction: lowest and highest rolling friction, m/s^2, where only a model of
    beads tells."""

    body: Reference
    stage: Known
    memory: float = 0.0
    remaining: float = 0.0
    source: str = "the reference"
    friction: tuple[float, float] | None = None


def reference_of(tables: Sequence[Table], maze: Maze, model: RigModel | None) -> RigReference:
    """The body and the stage of records in which the model was right. Raises TableError."""
    body, stage = body_filter(tables[0] if len(tables) == 1 else join(tables), maze)
    fit = fit_body(body, first_guess(model, maze), FITTED, enough=ENOUGH)
    known = Known({}, {})
    if stage is not None:
        known = Known.of_model(RigModel(StageModel(*stage.axes), {}, kind="pi"))
    return RigReference(Reference(fit.model, fit.stderr), known, *left_over(body, fit))


def shortened(table: Table) -> Table:
    """The first stretches of a record, MOST pictures or so: more would only take time."""
    if len(table) <= MOST:
        return table
    numbers, counts = np.unique(table.segment, return_counts=True)
    kept = numbers[: max(int(np.searchsorted(np.cumsum(counts), MOST, side="right")), 1)]
    # segments are long where nobody places the ball anew; whole rings of a drive are, too
    rows = np.isin(table.segment, kept) if len(numbers) > 1 else np.arange(len(table)) < MOST
    return Table({name: column[rows] for name, column in table.columns.items()}, table.source)


def reference_by_model(model: RigModel, maze: Maze) -> RigReference:
    """What a model without records says."""
    known, guess = Known.of_model(model), first_guess(model, maze)
    own = body_of(model)
    if own is not None and model.body is not None:
        values = {name: getattr(own.view, name) for name in ("offset_x", "offset_y", "angle", "scale", "bend")}
        camera = {name: getattr(guess.view, name) for name in values}
        body = with_values(own, camera)
        stderr = {**stderr_by(model, maze), **model.body.stderr}
        return RigReference(Reference(body, stderr), known, source="the model")
    said = said_by(model, maze, "rolling")
    low, high = (factor * end for factor, end in zip(FRICTION, (min(said), max(said)), strict=True)) if said else (0, 1)
    body = with_values(guess, {"inertia": _inertia(model)})
    stderr = {**stderr_by(model, maze), "inertia": ROUND}
    reference = Reference(body, stderr, ("rolling", *UNTOLD))
    return RigReference(reference, known, source="the model", friction=(low, high))


def textbook() -> RigReference:
    """A solid ball that rolls without loss on a level table, seen without delay by a camera in the middle."""
    told = {"rolling": 0.0, "wall": 0.0, "spin": 0.0, "restitution": 0.0, "delay": 0.0}
    names = (*UNTOLD, *(name for name in FITTED if name not in (*UNTOLD, *NOISE, "inertia", *GAINS)))
    body = with_values(BodyModel(), told)
    reference = Reference(body, {"inertia": ROUND}, names, start=BodyModel())
    return RigReference(reference, Known({}, {}), source="a textbook ball")


def _inertia(model: RigModel) -> float:
    """Inertia over m R^2: of a solid ball, unless no place at floor and walls makes that of a factor in the model."""
    factors = [ball.parameter("rolling_inertia", "factor", 0.0) for ball in model.balls.values()]
    factors = [factor for factor in factors if 0.0 < factor < 1.0]
    if not factors:
        return SOLID
    low, high = (1.0 / max(factors) - 1.0) / 2.0, 1.0 / min(factors) - 1.0
    return min(max(SOLID, low), high)
