"""`view`: the page without a run, which Start begins."""

from __future__ import annotations

import sys

from mazeplan.cli.arguments import BehaviorModule
from mazeplan.cli.navigate import Behavior, From, HowFile, Map, Model, RigName, Seed, Sense, TimeLimit, To
from mazeplan.cli.viewoptions import HOST, PORT, Host, PagePort


def view(
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
) -> None:
    """The page in the browser, to operate a rig; Ctrl-C ends it."""
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
