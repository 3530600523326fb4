"""`view`: the page of a rig, or of recorded runs."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

from typer import Argument

from mazeplan.apps.cli import options as opt

ViewedLog = Annotated[Path | None, Argument(metavar="LOG", help="Run log to show.")]


def view(
    log: ViewedLog = None,
    start: opt.StartRing = "ring1",
    goal: opt.GoalRing = "centre",
    map_: opt.Map = "cme",
    rig: opt.RigName = "toy",
    model: opt.Model = None,
    behavior: opt.Behavior = "navigate",
    behavior_module: opt.BehaviorModule = None,
    settings: opt.Settings = None,
    seed: opt.Seed = 0,
    time_limit: opt.TimeLimit = 20.0,
    port: opt.PagePort = opt.PORT,
) -> None:
    """Open the page in the browser: operate a rig, or show a recorded run. Ctrl-C closes it."""
    if log is not None:
        from mazeplan.apps.cli.progress import ProgressBar
        from mazeplan.apps.view.replay import open_recording, show_log

        with ProgressBar("reading") as bar:
            bar.show(log.name)
            recording = open_recording(log)
        show_log(recording, port)
        return
    from mazeplan.apps.cli.live import navigate_live
    from mazeplan.run.request import NavigationRequest

    request = NavigationRequest(
        start, goal, map_, rig, model, behavior=behavior, behavior_modules=tuple(behavior_module or ()),
        settings=settings, seed=seed, time_limit=time_limit,
    )  # fmt: skip
    sys.exit(navigate_live(request, port, begin=False))
