"""`diagnose --system`: what the model of something with one degree of freedom lacks: a user's class, or EMPS."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mazeplan.cli.diagnose import declare_known, finish
from mazeplan.cli.progress import Working
from mazeplan.errors import InputError
from mazeplan.usermodule import user_module

if TYPE_CHECKING:
    from mazeplan.diagnosis.mechanism import Mechanism
    from mazeplan.physics.effect import Effect


def diagnose_system(
    system: str, path: Path, declare: list[str], effects: str | None, test: Path | None, output: Path | None,
    as_json: bool,
) -> None:  # fmt: skip
    """Diagnose a record; system: emps or MODULE:CLASS; test: a further record, for scores only."""
    from mazeplan.data.drivelog import read_drive, read_motion
    from mazeplan.diagnosis.mechanismdiagnose import diagnose_mechanism
    from mazeplan.physics.registry import brought

    own = [] if effects is None else brought(effects)
    mechanism = _mechanism(system, path.parent, own)
    log: Any = None
    if system == "emps":
        log = read_drive(path)
        read: Any = partial(read_drive, gain=log.gain)
    else:
        read = partial(read_motion, position=mechanism.position, inputs=mechanism.inputs, unit=mechanism.unit)
        log = read(path)
    known, along = _declared(declare, mechanism)
    further = None if test is None else read(test)
    with Working("diagnosing") as shown:
        done = diagnose_mechanism(mechanism, log, known, along, test=further, progress=shown.tell)
    document: dict[str, Any] = {**done.document(), "system": system, "declared": known, "report": None}
    finish(done, document, output, path.name, as_json)


def _mechanism(system: str, folder: Path, own: Sequence[Effect]) -> Mechanism:
    """What moves; folder: that of the log, where the module of its class may lie, too."""
    from mazeplan.diagnosis.emps import Axis
    from mazeplan.diagnosis.mechanism import mechanism_of

    told: Any = Axis
    if system != "emps":
        module, _, name = system.partition(":")
        code = user_module(module, "--system", folder)
        told = getattr(code, name, None)
        if told is None:
            raise InputError(f"--system: module {module!r} has no {name!r}, expected the name of a class in it")
    try:
        return mechanism_of(told, own)
    except InputError as problem:
        raise InputError(f"--system: {system}: {problem}") from None


def _declared(declare: list[str], mechanism: Mechanism) -> tuple[dict[str, dict[str, float]], list[str]]:
    """What is known with its values, and what is known to be there."""
    along = [text for text in declare if "=" not in text and "." not in text]
    known: dict[str, dict[str, float]] = {}
    names = [c.name for c in mechanism.library]
    declare_known(known, [text for text in declare if text not in along], mechanism.library, mechanism.motion.name)
    for name in along:
        if name not in names:
            raise InputError(f"--declare: got effect {name!r}, expected one of {', '.join(names)}")
        if name in known:
            raise InputError(f"--declare: got {name} both with and without a value, expected one of the two")
    return known, along
