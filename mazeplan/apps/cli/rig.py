"""`rig check` and `rig list`."""

from __future__ import annotations

import re
import sys
from collections.abc import Iterable, Iterator
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from mazeplan.apps.cli import options as opt
from mazeplan.apps.cli.output import print_json, print_result, say
from mazeplan.core.errors import MazeplanError, RigError

if TYPE_CHECKING:
    from mazeplan.maze.geometry import Maze
    from mazeplan.rigs.conformance import CheckResult

app = typer.Typer(help="Check and list rigs.", no_args_is_help=True)

RigArgument = Annotated[
    str, typer.Argument(metavar="RIG", help="Rig: a name from `rig list`, a YAML file, or MODULE:CLASS.")
]
Hardware = Annotated[bool, typer.Option("--hardware", help="Skip checks that only a simulation can repeat.")]
Yes = Annotated[bool, typer.Option("--yes", help="Ask no questions about a real rig.")]


@app.command("check")
def check(
    rig: RigArgument,
    map_: opt.Map = "cme",
    seed: opt.Seed = 0,
    hardware: Hardware = False,
    yes: Yes = False,
    as_json: opt.AsJson = False,
) -> None:
    """Check the rules of every rig: clock, signs, limits, level, repeatability.

    Of a real rig, first check each part, the board first. Exit status: 1 a check failed, 2 a file is wrong or not
    calibrated, 3 a part is silent."""
    from mazeplan.maze.mapfile import load_map
    from mazeplan.rigs.conformance import CheckResult, check_rig
    from mazeplan.rigs.hardware.settings import is_hardware
    from mazeplan.rigs.registry import make_rig
    from mazeplan.rigs.watchdog import watched

    maze, results = load_map(map_), list[CheckResult]()
    problem: MazeplanError | None = None
    if is_hardware(rig):
        found: Iterable[CheckResult] = _check_hardware(rig, maze, seed=seed, yes=yes)
    else:
        machine = watched(make_rig(rig, maze), own_process=True)
        found = check_rig(machine, maze, seed=seed, repeatable=not hardware)
    try:
        for result in found:
            results.append(result)
            if not as_json:
                detail = "" if result.detail == "ok" else result.detail
                print(f"{'ok' if result.passed else 'FAILED':6s}  {result.name:26s} {detail}".rstrip(), flush=True)
    except MazeplanError as error:
        if not results:
            raise
        problem = error
    passed = problem is None and all(result.passed for result in results)
    if as_json:
        print_json({"rig": rig, "passed": passed, "checks": [asdict(result) for result in results]})
    if problem is not None:
        raise problem
    sys.exit(0 if passed else 1)


def _check_hardware(spec: str, maze: Maze, *, seed: int, yes: bool) -> Iterator[CheckResult]:
    """Check the parts of a real rig, then the rules of every rig. Yields the results.

    Raises RigError for a silent part and SettingsError for an unusable file, both after yielding their result."""
    from mazeplan.rigs.conformance import RAISED, check_rig
    from mazeplan.rigs.hardware.check import HardwareCheck
    from mazeplan.rigs.hardware.rig import HardwareRig
    from mazeplan.rigs.registry import make_rig
    from mazeplan.rigs.watchdog import watched

    rig, passed = make_rig(spec, maze), True
    assert isinstance(rig, HardwareRig)
    try:
        for result in HardwareCheck(rig, (lambda question: True) if yes else _ask).steps():
            passed = passed and result.passed
            yield result
    finally:
        rig.close()
    if passed:
        failed = f"{RAISED}{RigError.__name__}: "  # the rig failed, it did not break a rule
        results = check_rig(watched(make_rig(spec, maze), own_process=True), maze, seed=seed, repeatable=False)
        yield from results
        for result in results:
            if result.detail.startswith(failed):
                raise RigError(result.detail.removeprefix(failed))


def _ask(question: str) -> bool:
    if not sys.stdin.isatty():
        say(f"{question}: no terminal to ask at, assuming yes (give --yes)")
        return True
    return typer.confirm(question, default=True, err=True)


@app.command("list")
def list_rigs(as_json: opt.AsJson = False) -> None:
    """List packaged rigs, and the keys of a simulated rig's YAML file."""
    from mazeplan.rigs.registry import PACKAGED, rig_names
    from mazeplan.rigs.sim.settings import SimulatedSettings

    keys = {
        name: {"default": info.default if name != "faults" else [], "what": info.description or ""}
        for name, info in SimulatedSettings.model_fields.items()
    }
    what = {name: _headline(PACKAGED / f"{name}.yaml") for name in rig_names()}
    rigs = [f"  {name:10s}  {words}" for name, words in what.items()]
    settings = [f"  {name:28s} {key['default']!s:12s} {key['what']}" for name, key in keys.items()]
    document = {"rigs": list(what), "settings": keys, "what": what}
    head, second = "packaged rigs:", "keys of a simulated rig (default; meaning):"
    print_result(as_json, document, head, *rigs, second, *settings)


def _headline(path: Path) -> str:
    """The first sentence of the comment at the beginning of a packaged file; empty without a comment."""
    comment = re.match(r"(?:#.*\n)*", path.read_text(encoding="utf-8"))
    words = " ".join(line.lstrip("# ") for line in comment[0].splitlines()) if comment else ""
    return re.split(r"(?<=[.;])\s", words)[0].rstrip(".;")
