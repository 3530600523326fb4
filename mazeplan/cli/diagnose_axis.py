"""`diagnose --system emps`: what the model of a drive axis lacks, by a record of the benchmark."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from mazeplan.cli.diagnose import declare_known, finish
from mazeplan.cli.progress import Working
from mazeplan.errors import InputError


def diagnose_drive(path: Path, declare: list[str], test: Path | None, output: Path | None, as_json: bool) -> None:
    """Diagnose the record in a .mat file; test: a further one, for scores only."""
    from mazeplan.data.drivelog import read_drive
    from mazeplan.diagnosis.axisdiagnose import diagnose_axis
    from mazeplan.diagnosis.axislibrary import axis_library

    log = read_drive(path)
    library = axis_library()
    along = [text for text in declare if "=" not in text and "." not in text]
    known: dict[str, dict[str, float]] = {}
    declare_known(known, [text for text in declare if text not in along], library)
    names = [c.name for c in library]
    for name in along:
        if name not in names:
            raise InputError(f"--declare: got effect {name!r}, expected one of {', '.join(names)}")
        if name in known:
            raise InputError(f"--declare: got {name} both with and without a value, expected one of the two")
    further = None if test is None else read_drive(test, log.gain)
    with Working("diagnosing") as shown:
        done = diagnose_axis(log, known, along, test=further, progress=shown.tell)
    document: dict[str, Any] = {**done.document(), "system": "emps", "declared": known, "report": None}
    finish(done, document, output, path.name, as_json)
