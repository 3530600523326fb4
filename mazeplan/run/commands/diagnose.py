"""`diagnose`: the effect that a model lacks, from a record."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from mazeplan.core.errors import InputError
from mazeplan.core.logs.column_units import parse_columns
from mazeplan.core.logs.table import as_table, name_of, several
from mazeplan.core.progress import Words, no_words
from mazeplan.diagnosis.rig.record import why_not_whole
from mazeplan.learning.modelfile import RigModel
from mazeplan.maze.geometry import Maze
from mazeplan.run.commands.diagnosis_request import DiagnosisRequest, DiagnosisResult


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
        from mazeplan.run.commands.diagnose_system import diagnose_system

        return diagnose_system(system, _single(request.logs, f"--system {system}"), request)
    alone = {"--ring": ring, "--radius": radius, "--declare": given}
    option = next((option for option, value in alone.items() if value), None)
    if request.references and option:
        raise InputError(f"{option}: got {alone[option]}, expected none with --reference, which uses all rings")
    why = ""
    if option is None:
        from mazeplan.run.commands.diagnose_rig import diagnose_rig

        tables = [as_table(log, request.columns) for log in request.logs]
        why = why_not_whole(tables, fewest=0)  # of a ball that meets walls, a short record of one ring says nothing
        if request.references or not why:
            return diagnose_rig(tables, request)
    from mazeplan.run.commands.diagnose_ring import diagnose_ring

    return diagnose_ring(_single(request.logs, option or "a table without x, y, u_beta and u_gamma"), request, why)


def _single(logs: list[Any], why: str) -> Any:
    """The only log. Raises InputError for more."""
    if len(logs) != 1:
        raise InputError(f"{name_of(logs[1]) if logs else 'logs'}: got {len(logs)} logs, expected one with {why}")
    return logs[0]


def _check_system(system: Any, request: DiagnosisRequest) -> None:
    """Raises InputError for an unknown system, and for options of a ball in a maze."""
    if isinstance(system, str) and system != "emps" and ":" not in system:
        raise InputError(f"--system: got {system!r}, expected ring, emps or MODULE:CLASS")
    single = {f"--{name}": getattr(request, name) for name in ("ring", "radius", "map", "model")}
    for option, value in {**single, "--reference": request.references or None}.items():
        if value is not None:
            raise InputError(f"{option}: got {value}, expected none with --system {system}, which has no ring")
