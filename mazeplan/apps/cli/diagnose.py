"""`diagnose`: the effect that a model lacks, from a record."""

from __future__ import annotations

from pathlib import Path

from mazeplan.apps.cli import options as opt
from mazeplan.apps.cli.diagnosis_request import DiagnosisRequest
from mazeplan.core.errors import InputError
from mazeplan.core.logs.column_units import parse_columns


def diagnose(
    logs: opt.Logs,
    model: opt.KnownModel = None,
    radius: opt.Radius = None,
    declare: opt.Declare = None,
    ring: opt.Ring = None,
    test: opt.TestLog = None,
    map_: opt.MapOfLog = None,
    system: opt.System = "ring",
    effects: opt.EffectModule = None,
    output: opt.DiagnosisFolder = None,
    reference: opt.Reference = None,
    columns: opt.Columns = None,
    force: opt.Force = False,
    as_json: opt.AsJson = False,
) -> None:
    """Find the effect that a model lacks, and the improvement of its predictions with the effect."""
    request = DiagnosisRequest(
        logs, model=model, radius=radius, declare=declare or [], ring=ring, test=test, map=map_, effects=effects,
        output=output, references=reference or [], as_json=as_json, columns=parse_columns(columns or []),
    )  # fmt: skip
    if system != "ring":
        _check_system(system, request)
        from mazeplan.apps.cli.diagnose_system import diagnose_system

        diagnose_system(system, _single(logs, f"--system {system}"), request)
        return
    alone = {"--ring": ring, "--radius": radius, "--declare": declare}
    given = next((option for option, value in alone.items() if value), None)
    if reference and given:
        raise InputError(f"{given}: got {alone[given]}, expected none with --reference, which uses all rings")
    why = ""
    if given is None:
        from mazeplan.apps.cli.diagnose_rig import diagnose_rig
        from mazeplan.core.logs.table import read_table
        from mazeplan.diagnosis.rig.record import why_not_whole

        tables = [read_table(log, request.columns) for log in logs]
        why = why_not_whole(tables)
        if reference or not why:
            diagnose_rig(tables, request)
            return
    from mazeplan.apps.cli.diagnose_ring import diagnose_ring

    diagnose_ring(_single(logs, given or "a table without x, y, u_beta and u_gamma"), request, why)


def _single(logs: list[Path], why: str) -> Path:
    """The only log. Raises InputError for more."""
    if len(logs) > 1:
        raise InputError(f"{logs[1]}: got {len(logs)} logs, expected one with {why}")
    return logs[0]


def _check_system(system: str, request: DiagnosisRequest) -> None:
    """Raises InputError for an unknown system, and for options of a ball in a maze."""
    if system != "emps" and ":" not in system:
        raise InputError(f"--system: got {system!r}, expected ring, emps or MODULE:CLASS")
    single = {f"--{name}": getattr(request, name) for name in ("ring", "radius", "map", "model")}
    for option, value in {**single, "--reference": request.references or None}.items():
        if value is not None:
            raise InputError(f"{option}: got {value}, expected none with --system {system}, which has no ring")
