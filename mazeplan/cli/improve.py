"""`improve`."""

from __future__ import annotations

import sys
import tempfile
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from mazeplan.cli.arguments import EffectModule
from mazeplan.cli.output import print_json, say

if TYPE_CHECKING:
    pass


def improve(
    rig: Annotated[
        str, typer.Option("--rig", help="Name of a rig (rig list), YAML file, or module:Class; surprise@3: its seed 3.")
    ],
    model: Annotated[
        str | None, typer.Option("--model", help="What is known already; default: the rig's own model.")
    ] = None,
    rounds: Annotated[int, typer.Option("--rounds", min=1, help="Rounds of collect, diagnose, navigate.")] = 1,
    runs: Annotated[int, typer.Option("--runs", min=1, help="Navigations before and after.")] = 16,
    seconds: Annotated[float, typer.Option("--seconds", help="Record of a round, in s of rig time.")] = 400.0,
    reference: Annotated[
        list[Path] | None,
        typer.Option("--reference", help="Log from when the model was right; what it shows, too, is no news."),
    ] = None,
    effects: EffectModule = None,
    map_: Annotated[str, typer.Option("--map", help="Packaged map or YAML file.")] = "cme",
    seed: Annotated[
        int, typer.Option("--seed", min=0, help="Of commands, places and noise, and of a surprise that has no @.")
    ] = 0,
    workers: Annotated[int, typer.Option("--workers", min=1, help="Processes to navigate in.")] = 1,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", help="Folder for logs, models and reports; default: none is kept.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON document on stdout.")] = False,
) -> None:
    """Close the loop: collect, diagnose, update the model, and navigate with the old one and the new one.

    Exit status 1 where something was found that has no name, or not all navigations arrived in the end."""
    from mazeplan.cli.arguments import positive
    from mazeplan.cli.navigate import note_missing_model
    from mazeplan.cli.owneffects import installed_effects, own_effects
    from mazeplan.cli.progress import Working
    from mazeplan.data.table import read_table
    from mazeplan.improve import Options
    from mazeplan.improve import improve as run
    from mazeplan.maze.mapfile import load_map
    from mazeplan.rigs.registry import make_rig, with_seed

    maze, spec = load_map(map_), with_seed(rig, seed)
    own = (*installed_effects().effects, *own_effects(effects))
    note_missing_model(spec, model, maze)
    options = Options(rounds, runs, positive("--seconds", seconds), seed, workers, map_, True, effects)
    with ExitStack() as stack:
        folder = output or Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="mazeplan-improve-")))
        shown = stack.enter_context(Working("improving"))
        known = [read_table(log) for log in reference or []]
        told: dict[str, Any] = {"tell": shown.line, "working": shown.tell, "advance": shown.advance}
        done = run(spec, folder, options, model=model, reference=known, own=own, **told)
        if output is None:
            for entry in done:
                entry["diagnosis"]["model"] = None
    answer = getattr(make_rig(spec, maze), "surprise", None)
    if answer is not None:
        say(f"the answer: {answer.kind} ({answer.effect})")
    if as_json:
        print_json({"rounds": done})
    else:
        _print(done)
    last = done[-1]
    good = all(r["diagnosis"]["verdict"] != "unknown_effect" for r in done)
    sys.exit(0 if good and last["navigation"]["after"]["success"] == runs else 1)


def _print(rounds: list[dict[str, Any]]) -> None:
    for number, entry in enumerate(rounds, start=1):
        done, navigation = entry["diagnosis"], entry["navigation"]
        print(f"round {number}: {done['sentence']}")
        for when in ("before", "after"):
            n = navigation[when]
            mean = n["time_s"]["mean"]
            print(f"  {when:7s} {n['success']} of {n['runs']} arrived" + (f", mean {mean:.2f} s" if mean else ""))
        if done["model"]:
            print(f"  model   {done['model']}")
