"""`diagnose --system`: a mechanism with one degree of freedom, which is a user's class or the drive axis EMPS."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

from mazeplan.apps.cli.diagnosis_request import DiagnosisRequest, Values, declare_known, finish
from mazeplan.apps.cli.progress import ProgressBar
from mazeplan.core.errors import InputError
from mazeplan.core.name_hints import one_of
from mazeplan.core.user_modules import user_module
from mazeplan.diagnosis.mechanism.diagnose import diagnose_mechanism
from mazeplan.diagnosis.mechanism.drive_log import read_drive, read_motion
from mazeplan.diagnosis.mechanism.emps import Axis
from mazeplan.diagnosis.mechanism.mechanism import Mechanism, mechanism_of
from mazeplan.physics.effect import Effect
from mazeplan.physics.registry import load_effects


def diagnose_system(system: str, path: Path, request: DiagnosisRequest) -> None:
    """Diagnose a record. system: emps or MODULE:CLASS. Raises InputError, TableError."""
    own = [] if request.effects is None else load_effects(request.effects)
    mechanism = _mechanism(system, path.parent, own)
    log: Any
    if system == "emps":
        log = read_drive(path)
        read: Any = partial(read_drive, gain=log.gain)
    else:
        read = partial(read_motion, position=mechanism.position, inputs=mechanism.inputs, unit=mechanism.unit)
        log = read(path)
    known, fitted = _declared(request.declare, mechanism)
    test = None if request.test is None else read(request.test)
    with ProgressBar("diagnosing") as bar:
        done = diagnose_mechanism(mechanism, log, known, fitted, test=test, progress=bar.show)
    document: dict[str, Any] = {**done.document(), "system": system, "declared": known, "report": None}
    finish(done, document, request, path.name)


def _mechanism(system: str, folder: Path, own: Sequence[Effect]) -> Mechanism:
    """The mechanism of a system. folder: folder of the log, in which the module is searched, too"""
    kind: Any = Axis
    if system != "emps":
        module, _, name = system.partition(":")
        kind = getattr(user_module(module, "--system", folder), name, None)
        if kind is None:
            raise InputError(f"--system: module {module!r} has no {name!r}, expected the name of a class in it")
    try:
        return mechanism_of(kind, own)
    except InputError as problem:
        raise InputError(f"--system: {system}: {problem}") from None


def _declared(declare: Sequence[str], mechanism: Mechanism) -> tuple[Values, list[str]]:
    """The declared effects: those with known values, and the names of those with unknown values."""
    fitted = [text for text in declare if "=" not in text and "." not in text]
    known: Values = {}
    names = [effect.name for effect in mechanism.library]
    valued = [text for text in declare if text not in fitted]
    declare_known(known, valued, mechanism.library, mechanism.motion.name)
    for name in fitted:
        if name not in names:
            raise InputError(f"--declare: got effect {name!r}, expected {one_of(names, name)}")
        if name in known:
            raise InputError(f"--declare: got {name} both with and without a value, expected one of the two")
    return known, fitted
