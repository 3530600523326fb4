"""`diagnose`: the effect that a model lacks, from a record: of a whole rig, of one ring, or of another machine."""

from __future__ import annotations

import shlex
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from mazeplan.core.errors import InputError
from mazeplan.core.logs.columns import parse_columns
from mazeplan.core.logs.table import Table, as_table, join, name_of, several
from mazeplan.core.progress import Words, no_words
from mazeplan.diagnosis.rig.record import why_not_whole
from mazeplan.diagnosis.rig.reference import known_reference, reference_of, save_reference
from mazeplan.diagnosis.rig.verdict import verdict_on
from mazeplan.diagnosis.rig.words import advice, errors_in_words
from mazeplan.diagnosis.update import kept_in_model, moved_model, reference_after
from mazeplan.learning.modelfile import RigModel, save_model
from mazeplan.maze.geometry import Maze
from mazeplan.physics.registry import own_effects
from mazeplan.run.commands.diagnose_mechanism import (
    DiagnosisRequest,
    DiagnosisResult,
    diagnose_ring,
    diagnose_system,
    finish,
)
from mazeplan.run.commands.log_context import check_wiring, logged_map


def diagnose(
    logs: Any,
    *,
    model: str | Path | RigModel | None = None,
    radius: float | None = None,
    declare: Iterable[str] | Mapping[str, float] = (),
    ring: int | None = None,
    test: Any = None,
    map: str | Path | Maze | None = None,
    system: Any = "ring",
    effects: str | None = None,
    output: str | Path | None = None,
    reference: Any = (),
    columns: Iterable[str] | Mapping[str, str] = (),
    progress: Words = no_words,
) -> DiagnosisResult:
    """Find the effect that a model lacks, and the improvement of its predictions with the effect.

    logs, test, reference, columns: as of `mazeplan.learn`
    model: packaged name, folder or RigModel; None: nominal physics
    radius: of the track, m; None: the map's
    declare: known parameters, {"dry_friction.coefficient": 0.4} or texts as of `--declare`
    ring: only this ring; None: all rings of the record
    system: "ring", "emps", "module:Class", or a class of your own
    effects: "module:function" with effects of your own
    output: folder for the report and the model; None: nothing is written
    progress: gets the step under way

    Raises InputError, TableError."""
    given = [f"{name}={value!r}" for name, value in declare.items()] if isinstance(declare, Mapping) else list(declare)
    request = DiagnosisRequest(
        several(logs), model, radius, given, ring, test, map, effects, None if output is None else Path(output),
        several(reference), parse_columns(columns), progress,
    )  # fmt: skip
    if system != "ring":
        _check_system(system, request)
        return diagnose_system(system, _single(request.logs, f"--system {system}"), request)
    alone = {"--ring": ring, "--radius": radius, "--declare": given}
    option = next((option for option, value in alone.items() if value), None)
    if request.references and option:
        raise InputError(f"{option}: got {alone[option]}, expected none with --reference, which uses all rings")
    why = ""
    if option is None:
        tables = [as_table(log, request.columns) for log in request.logs]
        why = why_not_whole(tables, fewest=0)  # of a ball that meets walls, a short record of one ring says nothing
        if request.references or not why:
            return diagnose_rig(tables, request)
    return diagnose_ring(_single(request.logs, option or "a table without x, y, u_beta and u_gamma"), request, why)


def _single(logs: list[Any], why: str) -> Any:
    if len(logs) != 1:
        raise InputError(f"{name_of(logs[1]) if logs else 'logs'}: got {len(logs)} logs, expected one with {why}")
    return logs[0]


def _check_system(system: Any, request: DiagnosisRequest) -> None:
    if isinstance(system, str) and system != "emps" and ":" not in system:
        raise InputError(f"--system: got {system!r}, expected ring, emps or MODULE:CLASS")
    single = {f"--{name}": getattr(request, name) for name in ("ring", "radius", "map", "model")}
    for option, value in {**single, "--reference": request.references or None}.items():
        if value is not None:
            raise InputError(f"{option}: got {value}, expected none with --system {system}, which has no ring")


def diagnose_rig(tables: Sequence[Table], request: DiagnosisRequest) -> DiagnosisResult:
    """Find the differences between a rig and its reference, all rings together. Raises TableError, InputError."""
    maze = logged_map(request.map, *request.logs, request.test, *request.references).maze
    known = request.known
    added = own_effects(request.effects)
    for one in tables:
        check_wiring(one, maze)
    request.progress("reference")
    references = [as_table(log, request.columns) for log in request.references]
    folder = None if isinstance(request.model, RigModel | None) else str(request.model)
    was = reference_of(references, maze, known) if references else known_reference(folder, known, maze)
    test = None if request.test is None else as_table(request.test, request.columns)
    table = tables[0] if len(tables) == 1 else join(tables)
    done = verdict_on(table, maze, was, request.progress, test, added)
    document: dict[str, Any] = done.document() | {"model": None, "report": None}
    names = [name_of(log) for log in request.logs]
    title = " and ".join(names[:2]) + (" and others" if len(names) > 2 else "")
    if request.output is not None and known is not None and kept_in_model(done.effects):
        new = moved_model(known, done.effects, done.searched.fit, done.zero)
        document["model"] = str(save_model(new, request.output / "model").parent)
        if not done.was.body.open:
            save_reference(reference_after(done), new, request.output / "model")
    needed = {"--model MODEL (the folder of `mazeplan learn`)": known, "-o FOLDER": request.output}
    add = " and ".join(option for option, value in needed.items() if value is None)
    typed = [str(log) if isinstance(log, str | Path) else name_of(log) for log in request.logs]
    document["advice"] = advice(done, document["model"], add, shlex.join(typed))
    evidence = {"kind": "rig", "title": title, **done.held.evidence(done.plate.body.pictures.dt)}
    on_test = "" if done.test is None else errors_in_words(done, done.test)
    return finish(document, evidence, request, document["sentence"], on_test, document["advice"])
