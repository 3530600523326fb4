"""`learn`: fit the model of a rig to its logs."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

from mazeplan.core.errors import InputError, TableError
from mazeplan.core.logs.column_units import parse_columns
from mazeplan.core.logs.table import Table, as_table, name_of, several
from mazeplan.core.progress import Advance, Words, no_advance, no_words
from mazeplan.core.results import DocumentResult
from mazeplan.diagnosis.rig.reference import reference_path, save_reference
from mazeplan.learning.fitting import FitOptions
from mazeplan.learning.gp_training import TrainingOptions
from mazeplan.learning.model_document import model_document
from mazeplan.learning.model_score import ring_errors, score_document
from mazeplan.learning.modelfile import KINDS, RigModel, save_model
from mazeplan.learning.policy_training import DEVICES
from mazeplan.maze.geometry import Maze
from mazeplan.run.commands.log_context import logged_map
from mazeplan.run.learn import Learned
from mazeplan.run.learn import learn as learn_model


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
        raise TableError(str(problem), file=", ".join(_place(log) for log in given)) from None
    path = None if output is None else save_model(done.model, output)
    kept = None if output is None else _keep_reference(done, Path(output))
    progress("judging")
    verdict = _verdict(done.model, tables, maze, "MODEL" if output is None else str(output))
    document = {
        "model": None if path is None else str(path), "reference": kept, **model_document(done.model),
        "windows": done.fit.windows, "fits": done.fits(), "judged": done.judgement.document(),
        "verdict": verdict["verdict"], "advice": verdict["advice"], "score": verdict,
    }  # fmt: skip
    return LearnedModel(document, done)


def _place(log: Any) -> str:
    return str(log) if isinstance(log, str | Path) else name_of(log)


def _verdict(model: RigModel, tables: list[Table], maze: Maze, folder: str) -> dict[str, Any]:
    """The score of the model on the logs that it was learned from."""
    try:
        rings = ring_errors(model, tables, maze)
    except InputError:  # the logs are too short for any ring
        rings = {}
    document = score_document(rings, folder, "LOG", [r.number for r in maze.rings[:-1]])
    document["because"] += "; on the logs that it was learned from"
    document["advice"].append(f"judge it on a log that it has not seen: mazeplan score {folder} NEW.mcap")
    return document


def _keep_reference(done: Learned, folder: Path) -> str | None:
    """Write the reference of the rig beside its model if the logs show a whole rig; otherwise remove an old one."""
    if done.reference is None:
        reference_path(folder).unlink(missing_ok=True)
        return None
    return str(save_reference(done.reference, done.model, folder))
