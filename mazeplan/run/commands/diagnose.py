"""`diagnose`: the effect that a model lacks, from a record: of a whole rig, of one ring, or of another machine."""

from __future__ import annotations

import shlex
from collections.abc import Iterable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from mazeplan.core.errors import InputError, one_of
from mazeplan.core.logs.columns import parse_columns
from mazeplan.core.logs.table import Table, as_table, join, name_of, several
from mazeplan.core.progress import Words, no_words
from mazeplan.core.user_modules import user_module
from mazeplan.diagnosis.engine.diagnosis import diagnose_motion
from mazeplan.diagnosis.engine.emps import Axis, emps_result, read_drive
from mazeplan.diagnosis.engine.record import read_record
from mazeplan.diagnosis.engine.system import System, system_of
from mazeplan.diagnosis.rig.record import why_not_whole
from mazeplan.diagnosis.rig.reference import known_reference, reference_of, save_reference
from mazeplan.diagnosis.rig.update import kept_in_model, moved_model, reference_after
from mazeplan.diagnosis.rig.verdict import verdict_on
from mazeplan.diagnosis.rig.words import advice, errors_in_words
from mazeplan.learning.modelfile import RigModel, save_model
from mazeplan.maze.geometry import Maze
from mazeplan.physics.effect import Effect
from mazeplan.physics.registry import load_effects, own_effects
from mazeplan.run.commands.diagnose_ring import diagnose_ring
from mazeplan.run.commands.diagnosis_request import (
    DiagnosisRequest,
    DiagnosisResult,
    Values,
    declare_known,
    finish,
    lines_of_files,
    lines_of_test,
    write_reports,
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
    further = [] if request.test is None else [request.test]
    found = logged_map(request.map, *request.logs, *further, *request.references)
    maze, known = found.maze, request.known
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
    if request.output is not None:
        write_reports(document, evidence, request.output)
    on_test = lines_of_test("" if done.test is None else errors_in_words(done, done.test))
    lines = [document["sentence"], *on_test, *document["advice"]]
    return DiagnosisResult(document, evidence, (*lines, *lines_of_files(document)))


def diagnose_system(system: Any, log: Any, request: DiagnosisRequest) -> DiagnosisResult:
    """Diagnose a record. system: emps, MODULE:CLASS, or a class. Raises InputError, TableError."""
    own = [] if request.effects is None else load_effects(request.effects)
    machine = _machine(system, Path(log).parent if isinstance(log, str | Path) else Path(), own)
    known, fitted = _declared(request.declare, machine)
    done: Any
    if system == "emps":
        record, gain = read_drive(Path(log))
        test = None if request.test is None else read_drive(Path(request.test), gain)[0]
        done = emps_result(machine, record, known, fitted, test, request.progress)
    else:
        columns = {"positions": machine.positions, "inputs": machine.inputs, "columns": request.columns}
        read = partial(read_record, units=machine.units, **columns)
        record, test = read(log), None if request.test is None else read(request.test)
        done = diagnose_motion(machine, record, known, fitted, test=test, progress=request.progress)
    name = system if isinstance(system, str) else f"{system.__module__}:{system.__qualname__}"
    document: dict[str, Any] = {**done.document(), "system": name, "declared": known, "report": None}
    return finish(done, document, request, name_of(log))


def _machine(system: Any, folder: Path, own: Sequence[Effect]) -> System:
    """The system of a name. folder: folder of the log, in which the module is searched, too"""
    kind: Any = Axis if system == "emps" else system
    if isinstance(system, str) and system != "emps":
        module, _, name = system.partition(":")
        kind = getattr(user_module(module, "--system", folder), name, None)
        if kind is None:
            raise InputError(f"--system: module {module!r} has no {name!r}, expected the name of a class in it")
    try:
        return system_of(kind, own)
    except InputError as problem:
        raise InputError(f"--system: {system}: {problem}") from None


def _declared(declare: Sequence[str], machine: System) -> tuple[Values, list[str]]:
    fitted = [text for text in declare if "=" not in text and "." not in text]
    known: Values = {}
    names = [effect.name for effect in machine.library]
    valued = [text for text in declare if text not in fitted]
    declare_known(known, valued, machine.library, machine.motion.name)
    for name in fitted:
        if name not in names:
            raise InputError(f"--declare: got effect {name!r}, expected {one_of(names, name)}")
        if name in known:
            raise InputError(f"--declare: got {name} both with and without a value, expected one of the two")
    return known, fitted
