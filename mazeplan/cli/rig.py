"""`rig check`, `rig list`."""

from __future__ import annotations

import sys
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from mazeplan.cli.output import print_json

app = typer.Typer(help="Rigs: conformance, list.", no_args_is_help=True)


@app.command("check")
def check(
    rig: Annotated[str, typer.Argument(help="Name of a rig (rig list), YAML file, or module:Class.")],
    map_: Annotated[str, typer.Option("--map", help="Packaged map or YAML file.")] = "cme",
    seed: Annotated[int, typer.Option("--seed", min=0)] = 0,
    hardware: Annotated[bool, typer.Option("--hardware", help="Leave out what only a simulation can repeat.")] = False,
    yes: Annotated[bool, typer.Option("--yes", help="Of a rig on a table: ask nothing.")] = False,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", help="File that gets its latencies; default: the rig's own.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON document on stdout.")] = False,
) -> None:
    """Try whether a rig does what every rig must: clock, signs, limits, level, repeatability.

    Of a rig on a table each part is looked at before, the board first, and its latencies are measured. Exit status: 1 a
    check did not pass, 2 a file is wrong or not calibrated, 3 a part is silent."""
    from mazeplan.cli.progress import Working
    from mazeplan.cli.rig_walk import check_hardware
    from mazeplan.errors import MazeplanError
    from mazeplan.maze.mapfile import load_map
    from mazeplan.rigs.conformance import check_rig
    from mazeplan.rigs.hardware.files import is_hardware
    from mazeplan.rigs.registry import make_rig
    from mazeplan.rigs.watchdog import watched

    maze, results, more = load_map(map_), [], {}
    problem: MazeplanError | None = None
    if is_hardware(rig):
        found = check_hardware(rig, maze, seed=seed, yes=yes, output=output)
    else:
        machine = watched(make_rig(rig, maze), own_process=True)
        found = iter(check_rig(machine, maze, seed=seed, repeatable=not hardware))
    bar = None if is_hardware(rig) else Working("checking")  # a walk asks, and takes as long as the person does
    try:
        for result in found if bar is None else bar.over(found, lambda result: f"after {result.name}"):
            if isinstance(result, tuple):
                more[result[0]] = result[1]
                continue
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
        print_json({"rig": rig, "passed": passed, "checks": [asdict(result) for result in results], **more})
    if problem is not None:
        raise problem
    sys.exit(0 if passed else 1)


@app.command("list")
def list_rigs(
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON document on stdout.")] = False,
) -> None:
    """The packaged rigs, those of installed packages, and every key that a simulated rig's YAML file may set."""
    from mazeplan.plugins import RIGS, plugins
    from mazeplan.rigs.registry import installed_rigs, rig_names, unusable
    from mazeplan.rigs.settings import SimulatedSettings

    keys = {
        name: {"default": info.default if name != "faults" else [], "what": info.description or ""}
        for name, info in SimulatedSettings.model_fields.items()
    }
    if as_json:
        installed = {
            name: {"package": found.package, "version": found.version, "object": found.value}
            for name, found in installed_rigs().items()
        }
        print_json({"rigs": [*rig_names(), *installed], "installed": installed, "settings": keys})
        return
    print("packaged rigs: " + ", ".join(rig_names()))
    for found in plugins(RIGS):
        problem = unusable(found)
        print(f"of package {found.source}: {found.name} ({found.value}){f': not used: {problem}' if problem else ''}")
    print("keys of a simulated rig (default; what):")
    for name, key in keys.items():
        print(f"  {name:28s} {key['default']!s:12s} {key['what']}")
