"""`diagnose --system`: a user's class of a mechanism, or the drive axis EMPS."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

from mazeplan.core.errors import InputError
from mazeplan.core.logs.table import name_of
from mazeplan.core.name_hints import one_of
from mazeplan.core.user_modules import user_module
from mazeplan.diagnosis.engine.diagnosis import diagnose_motion
from mazeplan.diagnosis.engine.emps import Axis, emps_result, read_drive
from mazeplan.diagnosis.engine.record import read_record
from mazeplan.diagnosis.engine.system import System, system_of
from mazeplan.physics.effect import Effect
from mazeplan.physics.registry import load_effects
from mazeplan.run.commands.diagnosis_request import DiagnosisRequest, DiagnosisResult, Values, declare_known, finish


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
        read = partial(
            read_record,
            positions=machine.positions,
            units=machine.units,
            inputs=machine.inputs,
            columns=request.columns,
        )
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
    """The declared effects: those with known values, and the names of those with unknown values."""
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
