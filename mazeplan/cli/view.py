"""`view`: the page without a run, which Start begins; recorded runs in it; or a map to edit."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from mazeplan.cli.arguments import BehaviorModule
from mazeplan.cli.navigate import Behavior, From, HowFile, Map, Model, RigName, Seed, Sense, TimeLimit, To
from mazeplan.cli.viewoptions import HOST, PORT, Host, PagePort
from mazeplan.errors import InputError

Logs = Annotated[
    list[Path] | None, typer.Argument(metavar="LOG [OTHER]", help="Run log to look at, or two beside each other.")
]
Edit = Annotated[bool, typer.Option("--edit", help="Edit the map of --map, else cme, on the page; nothing is driven.")]


def view(
    logs: Logs = None,
    start: From = "ring1",
    goal: To = "centre",
    map_: Map = "cme",
    rig: RigName = "toy",
    model: Model = None,
    behavior: Behavior = "navigate",
    behavior_module: BehaviorModule = None,
    settings: HowFile = None,
    seed: Seed = 0,
    time_limit: TimeLimit = 20.0,
    sense: Sense = None,
    host: Host = HOST,
    port: PagePort = PORT,
    edit: Edit = False,
) -> None:
    """The page in the browser, to operate a rig, to look at recorded runs, or to edit a map; Ctrl-C ends it."""
    if logs or edit:
        from mazeplan.cli.progress import Working
        from mazeplan.view.serving import edit_map, open_logs, show_logs

        if logs and edit:
            raise InputError("--edit: got a log as well, expected one of the two")
        if not logs:
            edit_map(map_, host, port)
            return
        with Working("reading") as shown:
            runs = open_logs(logs, shown.tell)
        show_logs(runs, host, port)
        return
    from mazeplan.cli.arguments import positive
    from mazeplan.cli.live import navigate_live
    from mazeplan.cli.navigate import note_missing_model
    from mazeplan.maze.mapfile import load_map

    maze = load_map(map_)
    note_missing_model(rig, model, maze, sense)
    job = {
        "start": start, "goal": len(maze.rings) if goal == "centre" else goal, "map": maze, "rig": rig, "model": model,
        "behavior": behavior, "behavior_modules": tuple(behavior_module or ()), "settings": settings, "seed": seed,
        "time_limit": positive("--time-limit", time_limit), "log": None, "sense": sense,
    }  # fmt: skip
    sys.exit(navigate_live(job, host, port, begin=False))
