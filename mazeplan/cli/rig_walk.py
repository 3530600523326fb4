"""`rig check` of a rig on a table: the walk, what was measured into the rig's file, then what every rig must do."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from mazeplan.cli.output import say

if TYPE_CHECKING:
    from mazeplan.rigs.conformance import CheckResult


def check_hardware(
    spec: str, maze: Any, *, seed: int, yes: bool, output: Path | None
) -> Iterator[CheckResult | tuple[str, dict[str, Any]]]:
    """Results one by one; ("latency", section) once it is measured. The rig is level and closed at the end.

    Raises RigError when a part is silent or gone, SettingsError for a file that cannot be used, both after the result
    that says so. The latencies are written to `output`, by default the rig's own file, unless that is a packaged one
    that is no template: the emulated rig stays as it is."""
    from mazeplan.cli.calibrate import today
    from mazeplan.errors import RigError
    from mazeplan.rigs.conformance import RAISED, check_rig
    from mazeplan.rigs.hardware.files import hardware_file
    from mazeplan.rigs.hardware.rig import HardwareRig
    from mazeplan.rigs.hardware.walk import Walk
    from mazeplan.rigs.registry import make_rig
    from mazeplan.rigs.watchdog import watched

    file = hardware_file(spec)
    rig: Any = make_rig(spec, maze)
    assert isinstance(rig, HardwareRig)
    passed = True
    try:
        walk = Walk(rig, (lambda question: True) if yes else _ask)
        for result in walk.steps():
            passed = passed and result.passed
            yield result
        if walk.latencies is not None:
            section = walk.latencies.section(today())
            yield "latency", section
            target = output or (file.target if file.keeps else None)
            if target is not None:
                say(f"wrote latency to {file.write({'latency': section}, target)}")
    finally:
        rig.close()
    if passed:
        results = check_rig(watched(make_rig(spec, maze), own_process=True), maze, seed=seed, repeatable=False)
        yield from results
        failed = f"{RAISED}{RigError.__name__}: "  # the machine, where others miss what they should do
        for result in results:
            if result.detail.startswith(failed):
                raise RigError(result.detail.removeprefix(failed))


def _ask(question: str) -> bool:
    if not sys.stdin.isatty():
        say(f"{question}: nobody to ask, so taken as yes (--yes says so)")
        return True
    return typer.confirm(question, default=True, err=True)
